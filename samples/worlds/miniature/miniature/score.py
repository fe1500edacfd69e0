"""Scores the autoencoder on unseen data: held-out scenes, or held-out walks through the levels it was trained on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from . import autoencoder, perceptual
from .train_autoencoder import resized
from .clips import FAMILIES, PICTURES_PER_LATENT, Clip, draw
from .held_out import held_out_seeds

# Seed of a held-out scene of each family. The walk follows the family's own script, which is no training script.
SEED = 41
SECONDS = 4.0
# Seconds of each held-out walk through a level.
WALK_SECONDS = 1.0
SCRIPTS = Path(__file__).resolve().parents[3] / "scripts"
# Number of times that a rollout's first latent is decoded before its pictures are used.
PRIMING = 3
# LPIPS is measured on every tenth picture: with VGG16 it costs more than all else.
LPIPS_EVERY = 10


@dataclass(frozen=True)
class Scores:
    """Scores of one clip's reconstruction."""

    psnr: float  # over all pictures together, in dB
    detail: float  # mean difference of neighbouring pixels, relative to the true pictures
    lpips: dict[str, float]  # by network

    @staticmethod
    def mean(scores: list["Scores"]) -> "Scores":
        """Mean over several clips."""
        of = lambda value: float(np.mean([value(f) for f in scores]))
        return Scores(of(lambda f: f.psnr), of(lambda f: f.detail), {n: of(lambda f: f.lpips[n]) for n in scores[0].lpips})

    def __str__(self) -> str:
        names = {"alex": "AlexNet", "vgg": "VGG16"}
        distances = "".join(f"  LPIPS {names[network]} {value:.3f}" for network, value in self.lpips.items())
        return f"PSNR {self.psnr:.2f} dB{distances}  detail {self.detail:.2f}"


def held_out_clips(renderer: Path, folder: Path, size: tuple[int, int]) -> list[Clip]:
    """Renders a clip of each family, unless it exists."""
    assert SEED in held_out_seeds()
    folder.mkdir(parents=True, exist_ok=True)
    clips = [Clip(folder / f"{family}-{SEED}", *size) for family in FAMILIES]
    for clip in clips:
        if not clip.path.with_suffix(".rgb").is_file():
            draw(renderer, clip, clip.family, SEED, SCRIPTS / f"{clip.family}.txt", SECONDS)
    return clips


class Scorer:
    """Scores one autoencoder."""

    def __init__(self, parameters: dict, networks: dict[str, perceptual.Weights], decoded: tuple[int, int]):
        """`networks` are the networks for LPIPS: `alex`, `vgg`, both or none; `decoded` is the width and height that the autoencoder computes.
        Pictures of another size are resized before it and after it, as the library does.
        """
        width, height = decoded
        self._encode: Callable = jax.jit(lambda rgb: autoencoder.encode(parameters, resized(rgb.astype(jnp.float32) / 255, height, width)))
        self._decode: Callable = jax.jit(lambda z, *size: resized(jnp.clip(autoencoder.decode(parameters, z), 0, 1), *size), static_argnums=(1, 2))
        self._distances: dict[str, Callable] = {
            # One pair at a time: VGG16's activations of a picture are large.
            name: jax.jit(lambda true, made, name=name, weights=weights: perceptual.distance(weights, name, true[None], made[None])[0])
            for name, weights in networks.items()
        }

    def scores(self, clip: Clip) -> Scores:
        """Scores of one clip."""
        true, made = self.reconstruct(clip)
        pairs = list(zip(true[LPIPS_EVERY - 1 :: LPIPS_EVERY], made[LPIPS_EVERY - 1 :: LPIPS_EVERY]))
        lpips = {name: float(np.mean([distance(*pair) for pair in pairs])) for name, distance in self._distances.items()}
        return Scores(psnr(true, made), detail(made) / detail(true), lpips)

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
            pictures_ = np.asarray(self._decode(padded[None], *pictures.shape[1:3]))[0]
            made.append(pictures_[PICTURES_PER_LATENT * before : PICTURES_PER_LATENT * len(part)])
        true = quads.reshape(-1, *pictures.shape[1:]).astype(np.float32) / 255
        return true, np.concatenate(made)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """PSNR over all pictures together, in dB."""
    return float(-10 * np.log10(np.mean(np.square(a - b))))


def detail(pictures: np.ndarray) -> float:
    """Mean absolute difference of neighbouring pixels."""
    return float(sum(np.abs(np.diff(pictures, axis=axis)).mean(dtype=np.float64) for axis in (-3, -2)))
