"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-9, "gradient": 1e-8, "training": 1e-5}


def files(random):
    """{file name: inputs}"""
    tasks = ("bouncing_balls", "spring_color", "mnist_spring_color", "3bp_color")
    result = {f"{task}_train": draw.model(random, task) for task in tasks}
    return result | {"spring_color_altvel_train": draw.model(random, "spring_color", alt_vel=True)}
