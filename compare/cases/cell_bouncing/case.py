"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-11, "gradient": 1e-10}


def files(random):
    """{file name: inputs}"""
    return {"cell_bouncing": draw.cell(random, "bouncing_balls", 8)}
