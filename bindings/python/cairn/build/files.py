"""Writes folders and files completely or not at all."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import BuildError
from .manifest import MANIFEST_FILE
from .zip_damage import DAMAGE


def check_free(out: Path, replace: bool, as_file: bool = False) -> None:
    """Refuses a path that exists, unless it may be replaced; always refuses one that contains something other than a bundle. A file, which
    `as_file` says is to be written, cannot replace a folder.
    """
    if not out.exists():
        return
    if not replace:
        raise BuildError("it exists already", field=str(out), remedy="Name another place, or pass --replace.")
    if out.is_dir() and as_file:
        raise BuildError("it is a folder, and a file is to be written", field=str(out), remedy="Name another file, or remove the folder yourself.")
    if not _is_bundle(out):
        raise BuildError(
            f"it is no bundle ({MANIFEST_FILE} is missing), so it is not replaced",
            field=str(out),
            remedy="Name another place, or remove it yourself.",
        )


def _is_bundle(path: Path) -> bool:
    """Whether a folder or an archive has a manifest."""
    if not path.is_file():
        return (path / MANIFEST_FILE).is_file()
    try:
        with zipfile.ZipFile(path) as entries:
            return MANIFEST_FILE in entries.namelist()
    except DAMAGE:
        return False


@contextmanager
def fresh_folder(out: Path, replace: bool) -> Iterator[Path]:
    """A temporary folder beside `out`. It is renamed to `out` if the block succeeds, and removed if it fails. Until then, an existing bundle
    stays at `out`.
    """
    check_free(out, replace)
    out.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    try:
        yield work
        work.chmod(0o755)
        if out.exists():
            _replace(out, work)
        else:
            work.rename(out)
    finally:
        if work.exists():
            shutil.rmtree(work, ignore_errors=True)


def _replace(out: Path, work: Path) -> None:
    """Renames `work` to `out`, and deletes the bundle that was there. If that fails, it puts the bundle back."""
    old = Path(tempfile.mkdtemp(prefix=f".{out.name}.old.", dir=out.parent))
    try:
        out.rename(old / "bundle")
        work.rename(out)
    except BaseException:
        if not out.exists():
            (old / "bundle").rename(out)
        shutil.rmtree(old, ignore_errors=True)
        raise
    shutil.rmtree(old, ignore_errors=True)
