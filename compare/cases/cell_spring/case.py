"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-9, "gradient": 1e-8}


def files(random):
    """{file name: inputs}"""
    log_k, log_l = random.uniform(0, 1.5), random.uniform(1, 2)
    return {"cell_spring": draw.cell(random, "spring_color", 3, log_k=log_k, log_l=log_l)}
