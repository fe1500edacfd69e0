"""Random control scripts for training, which imitate a player.

They are in the format of `docs/control-script.md`, so that only the renderer converts them to the controls of latent steps.
"""

from __future__ import annotations

import numpy as np

# Rotation per mouse count in radians, as in the scenes' walker.
TURN_PER_COUNT = 0.0022
# Keys that are held together, and how often.
HOLDS = (
    ("W", 0.46),
    ("W SHIFT", 0.13),
    ("S", 0.08),
    ("A", 0.07),
    ("D", 0.07),
    ("W A", 0.04),
    ("W D", 0.04),
    ("", 0.11),
)
# A look to the side: angle in radians, and duration in seconds.
LOOK = (0.1, 1.4)
LOOK_SECONDS = (0.3, 2.2)
# A look away and back: angle in radians, and seconds until the player turns back.
AWAY = (0.7, 2.6)
AWAY_SECONDS = (0.5, 8.0)
# Maximum pitch in radians.
TILT = 0.35


def random_script(rng: np.random.Generator, seconds: float, first_look: float = 1.5) -> str:
    """A script of `seconds` with independent key presses and looks. The first look begins within `first_look` seconds."""
    lines = ["cairn-controls 1", *_keys(rng, seconds), *_looks(rng, seconds, first_look), f"{seconds:.3f} end"]
    return "\n".join(lines) + "\n"


def _keys(rng: np.random.Generator, seconds: float) -> list[str]:
    names, shares = zip(*HOLDS)
    lines, now = [], 0.0
    while now < seconds:
        until = min(now + rng.uniform(0.6, 4.0), seconds)
        held = names[rng.choice(len(names), p=np.asarray(shares) / sum(shares))]
        if held and until - now > 0.01:
            lines.append(f"{now:.3f}..{until:.3f} hold {held}")
        now = until
    return lines


def _looks(rng: np.random.Generator, seconds: float, first: float) -> list[str]:
    lines: list[str] = []
    now, tilt = rng.uniform(0.0, first), 0.0

    def move(length: float, yaw: float, pitch: float) -> None:
        nonlocal now
        until = min(now + length, seconds)
        if until - now > 0.02:
            share = (until - now) / length
            dx, dy = yaw * share / TURN_PER_COUNT, -pitch * share / TURN_PER_COUNT
            lines.append(f"{now:.3f}..{until:.3f} mouse {dx:.2f} {dy:.2f}")
        now = until

    while now < seconds:
        kind = rng.random()
        side = rng.choice([-1.0, 1.0])
        if kind < 0.55:
            target = rng.uniform(-TILT, TILT) if rng.random() < 0.3 else tilt * 0.5
            move(rng.uniform(*LOOK_SECONDS), side * rng.uniform(*LOOK), target - tilt)
            tilt = target
        elif kind < 0.75:
            turn, length = side * rng.uniform(*AWAY), rng.uniform(0.6, 1.8)
            move(length, turn, 0.0)
            now += rng.uniform(*AWAY_SECONDS)
            move(length, -turn, 0.0)
        now += rng.exponential(0.9)
    return lines
