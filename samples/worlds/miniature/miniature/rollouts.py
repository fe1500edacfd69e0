"""Rollouts of a bundle on held-out walks through the levels, by Cairn's library, against the renderer's own pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import levels
from .clips import FAMILIES, LATENTS_PER_SECOND, Clip

# Seconds after the first picture at which pictures are compared. Detail and brightness are means over what lies between them.
HORIZONS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0)
# Noise seed of every rollout.
SEED = 1


@dataclass
class Rollout:
    """Scores of one rollout, by horizon in seconds."""

    psnr: dict[float, tuple[float, float, float]] = field(default_factory=dict)  # dB: the world, the first picture, its reconstruction
    detail: dict[float, float] = field(default_factory=dict)  # over the truth's, since the horizon before
    brightness: dict[float, float] = field(default_factory=dict)  # likewise
    shown: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)  # the world's pictures and the true ones


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """PSNR of two 8-bit pictures in dB."""
    return float(10 * np.log10(255**2 / max(1e-9, np.mean(np.square(a.astype(np.float32) - b)))))


def detail(picture: np.ndarray) -> float:
    """Mean absolute difference of neighbouring pixels."""
    wide = picture.astype(np.float32)
    return float(sum(np.abs(np.diff(wide, axis=axis)).mean() for axis in (0, 1)))


def score(true: np.ndarray, append: Callable[[np.ndarray], np.ndarray], step: Callable[[int], np.ndarray]) -> Rollout:
    """Scores a rollout against `true` `[1 + N, H, W, 3]`, a picture for each latent step: `append` starts it from the first picture and returns
    the reconstruction, `step` makes latent step q, from 1, and returns its last picture.
    """
    found, repeated = Rollout(), true[0]
    reconstruction = append(repeated)
    found.shown.append((reconstruction, repeated))
    details, lights = [], []
    for q in range(1, len(true)):
        picture = step(q)
        details.append(detail(picture) / max(1e-6, detail(true[q])))
        lights.append(picture.mean() / max(1e-6, true[q].mean()))
        seconds = q / LATENTS_PER_SECOND
        if seconds in HORIZONS:
            found.psnr[seconds] = psnr(picture, true[q]), psnr(repeated, true[q]), psnr(reconstruction, true[q])
            found.detail[seconds], found.brightness[seconds] = float(np.mean(details)), float(np.mean(lights))
            found.shown.append((picture, true[q]))
            details, lights = [], []
    return found


def held_out(bundle: Path, renderer: Path, folder: Path, count: int, seconds: float, say: Callable[[str], None]) -> list[Rollout]:
    """Rollouts of `bundle` on the first `seconds` of `count` held-out walks of each level; a PPM of each goes into `folder`, truth above."""
    import cairn

    folder.mkdir(parents=True, exist_ok=True)
    all_found = []
    with cairn.Device.cpu() as device, device.load_world(bundle) as world:
        size = world.info.render_width, world.info.render_height
        opaque = np.full((size[1], size[0], 1), 255, np.uint8)
        for family in FAMILIES:
            of_family = []
            for number in range(count):
                walk = levels.held_out_walk(family, number)
                path = folder / f"{family}-{walk.seed}-{number}-{seconds:g}"
                clip: Clip = levels.render(renderer, path, walk, seconds, size, LATENTS_PER_SECOND)
                script = cairn.Script(walk.script)
                with world.rollout(seed=SEED) as rollout:

                    def append(picture: np.ndarray) -> np.ndarray:
                        rollout.append(np.concatenate([picture, opaque], -1))
                        return rollout.anchor().picture()[..., :3].copy()

                    def step(q: int) -> np.ndarray:
                        rollout.step(script.controls(q, LATENTS_PER_SECOND))
                        return rollout.anchor().picture()[..., :3].copy()

                    of_family.append(score(clip.pictures(), append, step))
                sheet = np.concatenate([np.concatenate([pair[1 - row] for pair in of_family[-1].shown], 1) for row in range(2)])
                path.with_suffix(".ppm").write_bytes(b"P6\n%d %d\n255\n" % sheet.shape[1::-1] + sheet.tobytes())
            for line in lines(family, of_family):
                say(line)
            all_found += of_family
    for line in lines("mean", all_found):
        say(line)
    return all_found


def lines(name: str, rollouts: list[Rollout]) -> list[str]:
    """A line for each horizon: means over rollouts, and the standard error of the first."""
    out = []
    for seconds in rollouts[0].psnr:
        world, repeat, reconstruction = np.mean([r.psnr[seconds] for r in rollouts], 0)
        error = np.std([r.psnr[seconds][0] for r in rollouts]) / max(1, len(rollouts) - 1) ** 0.5
        shown = f"{name:8} {seconds:4g} s  PSNR {world:.2f} ± {error:.2f} dB (first picture {repeat:.2f}, its reconstruction {reconstruction:.2f})"
        means = [np.mean([getattr(r, of)[seconds] for r in rollouts]) for of in ("detail", "brightness")]
        out.append(f"{shown}  detail {means[0]:.2f}  brightness {means[1]:.2f}")
    return out
