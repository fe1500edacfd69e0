"""The errors of damaged ZIP files, for archives of bundles and for torch's files."""

from __future__ import annotations

import struct
import zipfile

DAMAGE = (zipfile.BadZipFile, EOFError, NotImplementedError, OverflowError, UnicodeDecodeError, struct.error)
"""What `zipfile` raises for a damaged file."""


def check_position(info: zipfile.ZipInfo) -> None:
    """Raises `BadZipFile` for an entry before the start of the file. `zipfile` would let the file system refuse it."""
    if info.header_offset < 0:
        raise zipfile.BadZipFile(f"{info.filename} begins before the archive")
