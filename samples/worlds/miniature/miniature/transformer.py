"""The Waypoint-1.5 transformer in JAX, over whole sequences at once.

Parameters are a dictionary with the names and the layout of `cairn.build.weights`: matrices `[in, out]`, except that the last bias has
one number for each channel, as released. `cairn.build` writes the same network as an ONNX graph that computes one frame over a ring; a
test compares the two.

A window is a rollout from its seed: frame 0 is the seed's latent at ring clock 0. It is computed in *copies* side by side: copy
0 holds the frames as the cache pass stores them, every other copy holds the same frames with noise. Frame q of any copy attends to
itself, and to the frames of copy 0 that are visible in the rings at clock q. So one call trains every frame with the past of a rollout.

On a CPU, memory limits the speed: a matrix product takes a quarter of the time of storing its result in main memory. So a layer is
computed in blocks of a few hundred tokens, whose activations stay in the caches, and recomputed in the backward pass.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from cairn.build.geometry import Geometry
from cairn.build.transformer import FOURIER_WIDTH, RMS_EPSILON, SIGMA_SCALE, fourier_frequencies
from cairn.build.weights import MODULATIONS, transformer_weights
from jax import Array
from jax.ad_checkpoint import checkpoint_name

Parameters = dict[str, Array]
# Range of the initial scale of one mouse count.
MOUSE_SCALES = (0.01, 0.05)
# Frames in a block of `wide`: the shorter, the fewer frames that its masks hide from all of a block's queries.
WIDE_BLOCK = 4
# Name of the activations that are stored for the backward pass, besides a block's input: small, and slow to recompute.
KEPT = "kept"


def initial(g: Geometry, seed: int) -> dict[str, np.ndarray]:
    """Initial parameters, with which the velocity is zero."""
    out = {}
    for index, weight in enumerate(transformer_weights(g)):
        rng = np.random.default_rng([seed, index])
        if weight.name.endswith(("v_lamb", "bias")):
            value = np.full(weight.shape, 0.5 if weight.name.endswith("v_lamb") else 0.0, np.float32)
        elif weight.name.startswith(("unpatchify", "out_norm")) or weight.name.endswith("ctrl_mlpfusion.fc2.weight"):
            value = np.zeros(weight.shape, np.float32)
        elif weight.name.startswith("cond_head.cond_proj."):
            # Gates, scales and shifts start small.
            value = rng.standard_normal(weight.shape, np.float32) * np.float32(0.3 / np.sqrt(weight.fan_in))
        elif weight.name == "cond_head.bias_in":
            value = rng.standard_normal(weight.shape, np.float32) * np.float32(0.5)
        elif weight.name == "ctrl_emb.mlp.fc1.weight":
            # Mouse counts range from one to a hundred. The embedding is normalised, so only the nonlinearity can separate large motion
            # from small. So every hidden unit has a mouse scale of its own.
            value = rng.standard_normal(weight.shape, np.float32)
            value[:2] *= np.exp(rng.uniform(*np.log(MOUSE_SCALES), weight.shape[1])).astype(np.float32)
        else:
            value = rng.standard_normal(weight.shape, np.float32) / np.float32(np.sqrt(weight.fan_in))
        out[weight.name] = value
    out["unpatchify.bias"] = np.zeros(g.latent_channels, np.float32)
    return out


def local_table(frames: int, window: int) -> np.ndarray:
    """`[frames, frames]`: which stored frames a frame attends to in a local layer, besides itself: the last `window - 1`."""
    age = np.arange(frames)[:, None] - np.arange(frames)[None]
    return (age >= 1) & (age < window)


def global_table(frames: int, window: int | Array, dilation: int) -> np.ndarray | Array:
    """`[frames, ceil(frames / dilation)]`: which of the frames 0, d, 2 d, ... a frame attends to in a global layer, besides itself.

    A frame whose clock is a multiple of d attends to `window / d - 1` frames before it, because it takes the slot of the oldest. Other
    frames attend to `window / d`.
    """
    clock, kept = np.arange(frames)[:, None], np.arange(0, frames, dilation)[None]
    reach = window // dilation - (clock % dilation == 0)
    age = -(-clock // dilation) - kept // dilation
    return (age >= 1) & (age <= reach)


def rope_tables(g: Geometry, frames: int) -> tuple[Array, Array]:
    """Cosines and sines `[frames, T, d / 2]` of the angles in `docs/bundle.md`, section 5, for clocks from 0."""
    pairs = g.head_width // 2
    spatial, temporal = pairs // 4, pairs // 2
    rows, columns = g.grid
    steps = np.linspace(1.0, min(rows, columns) * g.nyquist_fraction / 2, (spatial + 1) // 2)
    f_xy = np.repeat(steps * np.pi, 2)[:spatial]
    f_t = np.repeat(g.time_base ** -(np.arange(0, temporal, 2) / temporal), 2)
    row, column = np.divmod(np.arange(g.tokens), columns)
    angle = np.empty((frames, g.tokens, pairs))
    angle[..., :spatial] = ((2 * column + 1) / columns - 1)[:, None] * f_xy
    angle[..., spatial : 2 * spatial] = ((2 * row + 1) / rows - 1)[:, None] * f_xy
    angle[..., 2 * spatial :] = (np.arange(frames) * g.time_multiplier)[:, None, None] * f_t
    return jnp.asarray(np.cos(angle), jnp.float32), jnp.asarray(np.sin(angle), jnp.float32)


def rms(x: Array) -> Array:
    """x / sqrt(mean(x^2) + eps) over the last axis, in float32."""
    wide = x.astype(jnp.float32)
    return (wide / jnp.sqrt(jnp.mean(wide * wide, -1, keepdims=True) + RMS_EPSILON)).astype(x.dtype)


def velocity(p: Parameters, g: Geometry, x: Array, sigma: Array, controls: Array, window: int | Array, wide: bool = False) -> Array:
    """Velocities of all frames of all copies of a window.

    `x` `[copies, F, h, w, C]`, `sigma` `[copies, F]`, `controls` `[F, 2 + buttons + 1]`; the result is shaped as `x`. F is at most
    the local window (of `wide`, `WIDE_BLOCK`), or a multiple of it. `window` is the global window g in latents; as an array it is not a
    compile-time constant. `wide` computes all blocks at once and keeps all activations, for a GPU.
    """
    copies, F = sigma.shape
    rows, columns = g.grid
    T, D = g.tokens, g.width
    ph, pw = g.patch
    assert x.shape == (copies, F, g.latent_height, g.latent_width, g.latent_channels), x.shape
    kind = x.dtype
    p = {name: value.astype(kind) for name, value in p.items()} if kind != jnp.float32 else p
    B = min(F, WIDE_BLOCK if wide else g.local_window)
    assert F % B == 0 and (B == F or g.local_window % B == 0), f"{F} frames are not blocks of {B}"

    def blocks(frames: Array) -> Array:
        """`[copies, F, ...]` -> `[F / B, copies, B, ...]`."""
        return frames.reshape(-1, F // B, B, *frames.shape[2:]).swapaxes(0, 1)

    cond = blocks(_noise_condition(p, sigma))  # [F / B, copies, B, D]
    activated = jax.nn.silu(cond + p["cond_head.bias_in"][:, None, None, None])
    shared = jnp.concatenate([p[f"cond_head.cond_proj.{j}.weight"] for j in range(len(MODULATIONS))], 1)
    modulations = jnp.split((activated @ shared)[..., None, :], len(MODULATIONS), -1)  # [layers, F / B, copies, B, 1, D] each
    ctrl = rms(jax.nn.silu(controls.astype(kind) @ p["ctrl_emb.mlp.fc1.weight"]) @ p["ctrl_emb.mlp.fc2.weight"])
    ctrl = ctrl.reshape(F // B, B, 1, D)

    # A token's numbers are ordered (c, row in patch, column in patch).
    cells = x.reshape(copies, F, rows, ph, columns, pw, g.latent_channels).transpose(0, 1, 2, 4, 6, 3, 5)
    h = blocks(cells.reshape(copies, F, T, g.patch_width)) @ p["patchify.weight"].reshape(D, -1).T
    rope = tuple(table.reshape(F // B, B, T, -1) for table in rope_tables(g, F))
    first_value = None
    for i in range(g.layers):
        h, first_value = _layer(_layer_parameters(p, i), g, i, h, [m[i] for m in modulations], ctrl, first_value, rope, window, wide)

    scale, shift = jnp.split((jax.nn.silu(cond) @ p["out_norm.fc.weight"])[..., None, :], 2, -1)
    y = jax.nn.silu(rms(h) * (1 + scale) + shift)
    y = y @ p["unpatchify.weight"] + p["unpatchify.bias"].repeat(ph * pw)
    y = y.swapaxes(0, 1).reshape(copies, F, rows, columns, g.latent_channels, ph, pw).transpose(0, 1, 2, 5, 3, 6, 4)
    return y.reshape(x.shape)


def _layer_parameters(p: Parameters, i: int) -> Parameters:
    """The parameters of layer i."""
    block = f"blocks.{i}."
    return {name.removeprefix(block): value for name, value in p.items() if name.startswith(block)}


def _noise_condition(p: Parameters, sigma: Array) -> Array:
    """Fourier features of the noise level through a small MLP, in float32 up to its first matrix: `[..., D]`."""
    phase = sigma.astype(jnp.float32)[..., None] * SIGMA_SCALE * fourier_frequencies("none")
    waves = jnp.sqrt(2.0) * jnp.concatenate([jnp.sin(phase), jnp.cos(phase)], -1)
    assert waves.shape[-1] == FOURIER_WIDTH
    first = p["denoise_step_emb.mlp.fc1.weight"]
    return jax.nn.silu(waves.astype(first.dtype) @ first) @ p["denoise_step_emb.mlp.fc2.weight"]


def _layer(p, g: Geometry, i: int, h: Array, modulation: list[Array], ctrl: Array, first_value, rope, window: int | Array, wide: bool):
    """One layer of the transformer. Returns its tokens `[F / B, copies, B, T, D]`, and layer 0's values."""
    blocks, _, B, T, _ = h.shape
    d = g.head_width
    s0, b0, g0, s1, b1, g1 = modulation  # [F / B, copies, B, 1, D] each
    # The rotary embedding pairs even with odd columns. With the even columns of every head first, the two are halves of an axis.
    q, k = (_even_first(p[f"attn.{name}_proj.weight"], heads) for name, heads in (("q", g.heads), ("k", g.kv_heads)))
    turned = (lambda w: w) if wide else _with_transpose
    inwards = turned(jnp.concatenate([q, k, p["attn.v_proj.weight"]], 1))
    matrices = {name: turned(value) for name, value in p.items() if value.ndim > 1}

    def project(h, s, b, first, cos, sin):
        """Queries `[kv, B, group, T, d]`, keys and values `[kv, B, T, d]` of a block of one copy."""
        y = _matmul(rms(h) * (1 + s) + b, inwards).reshape(B, T, -1, d)
        q, k, v = jnp.split(y, [g.heads, g.heads + g.kv_heads], 2)
        v = v.transpose(2, 0, 1, 3)
        if first is not None:
            v = v + p["attn.v_lamb"] * (first - v)
        q = (_rotate(q, cos, sin) * d**-0.5).reshape(B, T, g.kv_heads, g.group, d).transpose(2, 0, 3, 1, 4)
        return q, _rotate(k, cos, sin).transpose(2, 0, 1, 3), v

    q, k, v = _each_block(project, (h, s0, b0, first_value), rope, wide)
    first_value = v if first_value is None else first_value
    past = _kept_keys_and_values(g, i, k[:, 0], v[:, 0], window)
    control_bias = ctrl @ p["ctrl_mlpfusion.fc1_c.weight"] if g.sees_controls(i) else None

    def mix(h, q, k, v, g0, s1, b1, g1, kept_k, kept_v, table, control_bias):
        """A block of one copy after attention, controls and MLP."""
        y = _matmul(_attention(q, k, v, kept_k, kept_v, table), matrices["attn.out_proj.weight"])
        h = h + g0 * checkpoint_name(y, KEPT)
        if control_bias is not None:
            y = jax.nn.silu(_matmul(rms(h), matrices["ctrl_mlpfusion.fc1_x.weight"]) + control_bias)
            h = h + checkpoint_name(_matmul(y, matrices["ctrl_mlpfusion.fc2.weight"]), KEPT)
        y = jax.nn.silu(_matmul(rms(h) * (1 + s1) + b1, matrices["mlp.fc1.weight"]))
        return h + g1 * checkpoint_name(_matmul(y, matrices["mlp.fc2.weight"]), KEPT)

    return _each_block(mix, (h, q, k, v, g0, s1, b1, g1), (*past, control_bias), wide), first_value


def _each_block(f: Callable, own: tuple, shared: tuple, wide: bool):
    """`f(*own, *shared)` of every block `[F / B]` and copy `[copies]`: `own` has both axes, `shared` the first."""
    if wide:
        return jax.vmap(lambda own, shared: jax.vmap(lambda own: f(*own, *shared))(own))(own, shared)
    policy = jax.checkpoint_policies.save_only_these_names(KEPT)

    def of_copies(block):
        own, shared = block
        return jax.lax.map(jax.checkpoint(lambda one: f(*one, *shared), prevent_cse=False, policy=policy), own)

    return jax.lax.map(of_copies, (own, shared))


def _kept_keys_and_values(g: Geometry, i: int, k: Array, v: Array, window: int | Array) -> tuple[Array, Array, Array]:
    """Keys and values of the stored frames for every block, from those of all frames `[F / B, kv, B, T, d]`: both
    `[F / B, kv, S, T, d]`, and the mask of the S frames that a frame attends to, `[F / B, B, S]`.
    """
    blocks, kv, B, T, d = k.shape
    if g.is_global(i):
        step = g.global_dilation
        kept = (a.swapaxes(0, 1).reshape(kv, -1, T, d)[:, ::step] for a in (k, v))
        table = jnp.asarray(global_table(blocks * B, window, step)).reshape(blocks, B, -1)
        return *(jnp.broadcast_to(a, (blocks, *a.shape)) for a in kept), table
    # A block and so many before it hold all visible frames.
    earlier = min(blocks - 1, g.local_window // B)
    at = lambda a, ago: jnp.concatenate([jnp.zeros_like(a[:ago]), a[: blocks - ago]])
    k, v = (jnp.concatenate([at(a, ago) for ago in range(earlier, -1, -1)], 2) for a in (k, v))
    table = local_table((earlier + 1) * B, g.local_window)[-B:]
    # There are no frames before the first block.
    there = np.arange(blocks)[:, None, None] * B >= earlier * B - np.arange((earlier + 1) * B)
    return k, v, jnp.asarray(table & there)


def _even_first(w: Array, heads: int) -> Array:
    """Reorders the columns of a projection: for every head, even ones before odd ones."""
    D, width = w.shape
    return w.reshape(D, heads, -1, 2).swapaxes(2, 3).reshape(D, width)


def _rotate(x: Array, cos: Array, sin: Array) -> Array:
    """Normalises `[B, T, heads, d]` and applies the rotary embedding; the two halves hold the two parts of each pair."""
    even, odd = jnp.split(rms(x).astype(jnp.float32), 2, -1)
    cos, sin = cos[:, :, None], sin[:, :, None]
    return jnp.concatenate([even * cos - odd * sin, odd * cos + even * sin], -1).astype(x.dtype)


def _attention(q: Array, k: Array, v: Array, kept_k: Array, kept_v: Array, table: Array) -> Array:
    """Attention of a block to each frame's own tokens and to those of the S stored frames in the mask `table` `[B, S]`: `[B, T, D]`.

    Queries and keys are normalised, so that a score is at most sqrt(d) and the softmax needs no maximum subtracted. The softmax's
    denominator comes from a column of ones in the values, which saves a pass over the scores.
    """
    kv, B, group, T, d = q.shape
    S = kept_k.shape[1]
    kept_v, v = (jnp.concatenate([a, jnp.ones_like(a[..., :1])], -1) for a in (kept_v, v))
    scores = q.reshape(kv, -1, d) @ kept_k.reshape(kv, S * T, d).swapaxes(-1, -2)
    past = _masked_exp(scores.reshape(kv, B, group * T, S * T), table.repeat(T, 1)[:, None])
    own = _masked_exp(q.reshape(kv, B, group * T, d) @ k.swapaxes(-1, -2), True)
    y = (past.reshape(kv, -1, S * T) @ kept_v.reshape(kv, S * T, d + 1)).reshape(kv, B, group * T, d + 1) + own @ v
    y = (y[..., :d] / y[..., d:]).reshape(kv, B, group, T, d)
    return y.transpose(1, 3, 0, 2, 4).reshape(B, T, -1)


@jax.custom_vjp
def _masked_exp(scores: Array, seen: Array | bool) -> Array:
    """Exponentials of the scores, 0 outside the mask. The backward pass stores the result only, which is its own derivative."""
    return jnp.where(seen, jnp.exp(scores), 0)


def _masked_exp_forward(scores, seen):
    shares = _masked_exp(scores, seen)
    return shares, shares


def _masked_exp_backward(shares, change):
    return shares * change, None


_masked_exp.defvjp(_masked_exp_forward, _masked_exp_backward)


def _with_transpose(w: Array) -> tuple[Array, Array]:
    """A matrix and its transpose for the backward pass, computed once instead of in every block."""
    return w, jax.lax.optimization_barrier(jax.lax.stop_gradient(w).T)


def _matmul(x: Array, w: Array | tuple[Array, Array]) -> Array:
    """`x` times a matrix, which may be one of `_with_transpose`."""
    return _turned_matmul(x, w) if isinstance(w, tuple) else x @ w


@jax.custom_vjp
def _turned_matmul(x: Array, w: tuple[Array, Array]) -> Array:
    return x @ w[0]


def _matmul_forward(x, w):
    return x @ w[0], (x, w[1])


def _matmul_backward(kept, change):
    x, transposed = kept
    # Without the barrier, XLA fuses the transpose with the operation before it, which is ten times slower than both.
    x, change = jax.lax.optimization_barrier((x, change))
    return change @ transposed, (x.reshape(-1, x.shape[-1]).T @ change.reshape(-1, change.shape[-1]), None)


_turned_matmul.defvjp(_matmul_forward, _matmul_backward)
