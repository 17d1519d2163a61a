#!/usr/bin/env python3
"""Put libtorch 2.11.0 into ./libtorch/torch, taken from the PyPI wheels of PyTorch.

Only the files that a CPU build links are fetched: the headers, `libtorch_cpu`, `libc10`, `libgomp` out of the
PyTorch wheel, and the two CUDA libraries (runtime and CUPTI) that this `libtorch_cpu` needs in order to load.
The wheels are read through HTTP range requests, so 130 MB travel instead of 530; a package index that
does not serve ranges is asked for the whole wheel. `--cuda` installs the complete wheel and its GPU libraries.

Nothing is fetched when LIBTORCH or LIBTORCH_USE_PYTORCH is set, or when an earlier run finished. An interrupted
run continues where it stopped: a file appears under its name only when its CRC-32 has been checked.
"""

import argparse
import ctypes
import errno
import hashlib
import itertools
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# The Python package fetches the same libraries for those who install the wheel.
sys.path.append(str(ROOT / "crates" / "python" / "python" / "paig"))

import pinned  # noqa: E402
import wheel_parts  # noqa: E402
from wheel_parts import sha256  # noqa: E402

TORCH = pinned.TORCH
# CUDA's compiler, for the kernels in crates/kernels/src/gpu, with the headers that it includes: `torch` does not ask for them.
CUDA_COMPILER = ["nvidia-cuda-nvcc==13.0.88", "nvidia-nvvm==13.0.88", "nvidia-cuda-crt==13.0.88"]
# Beside the libraries.
TO_COMPILE = ("torch/include/", "torch/version.py")
HEADERS, PINNED_HEADERS = "torch/include", "1d9b6d04320631229fabd9fe6c05b61d71c0de092c9ef450cce5a81cf23289af"
SPARE_DISK = {"cpu": 1 << 30, "cuda": 8 << 30}


def say(text):
    print(f"libtorch: {text}", flush=True)


def fail(text):
    sys.exit(f"libtorch: error: {text}")


def wanted(requirement):
    """Prefixes of the files of a wheel."""
    return pinned.LIBRARIES[requirement] + (TO_COMPILE if requirement == TORCH else ())


def show(name):
    """Prints how far a fetch is, now and then."""
    shown = 0

    def progress(done, total):
        nonlocal shown
        if shown == 0:
            say(f"{name}: fetching {total / 1e6:.0f} MB")
        if shown == 0 or done - shown >= 32 << 20:
            shown = max(done, 1)
            say(f"  {done / 1e6:.0f} of {total / 1e6:.0f} MB")

    return progress


def fetch_whole(requirement, target):
    with tempfile.TemporaryDirectory(dir=target) as folder:
        say(f"{requirement}: fetching the whole wheel with pip")
        tags = wheel_parts.pip_tags(pinned.PYTHON_TAG, pinned.PLATFORMS)
        code, output = wheel_parts.pip("download", "--no-deps", "--dest", folder, *tags, requirement)
        if code:
            fail(f"pip could not download {requirement}: {wheel_parts.last_line(output)}")
        wheel_parts.unpack(next(Path(folder).glob("*.whl")), requirement, wanted(requirement), target)


def verify(target):
    """Refuse files that are not those that this program was built and tested with."""
    for name, expected in pinned.SHA256.items():
        if sha256(target / name) != expected:
            fail(f"{name} is not that of the official {TORCH} wheel (SHA-256 differs); delete {target}, see which index "
                 "pip is set up for, and run again")
    digest = hashlib.sha256()
    for path in sorted(path for path in (target / HEADERS).rglob("*") if path.is_file()):
        digest.update(path.relative_to(target).as_posix().encode() + b"\0" + bytes.fromhex(sha256(path)))
    if digest.hexdigest() != PINNED_HEADERS:
        fail(f"{HEADERS} is not that of the official {TORCH} wheel (SHA-256 differs); delete {target} and run again")


def fetch_cpu(target):
    requirements, urls = list(pinned.LIBRARIES), []
    try:
        urls = wheel_parts.wheel_urls(requirements, pinned.PYTHON_TAG, pinned.PLATFORMS)
    except wheel_parts.UNREADABLE as error:
        say(f"where the wheels are could not be found out ({error})")
    for requirement, url in itertools.zip_longest(requirements, urls):
        try:
            if url is None:
                fetch_whole(requirement, target)
            else:
                wheel_parts.fetch(url, requirement, wanted(requirement), target, show(requirement))
        except wheel_parts.Damaged as error:
            fail(error)
        except wheel_parts.UNREADABLE as error:
            if getattr(error, "errno", None) in (errno.ENOSPC, errno.EACCES, errno.EROFS):
                raise
            say(f"{requirement}: reading parts of the wheel failed ({error})")
            fetch_whole(requirement, target)
    verify(target)
    library = target / "torch" / "lib"
    for name in ("libcudart.so.13", "libcupti.so.13"):
        shutil.copyfile(target / "nvidia/cu13/lib" / name, library / name)
    # The wheel's libtorch.so only forwards to the CPU and the CUDA library; this one forwards to the CPU alone.
    build = ["cc", "-shared", "-o", str(library / "libtorch.so"), "-Wl,-soname,libtorch.so", "-Wl,--no-as-needed",
             f"-L{library}", "-ltorch_cpu", "-Wl,-rpath,$ORIGIN", "-Wl,--allow-shlib-undefined"]
    try:
        subprocess.run(build, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        fail(f"the C compiler failed ({error}); a C and C++ compiler (gcc, g++) is needed to build the project")


def fetch_cuda(target):
    say(f"{TORCH}: installing the complete wheel and its GPU libraries (about 2.5 GB to download, 6 GB on disk)")
    code = subprocess.call([sys.executable, "-m", "pip", "install", "--upgrade", "--target", str(target), TORCH, *CUDA_COMPILER])
    if code:
        fail("pip could not install the complete PyTorch wheel; finished downloads are in pip's cache: run it again")


def check(library):
    """Load what was fetched: a truncated or mismatched library fails here rather than at the first training."""
    for name in ("libc10.so", "libtorch_cpu.so", "libtorch.so"):
        try:
            ctypes.CDLL(str(library / name), mode=ctypes.RTLD_GLOBAL)
        except OSError as error:
            fail(f"{library / name} does not load: {error}; delete {library.parent.parent} and run again")


def check_tools():
    """What is needed later should be missed before anything is fetched."""
    if subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True).returncode:
        fail(f"{sys.executable} has no pip; install it (Debian: python3-pip, or python3-venv and an environment)")
    for compiler in ("cc", "c++"):
        if not shutil.which(compiler):
            fail(f"no {compiler} on the PATH; a C and C++ compiler (gcc, g++) is needed to build the project")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--target", type=Path, default=ROOT / "libtorch",
                        help="folder to fill (default: ./libtorch)")
    parser.add_argument("--cuda", action="store_true", help="the complete set with GPU support (several GB)")
    arguments = parser.parse_args()
    for name in ("LIBTORCH", "LIBTORCH_USE_PYTORCH"):
        if os.environ.get(name):
            return say(f"{name}={os.environ[name]} is set: using that, nothing to fetch")
    kind, target = ("cuda" if arguments.cuda else "cpu"), arguments.target
    stamp = target / "COMPLETE"
    found = stamp.read_text().strip() if stamp.exists() else ""
    # Earlier versions fetched no compiler.
    complete = kind == "cpu" or (target / "nvidia/cu13/bin/nvcc").exists()
    if complete and found in (f"{TORCH} {kind}", f"{TORCH} cuda"):
        return say(f"{found} is ready in {target}")
    if sys.platform != "linux" or platform.machine() != "x86_64":
        fail(f"no recipe for {sys.platform} {platform.machine()}: install PyTorch 2.11 and set LIBTORCH_USE_PYTORCH=1")
    check_tools()
    target.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(target).free
    if free < SPARE_DISK[kind]:
        fail(f"{target}: {free / 1e9:.1f} GB free on this disk, {SPARE_DISK[kind] / 1e9:.0f} GB needed")
    if found:
        stamp.unlink()
        shutil.rmtree(target / "torch")
    (fetch_cuda if arguments.cuda else fetch_cpu)(target)
    library = target / "torch" / "lib"
    if not arguments.cuda:
        check(library)
    (target / "torch" / "build-version").write_text("2.11.0\n")
    stamp.write_text(f"{TORCH} {kind}\n")
    say(f"{TORCH} ({kind}) is ready in {target}")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        fail("interrupted; run the command again to continue")
    except OSError as error:
        fail(f"{error}; run the command again once that is mended")
