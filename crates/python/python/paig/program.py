"""The program `paig` of the wheel: finds libtorch, then becomes the program."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from .errors import LibtorchError
from .libtorch import environment

__all__ = ["main", "path"]

FAILURE, INTERRUPTED = 1, 130


def path() -> Path:
    """The program itself; it needs the variables of `paig.libtorch.environment()`."""
    return Path(__file__).parent / "bin" / "paig"


def main() -> None:
    """Entry of the console script."""
    try:
        os.execve(path(), ["paig", *sys.argv[1:]], environment())
    except LibtorchError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(FAILURE)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
