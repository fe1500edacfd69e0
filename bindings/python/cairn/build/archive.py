"""Packs a bundle into one ZIP file without compression, and unpacks it: `docs/bundle.md`, section 1."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import onnx
from google.protobuf.message import DecodeError

from .errors import BuildError
from .geometry import Geometry
from .manifest import MANIFEST_FILE, geometry_of
from .files import fresh_folder
from .quantise import Quantisation, of_manifest

SUFFIX = ".cairn"
MANIFEST_LIMIT = 1 << 20
_NAME = re.compile(r"[A-Za-z0-9._-]+(/[A-Za-z0-9._-]+)*")
_CHUNK = 1 << 20
# A fixed date, so that equal content gives equal bytes: the earliest that ZIP can store.
_DATE = (1980, 1, 1, 0, 0, 0)


def pack(folder: Path, out: Path, replace: bool = False) -> Path:
    """Writes the folder's manifest and the files it names, uncompressed, into the archive `out`."""
    if out.exists() and not replace:
        raise BuildError("it exists already", field=str(out), remedy="Name another place, or pass --replace.")
    names = [entry["path"] for entry in _read_manifest(folder)["files"]]
    out.parent.mkdir(parents=True, exist_ok=True)
    handle, work = tempfile.mkstemp(prefix=f".{out.name}.", dir=out.parent)
    os.close(handle)
    try:
        with zipfile.ZipFile(work, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
            for name in [MANIFEST_FILE, *names]:
                info = zipfile.ZipInfo(_checked(name), _DATE)
                info.external_attr = 0o644 << 16
                info.file_size = (folder / name).stat().st_size
                with open(folder / name, "rb") as source, archive.open(info, "w") as sink:
                    shutil.copyfileobj(source, sink, _CHUNK)
        os.chmod(work, 0o644)
        os.replace(work, out)
    finally:
        Path(work).unlink(missing_ok=True)
    return out


def unpack(archive: Path, out: Path, replace: bool = False) -> Path:
    """Writes the archive's manifest and the files it names into the folder `out`; sizes and checksums are checked."""
    with _opened(archive) as entries, fresh_folder(out, replace) as folder:
        manifest = json.loads(_manifest_bytes(entries))
        (folder / MANIFEST_FILE).write_bytes(_manifest_bytes(entries))
        for entry in manifest["files"]:
            target = folder / _checked(entry["path"])
            target.parent.mkdir(parents=True, exist_ok=True)
            digest, size = hashlib.sha256(), 0
            with _entry(entries, entry["path"]) as source, open(target, "wb") as sink:
                while chunk := source.read(_CHUNK):
                    size += len(chunk)
                    if size > entry["size"]:
                        break
                    digest.update(chunk)
                    sink.write(chunk)
            if size != entry["size"] or digest.hexdigest() != entry["sha256"]:
                raise BuildError("size or checksum differs from the manifest", field=entry["path"], remedy="Fetch it again.")
    return out


def read_geometry(bundle: Path) -> Geometry:
    """The shapes in the manifest of a folder or an archive. The autoencoder's widths come from its graphs."""
    if bundle.is_dir():
        manifest = _read_manifest(bundle)
        return _with_widths(manifest, lambda name: (bundle / name).read_bytes())
    with _opened(bundle) as entries:
        manifest = json.loads(_manifest_bytes(entries))
        return _with_widths(manifest, lambda name: _entry(entries, name).read())


def read_quantisation(bundle: Path) -> Quantisation | None:
    """How the weights of a folder or an archive are quantised; `None` where all have 16 bits."""
    if bundle.is_dir():
        return of_manifest(_read_manifest(bundle))
    with _opened(bundle) as entries:
        return of_manifest(json.loads(_manifest_bytes(entries)))


def _with_widths(manifest: dict, read: Callable[[str], bytes]) -> Geometry:
    geometry = geometry_of(manifest)
    shapes = {}
    for kind in ("encoder", "decoder"):
        file = _checked(manifest["graphs"]["f32"][kind])
        try:
            model = onnx.load_model_from_string(read(file))
        except DecodeError as error:
            raise BuildError(f"it is no ONNX model ({error})", field=file, remedy="Make the bundle again.") from error
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


def _read_manifest(folder: Path) -> dict:
    path = folder / MANIFEST_FILE
    if not path.is_file():
        raise BuildError(f"it holds no {MANIFEST_FILE}", field=str(folder), remedy="Name the folder of a bundle.")
    try:
        return json.loads(path.read_bytes()[: MANIFEST_LIMIT + 1])
    except ValueError as error:
        raise BuildError(f"it is no JSON: {error}", field=str(path), remedy="Make the bundle again.") from error


def _opened(archive: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(archive)
    except zipfile.BadZipFile as error:
        raise BuildError(f"it is no archive: {error}", field=str(archive), remedy="Name a .cairn file, or a folder.") from error


def _entry(entries: zipfile.ZipFile, name: str):
    try:
        info = entries.getinfo(name)
    except KeyError:
        raise BuildError("it is not in the archive", field=name, remedy="Fetch the archive again.") from None
    if info.compress_type != zipfile.ZIP_STORED or info.flag_bits & 1:
        raise BuildError("it is compressed or encrypted", field=name, remedy="Pack it with `cairn.build pack`.")
    return entries.open(info)


def _manifest_bytes(entries: zipfile.ZipFile) -> bytes:
    with _entry(entries, MANIFEST_FILE) as source:
        data = source.read(MANIFEST_LIMIT + 1)
    if len(data) > MANIFEST_LIMIT:
        raise BuildError("it is longer than 1 MiB", field=MANIFEST_FILE, remedy="This is no world bundle.")
    return data


def _checked(name: str) -> str:
    if not isinstance(name, str) or len(name) > 200 or not _NAME.fullmatch(name) or {".", ".."} & set(name.split("/")):
        raise BuildError(f"{name!r} is no name a bundle may use", field="files", remedy="See docs/bundle.md, section 1.")
    return name
