"""Noise levels: the three kinds of schedule, in exact arithmetic until the last rounding."""

from fractions import Fraction

import numpy as np


def table(stock: tuple[float, ...], schedule: str, rounding: str) -> np.ndarray:
    """Levels of `stock`, `refined:N` or `explicit:a:b:...:0` in float32 and rounded as the manifest says."""
    kind, _, argument = schedule.partition(":")
    points = [Fraction(repr(level)) for level in stock]
    if kind == "refined":
        while len(points) < int(argument) + 1:
            widths = [a - b for a, b in zip(points, points[1:])]
            widest = widths.index(max(widths))
            points.insert(widest + 1, (points[widest] + points[widest + 1]) / 2)
    elif kind == "explicit":
        points = [Fraction(level) for level in argument.split(":")]
    else:
        assert kind == "stock"
    levels = np.array([float(point) for point in points], dtype=np.float32)
    return bfloat16(levels) if rounding == "bf16" else levels


def bfloat16(x: np.ndarray) -> np.ndarray:
    """Nearest bfloat16, ties to even, as float32."""
    bits = np.ascontiguousarray(x, dtype=np.float32).view(np.uint32)
    bits = bits + 0x7FFF + ((bits >> 16) & 1)
    return (bits & np.uint32(0xFFFF0000)).view(np.float32)
