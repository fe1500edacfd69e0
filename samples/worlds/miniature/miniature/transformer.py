"""The Waypoint-1.5 transformer in JAX, over whole sequences at once.

Parameters are a dictionary by the names and in the layout of `cairn.build.weights`: matrices `[in, out]`; but the last bias has one
number for each channel, as released. `cairn.build` writes the same network as an ONNX graph that computes one frame over a ring; a
test holds the two together.

A sequence is a rollout from its seed: frame 0 is the seed's latent at ring clock 0. It is computed in *copies* side by side: copy
0 holds the frames as the cache pass keeps them, every other copy holds the same frames with noise. Frame q of any copy sees
itself, and of copy 0 those frames that the rings show at clock q. So one call trains every frame on the past that a rollout has.
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

Parameters = dict[str, Array]
# Stands for minus infinity in masks, as in the graphs.
HIDDEN = -1e4
# Frames whose scores in global layers are in memory at once.
FRAMES_AT_ONCE = 64


def initial(g: Geometry, seed: int) -> dict[str, np.ndarray]:
    """Where training starts: every sublayer adds nothing, and the velocity is zero."""
    out = {}
    for index, weight in enumerate(transformer_weights(g)):
        rng = np.random.default_rng([seed, index])
        if weight.name.endswith(("v_lamb", "bias")):
            value = np.full(weight.shape, 0.5 if weight.name.endswith("v_lamb") else 0.0, np.float32)
        elif weight.name.startswith(("unpatchify", "out_norm")) or weight.name.endswith("ctrl_mlpfusion.fc2.weight"):
            value = np.zeros(weight.shape, np.float32)
        elif weight.name.startswith("cond_head.cond_proj."):
            # Gates start small and open with the conditioning; scales and shifts start near nothing.
            value = rng.standard_normal(weight.shape, np.float32) * np.float32(0.3 / np.sqrt(weight.fan_in))
        elif weight.name == "cond_head.bias_in":
            value = rng.standard_normal(weight.shape, np.float32) * np.float32(0.5)
        elif weight.name == "ctrl_emb.mlp.fc1.weight":
            value = rng.standard_normal(weight.shape, np.float32) * np.float32(0.3)
        else:
            value = rng.standard_normal(weight.shape, np.float32) / np.float32(np.sqrt(weight.fan_in))
        out[weight.name] = value
    out["unpatchify.bias"] = np.zeros(g.latent_channels, np.float32)
    return out


def local_table(frames: int, window: int) -> np.ndarray:
    """`[frames, frames]`: which kept frames a frame sees in a local layer, beside itself: the last `window - 1`."""
    age = np.arange(frames)[:, None] - np.arange(frames)[None]
    return (age >= 1) & (age < window)


def global_table(frames: int, window: int | Array, dilation: int) -> np.ndarray | Array:
    """`[frames, ceil(frames / dilation)]`: which of the frames 0, d, 2 d, ... a frame sees in a global layer, beside itself.

    A frame whose clock divides by d sees `window / d - 1` of those before it: the oldest is hidden as its slot is taken. Another
    sees `window / d`.
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


def velocity(
    p: Parameters, g: Geometry, x: Array, sigma: Array, controls: Array, window: int | Array, remember: Callable = lambda f: f
) -> Array:
    """Velocities of all frames of all copies.

    `x` `[n, copies, F, h, w, C]`, `sigma` `[n, copies, F]`, `controls` `[n, F, 2 + buttons + 1]`; the result is shaped as `x`.
    `window` is the global window g in latents; as an array it is no constant of what is compiled. `remember` wraps a layer: `jax.checkpoint` saves memory.
    """
    n, copies, F = sigma.shape
    rows, columns = g.grid
    T, D = g.tokens, g.width
    ph, pw = g.patch
    assert x.shape == (n, copies, F, g.latent_height, g.latent_width, g.latent_channels), x.shape
    kind = x.dtype
    p = {name: value.astype(kind) for name, value in p.items()} if kind != jnp.float32 else p

    cond = _noise_condition(p, sigma)  # [n, copies, F, D]
    ctrl = rms(jax.nn.silu(controls.astype(kind) @ p["ctrl_emb.mlp.fc1.weight"]) @ p["ctrl_emb.mlp.fc2.weight"])[:, None]

    # A token's numbers are ordered (c, row in patch, column in patch).
    cells = x.reshape(n, copies, F, rows, ph, columns, pw, g.latent_channels).transpose(0, 1, 2, 3, 5, 7, 4, 6)
    h = cells.reshape(n, copies, F, T, g.patch_width) @ p["patchify.weight"].reshape(D, -1).T
    rope = rope_tables(g, F)
    first_value = None
    for i in range(g.layers):
        layer = remember(lambda h, first, p=_of_layer(p, i), i=i: _layer(p, g, i, h, cond, ctrl, first, rope, window))
        h, first_value = layer(h, first_value)

    scale, shift = jnp.split(jax.nn.silu(cond) @ p["out_norm.fc.weight"], 2, -1)
    y = jax.nn.silu(rms(h) * (1 + scale[..., None, :]) + shift[..., None, :])
    y = y @ p["unpatchify.weight"] + p["unpatchify.bias"].repeat(ph * pw)
    y = y.reshape(n, copies, F, rows, columns, g.latent_channels, ph, pw).transpose(0, 1, 2, 3, 6, 4, 7, 5)
    return y.reshape(x.shape)


def _of_layer(p: Parameters, i: int) -> Parameters:
    """The parameters that layer i reads."""
    block = f"blocks.{i}."
    own = {name.removeprefix(block): value for name, value in p.items() if name.startswith(block)}
    shared = {f"cond.{j}": p[f"cond_head.cond_proj.{j}.weight"] for j in range(len(MODULATIONS))}
    return own | shared | {"bias_in": p["cond_head.bias_in"][i]}


def _noise_condition(p: Parameters, sigma: Array) -> Array:
    """Fourier features of the noise level through a small MLP, in float32 up to its first matrix: `[..., D]`."""
    phase = sigma.astype(jnp.float32)[..., None] * SIGMA_SCALE * fourier_frequencies("none")
    waves = jnp.sqrt(2.0) * jnp.concatenate([jnp.sin(phase), jnp.cos(phase)], -1)
    assert waves.shape[-1] == FOURIER_WIDTH
    first = p["denoise_step_emb.mlp.fc1.weight"]
    return jax.nn.silu(waves.astype(first.dtype) @ first) @ p["denoise_step_emb.mlp.fc2.weight"]


def _layer(p, g: Geometry, i: int, h: Array, cond: Array, ctrl: Array, first_value, rope, window: int | Array):
    """One layer of the transformer: the tokens after it, and layer 0's values."""
    lit = jax.nn.silu(cond + p["bias_in"])
    s0, b0, g0, s1, b1, g1 = ((lit @ p[f"cond.{j}"])[..., None, :] for j in range(len(MODULATIONS)))
    y, first_value = _attention(p, g, i, rms(h) * (1 + s0) + b0, first_value, rope, window)
    h = h + g0 * y
    if g.sees_controls(i):
        mixed = rms(h) @ p["ctrl_mlpfusion.fc1_x.weight"] + (ctrl @ p["ctrl_mlpfusion.fc1_c.weight"])[..., None, :]
        h = h + jax.nn.silu(mixed) @ p["ctrl_mlpfusion.fc2.weight"]
    y = jax.nn.silu((rms(h) * (1 + s1) + b1) @ p["mlp.fc1.weight"]) @ p["mlp.fc2.weight"]
    return h + g1 * y, first_value


def _rotate(x: Array, rope: tuple[Array, Array]) -> Array:
    """Turns `[n, copies, F, T, heads, d]`: neighbours in, halves out."""
    cos, sin = (table[:, :, None] for table in rope)
    even, odd = x[..., 0::2].astype(jnp.float32), x[..., 1::2].astype(jnp.float32)
    return jnp.concatenate([even * cos - odd * sin, odd * cos + even * sin], -1).astype(x.dtype)


def _attention(p, g: Geometry, i: int, x: Array, first_value, rope, window: int | Array):
    """Attention of one layer: (`[n, copies, F, T, D]`, layer 0's values)."""
    n, copies, F, T, D = x.shape
    d = g.head_width
    q = (x @ p["attn.q_proj.weight"]).reshape(n, copies, F, T, g.heads, d)
    k = (x @ p["attn.k_proj.weight"]).reshape(n, copies, F, T, g.kv_heads, d)
    v = (x @ p["attn.v_proj.weight"]).reshape(n, copies, F, T, g.kv_heads, d)
    if first_value is None:
        first_value = v
    else:
        v = v + p["attn.v_lamb"] * (first_value - v)
    q, k = _rotate(rms(q), rope) * d**-0.5, _rotate(rms(k), rope)
    q = q.reshape(n, copies, F, T, g.kv_heads, g.group, d)

    if g.is_global(i):
        step = g.global_dilation
        y = _see_in_parts(q, k, v, k[:, 0, ::step], v[:, 0, ::step], global_table(F, window, step))
    elif F <= g.local_window:
        y = _see(q, k, v, k[:, 0], v[:, 0], local_table(F, g.local_window))
    else:
        y = _see_in_blocks(q, k, v, g.local_window)
    return y.reshape(n, copies, F, T, D) @ p["attn.out_proj.weight"], first_value


def _see(q: Array, k: Array, v: Array, kept_k: Array, kept_v: Array, table: np.ndarray | Array) -> Array:
    """Attention of every frame over itself and over those of S kept frames that `table` `[F, S]` shows.

    `q` `[n, c, F, T, kv, group, d]`, `k` and `v` `[n, c, F, T, kv, d]`, the kept ones `[n, S, T, kv, d]`.
    """
    n, c, F, T, kv, group, d = q.shape
    S = kept_k.shape[1]
    past = jnp.einsum("ncfthgd,nsuhd->ncfhgtsu", q, kept_k)
    past = past + jnp.where(jnp.asarray(table), 0, HIDDEN).astype(q.dtype)[:, None, None, None, :, None]
    own = jnp.einsum("ncfthgd,ncfuhd->ncfhgtu", q, k)
    scores = jnp.concatenate([past.reshape(n, c, F, kv, group, T, S * T), own], -1).astype(jnp.float32)
    shares = jax.nn.softmax(scores, -1).astype(q.dtype)
    y = jnp.einsum("ncfhgtsu,nsuhd->ncfthgd", shares[..., : S * T].reshape(past.shape), kept_v)
    return y + jnp.einsum("ncfhgtu,ncfuhd->ncfthgd", shares[..., S * T :], v)


def _see_in_parts(q: Array, k: Array, v: Array, kept_k: Array, kept_v: Array, table: np.ndarray | Array) -> Array:
    """`_see`, in a long sequence for so many frames at once, which bounds the memory of the scores."""
    F = q.shape[2]
    if F <= FRAMES_AT_ONCE:
        return _see(q, k, v, kept_k, kept_v, table)
    assert F % FRAMES_AT_ONCE == 0, f"{F} frames are not parts of {FRAMES_AT_ONCE}"

    def cut(x: Array) -> Array:
        return jnp.moveaxis(x.reshape(*x.shape[:2], -1, FRAMES_AT_ONCE, *x.shape[3:]), 2, 0)

    see = jax.checkpoint(lambda part: _see(*part[:3], kept_k, kept_v, part[3]))
    y = jax.lax.map(see, (cut(q), cut(k), cut(v), jnp.asarray(table).reshape(-1, FRAMES_AT_ONCE, table.shape[1])))
    return jnp.moveaxis(y, 0, 2).reshape(q.shape)


def _see_in_blocks(q: Array, k: Array, v: Array, window: int) -> Array:
    """Local attention of long sequences: blocks of `window` frames, one after the other, each over itself and the one before."""
    n, copies, F = q.shape[:3]
    assert F % window == 0, f"{F} frames are not blocks of {window}"

    def cut(x: Array) -> Array:
        return jnp.moveaxis(x.reshape(n, copies, -1, window, *x.shape[3:]), 2, 0)

    def two(x: Array) -> Array:
        here = cut(x)[:, :, 0]
        before = jnp.concatenate([jnp.zeros_like(here[:1]), here[:-1]])
        return jnp.concatenate([before, here], 2)

    age = np.arange(window)[:, None] + window - np.arange(2 * window)[None]
    # What lies before the first block is no frame.
    there = (np.arange(F // window) > 0)[:, None, None] | (np.arange(2 * window) >= window)
    table = ((age >= 1) & (age < window))[None] & there
    see = jax.checkpoint(lambda block: _see(*block))
    y = jax.lax.map(see, (cut(q), cut(k), cut(v), two(k), two(v), jnp.asarray(table)))
    return jnp.moveaxis(y, 0, 2).reshape(q.shape)
