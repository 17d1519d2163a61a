"""Arrays of other libraries."""

from __future__ import annotations

import numpy as np

from paig import arrays


class Foreign:
    """An array that only has the DLPack protocol."""

    def __init__(self, array: np.ndarray) -> None:  # type: ignore[type-arg]
        self.array = array

    def __dlpack__(self, **arguments: object) -> object:
        return self.array.__dlpack__(**arguments)  # type: ignore[arg-type]

    def __dlpack_device__(self) -> tuple[int, int]:
        device: tuple[int, int] = self.array.__dlpack_device__()
        return device


def test_arrays_with_dlpack_are_taken_without_a_copy() -> None:
    frames = np.zeros((2, 3), np.float32)
    assert np.shares_memory(arrays.floats(Foreign(frames)), frames)
    assert arrays.floats(frames) is frames


def test_frames_are_bytes_or_numbers_from_0_to_1() -> None:
    levels = np.arange(256, dtype=np.uint8)
    floats = arrays.floats(levels)
    assert floats.dtype == np.float32 and floats[255] == 1
    np.testing.assert_array_equal(arrays.pixels(floats), levels)
    assert arrays.pixels(levels) is levels
