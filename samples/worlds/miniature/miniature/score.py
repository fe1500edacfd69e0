"""How well the autoencoder shows what it has never seen: places, or walks through the levels it knows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from . import autoencoder, perceptual
from .clips import FAMILIES, PICTURES_PER_LATENT, Clip, draw
from .held_out import held_out_seeds

# One of the held-out places of each kind, walked by the kind's own script, which is no training script.
SEED = 41
SECONDS = 4.0
# Seconds of each held-out walk through a level.
WALK_SECONDS = 1.0
SCRIPTS = Path(__file__).resolve().parents[3] / "scripts"
# Times that a rollout's first latent is decoded before its pictures count.
PRIMING = 3
# LPIPS takes one picture of so many: with VGG16 it costs more than all else.
LPIPS_EVERY = 10


@dataclass(frozen=True)
class Figures:
    """What one clip's reconstruction is like."""

    psnr: float  # over all pictures together, in decibels
    detail: float  # mean difference of neighbouring pixels, over that of the true pictures
    lpips: dict[str, float]  # by network

    @staticmethod
    def mean(figures: list["Figures"]) -> "Figures":
        """Of several clips."""
        of = lambda value: float(np.mean([value(f) for f in figures]))
        return Figures(of(lambda f: f.psnr), of(lambda f: f.detail), {n: of(lambda f: f.lpips[n]) for n in figures[0].lpips})

    def __str__(self) -> str:
        names = {"alex": "AlexNet", "vgg": "VGG16"}
        distances = "".join(f"  LPIPS {names[network]} {value:.3f}" for network, value in self.lpips.items())
        return f"PSNR {self.psnr:.2f} dB{distances}  detail {self.detail:.2f}"


def held_out_clips(renderer: Path, folder: Path, size: tuple[int, int]) -> list[Clip]:
    """A clip of each kind of place, drawn unless it is there."""
    assert SEED in held_out_seeds()
    folder.mkdir(parents=True, exist_ok=True)
    clips = [Clip(folder / f"{family}-{SEED}", *size) for family in FAMILIES]
    for clip in clips:
        if not clip.path.with_suffix(".rgb").is_file():
            draw(renderer, clip, clip.family, SEED, SCRIPTS / f"{clip.family}.txt", SECONDS)
    return clips


class Judge:
    """Scores one autoencoder."""

    def __init__(self, parameters: dict, networks: dict[str, perceptual.Weights]):
        """`networks` are those that LPIPS is measured with: `alex`, `vgg`, both or none."""
        self._encode: Callable = jax.jit(lambda rgb: autoencoder.encode(parameters, rgb.astype(jnp.float32) / 255))
        self._decode: Callable = jax.jit(lambda z: autoencoder.decode(parameters, z))
        self._distances: dict[str, Callable] = {
            # One pair at a time: VGG16's activations of a picture are large.
            name: jax.jit(lambda true, made, name=name, weights=weights: perceptual.distance(weights, name, true[None], made[None])[0])
            for name, weights in networks.items()
        }

    def figures(self, clip: Clip) -> Figures:
        """Of one clip."""
        true, made = self.reconstruct(clip)
        pairs = list(zip(true[LPIPS_EVERY - 1 :: LPIPS_EVERY], made[LPIPS_EVERY - 1 :: LPIPS_EVERY]))
        lpips = {name: float(np.mean([distance(*pair) for pair in pairs])) for name, distance in self._distances.items()}
        return Figures(psnr(true, made), detail(made) / detail(true), lpips)

    def reconstruct(self, clip: Clip) -> tuple[np.ndarray, np.ndarray]:
        """True and decoded pictures of a clip from step 1 on, `[4 N, H, W, 3]` in [0, 1]; the decoder is primed with the seed's still."""
        pictures = clip.pictures()
        steps = (len(pictures) - 1) // PICTURES_PER_LATENT
        quads = pictures[1:].reshape(steps, PICTURES_PER_LATENT, *pictures.shape[1:])
        seed = np.repeat(pictures[:1], PICTURES_PER_LATENT, 0)[None]
        latents = np.concatenate([np.asarray(self._encode(rgb[None])) for rgb in [seed[0], *quads]])
        # A decoded picture depends on few latents before its own; pieces keep the memory small.
        before, piece, made = PRIMING + 1, 8, []
        latents = np.concatenate([np.repeat(latents[:1], PRIMING, 0), latents])
        for at in range(before, len(latents), piece):
            part = latents[at - before : at + piece]
            padded = np.concatenate([part, np.repeat(part[-1:], before + piece - len(part), 0)])
            pictures_ = np.asarray(self._decode(padded[None]))[0]
            made.append(pictures_[PICTURES_PER_LATENT * before : PICTURES_PER_LATENT * len(part)])
        true = quads.reshape(-1, *pictures.shape[1:]).astype(np.float32) / 255
        return true, np.clip(np.concatenate(made), 0, 1)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Over all pictures together, in decibels."""
    return float(-10 * np.log10(np.mean(np.square(a - b))))


def detail(pictures: np.ndarray) -> float:
    """Mean absolute difference of neighbouring pixels."""
    return float(sum(np.abs(np.diff(pictures, axis=axis)).mean(dtype=np.float64) for axis in (-3, -2)))
