"""Compares Rust, PyTorch and TensorFlow with each other on freshly drawn weights and inputs: python live.py --seed 0

All three compute in double precision, where rounding is far below any error of substance; what single precision makes
of it is what the golden files show. The table goes to report.md as well. Exit code 1: a tensor is off.
"""
import argparse
import importlib
import json
import platform
import subprocess
import sys
import tempfile
import zlib
from datetime import date
from importlib.metadata import version
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from shared.checks import errors, load
from shared.variable_names import layout_to_torch, to_torch

HERE = Path(__file__).resolve().parent
CASES = ("resize_bilinear", "shallow_unet", "unet", "stn", "variable_from_network", "cell_bouncing", "cell_spring",
         "cell_gravity", "velocity_encoder", "encoder", "decoder", "whole_model", "optimizers")
QUANTITIES = {"out": "forward", "in": "forward", "w": "forward", "grad": "gradient", "gradnorm": "gradient",
              "train": "training"}
PAIRS = ("rust-tf", "rust-torch", "torch-tf")
CONVERTED = "spring_color_rmsprop_train"


def call(command, log, may_differ=False):
    """Runs a program in this folder; its last lines are shown only if it goes wrong. One that compares says by its exit code 1
    that something differs."""
    began = log.tell()
    done = subprocess.run([str(part) for part in command], cwd=HERE, stdout=log, stderr=subprocess.STDOUT)
    if done.returncode not in ((0, 1) if may_differ else (0,)):
        log.seek(began)
        said = "".join(log.readlines()[-20:])
        sys.exit(f"{said}error: {' '.join(map(str, command))} failed")
    log.seek(0, 2)
    return done.returncode == 0


def quantity(tensor):
    return QUANTITIES[tensor.split("/")[0]]


def python_rows(first, second):
    """(file, tensor, relative error) of two folders of the same files."""
    for path in sorted(first.glob("*.npz")):
        a, b = load(path), load(second / path.name)
        for tensor in a:
            if tensor.split("/")[0] in ("out", "grad", "gradnorm", "train"):
                yield path.stem, tensor, float(np.max(errors(b[tensor], a[tensor])))


def rust_rows(path):
    for line in path.read_text().splitlines():
        row = json.loads(line)
        yield row["file"], row["tensor"], np.nan if row["relative"] is None else row["relative"]


def table(case_of, tolerances, rows):
    """Lines of the table, and whether all is within its tolerance."""
    worst, counts, good = {}, {}, True
    for pair in PAIRS:
        for file, tensor, error in rows[pair]:
            key = (case_of[file], quantity(tensor), pair)
            worst[key] = np.fmax(worst.get(key, 0.0), np.inf if np.isnan(error) else error)
            counts[key] = counts.get(key, 0) + 1
    lines = ["| submodule | quantity | tensors | " + " | ".join(PAIRS) + " | tolerance | result |", "|---" * 8 + "|"]
    for case in CASES:
        for kind, tolerance in tolerances[case].items():
            figures = [worst.get((case, kind, pair), np.inf) for pair in PAIRS]
            passed = max(figures) <= tolerance
            good &= passed
            cells = [case, kind, str(counts.get((case, kind, PAIRS[2]), 0)), *(f"{x:.1e}" for x in figures),
                     f"{tolerance:.0e}", "pass" if passed else "FAIL"]
            lines.append("| " + " | ".join(cells) + " |")
    return lines, good


def conversion(folder, binaries, log):
    """Lines on a TensorFlow checkpoint that goes through `convert` and on the timed reference, and whether all was as it should be."""
    read, weights, back = folder / "read.npz", folder / "weights.safetensors", folder / "back.npz"
    convert = [binaries / "paig", "convert", "--task", "spring_color"]
    call([sys.executable, "-m", "tf_reference.check_checkpoint", folder / f"given/{CONVERTED}.npz", read], log)
    call([*convert, read, weights], log)
    call([*convert, weights, back], log)
    original, state, returned = load(read), load_file(weights), load(back)
    same = {to_torch(name): layout_to_torch(x) for name, x in original.items()}
    results = {
        "TensorFlow 1 checkpoint -> npz -> safetensors has every value at its place": same.keys() == state.keys()
        and all(np.array_equal(same[name], state[name]) for name in same),
        "and back to npz: equal to the bit": original.keys() == returned.keys()
        and all(original[name].tobytes() == returned[name].tobytes() for name in original),
        "the converted model in Rust gives TensorFlow's outputs": call(
            [binaries / "paig", "compare", "--goldens", folder / "tf", "--file-filter", CONVERTED, "--f64",
             "--weights", weights], log, may_differ=True),
        "the PyTorch that is timed computes what the one that is read does": call(
            [sys.executable, "-m", "torch_reference.check_fast"], log, may_differ=True),
    }
    return [f"- {text}: {'pass' if passed else 'FAIL'}" for text, passed in results.items()], all(results.values())


def commit():
    """What is compared; + where the sources differ from it."""
    described = subprocess.run(["git", "describe", "--always", "--dirty=+", "--abbrev=10"], cwd=HERE, capture_output=True, text=True)
    return described.stdout.strip() or "unknown"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of all weights and inputs [default: 0]")
    parser.add_argument("--binaries", type=Path, default=HERE.parent / "target/release", help="folder of the programs")
    parser.add_argument("--keep", type=Path, help="folder to keep all files in")
    parser.add_argument("--report", type=Path, default=HERE / "report.md", help="[default: report.md]")
    arguments = parser.parse_args()
    binaries = arguments.binaries.resolve()
    if not (binaries / "paig").exists():
        parser.error(f"{binaries / 'paig'} is missing; build it with make build")
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep.resolve() if arguments.keep else Path(temporary)
        (folder / "given").mkdir(parents=True, exist_ok=True)
        case_of, tolerances = {}, {}
        for name in CASES:
            case = importlib.import_module(f"cases.{name}.case")
            tolerances[name] = case.TOLERANCES
            random = np.random.default_rng([arguments.seed, zlib.crc32(name.encode())])
            for file, arrays in case.files(random).items():
                case_of[file] = name
                np.savez(folder / "given" / f"{file}.npz", **arrays)
        with open(folder / "log.txt", "w+") as log:
            for reference in ("torch", "tf"):
                print(f"computing with {reference} ..", flush=True)
                call([sys.executable, "-m", f"{reference}_reference", folder / "given", folder / reference], log)
                print(f"comparing Rust with {reference} ..", flush=True)
                call([binaries / "paig", "compare", "--goldens", folder / reference, "--f64", "--rows",
                      folder / f"{reference}.jsonl"], log, may_differ=True)
            rows = {f"rust-{name}": list(rust_rows(folder / f"{name}.jsonl")) for name in ("tf", "torch")}
            rows["torch-tf"] = list(python_rows(folder / "torch", folder / "tf"))
            for pair, found in rows.items():
                if missing := sorted(case_of.keys() - {file for file, _, _ in found}):
                    sys.exit(f"error: {pair} compared nothing of {', '.join(missing)}")
            lines, good = table(case_of, tolerances, rows)
            more, converted = conversion(folder, binaries, log)
    versions = {name: version(name) for name in ("torch", "tensorflow-cpu", "numpy")}
    head = [f"# Rust, PyTorch and TensorFlow on the same numbers (seed {arguments.seed})", "",
            f"{date.today()}, commit {commit()}, {platform.machine()}, Python {platform.python_version()}, "
            + ", ".join(f"{name} {number}" for name, number in versions.items()),
            "", "Worst error of any element, relative to its tensor's largest. Double precision.", ""]
    text = "\n".join([*head, *lines, "", *more, ""])
    arguments.report.write_text(text)
    print(text)
    sys.exit(0 if good and converted else 1)


if __name__ == "__main__":
    main()
