"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-11, "gradient": 1e-9}


def files(random):
    """{file name: inputs}"""
    result = {}
    for name, alt_vel in (("init_vel", False), ("init_vel_alt", True)):
        pos = 32 * draw.unit(random, 16, 4, 4)
        result[f"{name}_spring_color"] = draw.part(
            random, "spring_color", alt_vel, **{"in/pos": pos, "in/vel_weight": draw.normal(random, 16, 4)})
    return result
