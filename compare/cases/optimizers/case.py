"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-9, "gradient": 1e-8, "training": 1e-7}


def files(random):
    """{file name: inputs}"""
    rules = ("rmsprop", "adam", "momentum", "sgd")
    return {f"spring_color_{rule}_train": draw.model(random, "spring_color", rule) for rule in rules}
