"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-11, "gradient": 1e-10}


def files(random):
    """{file name: inputs}"""
    return {"shallow_unet": draw.unet(random, "spring_color")}
