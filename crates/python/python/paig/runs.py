"""Runs: what was learned, how sure it is, what it predicts."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, cast

from ._native import native
from .arrays import Floats
from .equation import Equation, entry
from .errors import MissingError
from .measurement import Measurement
from .model import Model
from .tables import Parameter, Table, unit_text

__all__ = ["Prediction", "Run", "Verdict", "load", "runs"]


@dataclass(frozen=True)
class Verdict:
    """What a run states about itself, from held-out clips and without the truth."""

    found: bool
    """Every check passed."""
    checks: list[dict[str, Any]]
    """Each with `name`, `passed`, `measured` and the picture to `look_at`."""

    def __bool__(self) -> bool:
        return self.found

    def __repr__(self) -> str:
        if self.found:
            return "found"
        failed = (f"{check['name']}: {check['measured']}; look at {check['look_at']}" for check in self.failed)
        return "not found: " + "; ".join(failed)

    @property
    def failed(self) -> list[dict[str, Any]]:
        return [check for check in self.checks if not check["passed"]]


@dataclass(frozen=True)
class Prediction:
    """Frames and states after the input frames of one clip."""

    clip: Floats
    """The whole clip, `[time, side, side, channels]`, 0 to 1."""
    frames: Floats
    """Predicted frames, the first one right after the input, `[n, side, side, channels]`, 0 to 1."""
    positions: Floats
    """From the last input frame on, `[1 + n, objects, coordinates]`, pixels or radians."""
    velocities: Floats
    """The same per unit of time."""


class Run:
    """A run folder."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        about = json.loads(native.describe(self.folder))
        self.task: str = about["task"]
        self.recipe: str = about["recipe"]
        self.seed: int = about["seed"]
        self.dt: float = about["dt"]
        """Time between two frames, in the unit of the parameters."""
        self.input_steps: int = about["input_steps"]
        """Frames that the encoder sees before the roll-out."""
        self.filmed: bool = about["filmed"]
        """Whether the task was made from videos, so that `measure` works."""
        self._units: dict[str, list[int] | None] = about["units"]
        self._models: dict[tuple[bool, str, int], Model] = {}

    @property
    def finished(self) -> bool:
        return (self.folder / "summary.json").exists()

    @cached_property
    def summary(self) -> dict[str, Any]:
        """All of `summary.json`.

        Raises:
            paig.errors.MissingError: A run that has not finished.
        """
        path = self.folder / "summary.json"
        if not path.exists():
            raise MissingError(f"{self.folder} has not finished; go on with paig.resume({str(self.folder)!r})")
        return cast("dict[str, Any]", json.loads(path.read_text()))

    @property
    def parameters(self) -> Table[Parameter]:
        """The learned parameters: value, interval, unit, and the truth where it is known. Of a measured video those of the
        measurement."""
        measured = self.measurement
        if measured is not None:
            return measured.parameters
        intervals = (self.summary.get("verdict") or {}).get("intervals", {})

        def parameter(name: str, learned: dict[str, Any]) -> Parameter:
            ends = intervals.get(name)
            interval = None
            if ends is not None:
                low, high = ends["low"], ends["high"]
                interval = (-math.inf if low is None else low, math.inf if high is None else high)
            return Parameter(learned["learned"], interval, unit_text(self._units.get(name)), learned["truth"])

        return Table((name, parameter(name, learned)) for name, learned in self.summary["parameters"].items())

    @property
    def verdict(self) -> Verdict | None:
        """What the run states about itself; `None` of runs by versions that did not."""
        verdict = self.summary.get("verdict")
        return verdict and Verdict(verdict["found"], verdict["checks"])

    @property
    def measurement(self) -> Measurement | None:
        """The measurement of the run's videos, where there is one in its folder."""
        path = self.folder / "measurement.json"
        return Measurement(self.folder, json.loads(path.read_text())) if path.exists() else None

    def model(self, *, best: bool = False, device: str = "cpu", threads: int = 0) -> Model:
        """The trained model; loaded once."""
        key = (best, device, threads)
        if key not in self._models:
            self._models[key] = Model(self.folder, best=best, device=device, threads=threads)
        return self._models[key]

    def positions(self, split: str = "test") -> Floats:
        """Where the encoder sees the objects in all frames of a split, `[clips, time, objects, coordinates]`, pixels or
        radians."""
        model = self.model()
        return model.encode(model.clips(split))

    def predict(self, n: int, *, clip: int = 0, split: str = "test") -> Prediction:
        """Predict `n` frames after the input frames of a clip; its later frames are not looked at."""
        return Prediction(*self.model()._model.predict(split, clip, n))

    def evaluate(self, split: str = "test") -> dict[str, Any]:
        """Losses and errors on a split; see `Model.evaluate`."""
        return self.model().evaluate(split)

    def measure(
        self,
        equation: Equation | str | None = None,
        *,
        against: Sequence[Equation | str] = (),
        out: str | Path | None = None,
        device: str = "cpu",
        threads: int = 0,
    ) -> Measurement:
        """Measure the run's videos, as `paig measure`: fit an equation to every frame as one long trajectory.

        Args:
            equation: Instead of the run's own.
            against: Equations to compare with it.
            out: Folder for the files; by default the run's.
        """
        named = [{"name": _name(other), "equation": entry(other)} for other in ([equation] if equation else []) + list(against)]
        request = {
            "run": str(self.folder), "out": str(out) if out is not None else None,
            "equation": named.pop(0) if equation else None, "against": named, "device": device, "threads": threads}
        details = json.loads(native.measure(json.dumps(request)))
        return Measurement(Path(out) if out is not None else self.folder, details)

    def metrics(self) -> list[dict[str, Any]]:
        """The course of the training, a record for each line of `metrics.jsonl`; for `pandas.DataFrame`."""
        lines = (self.folder / "metrics.jsonl").read_text().splitlines()
        return [record for record in map(json.loads, lines) if record["kind"] != "begin"]

    def record(self) -> dict[str, Any]:
        """The run as one flat row: task, recipe, seed, parameters, errors in per cent, losses, seconds, verdict; for
        `pandas.DataFrame`."""
        summary, test = self.summary, self.summary["test"]
        row: dict[str, Any] = {"folder": str(self.folder), "task": self.task, "recipe": self.recipe, "seed": self.seed}
        for name, parameter in self.parameters.items():
            row[name] = parameter.value
            if parameter.error_percent is not None:
                row[f"{name} error %"] = parameter.error_percent
        row.update({key: test[key] for key in ("recons_loss", "pred_loss", "extrap_loss") if key in test})
        row.update({"steps": summary["steps"], "seconds": summary["wall_seconds"], "found": bool(self.verdict)})
        return row

    def pictures(self) -> dict[str, Path]:
        """The pictures of the run by name: `losses`, `example0`, `templates`, .."""
        files = sorted([*self.folder.glob("*.png"), *self.folder.glob("*.gif")])
        return {path.stem: path for path in files}

    def __repr__(self) -> str:
        state = repr(self.parameters) + f"\n{self.verdict!r}" if self.finished else "not finished"
        return f"run {self.folder} of {self.task}, recipe {self.recipe}, seed {self.seed}\n{state}"

    def _repr_html_(self) -> str:
        head = f"<b>{escape(self.task)}</b>, recipe {escape(self.recipe)}, seed {self.seed}, <code>{escape(str(self.folder))}</code>"
        if not self.finished:
            return f"{head}: not finished"
        return f"{head}{self.parameters._repr_html_()}<p>{escape(repr(self.verdict))}</p>"


def load(folder: str | Path) -> Run:
    """A run by its folder."""
    return Run(folder)


def runs(*folders: str | Path) -> list[Run]:
    """The runs in and under some folders, in the order of their names; `runs` where none is given."""
    found = native.run_folders([str(folder) for folder in folders or ("runs",)])
    return [Run(Path(folder)) for folder in found]


def _name(equation: Equation | str) -> str:
    return equation.text if isinstance(equation, Equation) else equation
