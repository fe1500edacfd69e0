"""Training of the autoencoder: stills and short sequences of the clips, cropped at random."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from cairn.build.geometry import AUTOENCODER_TEMPORAL, Geometry
from jax import Array, lax

from . import adversary, autoencoder, optimiser, perceptual, store
from .clips import Clip
from .shapes import AutoencoderPlan

SEED = 1
# Weight of a sequence's first latent relative to later ones: a rollout primes the decoder first, training does not.
FIRST_LATENT_WEIGHT = 0.25
# Share of sequences that start with a still, like the seed picture of a rollout.
STILL_SHARE = 0.3
# Weights of the squared difference, of the absolute one, and of the absolute difference of neighbouring pixels' differences.
SQUARED, ABSOLUTE, EDGES = 100.0, 1.0, 1.0
# Maximum noise on latents in training; makes the decoder robust against errors of the transformer of that size.
MAX_NOISE = 0.15
# Weight of the loss that keeps the latents' channels at mean 0 and variance 1.
NORMALISATION_WEIGHT = 0.01
# Pictures of each latent that LPIPS compares: all four would cost more than the autoencoder itself.
PERCEIVED_PICTURES = 2
# Stride of AlexNet's first layer in pixels. Random crops within it keep the decoder from learning its grid.
GRID = 4
# Latent cells at the border of a crop that depend on the zero padding outside.
BORDER = 1
# Factor that keeps the discriminator's loss small, so that the autoencoder's gradient alone decides about clipping. Adam's steps do not
# depend on the scale of a loss.
DISCRIMINATOR_SCALE = 1e-3


def sample(rng: np.random.Generator, clips: list[Clip], plan: AutoencoderPlan) -> np.ndarray:
    """`[batch, latents, 4, height, width, 3]` uint8: random crops of clips, half of them mirrored."""
    width, height = plan.crop
    out = np.empty((plan.batch, plan.latents, AUTOENCODER_TEMPORAL, height, width, 3), np.uint8)
    for sequence in out:
        clip = clips[rng.integers(len(clips))]
        pictures = clip.pictures()
        still = rng.random() < STILL_SHARE
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


def pixel_loss(made: Array, rgb: Array) -> Array:
    """Loss of `[n, L, 4, H, W, 3]` by pixel values and by differences of neighbouring pixels."""
    L = rgb.shape[1]
    weight = jnp.where(jnp.arange(L) == 0, FIRST_LATENT_WEIGHT, 1.0)
    weight = (weight / weight.mean())[None, :, None, None, None, None]
    error = made - rgb
    edges = jnp.mean(weight * jnp.abs(jnp.diff(error, axis=3))) + jnp.mean(weight * jnp.abs(jnp.diff(error, axis=4)))
    return SQUARED * jnp.mean(weight * error**2) + ABSOLUTE * jnp.mean(weight * jnp.abs(error)) + EDGES * edges


def resized(pictures: Array, height: int, width: int) -> Array:
    """`[..., H, W, 3]` at another size, as the library resizes pictures: bilinear, half-pixel centres, no antialiasing."""
    *more, H, W, channels = pictures.shape
    if (H, W) == (height, width):
        return pictures
    flat = jax.image.resize(pictures.reshape(-1, H, W, channels), (pictures.size // (H * W * channels), height, width, channels), "linear", antialias=False)
    return flat.reshape(*more, height, width, channels)


def perceptual_loss(weights: perceptual.Weights, made: Array, rgb: Array, key: Array) -> Array:
    """LPIPS of some pictures of every latent, at a random offset to AlexNet's grid."""
    n, L, frames, H, W, _ = rgb.shape
    which, row, column = jax.random.split(key, 3)
    chosen = jax.vmap(lambda k: jax.random.permutation(k, frames)[:PERCEIVED_PICTURES])(jax.random.split(which, n * L))
    at = (0, *(jax.random.randint(k, (), 0, GRID) for k in (row, column)), 0)

    def cut(pictures: Array) -> Array:
        some = jnp.take_along_axis(pictures.reshape(n * L, frames, H, W, 3), chosen[:, :, None, None, None], axis=1)
        return lax.dynamic_slice(some.reshape(-1, H, W, 3), at, (n * L * PERCEIVED_PICTURES, H - GRID, W - GRID, 3))

    distances = perceptual.distance(weights, "alex", cut(rgb), cut(made)).reshape(n, L, PERCEIVED_PICTURES)
    weight = jnp.where(jnp.arange(L) == 0, FIRST_LATENT_WEIGHT, 1.0)
    return jnp.mean((weight / weight.mean())[None, :, None] * distances)


def consecutive(pictures: Array, key: Array) -> Array:
    """Three pictures in a row of every sequence `[n, L, 4, H, W, 3]`, none of them of the first latent."""
    n, L, frames, H, W, _ = pictures.shape
    at = jax.random.randint(key, (n,), frames, L * frames - adversary.PICTURES + 1)
    flat = pictures.reshape(n, L * frames, H, W, 3)
    return jax.vmap(lambda sequence, start: lax.dynamic_slice_in_dim(sequence, start, adversary.PICTURES))(flat, at)


def equivariance(encode: Callable[[Array], Array], rgb: Array, z: Array, key: Array) -> Array:
    """Squared difference between the latent of a shifted picture and the shifted latent, for one latent of the batch; shifts are below a cell."""
    n, L, frames, H, W, _ = rgb.shape
    cell = H // z.shape[2]
    which, by = jax.random.split(key)
    chosen = jax.random.randint(which, (), 0, n * L)
    down, right = jax.random.randint(by, (2,), 0, cell)
    quad = lax.dynamic_index_in_dim(rgb.reshape(n * L, frames, H, W, 3), chosen)
    whole = lax.dynamic_index_in_dim(z.reshape(n * L, *z.shape[2:]), chosen)
    cut = lax.dynamic_slice(quad, (0, 0, down, right, 0), (1, frames, H - cell, W - cell, 3))
    found = encode(cut)
    y, x = down / cell, right / cell
    rows = (1 - y) * whole[:, :-1] + y * whole[:, 1:]
    expected = (1 - x) * rows[:, :, :-1] + x * rows[:, :, 1:]
    return jnp.mean((found - expected)[:, BORDER:-BORDER, BORDER:-BORDER] ** 2)


def detail(pictures: Array) -> Array:
    """Mean absolute difference of neighbouring pixels."""
    return jnp.mean(jnp.abs(jnp.diff(pictures, axis=-3))) + jnp.mean(jnp.abs(jnp.diff(pictures, axis=-2)))


def loss(
    p: dict[str, Array], plan: AutoencoderPlan, weights: perceptual.Weights | None, pictures: Array, key: Array, now: Array
) -> tuple[Array, dict[str, Array]]:
    """The loss at step `now`, and the metrics for the log.

    The adversary's gradient at the pictures is scaled to `plan.adversary` times the norm of all other losses' gradient, which needs no
    tuning as pictures become sharper.
    """
    n, L, frames, H, W, _ = pictures.shape
    rgb = pictures.astype(jnp.float32) / 255
    kind = jnp.bfloat16 if plan.half else jnp.float32
    networks = {name: value.astype(kind) for name, value in p.items() if not name.startswith(adversary.PREFIX)}
    encode = lambda rgb: autoencoder.encode(networks, rgb.astype(kind)).astype(jnp.float32)
    width, height = plan.decoded or (W, H)
    z = encode(resized(rgb.reshape(n * L, frames, H, W, 3), height, width))
    if plan.fixed_encoder:
        z = lax.stop_gradient(z)
    mean, variance = z.mean((0, 1, 2)), z.var((0, 1, 2))
    unit = jnp.mean(mean**2) + jnp.mean(jnp.log(variance + 1e-6) ** 2)
    level_key, noise_key, lpips_key, discriminator_key, shift_key = jax.random.split(key, 5)
    level = jax.random.uniform(level_key, (n * L, 1, 1, 1), maxval=MAX_NOISE)
    noisy = (z + level * jax.random.normal(noise_key, z.shape)).reshape(n, L, *z.shape[1:])
    made = autoencoder.decode(networks, noisy.astype(kind)).astype(jnp.float32).reshape(n, L, frames, height, width, 3)
    if plan.decoded:
        # The library clamps before it resizes; here the gradient ignores that.
        made = resized(made + lax.stop_gradient(jnp.clip(made, 0, 1) - made), H, W)

    def differences(made: Array) -> tuple[Array, Array]:
        if weights is None:
            return pixel_loss(made, rgb), jnp.zeros(())
        lpips = perceptual_loss(weights, made, rgb, lpips_key)
        return pixel_loss(made, rgb) + plan.perceptual * lpips, lpips

    figures, more = {}, jnp.zeros(())
    if plan.adversary:
        fixed = lax.stop_gradient(p)
        true = consecutive(rgb, discriminator_key)
        (differing, lpips), gradient = jax.value_and_grad(differences, has_aux=True)(lax.stop_gradient(made))
        fooling = lambda made: adversary.generator_loss(fixed, true, consecutive(made, discriminator_key))
        adversary_gradient = jax.grad(fooling)(lax.stop_gradient(made))
        scale = plan.adversary * jnp.linalg.norm(gradient) / (jnp.linalg.norm(adversary_gradient) + 1e-12)
        gradient += jnp.where(now >= plan.adversary_from + plan.adversary_alone, scale, 0.0) * adversary_gradient
        # The gradient of this sum is `gradient`; its value is subtracted again.
        surrogate = jnp.sum(lax.stop_gradient(gradient) * made)
        discriminator = adversary.discriminator_loss(p, true, lax.stop_gradient(consecutive(made, discriminator_key)))
        more = surrogate - lax.stop_gradient(surrogate) + jnp.where(now >= plan.adversary_from, DISCRIMINATOR_SCALE, 0.0) * discriminator
        figures["adversary"] = discriminator
    else:
        differing, lpips = differences(made)
    total = differing + NORMALISATION_WEIGHT * unit
    if plan.equivariance:
        figures["shift"] = equivariance(encode, rgb, z.reshape(n, L, *z.shape[1:]), shift_key)
        total += plan.equivariance * figures["shift"]
    psnr = -10 * jnp.log10(jnp.mean((jnp.clip(made[:, 1:], 0, 1) - rgb[:, 1:]) ** 2))
    if weights is not None:
        figures["lpips"] = lpips
    figures |= {"detail": detail(made[:, 1:]) / detail(rgb[:, 1:]), "deviation": jnp.sqrt(variance.mean())}
    return total + more, {"loss": total, "psnr": psnr, **figures}


@partial(jax.jit, static_argnums=(0, 1), donate_argnums=3)
def step(settings: optimiser.Settings, plan: AutoencoderPlan, weights: perceptual.Weights | None, state: optimiser.State, pictures: Array, key: Array, at: Array | None = None):
    """One training step on one batch; rate and discriminator are those of step `at`, the state's own unless given."""
    gradient_of = jax.value_and_grad(loss, has_aux=True)
    (_, figures), gradient = gradient_of(state.parameters, plan, weights, pictures, key, state.step if at is None else at)
    state, norm = optimiser.update(settings, state, gradient, at)
    return state, {**figures, "gradient": norm}


def start(parameters: dict, plan: AutoencoderPlan) -> optimiser.State:
    """The state before the first step."""
    return optimiser.start(parameters | (adversary.initial(SEED) if plan.adversary else {}))


def train(path: Path, g: Geometry, plan: AutoencoderPlan, clips: list[Clip], minutes: float, say=print, until: int = sys.maxsize) -> optimiser.State:
    """Trains from the state at `path`, or from nothing, and leaves the state there."""
    settings = optimiser.Settings(rate=plan.rate, steps=plan.steps)
    count = flops(g, plan)
    weights = perceptual.load("alex") if plan.perceptual else None

    def one_step(state: optimiser.State, n: int):
        pictures = sample(np.random.default_rng([SEED, n]), clips, plan)
        return step(settings, plan, weights, state, pictures, jax.random.fold_in(jax.random.key(SEED), n))

    initial = lambda: start(autoencoder.initial(g, SEED), plan)
    return store.train(path, initial, one_step, min(plan.steps, until), minutes, lambda _: count, say)


def flops(g: Geometry, plan: AutoencoderPlan) -> float:
    """Floating-point operations of one step: three times those of the forward pass."""
    e, (a, b, c, d) = g.encoder_width, g.decoder_widths
    width, height = plan.decoded or plan.crop
    cells = width * height // 256
    # Multiplications per latent cell, by resolution: grids of 4, 16 and 64 positions per cell, times frames.
    encoder = 4 * 64 * 108 * e + 2 * 64 * 2 * e * e + 32 * 9 * e * e + 3 * 32 * 36 * e * e
    encoder += 16 * 2 * e * e + 4 * 9 * e * e + 3 * 4 * 36 * e * e + e * e + 9 * e * e + 3 * 36 * e * e + 9 * e * g.latent_channels
    decoder = 9 * g.latent_channels * a + 3 * 36 * a * a + a * a + 4 * 9 * a * b + 3 * 4 * 36 * b * b + 4 * 2 * b * b
    decoder += 32 * 9 * b * c + 3 * 32 * 36 * c * c + 32 * 2 * c * c + 256 * 9 * c * d + 256 * 108 * d
    return 6.0 * (encoder + decoder) * cells * plan.batch * plan.latents
