"""Splits large files, for machines that transfer small files only.

`split` writes `NAME.000`, `NAME.001` and so on, and then `NAME.pieces`: the length and SHA-256 of the whole. `join` puts them together
again, and writes the file only if its checksum is right.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

# Bytes of a piece; as base64 it is below 15 MiB too.
LONGEST = 11_000_000


class BrokenPieces(ValueError):
    """Pieces are missing, or do not have the file's checksum."""


def split(path: Path, folder: Path, longest: int = LONGEST) -> list[Path]:
    """Writes the pieces of the file at `path` into `folder`, and replaces earlier ones. The list of pieces is written last."""
    folder.mkdir(parents=True, exist_ok=True)
    content = path.read_bytes()
    written = [folder / f"{path.name}.{number:03}" for number in range(-(-len(content) // longest))]
    for earlier in folder.glob(f"{path.name}.*"):
        earlier.unlink()
    for number, piece in enumerate(written):
        piece.write_bytes(content[number * longest : (number + 1) * longest])
    listed = {"bytes": len(content), "pieces": len(written), "sha256": hashlib.sha256(content).hexdigest()}
    (folder / f"{path.name}.pieces").write_text(json.dumps(listed) + "\n", encoding="utf-8")
    return written


def join(folder: Path, path: Path) -> None:
    """Joins the pieces in `folder` to the file at `path`."""
    listed = json.loads((folder / f"{path.name}.pieces").read_text(encoding="utf-8"))
    pieces = [folder / f"{path.name}.{number:03}" for number in range(listed["pieces"])]
    if missing := [piece.name for piece in pieces if not piece.is_file()]:
        raise BrokenPieces(f"{folder} lacks {', '.join(missing)}")
    content = b"".join(piece.read_bytes() for piece in pieces)
    if len(content) != listed["bytes"] or hashlib.sha256(content).hexdigest() != listed["sha256"]:
        raise BrokenPieces(f"{folder}: the pieces of {path.name} make another file than the one that was cut. Fetch them again")
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    os.replace(partial, path)
