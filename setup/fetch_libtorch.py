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
import errno
import ctypes
import hashlib
import http.client
import json
import os
import platform
import shutil
import struct
import subprocess
import sys
import tempfile
import urllib.request
import zipfile
import zlib
from pathlib import Path

TORCH = "torch==2.11.0"
# What `torch==2.11.0` pins through cuda-toolkit 13.0.2, and all that libtorch_cpu.so needs of it.
CUDA_RUNTIME = "nvidia-cuda-runtime==13.0.96"
CUPTI = "nvidia-cuda-cupti==13.0.85"
# CUDA's compiler, for the kernels in src/kernels/gpu, with the headers that it includes: `torch` does not ask for them.
CUDA_COMPILER = ["nvidia-cuda-nvcc==13.0.88", "nvidia-nvvm==13.0.88", "nvidia-cuda-crt==13.0.88"]
WANTED = {
    TORCH: (
        "torch/include/",
        "torch/lib/libtorch_cpu.so",
        "torch/lib/libc10.so",
        "torch/lib/libgomp.so.1",
        "torch/version.py",
    ),
    CUDA_RUNTIME: ("nvidia/cu13/lib/libcudart.so.13",),
    CUPTI: ("nvidia/cu13/lib/libcupti.so.13",),
}
# libtorch_cpu.so is the same in the wheels of every Python: this one is taken whatever python3 is installed.
WHEEL_TAGS = ["--python-version", "3.12", "--only-binary=:all:", "--platform", "manylinux_2_28_x86_64",
              "--platform", "manylinux_2_17_x86_64", "--platform", "manylinux2014_x86_64",
              "--platform", "manylinux_2_25_x86_64", "--platform", "manylinux_2_27_x86_64"]
# SHA-256 of what is linked and loaded, and of all headers together (names and contents): a wheel that was changed in one
# byte is refused, also where it says of itself that it is whole.
PINNED = {
    "torch/lib/libtorch_cpu.so": "2e1034d418c1c881c86f67fc357b8723efc3f22bdb266f06aace8e6ca9c170b3",
    "torch/lib/libc10.so": "be5e17cd7752a6af003978706379384c3108f6b68916bb1949e610f6397bb640",
    "torch/lib/libgomp.so.1": "e28fb2896a3d612b46a27d7f8ef840d34c9efbc29b70a044c42095fb94856890",
    "nvidia/cu13/lib/libcudart.so.13": "96c42e418cec19054186b9429c321603cc190bf26a18104e19408117a2a817b0",
    "nvidia/cu13/lib/libcupti.so.13": "e2f9ed861fe27c492b8bb52b5e3220ef5120f3edcda36312e96b7fd8a186be3e",
}
HEADERS, PINNED_HEADERS = "torch/include", "1d9b6d04320631229fabd9fe6c05b61d71c0de092c9ef450cce5a81cf23289af"
BLOCK = 1 << 20
SPARE_DISK = {"cpu": 1 << 30, "cuda": 8 << 30}


def say(text):
    print(f"libtorch: {text}", flush=True)


def fail(text):
    sys.exit(f"libtorch: error: {text}")


def pip(*arguments):
    command = [sys.executable, "-m", "pip", *arguments, "--disable-pip-version-check"]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.returncode, done.stdout


class RangeReader:
    """A remote file with the three calls `zipfile` needs (seek, tell, read), served by HTTP range requests."""

    def __init__(self, url):
        self.url, self.position = url, 0
        with self.open(0, 0) as answer:
            content_range = answer.headers.get("Content-Range", "")
            if answer.status != 206 or "/" not in content_range:
                raise OSError("the index does not serve byte ranges")
            self.size = int(content_range.rsplit("/", 1)[1])

    def open(self, first, last):
        request = urllib.request.Request(self.url, headers={"Range": f"bytes={first}-{last}"})
        return urllib.request.urlopen(request, timeout=60)

    def seekable(self):
        return True

    def seek(self, offset, whence=0):
        self.position = offset + (0, self.position, self.size)[whence]
        return self.position

    def tell(self):
        return self.position

    def read(self, count=-1):
        end = self.size if count < 0 else min(self.size, self.position + count)
        if end <= self.position:
            return b""
        with self.open(self.position, end - 1) as answer:
            data = answer.read()
        self.position += len(data)
        return data


def wheel_url(requirement):
    """The address of the wheel, from the index the user's pip is set up for."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.json")
        code, output = pip("install", "--dry-run", "--ignore-installed", "--no-deps", "--quiet",
                           "--target", folder, "--report", str(report), *WHEEL_TAGS, requirement)
        if code:
            raise OSError(output.strip().splitlines()[-1] if output.strip() else "pip failed")
        return json.loads(report.read_text())["install"][0]["download_info"]["url"]


def wanted_members(archive, requirement):
    prefixes = WANTED[requirement]
    members = [m for m in archive.infolist() if m.filename.startswith(prefixes) and not m.is_dir()]
    for prefix in prefixes:
        if not any(m.filename.startswith(prefix) for m in members):
            fail(f"{requirement}: the wheel holds no {prefix}; expected the layout of the official Linux wheels")
    return members


def complete(member, target):
    path = target / member.filename
    return path.exists() and path.stat().st_size == member.file_size


def fetch_runs(members, limit=64 * BLOCK):
    """Neighbouring members joined into runs, so that ten thousand headers cost a few requests, not ten thousand."""
    run = []
    for member in sorted(members, key=lambda m: m.header_offset):
        if run and (member.header_offset - run[-1].header_offset > 4 * BLOCK
                    or member.header_offset + member.compress_size - run[0].header_offset > limit):
            yield run
            run = []
        run.append(member)
    if run:
        yield run


def place(member, data, target):
    """Check `data` against the member's CRC and size and let it appear under its name in one step."""
    if len(data) != member.file_size or zlib.crc32(data) != member.CRC:
        fail(f"{member.filename}: damaged in transfer (size or CRC-32 differs); run the command again")
    path = target / member.filename
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(data)
    partial.replace(path)


def inflate(member, compressed):
    return compressed if member.compress_type == zipfile.ZIP_STORED else zlib.decompress(compressed, -15)


def fetch_one_large(reader, member, target, progress):
    """A large member is kept as it arrives, so that an interruption costs no more than one block."""
    header = struct.unpack("<HH", read_at(reader, member.header_offset + 26, 4))
    start = member.header_offset + 30 + sum(header)
    cache = target / (member.filename.replace("/", "_") + ".download")
    have = cache.stat().st_size if cache.exists() else 0
    with open(cache, "ab") as file:
        while have < member.compress_size:
            with reader.open(start + have, start + member.compress_size - 1) as answer:
                while block := answer.read(BLOCK):
                    file.write(block)
                    have += len(block)
                    progress(len(block))
    data = cache.read_bytes()
    if len(data) != member.compress_size:
        cache.unlink()
        fail(f"{member.filename}: received {len(data)} bytes, expected {member.compress_size}; run the command again")
    try:
        place(member, inflate(member, data), target)
    finally:
        cache.unlink()


def read_at(reader, offset, count):
    reader.seek(offset)
    return reader.read(count)


def fetch_run(reader, run, target, progress):
    first = run[0].header_offset
    last = run[-1]
    # The local header's own extra field can be longer than the directory's: 4 KiB of slack covers it.
    end = last.header_offset + 30 + len(last.filename) + last.compress_size + 4096
    data = read_at(reader, first, min(end, reader.size) - first)
    for member in run:
        offset = member.header_offset - first
        name_length, extra_length = struct.unpack("<HH", data[offset + 26:offset + 30])
        offset += 30 + name_length + extra_length
        place(member, inflate(member, data[offset:offset + member.compress_size]), target)
    progress(len(data))


def fetch_by_ranges(requirement, target):
    reader = RangeReader(wheel_url(requirement))
    with zipfile.ZipFile(reader) as archive:
        members = wanted_members(archive, requirement)
    missing = [m for m in members if not complete(m, target)]
    if not missing:
        return say(f"{requirement}: already here")
    total = sum(m.compress_size for m in missing)
    say(f"{requirement}: fetching {total / 1e6:.0f} MB ({len(missing)} files) of a {reader.size / 1e6:.0f} MB wheel")
    done, shown = 0, 0

    def progress(count):
        nonlocal done, shown
        done += count
        if done - shown >= 32 * BLOCK:
            shown = done
            say(f"  {min(done, total) / 1e6:.0f} of {total / 1e6:.0f} MB")

    large = [m for m in missing if m.compress_size > 4 * BLOCK]
    for run in fetch_runs([m for m in missing if m.compress_size <= 4 * BLOCK]):
        fetch_run(reader, run, target, progress)
    for member in large:
        fetch_one_large(reader, member, target, progress)


def fetch_whole(requirement, target):
    with tempfile.TemporaryDirectory(dir=target) as folder:
        say(f"{requirement}: fetching the whole wheel with pip")
        code, output = pip("download", "--no-deps", "--dest", folder, *WHEEL_TAGS, requirement)
        if code:
            fail(f"pip could not download {requirement}: {(output.strip().splitlines() or ['it said nothing'])[-1]}")
        with zipfile.ZipFile(next(Path(folder).glob("*.whl"))) as archive:
            for member in wanted_members(archive, requirement):
                if not complete(member, target):
                    place(member, archive.read(member), target)


def sha256(path):
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest() if hasattr(hashlib, "file_digest") \
            else hashlib.sha256(file.read()).hexdigest()


def verify(target):
    """Refuse files that are not those that this program was built and tested with."""
    for name, expected in PINNED.items():
        if sha256(target / name) != expected:
            fail(f"{name} is not that of the official {TORCH} wheel (SHA-256 differs); delete {target}, see which index "
                 "pip is set up for, and run again")
    digest = hashlib.sha256()
    for path in sorted(path for path in (target / HEADERS).rglob("*") if path.is_file()):
        digest.update(path.relative_to(target).as_posix().encode() + b"\0" + bytes.fromhex(sha256(path)))
    if digest.hexdigest() != PINNED_HEADERS:
        fail(f"{HEADERS} is not that of the official {TORCH} wheel (SHA-256 differs); delete {target} and run again")


def fetch_cpu(target):
    for requirement in WANTED:
        try:
            fetch_by_ranges(requirement, target)
        except (OSError, http.client.HTTPException, zipfile.BadZipFile, zlib.error, struct.error, KeyError, IndexError) as error:
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
    parser.add_argument("--target", type=Path, default=Path(__file__).resolve().parent.parent / "libtorch",
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
