"""The wheel's package, tested as it is installed. See setup/check_wheel.sh."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import paig

# Steps that find nothing, but go through every phase.
SHORT = {"discover.max_steps": 6, "identify.max_iterations": 1, "join.max_steps": 4}


@pytest.fixture(scope="session")
def spring(tmp_path_factory: pytest.TempPathFactory) -> paig.Dataset:
    """A small dataset of two balls on a spring."""
    return paig.generate("spring_color", train=120, valid=20, test=20, seed=3, out=tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="session")
def run(spring: paig.Dataset, tmp_path_factory: pytest.TempPathFactory) -> paig.Run:
    """A run that went through all phases in a few steps."""
    out = tmp_path_factory.mktemp("runs") / "spring"
    return paig.train(spring, out=out, settings=SHORT, threads=1, progress=False)


def python(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """A Python of its own, with these environment variables."""
    environment = {**os.environ, **variables}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)


def program(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The program of the wheel."""
    command = [str(Path(sys.executable).parent / "paig"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)
