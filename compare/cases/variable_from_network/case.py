"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-11, "gradient": 1e-10}


def files(random):
    """{file name: inputs}"""
    return {"variable_from_network_spring_color": draw.part(
        random, "spring_color", out_weight_seed=random.integers(1_000_000))}
