"""The shared library: its search paths, version checks, and calls of its functions."""

from __future__ import annotations

import ctypes
import operator
import os
import sys
import threading
import warnings
from ctypes import byref, c_size_t, c_void_p
from pathlib import Path
from typing import Any, SupportsIndex

from . import _interface as c
from . import _library_file
from .errors import Error, LibraryMissing, Unsupported, kind_of, refuse

VARIABLE = "CAIRN_LIBRARY"
"""The environment variable with the path of the library; if it is set, no other path is searched."""

FILE = {"win32": "cairn.dll", "darwin": "libcairn.dylib"}.get(sys.platform, "libcairn.so")

REMEDY = (
    f"Install the wheel of Cairn for this platform, which carries it, or run `cargo build --release` in a clone of Cairn, or set {VARIABLE} "
    f"to the file {FILE}"
)


def search_paths() -> list[Path]:
    """The paths that are searched, in this order: only the one in `CAIRN_LIBRARY` if it is set; otherwise beside this package, then, if the
    package lies in a clone of the repository, cargo's output folder there.
    """
    if named := os.environ.get(VARIABLE):
        return [Path(named).absolute()]
    package = Path(__file__).resolve().parent
    found = [package / FILE]
    for folder in package.parents:
        if (folder / "Cargo.toml").is_file() and (folder / "include" / "cairn.h").is_file():
            target = Path(os.environ.get("CARGO_TARGET_DIR") or folder / "target")
            found += [target / profile / FILE for profile in ("release", "debug")]
            break
    return found


def find() -> Path:
    """The first of `search_paths` that exists."""
    searched = search_paths()
    for path in searched:
        if path.is_file():
            return path
    field = VARIABLE if os.environ.get(VARIABLE) else FILE
    cause = f"Cairn's library was not found; looked at {', '.join(map(str, searched))}"
    raise LibraryMissing(f"{field}: {cause}. {REMEDY}", field=field, cause=cause, remedy=REMEDY)


class Library:
    """A loaded library: both versions are checked, and every function was found that it must have."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if wrong := _library_file.mismatch(path):
            raise _unusable(path, *wrong)
        others = _library_file.other_copies(FILE, path)
        try:
            # CDLL, not PyDLL: the GIL is released during every call.
            loaded = ctypes.CDLL(str(path))
        except OSError as why:
            raise _unusable(path, *(_library_file.explain_failure(why) or (f"cannot be loaded: {why}", REMEDY))) from None
        self.abi_version = self._resolve(loaded, "abi_version")()
        if self.abi_version != c.ABI_VERSION:
            cause = f"has the binary interface {self.abi_version}, and this package was made for {c.ABI_VERSION}"
            raise _unusable(path, cause, "Use library and package of the same release")
        self.version = self._resolve(loaded, "version")()
        if self.version < c.VERSION:
            cause = f"is version {version_text(self.version)}, older than the {version_text(c.VERSION)} this package was made for"
            raise _unusable(path, cause, "Use library and package of the same release")
        left_out = frozenset() if self.version == c.VERSION else c.EXPERIMENTAL
        self.functions = {name: self._resolve(loaded, name) for name in c.FUNCTIONS if name not in left_out}
        for other in others:
            warnings.warn(
                f"this process has another Cairn, {other}, besides {path}, which this package uses. They do not know each other's objects, "
                f"and may use one file of ONNX Runtime only. To use that one here too, set {VARIABLE} to it before anything of Cairn is used",
                RuntimeWarning,
                stacklevel=2,
            )

    def function(self, name: str) -> Any:
        """A function by its name. Raises `Unsupported` for an experimental one if the library is of another version than this package."""
        if (function := self.functions.get(name)) is not None:
            return function
        cause = f"it is experimental, and the library is not of version {version_text(c.VERSION)}"
        remedy = "Use library and package of the same release"
        raise Unsupported(f"cairn_{name}: {cause}. {remedy}", function=f"cairn_{name}", cause=cause, remedy=remedy)

    def _resolve(self, loaded: ctypes.CDLL, name: str) -> Any:
        try:
            function = getattr(loaded, f"cairn_{name}")
        except AttributeError:
            raise _unusable(self.path, f"has no cairn_{name}", "Name the file that is Cairn's library, and whole") from None
        function.argtypes = c.FUNCTIONS[name]
        function.restype = c.RETURNS.get(name, ctypes.c_int32)
        return function


def version_text(version: int) -> str:
    """A version number in the form 1.2.3."""
    return f"{version // 1_000_000}.{version // 1000 % 1000}.{version % 1000}"


def _unusable(path: Path, cause: str, remedy: str) -> LibraryMissing:
    return LibraryMissing(f"{path}: {cause}. {remedy}", field=str(path), cause=cause, remedy=remedy)


_loaded: Library | None = None
_loading = threading.Lock()


def library() -> Library:
    """The library; loads it at first use."""
    global _loaded
    # Without the lock: a finaliser may call this on a thread that holds it.
    if _loaded is not None:
        return _loaded
    with _loading:
        if _loaded is None:
            _loaded = Library(find())
        return _loaded


def call(name: str, *arguments: Any) -> int:
    """Calls a function. Returns its result if that is not an error, otherwise raises the error."""
    result: int = library().function(name)(*arguments)
    if result < 0:
        raise last_error(result)
    return result


def last_error(result: int) -> Error:
    """The exception for a result of this thread's latest call."""
    whole = read_text("last_error")
    function, field, cause, remedy = (
        read_text("last_error_part", part)
        for part in (c.LAST_ERROR_FUNCTION, c.LAST_ERROR_FIELD, c.LAST_ERROR_CAUSE, c.LAST_ERROR_REMEDY)
    )
    return kind_of(result)(whole, result, function=function, field=field, cause=cause, remedy=remedy)


def read_text(name: str, *arguments: Any) -> str:
    """The whole text that a function copies into a buffer."""
    function = library().functions[name]
    length = c_size_t()
    capacity = 1024
    while True:
        buffer = ctypes.create_string_buffer(capacity)
        result: int = function(*arguments, buffer, capacity, byref(length))
        if result == c.TRUNCATED:
            capacity = length.value + 1
        elif result == c.OK:
            return buffer.raw[: length.value].decode(errors="replace")
        elif name.startswith("last_error"):
            return ""
        else:
            raise last_error(result)


def make(kind: str, name: str, *arguments: Any) -> int:
    """Calls a function that creates an object of this kind, and returns the handle, which the function writes to its last parameter."""
    handle = c_void_p()
    call_for_handle(kind, handle, name, *arguments, byref(handle))
    assert handle.value is not None, f"cairn_{name} gave no handle"
    return handle.value


def call_for_handle(kind: str, handle: c_void_p, name: str, *arguments: Any) -> int:
    """Does what `call` does, for a function that may write the handle of an object of this kind. After an exception there is no object."""
    try:
        return call(name, *arguments)
    except BaseException:
        # Python raises a Ctrl+C of the time of the call right after it, when the object may exist.
        if handle.value is not None:
            library().functions[f"{kind}_destroy"](handle)
        raise


def whole(field: str, value: SupportsIndex, low: int, high: int, remedy: str = "") -> int:
    """A whole number as an int. ctypes cuts one that does not fit into its type, and does not tell.

    Raises `InvalidArgument` if it is not from `low` to `high`, and for another type, such as a float.
    """
    remedy = remedy or f"Give a whole number from {low} to {high}"
    try:
        number = operator.index(value)
    except TypeError:
        raise refuse(field, f"{value!r} is no whole number", remedy) from None
    if not low <= number <= high:
        raise refuse(field, f"{number} is out of range", remedy)
    return number


def encoded(text: str | os.PathLike[str] | None, field: str) -> bytes | None:
    """A text as bytes for the library. A text with a NUL is refused, because it ends at the NUL there."""
    if text is None:
        return None
    path = os.fspath(text)
    if not isinstance(path, str):
        raise refuse(field, f"is of the type {type(path).__name__}", "Give a str, or a path that is one")
    try:
        found = path.encode()
    except UnicodeEncodeError:
        raise refuse(field, "is not valid Unicode", "Use a name of valid Unicode") from None
    if b"\0" in found:
        raise refuse(field, "holds a NUL character")
    return found
