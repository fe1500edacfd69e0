"""Reads manifests, models and files of bundles that others may have made, with the checks of `docs/bundle.md`, sections 1 and 7."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import onnx
from google.protobuf.message import DecodeError

from .errors import BuildError
from .manifest import MANIFEST_FILE, MANIFEST_LIMIT

FILES_LIMIT = 4096
PATH_LIMIT = 200
GRAPH_KINDS = ("transformer", "encoder", "decoder")
# A kind that a bundle may have, in both precisions or in none.
JOINED = "joined"
_COMPONENT = re.compile(r"[A-Za-z0-9._-]+")
_DEVICE_OF_WINDOWS = re.compile(r"(con|prn|aux|nul|(com|lpt)[0-9])(\..*)?", re.IGNORECASE)
_SHA256 = re.compile(r"[0-9a-f]{64}")
_CHUNK = 1 << 20
# Of the values of a manifest, which has no more than 6. Python's own limit depends on the caller.
_DEPTH_LIMIT = 16
_TOO_DEEP = "its values are nested too deeply"
# Members that the builder reads without further checks.
_MEMBERS = {"name": str, "geometry": dict, "sampler": dict, "graphs": dict, "files": list, "licence": dict, "provenance": dict}


def name_violation(name: object) -> str | None:
    """The rule for file names that `name` violates; `None` for a valid name. `src/bundle/names.rs` has the same rules.

    A valid name cannot lead out of the bundle on any system.
    """
    if not isinstance(name, str):
        return "it is no text"
    if not 1 <= len(name) <= PATH_LIMIT:
        return f"it has {len(name)} characters, 1 to {PATH_LIMIT} are allowed"
    for part in name.split("/"):
        if part in (".", ".."):
            return "it has a . or .. component"
        if not _COMPONENT.fullmatch(part):
            return "a component is empty, or has a character outside A-Z a-z 0-9 . _ -"
        if part.endswith("."):
            return "a component ends in a dot"
        if _DEVICE_OF_WINDOWS.fullmatch(part):
            return "a component is a device name of Windows"
    return None


def checked_name(name: object, field: str) -> str:
    """`name`, which must be a valid file name in a bundle."""
    if (fault := name_violation(name)) is not None:
        raise BuildError(f"{name!r:.250} is no name a bundle may use: {fault}", field=field, remedy="See docs/bundle.md, section 1.")
    return name


def manifest_bytes(folder: Path) -> bytes:
    """The manifest's file of a bundle in a folder; of one that is too long, enough to see that."""
    path = folder / MANIFEST_FILE
    if not path.is_file():
        raise BuildError(f"it holds no {MANIFEST_FILE}", field=str(folder), remedy="Name the folder of a bundle.")
    with open(path, "rb") as source:
        return source.read(MANIFEST_LIMIT + 1)


def read_manifest(folder: Path) -> dict:
    """The manifest of a bundle in a folder; all names in it are checked."""
    return parse_manifest(manifest_bytes(folder), str(folder / MANIFEST_FILE))


def parse_manifest(data: bytes, field: str = MANIFEST_FILE) -> dict:
    """The manifest in `data`; all names in it are checked. `field` is its path, for messages."""
    if len(data) > MANIFEST_LIMIT:
        raise BuildError("it is longer than 1 MiB", field=field, remedy="This is no world bundle.")
    try:
        manifest = json.loads(data.decode("utf-8"))
    except RecursionError:
        raise BuildError(_TOO_DEEP, field=field, remedy="This is no world bundle.") from None
    except ValueError as error:
        raise BuildError(f"it is no JSON: {error}", field=field, remedy="Make the bundle again.") from error
    level = [manifest]
    for _ in range(_DEPTH_LIMIT):
        containers = (value for value in level if isinstance(value, (dict, list)))
        level = [inner for value in containers for inner in (value.values() if isinstance(value, dict) else value)]
    if level:
        raise BuildError(_TOO_DEEP, field=field, remedy="This is no world bundle.")
    if not isinstance(manifest, dict):
        raise BuildError("it is no JSON object", field=field, remedy="This is no world bundle.")
    for member, kind in _MEMBERS.items():
        if not isinstance(manifest.get(member), kind):
            raise BuildError(f"its member {member} is missing or of another kind", field=field, remedy="See docs/bundle.md, section 2.")
    check_names(manifest)
    return manifest


def check_names(manifest: dict) -> None:
    """Checks the files that a manifest lists, and that it lists those that it names as graphs and as licence."""
    listed = _checked_files(manifest["files"])
    named = {}
    graphs = manifest["graphs"]
    if "f32" not in graphs or not graphs.keys() <= {"f32", "f16"}:
        raise BuildError("it must have f32, and may have f16", field="graphs", remedy="See docs/bundle.md, section 2.")
    for precision, kinds in graphs.items():
        if not isinstance(kinds, dict) or kinds.keys() - {JOINED} != set(GRAPH_KINDS):
            cause = f"its members must be {', '.join(GRAPH_KINDS)}, and may be {JOINED}"
            raise BuildError(cause, field=f"graphs.{precision}", remedy="See docs/bundle.md, section 2.")
        if (JOINED in kinds) != (JOINED in graphs["f32"]):
            raise BuildError("one precision has it, and the other not", field=f"graphs.{precision}.{JOINED}", remedy="See docs/bundle.md, section 2.")
        named |= {f"graphs.{precision}.{kind}": name for kind, name in kinds.items()}
    if manifest["licence"].get("file") is not None:
        named["licence.file"] = manifest["licence"]["file"]
    for field, name in named.items():
        _check_listed(checked_name(name, field), listed, field)


def _checked_files(entries: list) -> set[str]:
    """The names in `files`, without regard to case no two of them the same."""
    if not 1 <= len(entries) <= FILES_LIMIT:
        raise BuildError(f"it has {len(entries)} entries, 1 to {FILES_LIMIT} are allowed", field="files", remedy="See docs/bundle.md, section 3.")
    folded = {MANIFEST_FILE}
    for i, entry in enumerate(entries):
        entry = entry if isinstance(entry, dict) else {}
        path, size, sha256 = entry.get("path"), entry.get("size"), entry.get("sha256")
        checked_name(path, f"files[{i}].path")
        if path.lower() in folded:
            raise BuildError(f"{path} is listed twice, or is the manifest", field=f"files[{i}].path", remedy="See docs/bundle.md, section 1.")
        folded.add(path.lower())
        if type(size) is not int or size < 0:
            raise BuildError(f"{size!r:.50} is no size in bytes", field=f"files[{i}].size", remedy="See docs/bundle.md, section 2.")
        if not isinstance(sha256, str) or not _SHA256.fullmatch(sha256):
            raise BuildError(f"{sha256!r:.80} is not 64 lower-case hex digits", field=f"files[{i}].sha256", remedy="See docs/bundle.md, section 2.")
    return {entry["path"] for entry in entries}


def _check_listed(name: str, listed: set[str], field: str) -> None:
    if name not in listed:
        raise BuildError(f"{name} is not listed under files", field=field, remedy="See docs/bundle.md, section 1.")


def read_model(data: bytes, name: str) -> onnx.ModelProto:
    """The model in the file `name`, without external data."""
    try:
        return onnx.load_model_from_string(data)
    except DecodeError as error:
        raise BuildError(f"it is no ONNX model ({error})", field=name, remedy="Make the bundle again.") from error


def external_data(tensor: onnx.TensorProto, graph: str, manifest: dict) -> tuple[str, int]:
    """File and offset of a tensor's external data. The location is relative to the folder of `graph`, and must name a listed file."""
    entries = {entry.key: entry.value for entry in tensor.external_data}
    field = f"{graph}: {tensor.name}"
    location = checked_name(entries.get("location"), field)
    folder, slash, _ = graph.rpartition("/")
    file, offset = f"{folder}{slash}{location}", entries.get("offset", "0")
    _check_listed(file, {entry["path"] for entry in manifest["files"]}, field)
    # No file is longer than a number of 18 digits says.
    if not (offset.isascii() and offset.isdecimal() and len(offset) <= 18):
        raise BuildError(f"its offset {offset!r:.50} is no whole number", field=field, remedy="Make the bundle again.")
    return file, int(offset)


def copy_checked(source: BinaryIO, entry: dict, write: Callable[[bytes], object] = lambda chunk: None) -> None:
    """Gives all bytes of the file that `entry` of `files` describes to `write`. Size and checksum must be those of the entry."""
    digest, size = hashlib.sha256(), 0
    while chunk := source.read(_CHUNK):
        size += len(chunk)
        if size > entry["size"]:
            break
        digest.update(chunk)
        write(chunk)
    if size != entry["size"] or digest.hexdigest() != entry["sha256"]:
        raise BuildError("size or checksum differs from the manifest", field=entry["path"], remedy="Fetch it again.")


def open_listed(folder: Path, entry: dict) -> BinaryIO:
    """The file that `entry` of `files` describes."""
    path = folder / entry["path"]
    # A pipe in its place would never end.
    if not path.is_file():
        raise BuildError("the manifest lists it, and it is missing or no file", field=str(path), remedy="Fetch the bundle again.")
    return open(path, "rb")


def verify(folder: Path, manifest: dict) -> None:
    """Checks sizes and checksums of all files of the bundle in `folder`."""
    for entry in manifest["files"]:
        with open_listed(folder, entry) as source:
            copy_checked(source, entry)
