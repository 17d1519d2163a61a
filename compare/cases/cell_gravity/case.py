"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-9, "gradient": 1e-8}


def files(random):
    """{file name: inputs}"""
    return {"cell_gravity": draw.cell(random, "3bp_color", 2, log_g=random.uniform(2, 4), log_m=random.uniform(-0.3, 0.3))}
