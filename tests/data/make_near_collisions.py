"""Makes cell_gravity_near_collisions.npz, a golden-format file that is chaotic, for tests/goldens.rs:

    make compare/.venv/installed
    cd compare && PYTHONPATH=. .venv/bin/python ../tests/data/make_near_collisions.py

Four triples of bodies start at rest and fall towards each other again and again, 30 frames long. Computed by the
TensorFlow reference in float32, as the original's golden files were by the original.
"""

from pathlib import Path

import numpy as np

from shared import draw
from shared.given import Given
from tf_reference.evaluate import evaluate

STEM, BATCH, FRAMES, SIDE = "cell_gravity_near_collisions", 4, 30, 36

random = np.random.default_rng(0)
given = {
    "in/pos": random.uniform(0.3 * SIDE, 0.7 * SIDE, (BATCH, 6)).astype("float32"),
    "in/vel": np.zeros((BATCH, 6), "float32"),
    "in/pos_weight": draw.normal(random, FRAMES, BATCH, 6),
    "param/log_g": np.float32(np.log(60)),
    "param/log_m": np.float32(0),
}
np.savez_compressed(Path(__file__).with_name(f"{STEM}.npz"), **given | evaluate(Given(STEM, given)))
