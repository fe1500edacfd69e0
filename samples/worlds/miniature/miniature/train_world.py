"""Training of the transformer by flow matching: every frame of a window, each with its own noise, over the past a rollout has.

The last stage trains for few steps: at the levels of the schedules alone, from where the network's own step leads to, and half of
the time over a past of the network's own making.
"""

from __future__ import annotations

import sys
from functools import cache, partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from cairn.build.geometry import Geometry
from jax import Array

from . import optimiser, schedules, store, transformer
from .clips import clip_name
from .latents import Walks
from .shapes import Stage, WorldPlan

SEED = 2
# Kept frames but the seed carry drift of a level up to this, each window its own, and are told that they carry none: what a rollout
# keeps is not quite right either. Measured on rollouts of 80 latents: the squared error against the truth is .15 after 8 latents, .27
# after 16 and .5 after 50 (the latents have variance 1), channels' means wander off together with it, and the next latent has the same error.
KEPT_DRIFT = 0.6
# How often a window's kept frames carry any.
DRIFTING = 0.65
# A rollout that goes wrong shows other places in parts of its pictures. So in so many windows parts of the past are another walk's: where a
# smooth field is above a threshold from this range. That is a tenth of the picture in the mean, and up to a third.
FOREIGN = 0.4
FOREIGN_ABOVE = (0.25, 1.75)
# What part of the drift a latent shares with the one before it.
LASTING = 0.95
# Within so many latents after the seed the drift comes to its level.
COMING = 16
# How often a window has no controls.
DROPPED = 0.05
# Noise levels are drawn evenly this often; else from a bell over the logit, whose middle and width these are: most of what a
# frame is gets settled at high levels, where the past says most.
EVEN = 0.4
BELL = (0.8, 1.2)
# Passes of the finer of the two schedules that a few-step stage trains for; the other is the stock one.
REFINED = 10
# How often a frame is one of the finer schedule's: what the world is judged by, and what the stock one's training does not give.
REFINED_SHARE = 0.75
# How often the past of a window is the network's own in a few-step stage, and how often, of those, it made that over a past of its own too.
OWN_PAST = 0.6
OWN_TWICE = 0.5


def noise_levels(key: Array, shape: tuple[int, ...]) -> Array:
    """Levels in (0, 1)."""
    a, b, c = jax.random.split(key, 3)
    even = jax.random.uniform(a, shape, minval=1e-3)
    bell = jax.nn.sigmoid(BELL[0] + BELL[1] * jax.random.normal(b, shape))
    return jnp.where(jax.random.uniform(c, shape) < EVEN, even, bell)


def sampled(p, g: Geometry, window: Array, kept: Array, clean: Array, noise: Array, controls: Array, key: Array) -> tuple[Array, Array, Array, Array]:
    """Frames as a sampler meets them, `[copies, F, h, w, C]`, and their levels: of some pass of the stock or of the refined schedule,
    reached by one step of the network itself from the level before. So what a long step gets wrong is seen, and can be mended. Last,
    the clean frames that this step points to.
    """
    of_each = [schedules.passes(g.schedule), schedules.passes(schedules.refined(g.schedule, REFINED))]
    # All passes of one schedule are equally likely.
    shares = (1 - REFINED_SHARE, REFINED_SHARE)
    chances = np.concatenate([np.full(len(passes), share / len(passes)) for share, passes in zip(shares, of_each)])
    pairs = jnp.asarray(np.concatenate(of_each), jnp.float32)
    chosen = pairs[jax.random.choice(key, len(pairs), noise.shape[:2], p=jnp.asarray(chances, jnp.float32))]
    before, sigma = chosen[..., 0], chosen[..., 1]
    s = before[..., None, None, None]
    x = jnp.concatenate([kept[None], (1 - s) * clean + s * noise])
    told = jnp.concatenate([jnp.zeros_like(before[:1]), before])
    v = transformer.velocity(jax.lax.stop_gradient(p), g, x, told, controls, window)[1:]
    return x[1:] + (sigma - before)[..., None, None, None] * v, sigma, x[1:] - s * v, before


def lasting(key: Array, shape: tuple[int, ...]) -> Array:
    """Numbers of unit variance that change slowly along the first axis, the frames."""
    fresh = jnp.sqrt(1 - LASTING**2)
    numbers = jax.random.normal(key, shape)
    _, walked = jax.lax.scan(lambda at, step: (LASTING * at + fresh * step,) * 2, numbers[0], numbers)
    return walked


def patches(key: Array, shape: tuple[int, ...]) -> Array:
    """The same over the frames of a window, `[F, h, w, C]`, and smooth over four tokens each way."""
    F, h, w, C = shape
    return jax.image.resize(lasting(key, (F, -(-h // 4), -(-w // 4), C)), shape, "linear")


def drift(key: Array, shape: tuple[int, ...]) -> Array:
    """What adds up in a rollout, for the frames of one window `[F, h, w, C]`: of variance about 1, a third each in whole channels, in
    smooth patches and in single numbers, of which the first two last.
    """
    F, _, _, C = shape
    whole, smooth, numbers = jax.random.split(key, 3)
    return (lasting(whole, (F, 1, 1, C)) + patches(smooth, shape) + jax.random.normal(numbers, shape)) / jnp.sqrt(3.0)


def foreign(key: Array, shape: tuple[int, ...]) -> Array:
    """How much of every token of a window's past is another walk's: `[F, h, w, 1]`, 0 to 1."""
    field, above, often, level = jax.random.split(key, 4)
    threshold = jax.random.uniform(above, minval=FOREIGN_ABOVE[0], maxval=FOREIGN_ABOVE[1])
    inside = jax.nn.sigmoid(4.0 * (patches(field, (*shape[:3], 1)) - threshold))
    return inside * jnp.sqrt(jax.random.uniform(level)) * (jax.random.uniform(often) < FOREIGN)


def loss(p, g: Geometry, stage: Stage, window: Array, latents: Array, others: Array, controls: Array, key: Array):
    """Mean squared error of the velocity over the noisy frames after the seed, of one window; in a few-step stage times the level.
    `others` are the latents of another walk, shaped like `latents`: what the past is spoilt with.
    """
    F = len(latents)
    keys = jax.random.split(key, 7)
    clean = latents.astype(jnp.float32)
    level = KEPT_DRIFT * jax.random.uniform(keys[0]) * (jax.random.uniform(keys[1]) < DRIFTING)
    coming = jnp.minimum(1.0, jnp.arange(F) / COMING)[:, None, None, None]
    share = coming * foreign(keys[6], clean.shape)
    kept = (1 - share) * clean + share * others.astype(jnp.float32)
    kept = (1 - level * coming) * kept + level * coming * drift(keys[2], clean.shape)
    noise = jax.random.normal(keys[4], (stage.noisy, *clean.shape))
    driven = controls.astype(jnp.float32) * (jax.random.uniform(keys[5]) >= DROPPED)
    if stage.few_step:
        key, key_own, key_twice, key_again = jax.random.split(keys[3], 4)
        noisy, sigma, made, before = sampled(p, g, window, kept, clean, noise, driven, key)
        truth = (noisy - clean) / sigma[..., None, None, None]

        # A rollout's past is what the network made, from the seed on, and that over what it had made before.
        def own() -> Array:
            once = made[0].at[0].set(kept[0])
            return jax.lax.cond(jax.random.uniform(key_twice) < OWN_TWICE, lambda: again(once), lambda: once)

        def again(once: Array) -> Array:
            return sampled(p, g, window, once, clean, noise, driven, key_again)[2][0].at[0].set(once[0])

        kept = jax.lax.stop_gradient(jax.lax.cond(jax.random.uniform(key_own) < OWN_PAST, own, lambda: kept))
    else:
        sigma = noise_levels(keys[3], (stage.noisy, F))
        s = sigma[..., None, None, None]
        noisy, truth = (1 - s) * clean + s * noise, noise - clean
        before = sigma
    x = jnp.concatenate([kept[None], noisy])
    told = jnp.concatenate([jnp.zeros((1, F)), sigma])
    v = transformer.velocity(p, g, x, told, driven, window)[1:, 1:]
    off = v - truth[:, 1:]
    error = jnp.mean(jnp.square(off), (2, 3, 4))
    blind = (before[:, 1:] > 0.999).astype(jnp.float32)
    means_error = jnp.mean(jnp.square(jnp.mean(off, (2, 3))), 2) * blind
    # The same error, as that of the clean latent which the velocity points to.
    clean_error = jnp.mean(error * jnp.square(sigma[:, 1:]))
    # What is left to mend at a low level is small, and divided by it large: the level is the middle between both errors.
    weight = sigma[:, 1:] if stage.few_step else jnp.ones_like(sigma[:, 1:])
    mean = jnp.mean(error * weight)
    means = jnp.mean(means_error * weight)
    return mean + stage.means * means, {"loss": mean, "latent_error": clean_error, "means": means}


@partial(jax.jit, static_argnums=(0, 1, 2), donate_argnums=4)
def step(settings, g: Geometry, stage: Stage, window: Array, state: optimiser.State, latents, others, controls, key):
    """One step of training on one batch, `stage.together` windows after the others."""
    parts, together = len(latents) // stage.together, stage.together
    assert parts * together == len(latents), f"{len(latents)} windows are not parts of {together}"

    def mean_loss(p, *items):
        if together == 1:
            return loss(p, g, stage, window, *(x[0] for x in items))
        losses, figures = jax.vmap(lambda *item: loss(p, g, stage, window, *item))(*items)
        return losses.mean(), jax.tree.map(jnp.mean, figures)

    def add(sums, items):
        of_part = jax.grad(mean_loss, has_aux=True)(state.parameters, *items)
        return jax.tree.map(lambda total, one: total + one / parts, sums, of_part), None

    items = latents, others, controls, jax.random.split(key, len(latents))
    items = jax.tree.map(lambda x: x.reshape(parts, together, *x.shape[1:]), items)
    nothing = jax.tree.map(jnp.zeros_like, state.parameters), dict.fromkeys(("loss", "latent_error", "means"), jnp.zeros(()))
    (gradient, figures), _ = jax.lax.scan(add, nothing, items)
    state, norm = optimiser.update(settings, state, gradient)
    return state, {**figures, "gradient": norm}


def by_muon(name: str) -> bool:
    """Whether Muon moves a parameter: the matrices within the transformer, not those that take in or give out."""
    return name.startswith("blocks.") and name.endswith(".weight") or name.startswith("cond_head.cond_proj.")


def batch(rng: np.random.Generator, walks: Walks, stage: Stage) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Latents `[n, F, h, w, C]` of random windows, as many of other ones, and the first ones' controls `[n, F, 3 + 256]`."""
    take = walks.window
    windows, others = ([take(rng, stage.frames, *more) for _ in range(stage.batch)] for more in ((stage.more_of, stage.times), ()))
    return np.stack([w[0] for w in windows]), np.stack([w[0] for w in others]), np.stack([w[1] for w in windows])


def train(
    path: Path,
    g: Geometry,
    plan: WorldPlan,
    walks: Walks,
    minutes: float,
    say=print,
    clips: range = range(0),
    until: int = sys.maxsize,
) -> optimiser.State:
    """Trains from the state at `path`, or from nothing, to the plan's end or its step `until`, and leaves the state there. Of
    `walks`, the numbers `clips` are the autoencoder's clips, which are walks of the plan's first stage too; the plan's own follow.
    """

    @cache
    def first(count: int) -> Walks:
        return walks.among({"{}-{}".format(*clip_name(number)) for number in range(clips.start, clips.stop + count)})

    rates = {"rate": plan.rate, "muon_rate": plan.muon_rate, "decay": plan.decay}
    settings = optimiser.Settings(**rates, steps=plan.steps, warm_up=min(200, plan.steps // 4))

    def one_step(state: optimiser.State, n: int):
        stage = plan.stage(n)
        rng = np.random.default_rng([SEED, n])
        latents, others, controls = batch(rng, first(plan.count_at(n)), stage)
        window = np.int32(rng.choice(stage.windows))
        return step(settings, g, stage, window, state, latents, others, controls, jax.random.fold_in(jax.random.key(SEED), n))

    def initial() -> optimiser.State:
        return optimiser.start(transformer.initial(g, SEED), by_muon)

    last = min(plan.steps, until)
    return store.train(path, initial, one_step, last, minutes, lambda n: flops(g, plan.stage(n)), say)


def flops(g: Geometry, stage: Stage) -> float:
    """Floating-point operations of one step: three times those of the forward pass, four where a step of the sampler goes before. What
    is computed twice is counted once.
    """
    frames = stage.batch * (1 + stage.noisy) * stage.frames
    D, hidden = g.width, g.width * g.mlp_ratio
    controlled = sum(g.sees_controls(i) for i in range(g.layers))
    token = g.layers * (2 * D * D + 2 * D * g.kv_width + 2 * D * hidden) + controlled * 2 * D * D + 2 * D * g.patch_width
    keys = 0
    for i in range(g.layers):
        seen = -(-stage.frames // g.global_dilation) if g.is_global(i) else min(stage.frames, 2 * g.local_window)
        keys += (seen + 1) * g.tokens
    frame = 4 * D * (128 + D) + g.layers * 6 * D * D
    return (8.0 if stage.few_step else 6.0) * frames * (g.tokens * (token + 2 * D * keys) + frame)
