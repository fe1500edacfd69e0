"""Sends the library's log messages to Python's `logging`."""

from __future__ import annotations

import logging
import threading
from typing import Any

from . import _interface as c
from ._library import call

_LEVELS = {
    c.LOG_ERROR: logging.ERROR,
    c.LOG_WARNING: logging.WARNING,
    c.LOG_INFO: logging.INFO,
    c.LOG_DEBUG: logging.DEBUG,
    c.LOG_TRACE: logging.DEBUG,
}

# The library may call it until another one is set, so a reference is kept.
_current: Any = None
_changing = threading.Lock()


def log_to(logger: logging.Logger | None, level: int = logging.WARNING) -> None:
    """Sends the library's messages of at least that level to `logger`, on the thread that logs them; `None` ends this.

    The whole process has one logger. Raises `Busy` from within a handler of a message, `Unsupported` if the library is linked into a program
    that has set a logger of its own.
    """
    global _current
    if logger is None:
        number, callback = c.LOG_OFF, c.log_callback()
    else:
        number = max((n for n, of in _LEVELS.items() if of >= level), default=c.LOG_OFF)
        callback = c.log_callback(_handler(logger))
    with _changing:
        call("set_log_callback", number, callback, None)
        # The previous one is not running any more and will not be called again.
        _current = callback


def _handler(logger: logging.Logger) -> Any:
    def take(level: int, target: bytes, message: bytes, _user: object) -> None:
        part, text = target.decode(errors="replace"), message.decode(errors="replace")
        logger.log(_LEVELS.get(level, logging.ERROR), "%s: %s", part, text)

    return take
