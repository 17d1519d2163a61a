"""The native module, loaded on first use: `import paig` alone needs no libtorch."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from . import _paig as native
else:
    import importlib

    from . import libtorch

    class _Native:
        def __getattr__(self, name):
            libtorch.load()
            value = getattr(importlib.import_module("paig._paig"), name)
            setattr(self, name, value)
            return value

    native = _Native()

__all__ = ["native"]
