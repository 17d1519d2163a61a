"""A trained model in parts: encoder, equation, decoder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple, cast

from ._native import native
from .arrays import Array, Floats, floats

__all__ = ["Model", "States"]


class States(NamedTuple):
    """States of objects over time."""

    positions: Floats
    """`[clips, time, objects, coordinates]`: x and y in pixels from the top left corner, y down; or an angle, radians."""
    velocities: Floats
    """The same per unit of time."""


class Model:
    """The model of a run. Its computations release the GIL; results are arrays of NumPy, which torch and others take over
    without a copy (`torch.from_dlpack`)."""

    def __init__(self, folder: str | Path, *, best: bool = False, device: str = "cpu", threads: int = 0) -> None:
        """Load the weights of a run folder.

        Args:
            best: Those with the best validation score of the last phase, instead of the last checkpoint's.
            device: `cpu`, `cuda` or `cuda:n`.
            threads: Of this process from now on; 0 for one a core.
        """
        self._model = native.Model(folder, best, device, threads)

    @property
    def parameters(self) -> dict[str, float]:
        """The learned parameters, lengths in pixels."""
        return dict(self._model.parameters())

    def encode(self, frames: Array) -> Floats:
        """Positions of the objects in frames.

        Args:
            frames: `[clips, time, side, side, channels]`, bytes or 0 to 1.

        Returns:
            `[clips, time, objects, coordinates]`, pixels (radians where the equation is in angles). Those of the input frames,
            the first of each clip, are refined on the picture.
        """
        return self._model.encode(floats(frames))

    def roll_out(self, positions: Array, steps: int, actions: Array | None = None) -> States:
        """Estimate the state at the last input frame and continue it by the equation.

        Args:
            positions: `[clips, input_steps, objects, coordinates]`, as from `encode`.
            steps: Frames to predict.
            actions: `[clips, time]` from the first input frame on, where something acts from outside.

        Returns:
            States of `1 + steps` frames, the first one at the last input frame.
        """
        acting = None if actions is None else floats(actions)
        return States(*self._model.roll_out(floats(positions), steps, acting))

    def decode(self, positions: Array) -> Floats:
        """Draw objects: frames `[clips, time, side, side, channels]`, 0 to 1, of positions `[clips, time, objects,
        coordinates]`."""
        return self._model.decode(floats(positions))

    def clips(self, split: str = "test", first: int = 0, count: int | None = None) -> Floats:
        """Frames of the run's own clips as the model sees them, `[clips, time, side, side, channels]`, 0 to 1."""
        return self._model.clips(split, first, self.lengths(split)[0] if count is None else count)

    def lengths(self, split: str = "test") -> tuple[int, int]:
        """Clips of a split of the run's data, and frames in each."""
        return self._model.lengths(split)

    def evaluate(self, split: str = "test") -> dict[str, Any]:
        """Losses, errors of each predicted frame and of the states on a split, as in `summary.json`."""
        return cast("dict[str, Any]", json.loads(self._model.evaluate(split)))
