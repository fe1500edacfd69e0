"""Training of the autoencoder: stills and short sequences of the clips, cut out at random."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from cairn.build.geometry import AUTOENCODER_TEMPORAL, Geometry
from jax import Array

from . import autoencoder, optimiser, store
from .clips import Clip
from .shapes import AutoencoderPlan

SEED = 1
# Loss of the first latent of a sequence, over that of later ones: a rollout primes the decoder, training does not.
FIRST = 0.25
# How often a sequence starts with a still, as a rollout starts with its seed picture.
STILL = 0.3
# Weights of the squared difference, of the absolute one, and of the absolute difference of neighbouring pixels' differences.
SQUARED, ABSOLUTE, EDGES = 100.0, 1.0, 1.0
# Noise on latents in training, at most; what the transformer gets wrong by as much costs little then.
NOISE = 0.15
# Pull of the latents' channels to mean 0 and variance 1.
UNIT = 0.01


def sample(rng: np.random.Generator, clips: list[Clip], plan: AutoencoderPlan) -> np.ndarray:
    """`[batch, latents, 4, height, width, 3]` uint8: sequences cut out of clips, some of them mirrored."""
    width, height = plan.crop
    out = np.empty((plan.batch, plan.latents, AUTOENCODER_TEMPORAL, height, width, 3), np.uint8)
    for sequence in out:
        clip = clips[rng.integers(len(clips))]
        pictures = clip.pictures()
        still = rng.random() < STILL
        moving = AUTOENCODER_TEMPORAL * (plan.latents - still)
        at = int(rng.integers(len(pictures) - moving - still + 1))
        x = int(rng.integers((clip.width - width) // 16 + 1)) * 16
        y = int(rng.integers((clip.height - height) // 16 + 1)) * 16
        cut = np.asarray(pictures[at : at + moving + still, y : y + height, x : x + width])
        if still:
            cut = np.concatenate([np.repeat(cut[:1], AUTOENCODER_TEMPORAL, 0), cut[1:]])
        if rng.random() < 0.5:
            cut = cut[:, :, ::-1]
        sequence[:] = cut.reshape(sequence.shape)
    return out


def loss(p: dict[str, Array], pictures: Array, key: Array) -> tuple[Array, dict[str, Array]]:
    """What training lowers, and what its line shows."""
    n, L, frames, H, W, _ = pictures.shape
    rgb = pictures.astype(jnp.float32) / 255
    z = autoencoder.encode(p, rgb.reshape(n * L, frames, H, W, 3))
    mean, variance = z.mean((0, 1, 2)), z.var((0, 1, 2))
    unit = jnp.mean(mean**2) + jnp.mean(jnp.log(variance + 1e-6) ** 2)
    level_key, noise_key = jax.random.split(key)
    level = jax.random.uniform(level_key, (n * L, 1, 1, 1), maxval=NOISE)
    noisy = z + level * jax.random.normal(noise_key, z.shape)
    made = autoencoder.decode(p, noisy.reshape(n, L, *z.shape[1:])).reshape(rgb.shape)
    weight = jnp.where(jnp.arange(L) == 0, FIRST, 1.0)
    weight = (weight / weight.mean())[None, :, None, None, None, None]
    error = made - rgb
    squared = jnp.mean(weight * error**2)
    edges = jnp.mean(weight * jnp.abs(jnp.diff(error, axis=3))) + jnp.mean(weight * jnp.abs(jnp.diff(error, axis=4)))
    absolute = jnp.mean(weight * jnp.abs(error))
    total = SQUARED * squared + ABSOLUTE * absolute + EDGES * edges + UNIT * unit
    psnr = -10 * jnp.log10(jnp.mean((jnp.clip(made[:, 1:], 0, 1) - rgb[:, 1:]) ** 2))
    return total, {"loss": total, "psnr": psnr, "deviation": jnp.sqrt(variance.mean())}


@partial(jax.jit, static_argnums=0, donate_argnums=1)
def step(settings: optimiser.Settings, state: optimiser.State, pictures: Array, key: Array):
    """One step of training on one batch."""
    (_, figures), gradient = jax.value_and_grad(loss, has_aux=True)(state.parameters, pictures, key)
    state, norm = optimiser.update(settings, state, gradient)
    return state, {**figures, "gradient": norm}


def train(path: Path, g: Geometry, plan: AutoencoderPlan, clips: list[Clip], minutes: float, say=print) -> optimiser.State:
    """Trains from the state at `path`, or from nothing, and leaves the state there."""
    settings = optimiser.Settings(rate=plan.rate, steps=plan.steps)
    count = flops(g, plan)

    def one_step(state: optimiser.State, n: int):
        pictures = sample(np.random.default_rng([SEED, n]), clips, plan)
        return step(settings, state, pictures, jax.random.fold_in(jax.random.key(SEED), n))

    return store.train(
        path, lambda: optimiser.start(autoencoder.initial(g, SEED)), one_step, plan.steps, minutes, lambda _: count, say
    )


def flops(g: Geometry, plan: AutoencoderPlan) -> float:
    """Floating-point operations of one step: three times those of the forward pass."""
    e, (a, b, c, d) = g.encoder_width, g.decoder_widths
    cells = plan.crop[0] * plan.crop[1] // 256
    # Multiplications of one latent cell, by the grids they are made on: 4, 16 and 64 places a cell, and frames.
    encoder = 4 * 64 * 108 * e + 2 * 64 * 2 * e * e + 32 * 9 * e * e + 3 * 32 * 36 * e * e
    encoder += 16 * 2 * e * e + 4 * 9 * e * e + 3 * 4 * 36 * e * e + e * e + 9 * e * e + 3 * 36 * e * e + 9 * e * g.latent_channels
    decoder = 9 * g.latent_channels * a + 3 * 36 * a * a + a * a + 4 * 9 * a * b + 3 * 4 * 36 * b * b + 4 * 2 * b * b
    decoder += 32 * 9 * b * c + 3 * 32 * 36 * c * c + 32 * 2 * c * c + 256 * 9 * c * d + 256 * 108 * d
    return 6.0 * (encoder + decoder) * cells * plan.batch * plan.latents
