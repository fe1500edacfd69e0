"""The base class of all objects of the library: a handle that is destroyed once."""

from __future__ import annotations

import weakref
from ctypes import byref
from types import TracebackType
from typing import Any, ClassVar, Self, TypeVar

from . import _interface as c
from ._library import call, library
from .errors import InvalidHandle

_Struct = TypeVar("_Struct", bound=c.Sized)


class Object:
    """An object of the library. `close()`, the end of a `with` block, or the garbage collector destroys it.

    Objects keep what they need alive, so they may be closed in any order. Closing waits for calls in flight.
    """

    _kind: ClassVar[str]

    def __init__(self, handle: int) -> None:
        self._value = handle
        # Finalise at garbage collection or interpreter exit too, so that no worker thread is left running.
        self._finalizer = weakref.finalize(self, _destroy, f"{self._kind}_destroy", handle)

    @property
    def closed(self) -> bool:
        """Whether the object was closed."""
        return not self._finalizer.alive

    def close(self) -> None:
        """Destroys the object; a second call does nothing.

        Raises `Busy` from within a callback of a call on the object, which then stays open.
        """
        if self._finalizer.detach() is None:
            return
        try:
            call(f"{self._kind}_destroy", self._value)
        except BaseException:
            self._finalizer = weakref.finalize(self, _destroy, f"{self._kind}_destroy", self._value)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def _handle(self) -> int:
        if self.closed:
            cause = f"this {type(self).__name__} is closed"
            raise InvalidHandle(f"{self._kind}: {cause}", field=self._kind, cause=cause)
        return self._value

    def _fill(self, function: str, kind: type[_Struct]) -> _Struct:
        """A struct that a query of this object fills."""
        struct = kind()
        call(function, self._handle, byref(struct))
        return struct


def _destroy(function: str, handle: int) -> None:
    # A failure cannot be reported here, and an exception in the garbage collector would only be printed.
    library().functions[function](handle)


def field_values(struct: c.Sized, leave_out: tuple[str, ...] = ()) -> dict[str, Any]:
    """A struct's fields by name, with decoded texts, without its size and reserved fields."""
    fields = {}
    for field in struct._fields_:
        name = field[0]
        if name not in ("struct_size", "reserved", *leave_out):
            value = getattr(struct, name)
            fields[name] = value.decode(errors="replace") if isinstance(value, bytes) else value
    return fields
