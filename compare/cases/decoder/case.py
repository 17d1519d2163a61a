"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-11, "gradient": 1e-10}


def files(random):
    """{file name: inputs}"""
    result = {}
    for key, side, objects in (("spring_color", 32, 2), ("3bp_color", 36, 3), ("mnist_spring_color", 64, 2)):
        pos = random.uniform(-0.3 * side, 1.3 * side, (8, 2 * objects)).astype("float32")
        result[f"decoder_{key}"] = draw.part(
            random, key, **{"in/pos": pos, "out_weight_seed": random.integers(1_000_000)})
    return result
