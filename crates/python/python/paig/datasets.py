"""Clips to learn from: generated, or from arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ._native import native
from .arrays import Array, Floats, pixels
from .equation import Equation, entry
from .errors import InputError
from .events import Progress, listener

__all__ = ["Clips", "Dataset", "dataset", "generate", "generate_clips", "tasks"]

USUAL_CLIPS = {"train": 5000, "valid": 500, "test": 500}


@dataclass(frozen=True)
class Dataset:
    """A task and the folder with its clips; to be given to `paig.train`."""

    task: str
    """Name of a built-in task, or the task file."""
    folder: Path
    """The datasets folder."""
    train_file: Path
    test_file: Path
    warnings: tuple[str, ...] = ()
    """What should be looked at before training."""
    details: dict[str, Any] = field(default_factory=dict, repr=False)

    def arrays(self, split: str = "train") -> NDArray[np.uint8]:
        """Frames of a split (`train`, `valid`, `test`), uint8 `[clips, time, side, side, channels]`."""
        with np.load(self.test_file if split == "test" else self.train_file) as file:
            return cast("NDArray[np.uint8]", file[f"{split}_x"])

    def _repr_html_(self) -> str:
        warnings = "".join(f"<br>warning: {escape(warning)}" for warning in self.warnings)
        return f"<b>{escape(self.task)}</b> in <code>{escape(str(self.folder))}</code>{warnings}"


@dataclass(frozen=True)
class Clips:
    """Generated clips in memory, with the true states."""

    frames: NDArray[np.uint8]
    """`[clips, time, side, side, channels]`, 0 to 255."""
    positions: Floats
    """`[clips, time, objects, 2]`, pixels from the top left corner, y down; `[.., 1]`, radians, for a pendulum."""
    velocities: Floats
    """The same per unit of time."""
    actions: Floats | None = None
    """`[clips, time]`: what acts from outside; `None` for most tasks."""


def tasks() -> dict[str, str]:
    """The built-in tasks: name and summary."""
    return cast("dict[str, str]", json.loads(native.tasks()))


def _request(task: str, counts: dict[str, int], seed: int, threads: int, scene: dict[str, Any], **where: Any) -> str:
    return json.dumps({"task": str(task), **counts, "seed": seed, "threads": threads, "scene": scene, **where})


def generate(
    task: str,
    *,
    train: int = 5000,
    valid: int = 500,
    test: int = 500,
    seed: int = 0,
    out: str | Path | None = None,
    force: bool = False,
    threads: int = 0,
    progress: Progress = False,
    **scene: float | str,
) -> Dataset:
    """Generate the clips of a task into files, as `paig generate`.

    Args:
        task: A built-in task (`paig.tasks()`), or a task file with a scene.
        train: Training clips; `valid` and `test` likewise.
        seed: The same seed gives the same files, with any number of threads.
        out: The datasets folder; by default `data/datasets`.
        force: Whether to replace files that exist with other settings.
        threads: 0 for one a core.
        progress: Whether to print it, or what is called with each `paig.Event`.
        scene: Numbers of the scene to change: `k`, `equil`, `damping`, `g`, `m`, `length`, `a`, `torque`, `angle`, `spin`,
            `vx`, `vy`, `radius`, `dt`, `substeps`, `size`, `background`.
    """
    counts = {"train": train, "valid": valid, "test": test}
    request = _request(task, counts, seed, threads, scene, out=str(out) if out is not None else None, force=force)
    listen, end = listener(progress)
    try:
        train_file, test_file = (Path(path) for path in native.generate(request, listen))
    finally:
        end()
    folder = Path(out) if out is not None else train_file.parents[1]
    return Dataset(str(task), folder, train_file, test_file)


def generate_clips(
    task: str, *, frames: int | None = None, train: int = 100, valid: int = 1, test: int = 1, seed: int = 0,
    threads: int = 0, **scene: float | str,
) -> dict[str, Clips]:
    """Generate clips in memory, with their true states. Returns them by split: `train`, `valid`, `test`.

    Args:
        frames: Frames of a clip; by default those of the task's training clips.
        scene: As for `generate`.
    """
    counts = {"train": train, "valid": valid, "test": test}
    made = native.generate_clips(_request(task, counts, seed, threads, scene, out=None, force=False), frames)
    return {split: Clips(**cast("dict[str, Any]", arrays)) for split, arrays in made.items()}


def dataset(
    clips: Array,
    *,
    folder: str | Path,
    equation: Equation | str,
    dt: float,
    objects: int | None = None,
    name: str | None = None,
    input_steps: int = 4,
    pred_steps: int = 6,
    train_frames: int | None = None,
    truth: dict[str, float] | None = None,
) -> Dataset:
    """Write clips of your own and their task file, for `paig.train`.

    The first 80 % are trained on, 10 % validate, the last 10 % test.

    Args:
        clips: `[clips, time, side, side, channels]` of any library, bytes or numbers from 0 to 1; side a multiple of 4, from
            40 on of 8. At least 10 clips.
        folder: For `train.npz`, `test.npz` and `task.toml`.
        equation: A `paig.Equation`, or the name of a built-in one.
        dt: Time between two frames, in the unit that the parameters are to be in.
        objects: By default that of the equation.
        name: Of the task; by default that of the folder.
        input_steps: Frames that the encoder sees before the roll-out.
        pred_steps: Predicted frames that are trained on.
        train_frames: Frames of a training clip; by default input, prediction and two more.
        truth: True parameters, compared with the learned ones and never trained on.
    """
    frames, folder = pixels(clips), Path(folder)
    if frames.ndim != 5 or len(frames) < 10:
        raise InputError(f"clips of shape {frames.shape}: expected [clips, time, side, side, channels] with 10 clips or more")
    count, time, side, _, channels = frames.shape
    short = train_frames or min(time, input_steps + pred_steps + 2)
    held_out = max(1, count // 10)
    table: dict[str, Any] = {
        "name": name or folder.name,
        "system": {
            "side": side, "channels": channels, "input_steps": input_steps, "pred_steps": pred_steps, "dt": dt,
            "objects": objects or (equation.objects if isinstance(equation, Equation) else 1), "equation": entry(equation)},
        "data": {"folder": ".", "train_frames": short, "test_frames": time},
    }
    if truth:
        table["truth"] = truth
    text = native.task_file(json.dumps(table))
    folder.mkdir(parents=True, exist_ok=True)
    train, valid, test = np.split(frames, [count - 2 * held_out, count - held_out])
    train_file, test_file, task = (folder / file for file in ("train.npz", "test.npz", "task.toml"))
    np.savez_compressed(train_file, train_x=train[:, :short], valid_x=valid[:, :short])
    np.savez_compressed(test_file, test_x=test)
    task.write_text(text)
    return Dataset(str(task), folder, train_file, test_file)
