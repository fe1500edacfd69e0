"""The threads that share the library's work on pictures."""

from __future__ import annotations

from ctypes import byref

from . import _interface as c
from ._library import call, whole
from .errors import refuse

_PRIORITIES = {
    "below_normal": c.PRIORITY_BELOW_NORMAL,
    "normal": c.PRIORITY_NORMAL,
    "lowest": c.PRIORITY_LOWEST,
}


def set_threads(threads: int | None = None, priority: str = "below_normal") -> None:
    """Sets the number and the priority of the library's own threads, for the whole process.

    `threads` is 1 to 1024, in addition to the calling ones; `None` for one less than the physical cores that this process may use, but at least
    one. `priority` is "below_normal", "normal" or "lowest". The threads start with the first work that is shared and end with the last object.
    Their number changes no result. Raises `Busy` while there is an object, and `InvalidArgument`.
    """
    if priority not in _PRIORITIES:
        raise refuse("priority", f"{priority!r} is no priority", f"Use {', '.join(_PRIORITIES)}")
    count = 0 if threads is None else whole("threads", threads, 1, c.MAX_THREADS)
    call("set_threads", byref(c.ThreadOptions(threads=count, priority=_PRIORITIES[priority])))
