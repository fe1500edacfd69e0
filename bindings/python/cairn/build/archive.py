"""Packs a bundle into one ZIP file without compression, and unpacks it: `docs/bundle.md`, section 1."""

from __future__ import annotations

import io
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import BuildError
from .files import check_free, fresh_folder
from .geometry import Geometry
from .manifest import MANIFEST_FILE, MANIFEST_LIMIT, geometry_of
from .quantise import Quantisation, of_manifest
from .reader import copy_checked, manifest_bytes, open_listed, parse_manifest, read_manifest, read_model, verify
from .zip_damage import DAMAGE, check_position

SUFFIX = ".cairn"
# A fixed date and system, so that equal content gives equal bytes: the earliest date that ZIP can store, and the number of Unix.
_DATE = (1980, 1, 1, 0, 0, 0)
_SYSTEM = 3


def pack(folder: Path, out: Path, replace: bool = False) -> Path:
    """Writes the folder's manifest and the files it names, uncompressed, into the archive `out`; sizes and checksums are checked.

    Raises `BuildError`, also if `out` exists and may not be replaced, is a folder, or is a file that is no bundle.
    """
    check_free(out, replace, as_file=True)
    data = manifest_bytes(folder)
    manifest = parse_manifest(data, str(folder / MANIFEST_FILE))
    out.parent.mkdir(parents=True, exist_ok=True)
    handle, work = tempfile.mkstemp(prefix=f".{out.name}.", dir=out.parent)
    os.close(handle)
    try:
        with zipfile.ZipFile(work, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
            with _new_entry(archive, MANIFEST_FILE, len(data)) as sink:
                sink.write(data)
            for entry in manifest["files"]:
                with open_listed(folder, entry) as source, _new_entry(archive, entry["path"], entry["size"]) as sink:
                    copy_checked(source, entry, sink.write)
        os.chmod(work, 0o644)
        os.replace(work, out)
    finally:
        Path(work).unlink(missing_ok=True)
    return out


def _new_entry(archive: zipfile.ZipFile, name: str, size: int) -> BinaryIO:
    info = zipfile.ZipInfo(name, _DATE)
    info.create_system = _SYSTEM
    info.external_attr = 0o644 << 16
    info.file_size = size
    return archive.open(info, "w")


def unpack(archive: Path, out: Path, replace: bool = False) -> Path:
    """Writes the archive's manifest and the files it names into the folder `out`; sizes and checksums are checked."""
    with _opened(archive) as entries, fresh_folder(out, replace) as folder:
        data = _manifest_bytes(entries)
        manifest = parse_manifest(data)
        (folder / MANIFEST_FILE).write_bytes(data)
        for entry in manifest["files"]:
            target = folder / entry["path"]
            target.parent.mkdir(parents=True, exist_ok=True)
            with _entry(entries, entry["path"]) as source, open(target, "wb") as sink:
                copy_checked(source, entry, sink.write)
    return out


@contextmanager
def verified_folder(bundle: Path) -> Iterator[Path]:
    """The folder of a bundle whose sizes and checksums are checked: `bundle` itself, or what an archive is unpacked to until the block ends."""
    if bundle.is_dir():
        verify(bundle, read_manifest(bundle))
        yield bundle
        return
    with tempfile.TemporaryDirectory() as work:
        yield unpack(bundle, Path(work) / "bundle")


def read_geometry(bundle: Path) -> Geometry:
    """The shapes in the manifest of a folder or an archive. The autoencoder's widths come from its graphs."""
    if bundle.is_dir():
        return _with_widths(read_manifest(bundle), lambda entry: open_listed(bundle, entry))
    with _opened(bundle) as entries:
        manifest = parse_manifest(_manifest_bytes(entries))
        return _with_widths(manifest, lambda entry: _entry(entries, entry["path"]))


def read_quantisation(bundle: Path) -> Quantisation | None:
    """How the weights of a folder or an archive are quantised; `None` where all have 16 bits."""
    if bundle.is_dir():
        return of_manifest(read_manifest(bundle))
    with _opened(bundle) as entries:
        return of_manifest(parse_manifest(_manifest_bytes(entries)))


def _with_widths(manifest: dict, opened: Callable[[dict], BinaryIO]) -> Geometry:
    geometry = geometry_of(manifest)
    shapes = {}
    for kind in ("encoder", "decoder"):
        file = manifest["graphs"]["f32"][kind]
        (entry,) = [entry for entry in manifest["files"] if entry["path"] == file]
        data = io.BytesIO()
        with opened(entry) as source:
            copy_checked(source, entry, data.write)
        model = read_model(data.getvalue(), file)
        shapes |= {t.name: tuple(t.dims) for t in model.graph.initializer}
    try:
        first, last = shapes["encoder.0.weight"][0], shapes["decoder.20.weight"][0]
    except (KeyError, IndexError):
        raise BuildError(
            "the autoencoder's graphs name their weights otherwise",
            field="graphs.f32",
            remedy="Only bundles made by cairn.build can be described; give shapes instead.",
        ) from None
    return geometry.with_(encoder_width=first, decoder_widths=(*geometry.decoder_widths[:3], last))


@contextmanager
def _opened(archive: Path) -> Iterator[zipfile.ZipFile]:
    """The archive, opened for reading. Damage that is found within the block becomes a `BuildError`, too."""
    try:
        entries = zipfile.ZipFile(archive)
    except DAMAGE as error:
        raise BuildError(f"it is no archive: {error}", field=str(archive), remedy="Name a .cairn file, or a folder.") from error
    try:
        with entries:
            yield entries
    except DAMAGE as error:
        raise BuildError(f"the archive is damaged: {error}", field=str(archive), remedy="Fetch it again.") from error


def _entry(entries: zipfile.ZipFile, name: str):
    try:
        info = entries.getinfo(name)
    except KeyError:
        raise BuildError("it is not in the archive", field=name, remedy="Fetch the archive again.") from None
    if info.compress_type != zipfile.ZIP_STORED or info.flag_bits & 1:
        raise BuildError("it is compressed or encrypted", field=name, remedy="Pack it with `cairn.build pack`.")
    check_position(info)
    return entries.open(info)


def _manifest_bytes(entries: zipfile.ZipFile) -> bytes:
    with _entry(entries, MANIFEST_FILE) as source:
        return source.read(MANIFEST_LIMIT + 1)
