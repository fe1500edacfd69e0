"""ONNX Runtime as Python has it: the library inside the package that a wheel of Cairn brings along."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ._library import encoded
from .errors import RuntimeMissing

VARIABLE = "CAIRN_ONNXRUNTIME"
"""Names the library file; nothing else is looked at when it is set."""

PACKAGE = "onnxruntime-directml" if sys.platform == "win32" else "onnxruntime"
"""What is installed; what is imported is called `onnxruntime` everywhere."""

REQUIREMENT = f"{PACKAGE}==1.24.4"

REMEDY = f"In Python, `python -m pip install {REQUIREMENT}` is enough"

# File names of the releases that this package's library can use. On Windows the name has no version.
_FILES = {"win32": "onnxruntime.dll", "darwin": "libonnxruntime.1.24.*.dylib"}.get(sys.platform, "libonnxruntime.so.1.24.*")


def in_package() -> Path | None:
    """The library file of the installed package, which is not imported; None where there is none, or of another release only."""
    try:
        spec = importlib.util.find_spec("onnxruntime")
    except (ImportError, ValueError):
        return None
    folders = spec.submodule_search_locations if spec is not None else None
    found = [path for folder in folders or [] for path in Path(folder, "capi").glob(_FILES) if path.is_file()]
    return max(found, key=lambda path: (len(path.name), path.name), default=None)


def chosen(named: str | os.PathLike[str] | None) -> bytes | None:
    """What the library is told to load: what the caller named; else nothing where the environment names a file, which the library reads
    itself; else the package's file; else nothing, and the library looks where it looks without Python."""
    if named is None and not os.environ.get(VARIABLE):
        named = in_package()
    return encoded(named, "onnxruntime")


@contextmanager
def explained() -> Iterator[None]:
    """Adds what helps in Python to a missing runtime's error."""
    try:
        yield
    except RuntimeMissing as error:
        remedy = ". ".join(part for part in (error.remedy, REMEDY, *hints(error.cause)) if part)
        text = ". ".join([str(error).removesuffix(f". {error.remedy}"), remedy])
        raise RuntimeMissing(
            text, error.result, function=error.function, field=error.field, cause=error.cause, remedy=remedy
        ) from None


def hints(cause: str) -> Iterator[str]:
    """What the installed packages and the system have to do with a cause for which ONNX Runtime was not found, or not loaded."""
    for name in ("onnxruntime", "onnxruntime-directml", "onnxruntime-gpu"):
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        if not version.startswith("1.24."):
            yield f"The package {name} that is installed is {version}, and Cairn needs 1.24"
        elif name != PACKAGE and sys.platform == "win32":
            yield f"The package {name} puts its files where those of {PACKAGE} belong: uninstall both, then install {PACKAGE} alone"
    if sys.platform == "win32" and "cannot be loaded" in cause:
        yield "Where its file is there, it may lack Microsoft's Visual C++ Redistributable"
