"""Rotary position embedding over column, row and time; `docs/bundle.md` section 5."""

import numpy as np

from .geometry import Geometry
from .sigmas import bfloat16


def angles(geometry: Geometry, times: np.ndarray) -> np.ndarray:
    """`[frames, T, head_width / 2]` in radians, for frames at RoPE times `times`."""
    rows, columns = geometry.grid
    pairs = geometry.head_width // 2
    spatial, temporal = pairs // 4, pairs // 2

    top = min(rows, columns) * geometry.nyquist_fraction / 2
    f_xy = np.repeat(np.linspace(1.0, top, (spatial + 1) // 2) * np.pi, 2)[:spatial]
    f_t = np.repeat(geometry.time_base ** -(np.arange(0, temporal, 2) / temporal), 2)
    if geometry.rope_rounding == "bf16":
        f_xy, f_t = bfloat16(f_xy), bfloat16(f_t)

    token = np.arange(geometry.T)
    x = (2 * (token % columns) + 1) / columns - 1
    y = (2 * (token // columns) + 1) / rows - 1

    out = np.empty((len(times), geometry.T, pairs))
    out[:, :, :spatial] = x[:, None] * f_xy
    out[:, :, spatial : 2 * spatial] = y[:, None] * f_xy
    out[:, :, 2 * spatial :] = np.asarray(times, dtype=np.float64)[:, None, None] * f_t
    return out


def rotate(heads: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotates `heads` `[frames, heads, T, head_width]`. Input pairs are neighbours; in the output their parts are in the two halves."""
    even, odd = heads[..., 0::2], heads[..., 1::2]
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.concatenate((even * cos - odd * sin, odd * cos + even * sin), axis=-1)
