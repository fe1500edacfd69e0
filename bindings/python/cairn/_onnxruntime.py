"""Finds ONNX Runtime's library in the installed Python package on which a wheel of Cairn depends."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ._library import encoded
from .errors import RuntimeMissing

VARIABLE = "CAIRN_ONNXRUNTIME"
"""The environment variable with the path of the library; if it is set, no other path is searched."""

PACKAGE = "onnxruntime-directml" if sys.platform == "win32" else "onnxruntime"
"""The name of the installed distribution. The imported package is called `onnxruntime` on every system."""

REQUIREMENT = f"{PACKAGE}==1.24.4"

REMEDY = f"In Python, `python -m pip install {REQUIREMENT}` is enough"

OLDEST = (1, 24)
"""The oldest version that Cairn works with."""

# The library's file name with its version, by system. The name on Windows has no version.
_FILES = {
    "win32": r"onnxruntime\.dll",
    "darwin": r"libonnxruntime\.(\d+\.\d+\.\d+)\.dylib",
    "linux": r"libonnxruntime\.so\.(\d+\.\d+\.\d+)",
}


def in_package() -> Path | None:
    """The library file in the installed package, which is not imported. `None` if the package is missing or too old."""
    try:
        spec = importlib.util.find_spec("onnxruntime")
    except (ImportError, ValueError):
        return None
    folders = spec.submodule_search_locations if spec is not None else None
    files = [path for folder in folders or [] for path in Path(folder, "capi").glob("*onnxruntime.*") if path.is_file()]
    versions = {path: _file_version(path.name) for path in files}
    return max((path for path in files if versions[path] >= OLDEST), key=lambda path: versions[path], default=None)


def _file_version(name: str) -> tuple[int, ...]:
    """The version in a library's file name; the oldest for a name without one; none for other files."""
    match = re.fullmatch(_FILES.get(sys.platform, _FILES["linux"]), name)
    if match is None:
        return ()
    return tuple(map(int, match[1].split("."))) if match.groups() else OLDEST


def library_path(named: str | os.PathLike[str] | None) -> bytes | None:
    """The path that is passed to the library: the caller's if there is one. Otherwise none if the environment names a file, because the library
    reads the variable itself; otherwise the file in the package; otherwise none, and the library searches its own paths.
    """
    if named is None and not os.environ.get(VARIABLE):
        named = in_package()
    return encoded(named, "onnxruntime")


def webgpu_path(named: str | os.PathLike[str] | None) -> bytes | None:
    """The path of the WebGPU provider that is passed to the library: the caller's, else none if the environment names a file, else the one in the
    installed package `onnxruntime-ep-webgpu`, else none, and the library looks beside ONNX Runtime.
    """
    if named is None and not os.environ.get("CAIRN_WEBGPU"):
        named = _webgpu_in_package()
    return encoded(named, "webgpu")


def _webgpu_in_package() -> Path | None:
    try:
        spec = importlib.util.find_spec("onnxruntime_ep_webgpu")
    except (ImportError, ValueError):
        return None
    folders = spec.submodule_search_locations if spec is not None else None
    found = [path for folder in folders or [] for path in Path(folder).glob("*onnxruntime_providers_webgpu.*") if path.is_file()]
    return min(found, default=None)


@contextmanager
def with_hints() -> Iterator[None]:
    """Adds hints for Python to the error of a missing runtime."""
    try:
        yield
    except RuntimeMissing as error:
        remedy = ". ".join(part for part in (error.remedy, REMEDY, *hints(error.cause)) if part)
        text = ". ".join([str(error).removesuffix(f". {error.remedy}"), remedy])
        raise RuntimeMissing(
            text, error.result, function=error.function, field=error.field, cause=error.cause, remedy=remedy
        ) from None


def hints(cause: str) -> Iterator[str]:
    """Hints from the installed packages and the system on why ONNX Runtime was not found or not loaded."""
    for name in ("onnxruntime", "onnxruntime-directml", "onnxruntime-gpu"):
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        if tuple(int(part) for part in version.split(".")[:2] if part.isdigit()) < OLDEST:
            yield f"The package {name} that is installed is {version}, and Cairn needs 1.24 or newer"
        elif name != PACKAGE and sys.platform == "win32":
            yield f"The package {name} puts its files where those of {PACKAGE} belong: uninstall both, then install {PACKAGE} alone"
    if sys.platform == "win32" and "cannot be loaded" in cause:
        yield "Where its file is there, it may lack Microsoft's Visual C++ Redistributable"
