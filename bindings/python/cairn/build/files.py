"""Writes folders and files completely or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import BuildError
from .manifest import MANIFEST_FILE


def check_free(out: Path, replace: bool) -> None:
    """Refuses a path that exists, unless it may be replaced; always refuses one that contains something other than a bundle."""
    if not out.exists():
        return
    if not replace:
        raise BuildError("it exists already", field=str(out), remedy="Name another place, or pass --replace.")
    if out.is_dir() and not (out / MANIFEST_FILE).is_file():
        raise BuildError(
            f"it is no bundle ({MANIFEST_FILE} is missing), so it is not replaced",
            field=str(out),
            remedy="Name another place, or remove it yourself.",
        )


@contextmanager
def fresh_folder(out: Path, replace: bool) -> Iterator[Path]:
    """A temporary folder beside `out`. It is renamed to `out` if the block succeeds, and removed if it fails."""
    check_free(out, replace)
    out.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    try:
        yield work
        work.chmod(0o755)
        if out.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{out.name}.old.", dir=out.parent))
            out.rename(old / "bundle")
            work.rename(out)
            shutil.rmtree(old)
        else:
            work.rename(out)
    finally:
        if work.exists():
            shutil.rmtree(work, ignore_errors=True)
