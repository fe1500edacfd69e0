"""Sends the library's log messages to Python's `logging`."""

from __future__ import annotations

import logging
import threading
from typing import Any

from . import _interface as c
from ._library import call
from .errors import Busy

_LEVELS = {
    c.LOG_ERROR: logging.ERROR,
    c.LOG_WARNING: logging.WARNING,
    c.LOG_INFO: logging.INFO,
    c.LOG_DEBUG: logging.DEBUG,
    c.LOG_TRACE: logging.DEBUG,
}

# Callbacks that the library may still call, the newest last.
_callbacks: list[Any] = []
_changing = threading.Lock()
_this_thread = threading.local()


def log_to(logger: logging.Logger | None, level: int = logging.WARNING) -> None:
    """Sends the library's messages of at least that level to `logger`, on the thread that logs them; `None` ends this.

    The whole process has one logger. If Ctrl+C is pressed while the main thread is in a call that logs a message, `KeyboardInterrupt` is raised
    in the message's handler: Python prints it, that message may be lost, and the call continues.

    Raises `Busy` from within a handler of a message, `Unsupported` if the library is linked into a program that has set a logger of its own.
    """
    if getattr(_this_thread, "handles_message", False):
        # Checked before the lock: the thread that holds it waits in the library for this handler.
        cause, remedy = "a handler of a message called it", "Call it when the handler has returned"
        raise Busy(f"log_to: {cause}. {remedy}", function="log_to", cause=cause, remedy=remedy)
    if logger is None:
        number, callback = c.LOG_OFF, c.log_callback()
    else:
        number = max((n for n, of in _LEVELS.items() if of >= level), default=c.LOG_OFF)
        callback = c.log_callback(_handler(logger))
    with _changing:
        _callbacks.append(callback)
        call("set_log_callback", number, callback, None)
        # The former ones are not running any more and will not be called again. After a Ctrl+C during the call all are kept.
        del _callbacks[:-1]


def _handler(logger: logging.Logger) -> Any:
    def take(level: int, target: bytes, message: bytes, _user: object) -> None:
        # While the logger is replaced, a handler's own message may reach the next handler.
        is_nested = getattr(_this_thread, "handles_message", False)
        try:
            _this_thread.handles_message = True
            part, text = target.decode(errors="replace"), message.decode(errors="replace")
            logger.log(_LEVELS.get(level, logging.ERROR), "%s: %s", part, text)
        finally:
            _this_thread.handles_message = is_nested

    return take
