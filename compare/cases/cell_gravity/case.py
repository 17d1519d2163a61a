"""See README.md."""
from shared import draw

# Largest error relative to a tensor's scale; the reasons stand in README.md.
TOLERANCES = {"forward": 1e-9, "gradient": 1e-8}


def files(random):
    """{file name: inputs}"""
    # Nearer than 1 pixel and farther than 170 the force no longer follows the distance.
    radii = {"cell_gravity": (0.2, 0.35), "cell_gravity_near": (0.004, 0.014), "cell_gravity_far": (2.9, 6.4)}
    return {name: draw.cell(random, "3bp_color", 2 if radius[0] > 0.1 else 0.1, radius, log_g=random.uniform(2, 4),
                            log_m=random.uniform(-0.3, 0.3)) for name, radius in radii.items()}
