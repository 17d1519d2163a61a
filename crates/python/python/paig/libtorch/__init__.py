"""Which libtorch is loaded: that of the environment's `torch` if its version fits, else a set fetched once into a cache.

Order of the lookup:

1. the folder in `PAIG_LIBTORCH` (one that holds `libtorch_cpu`);
2. the `torch` of this Python, where its version is 2.11 (with its GPU support);
3. the cache: `PAIG_CACHE`, else `$XDG_CACHE_HOME/paig`, else `~/.cache/paig`. What is missing there is fetched from the
   package index that pip is set up for: 130 MB to download, 460 MB on disk, checked by SHA-256.

`python -m paig.libtorch` does the lookup, fetches if it must, and prints the folder.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import importlib.abc
import importlib.machinery
import importlib.metadata
import importlib.util
import json
import os
import platform
import shutil
import sys
import threading
import time
from pathlib import Path
from typing import Iterator, Sequence
from types import ModuleType

from .. import pinned, wheel_parts
from ..errors import LibtorchError

__all__ = ["environment", "find", "load"]

# Versions of torch whose libtorch this build was compiled for: its C++ interface changes with each.
FITTING = ".".join(pinned.TORCH_VERSION.split(".")[:2])
CACHED = f"libtorch-{pinned.TORCH_VERSION}-cpu"
STAMP = "COMPLETE.json"
# In the package: forwards to libtorch_cpu alone, where the wheel's own forwards to the CUDA library, too.
STUB = Path(__file__).parent.parent / "lib" / "libtorch.so"
SPARE_DISK = 1 << 30
ATTEMPTS = 3
SUFFIX = ".dylib" if sys.platform == "darwin" else ".so"
# Threads of OpenMP sleep while they wait: to spin, its default, costs several times the time as soon as anything else runs.
WAITING = ("OMP_WAIT_POLICY", "passive")

_loaded: Path | None = None
_loading = threading.Lock()


def find(fetch: bool = True) -> Path:
    """The folder of the libraries of libtorch that would be loaded. Fetches them if there are none and `fetch` is set."""
    given = os.environ.get("PAIG_LIBTORCH")
    if given:
        for folder in (Path(given), Path(given, "lib"), Path(given, "torch", "lib")):
            if (folder / f"libtorch_cpu{SUFFIX}").exists():
                return folder
        raise LibtorchError(f"PAIG_LIBTORCH={given}: there is no libtorch_cpu{SUFFIX} in it")
    installed = _installed()
    if installed is not None:
        return installed
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise LibtorchError(
            f"no torch {FITTING} in this environment: pip install 'torch=={FITTING}.*' (nothing is fetched for "
            f"{sys.platform} on {platform.machine()})")
    return _cached(fetch)


def environment() -> dict[str, str]:
    """The environment variables with which the program `paig` finds its libtorch."""
    variable = "DYLD_LIBRARY_PATH" if sys.platform == "darwin" else "LD_LIBRARY_PATH"
    folders = [str(find()), os.environ.get(variable, "")]
    return {**os.environ, variable: os.pathsep.join(folder for folder in folders if folder)}


def load() -> None:
    """Load libtorch into this process, once. To be called before `paig._paig` is imported."""
    global _loaded
    with _loading:
        if _loaded is not None:
            return
        _refuse_another()
        os.environ.setdefault(*WAITING)
        folder = find()
        try:
            _open(folder)
        except OSError as error:
            if folder != _cache() / CACHED / "torch" / "lib":
                raise LibtorchError(f"{folder}: libtorch does not load: {error}") from error
            _say(f"the copy in {folder} does not load ({error}); checking it")
            _repair(_cache() / CACHED)
            _open(folder)
        if folder != _installed():
            sys.meta_path.insert(0, _NoSecondTorch(folder))
        _loaded = folder


def _installed() -> Path | None:
    """The libraries of this Python's `torch`, if its version fits."""
    try:
        version, spec = importlib.metadata.version("torch"), importlib.util.find_spec("torch")
    except (importlib.metadata.PackageNotFoundError, ImportError, ValueError):
        return None
    if spec is None or not spec.submodule_search_locations or not _fits(version):
        return None
    folder = Path(next(iter(spec.submodule_search_locations)), "lib")
    return folder if (folder / f"libtorch_cpu{SUFFIX}").exists() else None


def _fits(version: str) -> bool:
    return version.split("+")[0].split(".")[:2] == FITTING.split(".")


def _refuse_another() -> None:
    """Two libtorch in one process share symbols and crash."""
    torch = sys.modules.get("torch")
    version = str(getattr(torch, "__version__", ""))
    if torch is not None and not _fits(version):
        raise LibtorchError(
            f"torch {version} is loaded in this process and paig needs {FITTING}; pip install 'torch=={FITTING}.*', or "
            "use paig in a process of its own (the program `paig`, or Python without `import torch`)")
    if torch is not None:
        return
    with contextlib.suppress(OSError):
        paths = {line.split(maxsplit=5)[-1].strip() for line in Path("/proc/self/maps").read_text().splitlines()}
        others = sorted(path for path in paths if path.endswith("libtorch_cpu.so"))
        if others and Path(others[0]).parent != find(fetch=False):
            raise LibtorchError(f"another libtorch is loaded in this process: {others[0]}; import paig first")


def _open(folder: Path) -> None:
    # With GPU support libtorch brings the CUDA library along; the dependencies of `torch` must come before it.
    for name in ("libtorch_global_deps", "libtorch"):
        library = folder / (name + SUFFIX)
        if library.exists():
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    ctypes.CDLL(str(folder / f"libtorch_cpu{SUFFIX}"))


class _NoSecondTorch(importlib.abc.MetaPathFinder):
    """Refuses `import torch` where another libtorch than torch's own is loaded."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname == "torch":
            raise ImportError(
                f"paig has loaded its own libtorch {FITTING} ({self.folder}), and two do not fit into one process; to use "
                f"both, pip install 'torch=={FITTING}.*', or use torch in a process of its own")
        return None


def _cache() -> Path:
    if os.environ.get("PAIG_CACHE"):
        return Path(os.environ["PAIG_CACHE"])
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "paig"


def _cached(fetch: bool) -> Path:
    folder = _cache() / CACHED
    libraries = folder / "torch" / "lib"
    if _is_complete(folder):
        return libraries
    if not fetch:
        return libraries
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _locked(folder):
            # Another process may have fetched it meanwhile.
            if not _is_complete(folder):
                _fetch(folder)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise LibtorchError(f"{folder}: cannot be written ({error.strerror}); set PAIG_CACHE to a folder that can") from error
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise LibtorchError(f"{folder}: {error.strerror}; 600 MB are needed; set PAIG_CACHE to another disk") from error
        raise LibtorchError(
            f"libtorch {pinned.TORCH_VERSION} is not on this machine and cannot be fetched ({error}); without network: pip "
            f"install 'torch=={FITTING}.*' from a wheel, or copy {folder} from a machine that has it") from error
    return libraries


def _is_complete(folder: Path) -> bool:
    """Whether all files have the sizes that they had when they were checked."""
    try:
        sizes = json.loads((folder / STAMP).read_text())
        return all((folder / name).stat().st_size == sizes[name] for name in [*pinned.SHA256, "torch/lib/libtorch.so"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    import fcntl

    with open(folder / "lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            _say(f"another process is fetching libtorch into {folder}; waiting for it")
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _fetch(folder: Path) -> None:
    free = shutil.disk_usage(folder).free
    if free < SPARE_DISK:
        raise OSError(errno.ENOSPC, f"{free / 1e9:.1f} GB free")
    _say(f"fetching libtorch {pinned.TORCH_VERSION} into {folder} (130 MB, once)")
    _drop_damaged(folder)
    missing = {
        requirement: names for requirement, names in pinned.LIBRARIES.items()
        if not all((folder / name).exists() for name in names)}
    _fetch_missing(missing, folder)
    for name, expected in pinned.SHA256.items():
        if wheel_parts.sha256(folder / name) != expected:
            (folder / name).unlink()
            raise LibtorchError(
                f"{name} is not that of the official {pinned.TORCH} wheel (SHA-256 differs); check which index pip is set up "
                "for, and try again")
    shutil.copyfile(STUB, folder / "torch" / "lib" / "libtorch.so")
    names = [*pinned.SHA256, "torch/lib/libtorch.so"]
    partial = folder / (STAMP + ".partial")
    partial.write_text(json.dumps({name: (folder / name).stat().st_size for name in names}))
    partial.replace(folder / STAMP)


def _drop_damaged(folder: Path) -> None:
    for name, expected in pinned.SHA256.items():
        path = folder / name
        if path.exists() and wheel_parts.sha256(path) != expected:
            _say(f"{path} is damaged; fetching it again")
            path.unlink()


def _fetch_missing(missing: dict[str, tuple[str, ...]], folder: Path) -> None:
    failure: Exception | None = None
    for _ in range(ATTEMPTS if missing else 0):
        try:
            urls = wheel_parts.wheel_urls(list(missing), pinned.PYTHON_TAG, pinned.PLATFORMS)
            for (requirement, names), url in zip(missing.items(), urls):
                with _Bar(requirement) as bar:
                    wheel_parts.fetch(url, requirement, names, folder, bar.show)
            return
        except wheel_parts.Damaged as error:
            failure = error
        except wheel_parts.UNREADABLE as error:
            if getattr(error, "errno", None) in (errno.ENOSPC, errno.EACCES, errno.EROFS):
                raise
            failure = error
    if failure is not None:
        raise OSError(str(failure))


def _repair(folder: Path) -> None:
    with _locked(folder):
        (folder / STAMP).unlink(missing_ok=True)
        _fetch(folder)


class _Bar:
    """A bar on a terminal, a line for every quarter elsewhere; on standard error."""

    def __init__(self, name: str) -> None:
        self.name, self.shown, self.terminal = name, -1, sys.stderr.isatty()
        self.begun = time.monotonic()

    def show(self, done: int, total: int) -> None:
        if total < 8 * wheel_parts.BLOCK:
            return
        part = int((40 if self.terminal else 4) * done / total)
        if part == self.shown:
            return
        self.shown = part
        numbers = f"{done / 1e6:.0f} of {total / 1e6:.0f} MB, {time.monotonic() - self.begun:.0f} s"
        if self.terminal:
            print(f"\r{self.name} [{'#' * part:40}] {numbers}", end="", file=sys.stderr, flush=True)
        else:
            _say(f"  {numbers}")

    def __enter__(self) -> _Bar:
        return self

    def __exit__(self, *_: object) -> None:
        if self.terminal and self.shown >= 0:
            print(file=sys.stderr)


def _say(text: str) -> None:
    print(f"paig: {text}", file=sys.stderr, flush=True)
