"""Clips by the scene renderer: colour, and the controls that caused it.

A clip is a walk of N latent steps: picture 0 is what is seen at its start, and step q (from 1) has the pictures 4 q - 3 to 4 q, a
sixtieth of a second apart, and the controls of that fifteenth of a second. Files lie side by side in one folder:

    forest-1000.rgb        (1 + 4 N) x height x width x 3 bytes
    forest-1000.controls   a line for each step: dx dy scroll, then the codes of the keys held
    forest-1000.txt        the control script

A file under its own name is complete: each is written under another name first.
"""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .held_out import TRAINING_SEEDS, require_trainable
from .scripts import random_script

FAMILIES = ("forest", "sword", "desert", "snow")
LATENTS_PER_SECOND = 15
PICTURES_PER_LATENT = 4
# Pictures per second.
RATE = LATENTS_PER_SECOND * PICTURES_PER_LATENT
BUTTONS = 256


@dataclass(frozen=True)
class Clip:
    """One walk: path and size of its pictures."""

    path: Path
    width: int
    height: int

    @property
    def family(self) -> str:
        """Family of the scene."""
        return self.path.name.partition("-")[0]

    def pictures(self) -> np.ndarray:
        """`[1 + 4 N, height, width, 3]` uint8, mapped from the file."""
        return np.memmap(self.path.with_suffix(".rgb"), np.uint8, "r").reshape(-1, self.height, self.width, 3)

    def controls(self) -> np.ndarray:
        """`[N, 3 + 256]` float32: mouse, buttons and scroll, as the transformer takes them."""
        return read_controls(self.path.with_suffix(".controls").read_text(encoding="utf-8"))


def read_controls(text: str) -> np.ndarray:
    """The renderer's list of controls as numbers: mouse x and y, one number for each button, scroll."""
    lines = text.splitlines()
    out = np.zeros((len(lines), 2 + BUTTONS + 1), np.float32)
    for row, line in zip(out, lines):
        dx, dy, scroll, *keys = line.split()
        row[0], row[1], row[-1] = float(dx), float(dy), float(scroll)
        row[[2 + int(key) for key in keys]] = 1
    return out


def clip_name(number: int) -> tuple[str, int]:
    """Family and scene seed of training clip `number`. The families alternate, and no scene comes twice."""
    seed = TRAINING_SEEDS.start + number // len(FAMILIES)
    return FAMILIES[number % len(FAMILIES)], require_trainable(seed)


def render(renderer: Path, folder: Path, number: int, seconds: float, size: tuple[int, int]) -> Clip:
    """Renders training clip `number`, unless it exists: `seconds` of world time, a whole number of latent steps."""
    family, seed = clip_name(number)
    clip = Clip(folder / f"{family}-{seed}", *size)
    if not clip.path.with_suffix(".rgb").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        script = clip.path.with_suffix(".txt")
        script.write_text(random_script(np.random.default_rng([seed, number]), seconds), encoding="utf-8")
        draw(renderer, clip, family, seed, script, seconds)
    return clip


def draw(renderer: Path, clip: Clip, family: str, seed: int, script: Path, seconds: float, start: str | None = None, level: bool = False, rate: int = RATE) -> None:
    """Runs the renderer for the clip's files, `rate` pictures a second; hills close a `level`. A file under the clip's name is complete."""
    partial = clip.path.with_suffix(".partial")
    command = [renderer, "clip", "--scene", family, "--seed", str(seed), "--script", script, "--seconds", str(seconds)]
    command += ["--rate", str(rate), "--size", f"{clip.width}x{clip.height}", "--raw", partial]
    command += ["--controls", clip.path.with_suffix(".controls")]
    command += ["--start", start] if start else []
    command += ["--level"] if level else []
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    os.replace(partial, clip.path.with_suffix(".rgb"))


def remove(clip: Clip) -> None:
    """Removes all files of a clip."""
    for suffix in (".rgb", ".controls", ".txt"):
        clip.path.with_suffix(suffix).unlink(missing_ok=True)


def ready(folder: Path, size: tuple[int, int]) -> list[Clip]:
    """All complete clips of a folder, in a fixed order."""
    return [Clip(path.with_suffix(""), *size) for path in sorted(folder.glob("*.rgb"))]
