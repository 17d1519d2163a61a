"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-11, "gradient": 1e-10}


def files(random):
    """{file name: inputs}"""
    result = {}
    for key, side in (("spring_color", 32), ("mnist_spring_color", 64)):
        x, weight = draw.unit(random, 2, side, side, 3), draw.normal(random, 2, 4)
        result[f"encoder_{key}"] = draw.part(random, key, **{"in/x": x, "in/pos_weight": weight})
    return result
