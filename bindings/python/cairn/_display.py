"""Representations of anchors and rollouts in notebooks, and PNG files, written with zlib alone."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .errors import Error
from .pictures import Bytes

if TYPE_CHECKING:
    from .rollout import Anchor, Rollout

_GAP = 4
"""Transparent pixels between the pictures of a contact sheet."""


def png(picture: Bytes) -> bytes:
    """A picture, `uint8` `[height, width, 4]`, as a PNG file."""
    return _file(picture.shape, [_chunk(b"IDAT", _compressed(picture))])


def animation(pictures: Sequence[Bytes], rate: int) -> bytes:
    """Pictures of one size as an animated PNG of `rate` pictures per second, in an endless loop. Viewers without support for it show the first
    picture.
    """
    chunks = [_chunk(b"acTL", struct.pack(">II", len(pictures), 0))]
    number = 0
    for i, picture in enumerate(pictures):
        height, width, _ = picture.shape
        # Complete frames, each in place of the previous one.
        chunks.append(_chunk(b"fcTL", struct.pack(">IIIIIHHBB", number, width, height, 0, 0, 1, rate, 0, 0)))
        number += 1
        data = _compressed(picture)
        if i == 0:
            chunks.append(_chunk(b"IDAT", data))
        else:
            chunks.append(_chunk(b"fdAT", struct.pack(">I", number) + data))
            number += 1
    return _file(pictures[0].shape, chunks)


def contact_sheet(pictures: Sequence[Bytes], columns: int) -> Bytes:
    """Pictures of one size in rows, from left to right and from top to bottom, as one picture."""
    height, width, _ = pictures[0].shape
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = np.zeros((rows * (height + _GAP) - _GAP, columns * (width + _GAP) - _GAP, 4), np.uint8)
    for i, picture in enumerate(pictures):
        y, x = (i // columns) * (height + _GAP), (i % columns) * (width + _GAP)
        sheet[y : y + height, x : x + width] = picture
    return sheet


def _file(shape: tuple[int, ...], chunks: list[bytes]) -> bytes:
    height, width, _ = shape
    # 8 bits per channel, RGBA, rows from top to bottom, sRGB.
    head = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)) + _chunk(b"sRGB", b"\0")
    return b"".join([b"\x89PNG\r\n\x1a\n", head, *chunks, _chunk(b"IEND", b"")])


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _compressed(picture: Bytes) -> bytes:
    """The picture's rows as compressed PNG data. Each row uses the filter "Sub" or "Up", whichever gives the smaller sum of absolute
    differences.
    """
    height, width, _ = picture.shape
    left = np.zeros_like(picture)
    left[:, 1:] = picture[:, :-1]
    above = np.zeros_like(picture)
    above[1:] = picture[:-1]
    filtered = np.stack([picture - left, picture - above]).reshape(2, height, 4 * width)
    sizes = np.abs(filtered.view(np.int8).astype(np.int16)).sum(axis=2, dtype=np.int64)
    rows = np.empty((height, 1 + 4 * width), np.uint8)
    rows[:, 0] = 1 + (sizes[1] < sizes[0])
    rows[:, 1:] = np.where((sizes[1] < sizes[0])[:, None], filtered[1], filtered[0])
    return zlib.compress(rows.tobytes(), 6)


def anchor(shown: Anchor) -> dict[str, object]:
    """A notebook's representation of an anchor."""
    if shown.closed:
        return {"text/plain": "an anchor that is closed"}
    info = shown.info
    text = f"anchor {info.latent}: {info.pictures} of {info.width}x{info.height} pixels{', a cut' if info.cut else ''}"
    return {"text/plain": text, "image/png": png(contact_sheet(shown.pictures(), info.pictures))}


def rollout(shown: Rollout) -> dict[str, object]:
    """A notebook's representation of a rollout; without pictures before the first anchor, and while a step is running."""
    if shown.closed:
        return {"text/plain": "a rollout that is closed"}
    try:
        info = shown.info
        text = f"rollout of {info.latents} latents, seed {info.seed}, {info.operating_point}"
        if info.latents == 0:
            return {"text/plain": text}
        with shown.anchor() as last:
            return {"text/plain": text, "image/png": png(contact_sheet(last.pictures(), last.info.pictures))}
    except Error as why:
        return {"text/plain": f"a rollout: {why.cause or why}"}
