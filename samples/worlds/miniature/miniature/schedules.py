"""The noise levels that a rollout goes through: the stock list, and the refined ones of `docs/bundle.md`'s sampler."""

from __future__ import annotations

from fractions import Fraction


def refined(stock: tuple[float, ...], passes: int) -> tuple[float, ...]:
    """The schedule `refined:passes`: the widest interval is split at its middle, of equals the earlier one, until there are as many
    intervals as passes. Computes with exact decimals, so that equal intervals are equal.
    """
    points = [Fraction(str(point)) for point in stock]
    while len(points) <= passes:
        at = max(range(len(points) - 1), key=lambda i: points[i] - points[i + 1])
        points.insert(at + 1, (points[at] + points[at + 1]) / 2)
    return tuple(float(point) for point in points)


def passes(schedule: tuple[float, ...]) -> list[tuple[float, float]]:
    """For every pass of a schedule: the noise level before it, and its own. For the first, both are the first level."""
    return list(zip((schedule[0], *schedule), schedule[:-1]))
