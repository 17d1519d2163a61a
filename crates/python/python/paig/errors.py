"""Exceptions of paig, one for each kind of error of the library. Ctrl-C raises `KeyboardInterrupt`."""

from __future__ import annotations

__all__ = [
    "CorruptError", "DefectError", "DeviceError", "Error", "FailedError", "InputError", "LibtorchError", "MissingError",
    "ResourcesError",
]


class Error(Exception):
    """Any error of paig."""


class InputError(Error, ValueError):
    """Arguments, settings or files with values that cannot be."""


class MissingError(Error, FileNotFoundError):
    """A file, folder or run that does not exist."""

    def __str__(self) -> str:
        return Exception.__str__(self)


class CorruptError(Error, ValueError):
    """A file that is damaged or of another form."""


class ResourcesError(Error):
    """A full disk, or too little memory."""


class DeviceError(Error, RuntimeError):
    """A GPU that does not exist."""


class FailedError(Error, RuntimeError):
    """Work that failed although its input was sound."""


class DefectError(Error, RuntimeError):
    """A defect of paig."""


class LibtorchError(Error, ImportError):
    """No libtorch that fits, or two of them in one process."""
