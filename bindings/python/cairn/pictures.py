"""Pictures as numpy arrays: `uint8`, `[height, width, channels]`, rows from top to bottom, display-referred sRGB."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _interface as c
from .errors import refuse

Bytes = npt.NDArray[np.uint8]
"""`uint8`, `[height, width, 4]`."""

Halves = npt.NDArray[np.float16]
"""`float16`: pictures `[height, width, 4]`, or motion `[height, width, 2]`."""

Floats = npt.NDArray[np.float32]
"""`float32`, such as a latent: `[channels, height, width]`."""

Order = Literal["rgba", "bgra"]
"""Which channel comes first. Alpha is straight and comes last."""

_FORMATS = {"rgba": c.FORMAT_RGBA8, "bgra": c.FORMAT_BGRA8}


def _format(order: str) -> int:
    if order not in _FORMATS:
        raise refuse("order", f"{order!r} is no order of channels", 'Use "rgba" or "bgra"')
    return _FORMATS[order]


def _pitch(array: Bytes | Halves) -> int | None:
    """Bytes from one row to the next if the library can use the array's own memory."""
    height, width, _ = array.shape
    if array.strides[2] != array.itemsize or array.strides[1] != 4 * array.itemsize:
        return None
    row, pitch = int(width) * 4 * array.itemsize, int(array.strides[0])
    if height == 1:
        return row
    return pitch if pitch >= row else None


def source(picture: npt.ArrayLike, order: Order) -> tuple[c.Picture, Bytes]:
    """A picture for the library to read, and the array that owns its memory: keep the array until the call has returned.

    The caller's memory is used directly if the picture has four channels and its pixels are contiguous; there may be space between rows, as in
    a part of a larger picture. Otherwise it is copied; three channels get an alpha of 255.
    """
    array: Any = np.asarray(picture)
    if array.dtype != np.uint8:
        remedy = "Give uint8 from 0 to 255; of floats from 0 to 1: (255 * picture).round().astype(numpy.uint8)"
        raise refuse("picture", f"is of the type {array.dtype}", remedy)
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise refuse("picture", f"has the shape {list(array.shape)}", "Give [height, width, 4], or 3 without alpha")
    height, width, channels = array.shape
    if height == 0 or width == 0:
        raise refuse("picture", f"has the shape {list(array.shape)}", "Give at least one pixel")
    if channels == 3:
        opaque = np.full((height, width, 4), 255, np.uint8)
        opaque[:, :, :3] = array
        array = opaque
    pitch = _pitch(array)
    if pitch is None:
        array = np.ascontiguousarray(array)
        pitch = width * 4
    size = (height - 1) * pitch + width * 4
    struct = c.Picture(
        format=_format(order), width=width, height=height, pixels=array.ctypes.data, size=size, row_pitch=pitch
    )
    return struct, array


def target(
    out: Bytes | Halves | None, height: int, width: int, order: Order, dtype: Any = np.uint8
) -> tuple[c.Target, Any]:
    """Memory into which the library writes a picture: `out`, or a new array of that type."""
    form = _format(order)
    if dtype == np.float16:
        if order != "rgba":
            raise refuse("order", "half floats are red first", 'Use "rgba"')
        form = c.FORMAT_RGBA16F
    if out is None:
        out = np.empty((height, width, 4), dtype)
    expected = (height, width, 4)
    if not isinstance(out, np.ndarray) or out.dtype != dtype or out.shape != expected:
        found = f"{out.dtype} {list(out.shape)}" if isinstance(out, np.ndarray) else type(out).__name__
        wanted = f"numpy.empty({expected}, numpy.{np.dtype(dtype).name})"
        raise refuse("out", f"is {found}", f"Give {wanted}, or None for a new array")
    pitch = _pitch(out)
    if pitch is None or not out.flags.writeable:
        why = "cannot be written" if not out.flags.writeable else "has pixels that do not lie side by side"
        raise refuse("out", why, "Give an array of its own, or None for a new one")
    size = (height - 1) * pitch + width * 4 * out.itemsize
    struct = c.Target(format=form, width=width, height=height, pixels=out.ctypes.data, size=size, row_pitch=pitch)
    return struct, out
