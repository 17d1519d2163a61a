"""Arrays of any library as those of NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Floats", "floats", "pixels"]

Floats = NDArray[np.float32]
# Anything with the DLPack or the array protocol: an array of NumPy, a tensor of torch or JAX.
Array = Any


def _as_array(array: Array) -> NDArray[Any]:
    if isinstance(array, np.ndarray):
        return array
    if hasattr(array, "detach"):
        array = array.detach().cpu()
    if hasattr(array, "__dlpack__"):
        return np.from_dlpack(array)
    return np.asarray(array)


def floats(array: Array) -> Floats:
    """A float32 array, row-major; frames of bytes (0 to 255) as 0 to 1. Without a copy where it has this form."""
    found = _as_array(array)
    if found.dtype == np.uint8:
        return np.ascontiguousarray(found, dtype=np.float32) / np.float32(255)
    return np.ascontiguousarray(found, dtype=np.float32)


def pixels(array: Array) -> NDArray[np.uint8]:
    """Frames as bytes; numbers from 0 to 1 are scaled to 0 to 255 and rounded."""
    found = _as_array(array)
    if found.dtype == np.uint8:
        return np.ascontiguousarray(found)
    return np.ascontiguousarray(np.clip(np.rint(found * 255.0), 0, 255), dtype=np.uint8)
