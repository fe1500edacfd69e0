"""A player's input: keys by name, controls of a step, scripts and their recording."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from ctypes import byref, c_uint64
from dataclasses import dataclass
from typing import Self

from . import _interface as c
from ._handles import Object
from ._library import call, make, read_text, whole
from .errors import refuse

KEYS: dict[str, int] = {
    **{chr(code): code for code in (*range(0x30, 0x3A), *range(0x41, 0x5B))},
    **{f"F{n}": 0x6F + n for n in range(1, 25)},
    **{f"NUM{n}": 0x60 + n for n in range(10)},
    "MOUSE_LEFT": 0x01,
    "MOUSE_RIGHT": 0x02,
    "MOUSE_MIDDLE": 0x04,
    "MOUSE_X1": 0x05,
    "MOUSE_X2": 0x06,
    "BACKSPACE": 0x08,
    "TAB": 0x09,
    "ENTER": 0x0D,
    "SHIFT": 0x10,
    "CTRL": 0x11,
    "ALT": 0x12,
    "PAUSE": 0x13,
    "CAPS_LOCK": 0x14,
    "ESC": 0x1B,
    "ESCAPE": 0x1B,
    "SPACE": 0x20,
    "PAGE_UP": 0x21,
    "PAGE_DOWN": 0x22,
    "END": 0x23,
    "HOME": 0x24,
    "LEFT": 0x25,
    "UP": 0x26,
    "RIGHT": 0x27,
    "DOWN": 0x28,
    "INSERT": 0x2D,
    "DELETE": 0x2E,
    "LEFT_SHIFT": 0xA0,
    "RIGHT_SHIFT": 0xA1,
    "LEFT_CTRL": 0xA2,
    "RIGHT_CTRL": 0xA3,
    "LEFT_ALT": 0xA4,
    "RIGHT_ALT": 0xA5,
    "SEMICOLON": 0xBA,
    "EQUALS": 0xBB,
    "COMMA": 0xBC,
    "MINUS": 0xBD,
    "PERIOD": 0xBE,
    "SLASH": 0xBF,
    "BACKQUOTE": 0xC0,
    "LEFT_BRACKET": 0xDB,
    "BACKSLASH": 0xDC,
    "RIGHT_BRACKET": 0xDD,
    "QUOTE": 0xDE,
}
"""Windows virtual-key codes by the names that control scripts use."""

_LONGEST_SCRIPT = 86_400
"""Seconds of world time that a script may have."""


def key_code(key: int | str) -> int:
    """The virtual-key code of a key. The key is a code, 0 to 255, or a name in upper or lower case, such as `W` or `VK_0x57`.

    Raises `InvalidArgument`.
    """
    if isinstance(key, str):
        name = key.upper()
        if re.fullmatch("VK_0X[0-9A-F]{1,2}", name):
            return int(name[3:], 16)
        if name not in KEYS:
            raise refuse("keys", f"there is no key called {key!r}", "Use a name from cairn.KEYS, or a code from 0 to 255")
        return KEYS[name]
    # A number of a small numpy type would lose bits in shifts.
    return whole("keys", key, 0, 255, "Use a code from 0 to 255, or a name from cairn.KEYS")


@dataclass(frozen=True)
class Controls:
    """Controls of one latent step.

    `keys` are the keys held at any time during the step: names or virtual-key codes. `mouse` is the motion in raw counts, right and down
    positive, each from -32768 to 32768. `scroll` is the wheel, up positive; only its sign counts.
    """

    keys: Iterable[int | str] = ()
    mouse: tuple[float, float] = (0.0, 0.0)
    scroll: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.keys, str):
            raise refuse("keys", f"is the text {self.keys!r}", f"Give a list of keys: [{self.keys!r}]")
        # Codes are sorted, so that equal controls compare equal.
        object.__setattr__(self, "keys", tuple(sorted({key_code(key) for key in self.keys})))

    def _struct(self) -> c.Controls:
        words = [0, 0, 0, 0]
        for key in self.keys:
            code = key_code(key)
            words[code // 64] |= 1 << code % 64
        dx, dy = self.mouse
        return c.Controls(mouse_dx=dx, mouse_dy=dy, scroll=self.scroll, keys=(c_uint64 * 4)(*words))

    @classmethod
    def _of(cls, struct: c.Controls) -> Self:
        keys = [code for code in range(256) if struct.keys[code // 64] >> code % 64 & 1]
        return cls(keys, (struct.mouse_dx, struct.mouse_dy), struct.scroll)


class Script(Object):
    """A player's input by world time, in the format of docs/control-script.md. Immutable.

    May be used from any thread.
    """

    _kind = "script"

    def __init__(self, text: str) -> None:
        """Raises `InvalidArgument` with line and column of the error; `Unsupported` for a newer version of the format."""
        data = text.encode(errors="surrogatepass")
        super().__init__(make("script", "script_create", data, len(data)))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Reads the script in a file; also raises the errors of reading a file."""
        with open(path, encoding="utf-8", newline="") as file:
            return cls(file.read())

    @classmethod
    def _own(cls, handle: int) -> Self:
        script = cls.__new__(cls)
        Object.__init__(script, handle)
        return script

    def controls(self, latent: int, latents_per_second: int) -> Controls:
        """The controls of the latent step with that number, from 1; `latents_per_second` is the rollout's, 1 to 240.

        Raises `InvalidArgument`, also if the mouse moves farther in the step than `Controls` allows.
        """
        struct = c.Controls()
        call("script_get_controls", self._handle, *_step(latent, latents_per_second), byref(struct))
        return Controls._of(struct)

    @property
    def duration(self) -> float:
        """Duration in seconds of world time: up to the explicit end, or if there is none, up to the end of the last event or motion."""
        microseconds = c_uint64()
        call("script_get_duration", self._handle, byref(microseconds))
        return microseconds.value / 1e6

    @property
    def text(self) -> str:
        """The script in the format's canonical form."""
        return read_text("script_get_text", self._handle)


class Recorder(Object):
    """Records a player's input and makes a `Script` of it. Times are seconds of world time; events must come in order of time.

    One call at a time; a concurrent call raises `Busy`. All methods raise `InvalidArgument`, also for an input that no script may hold.
    """

    _kind = "recorder"

    def __init__(self) -> None:
        super().__init__(make("recorder", "recorder_create"))

    def key(self, seconds: float, key: int | str, down: bool) -> None:
        """Records that a key or mouse button went down or up; repeats are ignored."""
        call("recorder_key", self._handle, _microseconds(seconds), key_code(key), int(bool(down)))

    def mouse(self, seconds: float, dx: float, dy: float) -> None:
        """Records a motion of the mouse in raw counts, right and down positive."""
        call("recorder_mouse", self._handle, _microseconds(seconds), dx, dy)

    def scroll(self, seconds: float, notches: int) -> None:
        """Records a turn of the wheel, up positive."""
        call("recorder_scroll", self._handle, _microseconds(seconds), whole("notches", notches, -(1 << 31), (1 << 31) - 1))

    def step(self, latent: int, latents_per_second: int, controls: Controls) -> None:
        """Records the controls of a latent step; `latent` counts from 1. A script of all steps reproduces them bit for bit."""
        call("recorder_step", self._handle, *_step(latent, latents_per_second), byref(controls._struct()))

    def script(self, seconds: float) -> Script:
        """Makes a script of the recording so far. It ends at that time; keys that are held are released there."""
        return Script._own(make("script", "recorder_make_script", self._handle, _microseconds(seconds)))


def _step(latent: int, latents_per_second: int) -> tuple[int, int]:
    """Number and rate of a latent step for the library, which checks them further."""
    return whole("latent", latent, 0, (1 << 64) - 1), whole("latents_per_second", latents_per_second, 1, 240)


def _microseconds(seconds: float) -> int:
    if not 0 <= seconds <= _LONGEST_SCRIPT:
        raise refuse("seconds", f"{seconds} is no time of a script", f"Give seconds of world time from 0 to {_LONGEST_SCRIPT}")
    return round(seconds * 1e6)


