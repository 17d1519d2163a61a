"""What computes."""

from __future__ import annotations

import json
from typing import Any, cast

from ._native import native

__all__ = ["versions"]


def versions() -> dict[str, Any]:
    """Version and commit of paig, version of libtorch, processor, vector path, GPUs; as `paig --version`."""
    return cast("dict[str, Any]", json.loads(native.versions()))
