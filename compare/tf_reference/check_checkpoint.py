"""That a TensorFlow 1 checkpoint is read to the bit: python -m tf_reference.check_checkpoint GIVEN.npz OUT.npz

Writes the weights of a whole-model file as a checkpoint, reads it back and writes what was read.
"""
import sys
import tempfile
from pathlib import Path

import numpy as np

from shared.checks import load
from shared.given import Given

from .read_checkpoint import read_checkpoint, write_checkpoint

if __name__ == "__main__":
    given, out = map(Path, sys.argv[1:])
    weights = Given(given.stem, load(given)).exact_weights()
    with tempfile.TemporaryDirectory() as folder:
        read = read_checkpoint(write_checkpoint(Path(folder, "model.ckpt"), weights))
    assert sorted(read) == sorted(weights), "other variables were read than were written"
    for name, x in weights.items():
        assert np.array_equal(read[name], x) and read[name].dtype == np.float32, name
    np.savez(out, **read)
