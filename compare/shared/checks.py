"""Compares what a reference computes with a folder of golden files and prints the worst error of each kind.

Tolerances and their reasons are those of ../tolerances.rs and of the cases' mod.rs: where a tensor misses its tolerance,
the computation runs again in double precision and with all inputs moved by some roundings, and an element is held to ten
times what that moves it. A tensor that it moves by more than a tenth of its scale is uninformative: neither passed nor
failed, and here, without the single steps of the program `compare`, not held by anything.
"""
import argparse
from pathlib import Path

import numpy as np

from .given import Given

# By the first part of a tensor's name, relative to its largest element.
TOLERANCES = {"in": 2e-7, "w": 2e-7, "out": 1e-5, "grad": 1e-4, "gradnorm": 1e-4, "train": 5e-5}
# TensorFlow adds cancelling weights of all points outside an image: float32 leaves a rest.
SAMPLED = 1e-3
MARGIN, CHAOTIC = 10, 1.0
UNINFORMATIVE = 1 / MARGIN
# Inputs are moved by up to so many roundings: each layer adds some of its own.
PROBES = (4,) * 12 + (16,) * 12


def scale(x):
    return np.abs(x).max() or 1.0


def errors(expected, computed):
    """Elementwise, relative to the largest element of `expected`."""
    if np.shape(expected) != np.shape(computed):
        raise ValueError(f"shape {np.shape(computed)}, expected {np.shape(expected)}")
    return np.abs(np.float64(computed) - np.float64(expected)) / scale(np.float64(expected))


def tolerance(stem, name):
    kind = name.split("/")[0]
    sampled = kind == "grad" and name != "grad/pos" and stem.startswith(("decoder", "stn"))
    return SAMPLED if sampled else TOLERANCES[kind]


def load(path):
    """All arrays of a golden-format file, with those that `shared` names of the files beside it."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    for name, stem in (text.split("=") for text in arrays.pop("shared", [])):
        with np.load(path.with_name(f"{stem}.npz")) as other:
            arrays[name] = other[name]
    return arrays


def check_folder(evaluate, title):
    """`evaluate(given)` gives {tensor name: array} for any golden-format file. Exits with 1 if a tensor is off."""
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("goldens", type=Path)
    arguments = parser.parse_args()
    files = sorted(arguments.goldens.glob("*.npz"))
    if not files:
        parser.error(f"{arguments.goldens}: no .npz file")
    failed = known = 0
    print(f"{'file':32}{'tensors':>8}{'forward':>10}{'gradient':>10}{'trained':>10}  result")
    for path in files:
        arrays = load(path)
        computed = evaluate(Given(path.stem, arrays))
        if computed is None:
            print(f"{path.stem:32} has no case in this reference")
            continue
        known += 1
        worst, missed = {}, {}
        for name, value in computed.items():
            error = errors(arrays[name], value)
            kind = {"gradnorm": "grad"}.get(name.split("/")[0], name.split("/")[0])
            worst[kind] = max(worst.get(kind, 0.0), error.max())
            if not error.max() <= tolerance(path.stem, name):
                missed[name] = error
        off, uninformative = beyond_tolerance(evaluate, path.stem, arrays, computed, missed) if missed else ([], [])
        compared = [n for n in arrays if n.split("/")[0] in TOLERANCES and not n.startswith("in/")]
        off += [f"{name}: not computed" for name in compared if name not in computed]
        failed += bool(off)
        figures = "".join(f"{worst[kind]:10.1e}" if kind in worst else " " * 10 for kind in ("out", "grad", "train"))
        within = len(missed) - len(uninformative)
        rounding = f", {within} within their own rounding" if within else ""
        result = "FAIL" if off else "pass" + rounding
        result += f", {len(uninformative)} uninformative" if uninformative else ""
        print(f"{path.stem:32}{len(computed):8}{figures}  {result}", flush=True)
        print("".join(f"    {line}\n" for line in off + uninformative), end="")
    if not known:
        parser.error(f"{arguments.goldens}: this reference has a case for none of its {len(files)} files")
    raise SystemExit(bool(failed))


def beyond_tolerance(evaluate, stem, arrays, computed, missed):
    """Of the tensors that missed their tolerance: those that rounding cannot explain, and those it leaves uninformative."""
    moved = {name: 0.0 for name in missed}
    moves = [Given(stem, arrays, roundings=roundings, seed=seed) for seed, roundings in enumerate(PROBES)]
    for given in [Given(stem, arrays, "float64"), *moves]:
        probe = evaluate(given)
        for name in missed:
            step = np.abs(np.float64(probe[name]) - np.float64(computed[name])) / scale(arrays[name])
            moved[name] = np.maximum(moved[name], np.nan_to_num(step, posinf=0.0))
    off, uninformative = [], []
    for name, error in missed.items():
        movement = np.max(moved[name])
        if movement > UNINFORMATIVE and np.isfinite(error).all():
            uninformative.append(f"{name}: uninformative, rounding moves it by {movement:.1e} of its scale")
            continue
        # What moves half of the elements may move any, though the few probes did not show it.
        step = np.maximum(moved[name], np.median(moved[name]))
        bound = np.clip(MARGIN * step, tolerance(stem, name), CHAOTIC)
        if not (error <= bound).all():
            off.append(f"{name}: {error.max():.1e} of its scale off, {int((error > bound).sum())} elements beyond")
    return off, uninformative
