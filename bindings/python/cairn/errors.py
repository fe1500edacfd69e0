"""The exceptions that failed calls raise, with the library's message and its parts."""

from __future__ import annotations

from . import _interface as c


class Error(Exception):
    """A call failed. The text is the library's message: function, offending argument or file, cause, remedy.

    `result` is the library's result, and `name` its name in `cairn.h`, such as `CAIRN_ERROR_IO`. `function`, `field` (the argument, file or
    field that is wrong), `cause` and `remedy` are the message's parts, which may be empty.
    """

    result: int = c.ERROR_INTERNAL
    name: str = ""

    def __init__(
        self,
        message: str,
        result: int | None = None,
        *,
        function: str = "",
        field: str = "",
        cause: str = "",
        remedy: str = "",
    ) -> None:
        super().__init__(message)
        if result is not None:
            self.result = result
        self.name = _NAMES.get(self.result, f"result {self.result}")
        self.function = function
        self.field = field
        self.cause = cause
        self.remedy = remedy


class InvalidArgument(Error, ValueError):
    """An argument is outside its range, not finite, or of a wrong shape or type."""

    result = c.ERROR_INVALID_ARGUMENT


class InvalidHandle(Error):
    """The object is closed."""

    result = c.ERROR_INVALID_HANDLE


class StructSize(Error):
    """Library and package do not match: the library does not know the size of a struct."""

    result = c.ERROR_STRUCT_SIZE


class Busy(Error):
    """The object is in use by a call that allows no other beside it. Nothing was done."""

    result = c.ERROR_BUSY


class Unsupported(Error):
    """A valid request that this build, platform, device or world does not support."""

    result = c.ERROR_UNSUPPORTED


class OutOfMemory(Error, MemoryError):
    """More memory is needed than is available or allowed."""

    result = c.ERROR_OUT_OF_MEMORY


class FileError(Error, OSError):
    """The operating system refused a file operation."""

    result = c.ERROR_IO


class InvalidBundle(Error):
    """The world's bundle is damaged, tampered with, or breaks the format."""

    result = c.ERROR_INVALID_BUNDLE


class RuntimeMissing(Error):
    """ONNX Runtime is missing or has the wrong version. `python -m cairn doctor` lists the files and folders that were searched."""

    result = c.ERROR_RUNTIME_MISSING


class DeviceError(Error):
    """ONNX Runtime or the device failed while running."""

    result = c.ERROR_DEVICE


class InvalidState(Error):
    """A saved state is damaged, or belongs to another world."""

    result = c.ERROR_INVALID_STATE


class Cancelled(Error):
    """The work was cancelled."""

    result = c.ERROR_CANCELLED


class Poisoned(Error):
    """An earlier call on this object failed by a fault of the library. The object can only be closed."""

    result = c.ERROR_POISONED


class InternalError(Error):
    """A fault of the library. Please report the message."""

    result = c.ERROR_INTERNAL


class DeviceRemoved(Error):
    """The graphics device was lost. Close the objects made on it, and make a new device."""

    result = c.ERROR_DEVICE_REMOVED


class LibraryMissing(Error):
    """Cairn's shared library is missing, or is not one that this package can use. `python -m cairn doctor` explains more."""

    result = c.ERROR_IO


_NAMES = {
    value: f"CAIRN_{name}" for name, value in vars(c).items() if name.startswith("ERROR_") and isinstance(value, int)
}

_KINDS: dict[int, type[Error]] = {
    kind.result: kind
    for kind in (
        InvalidArgument,
        InvalidHandle,
        StructSize,
        Busy,
        Unsupported,
        OutOfMemory,
        FileError,
        InvalidBundle,
        RuntimeMissing,
        DeviceError,
        InvalidState,
        Cancelled,
        Poisoned,
        InternalError,
        DeviceRemoved,
    )
}


def kind_of(result: int) -> type[Error]:
    """The exception class for a negative result; `Error` itself for one that this package does not know."""
    return _KINDS.get(result, Error)


def refuse(field: str, cause: str, remedy: str = "") -> InvalidArgument:
    """An `InvalidArgument` of this package itself, in the form of the library's errors."""
    end = f". {remedy}" if remedy else ""
    return InvalidArgument(f"{field}: {cause}{end}", field=field, cause=cause, remedy=remedy)
