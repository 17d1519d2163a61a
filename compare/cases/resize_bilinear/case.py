"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-6}


def files(random):
    """{file name: inputs}"""
    return {"resize_bilinear": {"in/x": draw.normal(random, 2, 9, 7, 3)}}
