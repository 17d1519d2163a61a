"""Types of the package and of the examples."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import paig

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "python"


@pytest.mark.parametrize("checked", [["-p", "paig"], sorted(path.name for path in EXAMPLES.glob("*.py"))], ids=["package", "examples"])
def test_types_pass_mypy_strict(checked: list[str]) -> None:
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", *checked], capture_output=True, text=True, cwd=EXAMPLES)
    assert checked and done.returncode == 0, done.stdout


def test_every_public_name_is_documented() -> None:
    bare = [name for name in paig.__all__ if name != "__version__" and not getattr(paig, name).__doc__]
    methods = [
        f"{name}.{method}"
        for name in ("Run", "Model", "Measurement", "Dataset", "Training", "Equation")
        for method, value in vars(getattr(paig, name)).items()
        if not method.startswith("_") and callable(value) and not value.__doc__
    ]
    assert bare == [] and methods == []
