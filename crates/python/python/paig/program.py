"""The program `paig` of the wheel: finds libtorch, then becomes the program."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from .errors import FailedError, LibtorchError
from .libtorch import environment

__all__ = ["main", "path", "run"]

FAILURE, INTERRUPTED = 1, 130


def path() -> Path:
    """The program itself; it needs the variables of `paig.libtorch.environment()`."""
    return Path(__file__).parent / "bin" / "paig"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the program with these arguments; output and errors are in `stdout` and `stderr` of what is returned.

    Raises:
        paig.errors.FailedError: An exit code other than 0; the message is the program's.
    """
    command = [str(path()), *map(str, arguments)]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True)
    if done.returncode:
        raise FailedError(done.stderr.strip() or f"exit code {done.returncode}")
    return done


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
