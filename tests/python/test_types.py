"""Types of the package and of the examples."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import paig

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "python"


def test_package_and_examples_pass_mypy_strict() -> None:
    package = Path(paig.__file__).parent
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", str(package), *map(str, sorted(EXAMPLES.glob("*.py")))],
        capture_output=True, text=True, cwd=EXAMPLES)
    assert checked.returncode == 0, checked.stdout
    assert len(list(EXAMPLES.glob("*.py"))) >= 4


def test_every_public_name_is_documented() -> None:
    bare = [name for name in paig.__all__ if name != "__version__" and not getattr(paig, name).__doc__]
    methods = [
        f"{name}.{method}"
        for name in ("Run", "Model", "Measurement", "Dataset", "Training", "Equation")
        for method, value in vars(getattr(paig, name)).items()
        if not method.startswith("_") and callable(value) and not value.__doc__
    ]
    assert bare == [] and methods == []
