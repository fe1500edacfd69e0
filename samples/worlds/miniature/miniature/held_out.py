"""Scene seeds and scripts that training must never see: `held-out.txt` beside this package."""

from __future__ import annotations

from pathlib import Path

LIST = Path(__file__).resolve().parent.parent / "held-out.txt"
# Scene seeds for training: disjoint from the list, and checked against it before a scene is rendered.
TRAINING_SEEDS = range(1000, 1_000_000)


class HeldOutSeed(ValueError):
    """Training requested a seed of the held-out list."""


def held_out_seeds(path: Path = LIST) -> frozenset[int]:
    """The seeds of the list: numbers and ranges `A..B`, both ends included, one a line; `#` starts a comment."""
    seeds: set[int] = set()
    for line in path.read_text(encoding="utf-8").splitlines():
        entry = line.partition("#")[0].strip()
        if entry:
            first, _, last = entry.partition("..")
            seeds.update(range(int(first), int(last or first) + 1))
    if not seeds:
        raise ValueError(f"{path} names no seed")
    return frozenset(seeds)


def require_trainable(seed: int) -> int:
    """`seed`, unless it is held out."""
    if seed in held_out_seeds():
        raise HeldOutSeed(f"scene seed {seed} is held out for evaluation ({LIST.name}). Train on seeds from {TRAINING_SEEDS.start}")
    return seed
