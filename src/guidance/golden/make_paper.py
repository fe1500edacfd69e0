"""Writes paper_*.json: what numpy makes of section 5.1 of the paper. Run it with numpy from this folder."""

import json

import numpy as np


def up(field, width, height):
    """Bilinear, half-pixel centres, edges clamped."""
    rows, columns = field.shape
    y = (np.arange(height) + 0.5) * rows / height - 0.5
    x = (np.arange(width) + 0.5) * columns / width - 0.5
    y0, x0 = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = (y - y0)[:, None], (x - x0)[None, :]
    at = lambda j, i: field[np.clip(j, 0, rows - 1)][:, np.clip(i, 0, columns - 1)]
    return (1 - fy) * ((1 - fx) * at(y0, x0) + fx * at(y0, x0 + 1)) + fy * (
        (1 - fx) * at(y0 + 1, x0) + fx * at(y0 + 1, x0 + 1)
    )


def slope(field, axis):
    return np.gradient(field, axis=axis) if field.shape[axis] > 1 else np.zeros_like(field)


for name, shape, (width, height), scale in [
    ("paper_grid", (6, 5, 7), (20, 11), 1.0),
    ("paper_clamped", (3, 4, 4), (9, 13), 40.0),
    ("paper_one_wide", (2, 4, 1), (6, 10), 1.0),
    ("paper_smaller", (2, 9, 12), (5, 4), 1.0),
]:
    rng = np.random.default_rng(15)
    z0, z1 = (scale * rng.standard_normal((2, *shape))).astype(np.float32)
    delta = (z1.astype(np.float64) - z0).mean(axis=0)
    motion = [-up(8 * slope(delta, axis), width, height) for axis in (1, 0)]
    motion = [np.clip(m, -limit, limit) for m, limit in zip(motion, (width, height))]
    first = z1[0].astype(np.float64)
    depth = up((first - first.min()) / (first.max() - first.min()), width, height)
    numbers = lambda a, digits: [float(f"%.{digits}g" % v) for v in np.ravel(a)]
    golden = {
        "shape": shape,
        "render": [width, height],
        "z0": numbers(z0, 9),
        "z1": numbers(z1, 9),
        "x": numbers(motion[0], 8),
        "y": numbers(motion[1], 8),
        "depth": numbers(depth, 8),
    }
    with open(name + ".json", "w", encoding="ascii", newline="\n") as file:
        file.write(json.dumps(golden) + "\n")
