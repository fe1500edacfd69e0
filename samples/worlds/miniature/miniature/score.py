"""How well the autoencoder shows places that it has never seen."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from . import autoencoder
from .clips import FAMILIES, PICTURES_PER_LATENT, Clip, draw
from .held_out import held_out_seeds

# One of the held-out places of each kind, walked by the kind's own script, which is no training script.
SEED = 41
SECONDS = 4.0
SCRIPTS = Path(__file__).resolve().parents[3] / "scripts"
# Times that a rollout's first latent is decoded before its pictures count.
PRIMING = 3


def held_out_clips(renderer: Path, folder: Path, size: tuple[int, int]) -> list[Clip]:
    """A clip of each kind of place, drawn unless it is there."""
    assert SEED in held_out_seeds()
    folder.mkdir(parents=True, exist_ok=True)
    clips = [Clip(folder / f"{family}-{SEED}", *size) for family in FAMILIES]
    for clip in clips:
        if not clip.path.with_suffix(".rgb").is_file():
            draw(renderer, clip, clip.family, SEED, SCRIPTS / f"{clip.family}.txt", SECONDS)
    return clips


def reconstruct(parameters: dict, clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """True and decoded pictures of a clip from step 1 on, `[4 N, H, W, 3]` in [0, 1]; the decoder is primed with the seed's still."""
    pictures = clip.pictures()
    steps = (len(pictures) - 1) // PICTURES_PER_LATENT
    quads = pictures[1:].reshape(steps, PICTURES_PER_LATENT, *pictures.shape[1:])
    seed = np.repeat(pictures[:1], PICTURES_PER_LATENT, 0)[None]
    encode = jax.jit(lambda rgb: autoencoder.encode(parameters, rgb.astype(jnp.float32) / 255))
    latents = np.concatenate([np.asarray(encode(rgb[None])) for rgb in [seed[0], *quads]])
    # A decoded picture depends on few latents before its own; pieces keep the memory small.
    decode = jax.jit(lambda z: autoencoder.decode(parameters, z))
    before, piece, made = PRIMING + 1, 8, []
    latents = np.concatenate([np.repeat(latents[:1], PRIMING, 0), latents])
    for at in range(before, len(latents), piece):
        part = latents[at - before : at + piece]
        padded = np.concatenate([part, np.repeat(part[-1:], before + piece - len(part), 0)])
        pictures_ = np.asarray(decode(padded[None]))[0]
        made.append(pictures_[PICTURES_PER_LATENT * before : PICTURES_PER_LATENT * len(part)])
    true = quads.reshape(-1, *pictures.shape[1:]).astype(np.float32) / 255
    return true, np.clip(np.concatenate(made), 0, 1)


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Over all pictures together, in decibels."""
    return float(-10 * np.log10(np.mean(np.square(a - b))))
