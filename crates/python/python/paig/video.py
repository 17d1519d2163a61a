"""Filmed videos: into tasks, and objects tracked without an equation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._native import native
from .datasets import Dataset
from .equation import Equation, entry
from .errors import InputError
from .events import Progress, listener

__all__ = ["Track", "import_video", "track"]


def import_video(
    videos: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    equation: Equation | str = "falling",
    objects: int | None = None,
    name: str | None = None,
    force: bool = False,
    frames: tuple[int, int | None] | Sequence[tuple[int, int | None]] | None = None,
    seconds: tuple[float, float | None] | None = None,
    step: int = 1,
    fps: float | None = None,
    crop: str | tuple[int, int, int, int] = "auto",
    side: int = 32,
    grey: bool = False,
    scale: tuple[float, float, float, float, float] | None = None,
    pixels_per_metre: float | None = None,
    scale_percent: float = 0.0,
    time_percent: float = 0.0,
    origin: tuple[float, float] | None = None,
    angle: float = 0.0,
    y_up: bool = False,
    time_unit: str = "s",
    input_steps: int = 4,
    pred_steps: int = 6,
    clip_frames: int | None = None,
    overlap: int | None = None,
    progress: Progress = False,
) -> Dataset:
    """Make a task from videos of one scene, as `paig import`; to be given to `paig.train`.

    Args:
        videos: mp4, mov, Matroska, WebM, AVI, gif, folders of pictures, npz; all of one size, from a camera that stands still.
        out: Folder for the task; `contact-sheet.png` in it shows what will be learned from.
        equation: What the objects obey: a `paig.Equation`, or the name of a built-in one.
        objects: How many things move; by default 1, or as the equation has it.
        force: Replace the files of an `out` that is not empty.
        frames: Only these frames of each video, counted from 0, without the last: `(118, 202)`; or several such parts.
        seconds: The same in seconds from the first frame.
        step: Keep every n-th frame.
        fps: Frames a second as it was filmed, where the file has another rate or none.
        crop: `auto` (around what moves), `full`, or `(x, y, width, height)` in pixels of the video.
        side: Of the frames that the model sees, pixels.
        grey: Frames with one channel.
        scale: Two points of the video and their distance, `(x1, y1, x2, y2, metres)`.
        pixels_per_metre: The same as a number.
        scale_percent: Standard deviation of the scale, per cent; `time_percent` that of the time between frames.
        origin: Of the scene's axes, pixels of the video; `angle` of the x axis, degrees counter-clockwise; `y_up`.
        time_unit: Of `dt` and the parameters while they are learned: `s`, `ms` or `frames`.
        input_steps: Frames that the encoder sees before the roll-out.
        pred_steps: Predicted frames that are trained on.
        clip_frames: Frames of a training clip.
        overlap: Frames that a clip shares with the next one.
    """
    paths = [videos] if isinstance(videos, (str, Path)) else list(videos)
    if objects is None and isinstance(equation, Equation):
        objects = equation.objects
    request = {
        "videos": [str(path) for path in paths], "out": str(out), "force": force, "name": name, "frames": _parts(frames),
        "seconds": seconds, "step": step, "fps": fps, "crop": None if crop == "auto" else crop, "side": side, "grey": grey,
        "pixels_per_metre": pixels_per_metre if scale is None else _pixels_per_metre(scale),
        "scale_percent": scale_percent, "time_percent": time_percent, "origin": origin, "angle": angle, "y_up": y_up,
        "time_unit": time_unit, "equation": entry(equation), "objects": objects, "input_steps": input_steps,
        "pred_steps": pred_steps, "clip_frames": clip_frames, "overlap": overlap}
    listen, end = listener(progress)
    try:
        made = json.loads(native.import_video(json.dumps(request), listen))
    finally:
        end()
    folder = Path(out)
    return Dataset(
        made["task_file"], folder, folder / "train.npz", folder / "test.npz", tuple(made["warnings"]), made)


@dataclass(frozen=True)
class Track:
    """The path of one object through a video."""

    frames: NDArray[np.int64]
    """Numbers of the frames, `[frames]`."""
    seconds: NDArray[np.float64] | None
    """Their times, `[frames]`; `None` where the video has none."""
    positions: NDArray[np.float64]
    """`[frames, 2]`, pixels of the video from its top left corner, y down; NaN where the object is not seen."""
    deviations: NDArray[np.float64]
    """Standard deviations of the positions, `[frames, 2]`, pixels."""
    visibility: list[str]
    """Of each frame: `visible`, `cut_off`, `occluded`, `absent`."""
    diameter: float
    """Pixels."""
    quality: dict[str, Any]
    """Shares of frames followed and registered, misfit, jitter, .."""


def track(
    video: str | Path,
    *,
    objects: int = 1,
    frames: tuple[int, int | None] | None = None,
    at: Sequence[tuple[int, float, float]] = (),
    ignore: Sequence[tuple[int, int, int, int]] = (),
) -> list[Track]:
    """Track what moves in a video at its own resolution, without an equation, as `paig track`.

    Args:
        objects: At most so many.
        frames: Only these, counted from 0, without the last.
        at: Points on the object: frame, x, y in pixels.
        ignore: Rectangles in which nothing is looked for: left, top, width, height in pixels.
    """
    request = {"video": str(video), "objects": objects, "frames": frames, "at": list(at), "ignore": list(ignore)}
    found = json.loads(native.track(json.dumps(request)))
    return [_track(track, found["times"]) for track in found["tracks"]]


def _track(track: dict[str, Any], times: list[float] | None) -> Track:
    points = track["points"]
    numbers = np.array([point["frame"] for point in points], dtype=np.int64)
    measured = [point["measurement"] for point in points]
    nowhere = [np.nan, np.nan]
    return Track(
        numbers,
        None if times is None else np.array(times)[numbers],
        np.array([m["position"] if m else nowhere for m in measured]).reshape(-1, 2),
        np.array([[m["covariance"][0][0] ** 0.5, m["covariance"][1][1] ** 0.5] if m else nowhere for m in measured]).reshape(-1, 2),
        [point["visibility"] for point in points],
        track["diameter"],
        track["quality"])


def _parts(frames: Any) -> list[Any] | None:
    if frames is None:
        return None
    return [list(frames)] if not isinstance(frames[0], (tuple, list)) else [list(part) for part in frames]


def _pixels_per_metre(scale: tuple[float, float, float, float, float]) -> float:
    x1, y1, x2, y2, metres = scale
    distance = hypot(x2 - x1, y2 - y1)
    if distance <= 0 or metres <= 0:
        raise InputError("scale: the points must differ, and the length must be positive")
    return distance / metres
