"""The world model over a whole history at once: every frame is computed from its own input, without a cache.

`Frames` lists all frames: those that filled a slot (*kept*), and those under test. One call of `run` computes all layers for all of
them; attention follows the tables of `visibility`.
"""

from dataclasses import dataclass

import numpy as np

from . import rope
from .geometry import Geometry
from .visibility import global_table, local_table
from .weights import BlockWeights, TransformerWeights

RMS_EPS = float(np.finfo(np.float32).eps)
ROWS_AT_ONCE = 16


@dataclass
class Frames:
    """N frames: the model's inputs, the ring clock, and whether the frame fills a slot."""

    x: np.ndarray  # [N, C, h, w]
    sigma: np.ndarray  # [N]
    time: np.ndarray  # [N] RoPE time
    clock: np.ndarray  # [N] commits before this frame
    controls: np.ndarray  # [N, mouse + buttons + scroll]
    kept: np.ndarray  # [N] bool: fills a slot with this very input


@dataclass
class Result:
    """The model's outputs for every frame."""

    v: np.ndarray  # [N, C, h, w]
    keys: list[np.ndarray]  # per layer [N, kv_heads, T, head_width], after norm and RoPE
    values: list[np.ndarray]  # per layer, after the value residual


def silu(x: np.ndarray) -> np.ndarray:
    return x / (1 + np.exp(-x))


def rms(x: np.ndarray) -> np.ndarray:
    return x / np.sqrt(np.mean(x * x, axis=-1, keepdims=True) + RMS_EPS)


def run(
    weights: TransformerWeights, geometry: Geometry, frames: Frames, global_window: int, *, blind: bool = False
) -> Result:
    """Computes all layers for all frames. `blind` hides every past frame, to measure what the past contributes."""
    N, C, h, w = frames.x.shape
    assert (C, h, w) == (geometry.C, geometry.h, geometry.w)
    rows, columns = geometry.grid
    ph, pw = geometry.patch
    T, D = geometry.T, geometry.D

    tables = {
        False: local_table(frames.clock, frames.clock, geometry.local_window),
        True: global_table(frames.clock, frames.clock, global_window, geometry.dilation),
    }
    for table in tables.values():
        table &= frames.kept[None, :] & (not blind)
        np.fill_diagonal(table, True)

    angle = rope.angles(geometry, frames.time)
    cond = noise_condition(weights, frames.sigma)  # [N, D]
    control = rms(silu(frames.controls @ weights.control_fc1.T) @ weights.control_fc2.T)  # [N, D]

    cells = frames.x.reshape(N, C, rows, ph, columns, pw).transpose(0, 2, 4, 1, 3, 5).reshape(N, T, C * ph * pw)
    x = cells @ weights.patchify.reshape(D, C * ph * pw).T
    assert x.shape == (N, T, D)

    keys, values, first_values = [], [], None
    for layer, block in enumerate(weights.blocks):
        s0, b0, g0, s1, b1, g1 = (silu(cond + block.bias_in) @ p.T for p in weights.condition)
        q, k, v = project(block, geometry, rms(x) * (1 + s0[:, None]) + b0[:, None])
        if first_values is None:
            first_values = v
        v = v + block.value_mix * (first_values - v)
        q, k = rope.rotate(rms(q), angle), rope.rotate(rms(k), angle)
        keys.append(k)
        values.append(v)

        seen = attend(q, k, v, tables[geometry.is_global(layer)])
        x = x + g0[:, None] * (seen.transpose(0, 2, 1, 3).reshape(N, T, D) @ block.out.T)
        if geometry.sees_controls(layer):
            mixed = rms(x) @ block.control_x.T + (control @ block.control_c.T)[:, None]
            x = x + silu(mixed) @ block.control_fc2.T
        x = x + g1[:, None] * (silu((rms(x) * (1 + s1[:, None]) + b1[:, None]) @ block.fc1.T) @ block.fc2.T)

    scale, shift = np.split(silu(cond) @ weights.out_norm.T, 2, axis=-1)
    y = silu(rms(x) * (1 + scale[:, None]) + shift[:, None]) @ weights.unpatchify.T + weights.unpatchify_bias
    v = y.reshape(N, rows, columns, C, ph, pw).transpose(0, 3, 1, 4, 2, 5).reshape(N, C, h, w)
    return Result(v=v, keys=keys, values=values)


def noise_condition(weights: TransformerWeights, sigma: np.ndarray) -> np.ndarray:
    """Fourier features of the noise level through a small MLP: `[N]` -> `[N, D]`."""
    half = weights.noise_fc1.shape[1] // 2
    phase = np.asarray(sigma, dtype=np.float64)[:, None] * 1000 * np.logspace(0, -1, half, base=10000.0)
    features = np.sqrt(2.0) * np.concatenate((np.sin(phase), np.cos(phase)), axis=-1)
    return silu(features @ weights.noise_fc1.T) @ weights.noise_fc2.T


def project(block: BlockWeights, geometry: Geometry, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`[N, T, D]` -> queries, keys and values, `[N, heads, T, head_width]` each with its own number of heads."""

    def heads(matrix: np.ndarray, count: int) -> np.ndarray:
        return (x @ matrix.T).reshape(len(x), geometry.T, count, geometry.head_width).transpose(0, 2, 1, 3)

    return heads(block.q, geometry.heads), heads(block.k, geometry.kv_heads), heads(block.v, geometry.kv_heads)


def attend(q: np.ndarray, k: np.ndarray, v: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Softmax attention between frames: `[N, heads, T, head_width]`, frame i over the frames that `table[i]` names."""
    N, heads, T, width = q.shape
    group = heads // k.shape[1]
    out = np.empty_like(q)
    for start in range(0, N, ROWS_AT_ONCE):
        rows = slice(start, min(start + ROWS_AT_ONCE, N))
        columns = np.flatnonzero(table[rows].any(axis=0))
        n, m = rows.stop - rows.start, len(columns)
        hidden = np.repeat(~table[rows][:, columns], T, axis=1)  # [n, m * T]
        for head in range(heads):
            keys = k[columns, head // group].reshape(m * T, width)
            score = (q[rows, head].reshape(n * T, width) @ keys.T).reshape(n, T, m * T) / np.sqrt(width)
            score = np.where(hidden[:, None, :], -np.inf, score)
            weight = np.exp(score - score.max(axis=-1, keepdims=True))
            weight /= weight.sum(axis=-1, keepdims=True)
            values = v[columns, head // group].reshape(m * T, width)
            out[rows, head] = (weight.reshape(n * T, m * T) @ values).reshape(n, T, width)
    return out
