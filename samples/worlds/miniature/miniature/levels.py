"""Four fixed levels, one of each family, and walks through them.

A level is the ground within `REACH` of a scene's origin, closed by hills. Walks are held out, not scenes: the walks for evaluation have
seeds of their own, and training refuses each of them by its SHA-256 (`held-out-walks.txt` beside this package).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .clips import FAMILIES, RATE, Clip, draw
from .scripts import random_script

# Scene seed of each level.
SEEDS = {"forest": 1001, "sword": 1001, "desert": 1001, "snow": 1001}
# How far from the origin a walk may start, east or north, in metres.
REACH = 50.0
# Share of walks that start like a rollout: on the path at the origin, looking along it.
FROM_ORIGIN = 0.15
# Seconds within which a walk's first look begins.
FIRST_LOOK = 0.3
# Held-out walks of each level, and their length in seconds.
HELD_OUT, HELD_OUT_SECONDS = 8, 60.0
LIST = Path(__file__).resolve().parent.parent / "held-out-walks.txt"
# Their scripts, for programs that cannot draw numpy's random numbers.
SCRIPTS = LIST.parent / "held-out-walks"
_TRAINING, _EVALUATION = 1, 2


class HeldOutWalk(ValueError):
    """A held-out walk was found among those of training."""


@dataclass(frozen=True)
class Walk:
    """One walk through a level."""

    family: str
    script: str  # a control script whose first comment is where the walk starts

    @property
    def seed(self) -> int:
        """The level's scene seed."""
        return SEEDS[self.family]

    @property
    def start(self) -> str | None:
        """East, north and direction as the renderer's option; `None` for a start at the origin."""
        return read_start(self.script)

    @property
    def sha256(self) -> str:
        """Identity of the walk in the list of held-out walks."""
        return digest(self.family, self.seed, self.script)


def read_start(script: str) -> str | None:
    """The start that a script's comment gives."""
    for line in script.splitlines():
        if line.startswith(_START):
            return line.removeprefix(_START)
    return None


_START = "# start "


def digest(family: str, seed: int, script: str) -> str:
    """SHA-256 of a walk: its level, its start and its controls."""
    return hashlib.sha256(f"{family} {seed}\n{script}".encode()).hexdigest()


def training_walk(number: int, seconds: float) -> Walk:
    """Training walk `number`; the families alternate."""
    return _walk(FAMILIES[number % len(FAMILIES)], np.random.default_rng([_TRAINING, number]), seconds)


def held_out_walk(family: str, number: int) -> Walk:
    """Held-out walk `number` of a level."""
    return _walk(family, np.random.default_rng([_EVALUATION, FAMILIES.index(family), number]), HELD_OUT_SECONDS)


def write_held_out_walks(folder: Path = SCRIPTS) -> list[Path]:
    """Writes the script of every held-out walk to `FAMILY-NUMBER.txt` in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for family in FAMILIES:
        for number in range(HELD_OUT):
            written.append(folder / f"{family}-{number}.txt")
            written[-1].write_bytes(held_out_walk(family, number).script.encode())
    return written


def _walk(family: str, rng: np.random.Generator, seconds: float) -> Walk:
    east, north = rng.uniform(-REACH, REACH, 2)
    yaw, from_origin = rng.uniform(0, 360), rng.random() < FROM_ORIGIN
    header, *lines = random_script(rng, seconds, FIRST_LOOK).splitlines()
    start = [] if from_origin else [f"{_START}{east:.2f},{north:.2f},{yaw:.1f}"]
    return Walk(family, "\n".join([header, *start, *lines]) + "\n")


def held_out_list(path: Path = LIST) -> frozenset[str]:
    """The SHA-256 of every held-out walk; `#` starts a comment."""
    entries = (line.partition("#")[0].split() for line in path.read_text(encoding="utf-8").splitlines())
    found = frozenset(entry[0] for entry in entries if entry)
    if not found:
        raise ValueError(f"{path} names no walk")
    return found


def require_trainable(clips: list[Clip]) -> list[Clip]:
    """`clips`, unless one of them is a held-out walk, or has no script that says which walk it is."""
    require_trainable_latents([clip.path for clip in clips])
    return clips


def require_trainable_latents(paths: list[Path]) -> None:
    """Refuses files of held-out walks, or of a walk without a script beside it that says which one it is."""
    refused = held_out_list()
    for path in paths:
        script = path.with_suffix(".txt")
        if not script.is_file():
            raise HeldOutWalk(f"{path.name} has no script: nothing shows that it is not a held-out walk. Draw it again.")
        family, seed, *_ = path.stem.split("-")
        if digest(family, int(seed), script.read_text(encoding="utf-8")) in refused:
            raise HeldOutWalk(f"{path.name} is held out for evaluation ({LIST.name}). Remove it from the training clips")


def render(renderer: Path, path: Path, walk: Walk, seconds: float, size: tuple[int, int], rate: int = RATE) -> Clip:
    """Renders the first `seconds` of a walk to `path`, `rate` pictures a second, unless the file exists."""
    clip = Clip(path, *size)
    if not clip.path.with_suffix(".rgb").is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        script = path.with_suffix(".txt")
        script.write_text(walk.script, encoding="utf-8")
        draw(renderer, clip, walk.family, walk.seed, script, seconds, walk.start, level=True, rate=rate)
    return clip


def draw_training_clip(renderer: Path, folder: Path, number: int, seconds: float, size: tuple[int, int]) -> Clip:
    """Renders training clip `number`."""
    walk = training_walk(number, seconds)
    return render(renderer, folder / f"{walk.family}-{walk.seed}-{number}", walk, seconds, size)


def held_out_clips(renderer: Path, folder: Path, count: int, seconds: float, size: tuple[int, int]) -> list[Clip]:
    """The first `seconds` of `count` held-out walks of each level."""
    walks = [(held_out_walk(family, number), number) for family in FAMILIES for number in range(count)]
    assert {walk.sha256 for walk, _ in walks} <= held_out_list(), f"{LIST.name} does not list these walks"
    return [render(renderer, folder / f"{w.family}-{w.seed}-held-out-{n}", w, seconds, size) for w, n in walks]
