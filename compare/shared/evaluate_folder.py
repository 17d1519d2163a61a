"""Runs a reference over a folder of drawn inputs; what it computes is written beside the inputs, file by file."""
import argparse
from pathlib import Path

import numpy as np

from .checks import load
from .given import Given


def main(evaluate):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("given", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for path in sorted(arguments.given.glob("*.npz")):
        arrays = load(path)
        computed = evaluate(Given(path.stem, arrays, "float64"))
        if computed is None:
            parser.error(f"{path}: no case for a file of this name")
        np.savez(arguments.out / path.name, **arrays | computed)
