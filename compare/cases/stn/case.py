"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-11, "gradient": 1e-10}


def files(random):
    """{file name: inputs}"""
    theta = random.normal([1, 0, 0, 0, 1, 0], 0.7, (12, 6)).astype("float32")
    return {"stn": {"in/U": draw.normal(random, 12, 16, 16, 4), "in/theta": theta,
                    "in/out_weight": draw.normal(random, 12, 32, 32, 4)}}
