"""TAEHV-1.5 in JAX: x4 in time, x16 in space with the pixel shuffle outside, causal memories.

Parameters are a dictionary by the released names, kernels `[out, in, rows, columns]`. Pictures and latents have their channels
last; a latent is `[h, w, C]`. `cairn.build` writes the same network as two ONNX graphs, and a test holds the two together.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from cairn.build.geometry import AUTOENCODER_PATCH, AUTOENCODER_TEMPORAL, MEMORIES_PER_STAGE, STAGES, Geometry
from cairn.build.weights import DECODER_GROWTH, ENCODER_POOLING, autoencoder_weights
from jax import Array, lax

Parameters = dict[str, Array]
# The decoder's first step bounds the latent softly: tanh(x / 3) * 3.
SOFT_LIMIT = 3.0


def initial(g: Geometry, seed: int) -> dict[str, np.ndarray]:
    """Initial parameters: memory blocks are near the identity, all other layers keep the variance."""
    linear = {"encoder.0", "decoder.1", *(f"encoder.{3 + 5 * stage}" for stage in range(STAGES))}
    # After upsampling neighbours are equal, so their weights add up.
    doubled = {f"decoder.{8 + 6 * stage}" for stage in range(STAGES)}
    out = {}
    for index, weight in enumerate(autoencoder_weights(g)):
        rng = np.random.default_rng([seed, index])
        if weight.name.endswith(".bias"):
            value = np.zeros(weight.shape, np.float32)
        else:
            name = weight.name.removesuffix(".weight")
            gain = 1.0 if name in linear else 0.6 if name in doubled else np.sqrt(2.0)
            gain *= 0.1 if name.endswith(".conv.4") else 1.0
            value = rng.standard_normal(weight.shape, np.float32) * np.float32(gain / np.sqrt(weight.fan_in))
        out[weight.name] = value
    out["decoder.22.bias"] = np.full_like(out["decoder.22.bias"], 0.5)
    out["decoder.22.weight"] *= np.float32(0.2)
    return out


def encode(p: Parameters, rgb: Array) -> Array:
    """Clips `[n, 4, H, W, 3]` in [0, 1] -> latents `[n, h, w, C]`; memories start at zero in every clip."""
    n, frames, H, W, _ = rgb.shape
    assert frames == AUTOENCODER_TEMPORAL
    s = AUTOENCODER_PATCH
    # Channel, row in patch, column in patch.
    x = rgb.reshape(n, frames, H // s, s, W // s, s, 3).transpose(0, 1, 2, 4, 6, 3, 5)
    x = x.reshape(n, frames, H // s, W // s, 3 * s * s)
    x = jax.nn.relu(_conv(p, x, "encoder.0"))
    for stage, pooled in enumerate(ENCODER_POOLING):
        first = 2 + stage * (2 + MEMORIES_PER_STAGE)
        _, frames, rows, columns, width = x.shape
        # Joined frames are concatenated along the channels.
        x = x.reshape(n, frames // pooled, pooled, rows, columns, width).transpose(0, 1, 3, 4, 2, 5)
        x = x.reshape(n, frames // pooled, rows, columns, pooled * width)
        x = _conv(p, x, f"encoder.{first}.conv")
        x = _conv(p, x, f"encoder.{first + 1}", stride=2)
        for m in range(MEMORIES_PER_STAGE):
            x = _memory_block(p, x, f"encoder.{first + 2 + m}")
    x = _conv(p, x, f"encoder.{2 + STAGES * (2 + MEMORIES_PER_STAGE)}")
    return x[:, 0]


def decode(p: Parameters, latents: Array) -> Array:
    """Sequences `[n, L, h, w, C]` -> pictures `[n, 4 L, H, W, 3]`, not clipped; memories start at zero."""
    n = latents.shape[0]
    x = jnp.tanh(latents / SOFT_LIMIT) * SOFT_LIMIT
    x = jax.nn.relu(_conv(p, x, "decoder.1"))
    for stage, grown in enumerate(DECODER_GROWTH):
        first = 3 + stage * (3 + MEMORIES_PER_STAGE)
        for m in range(MEMORIES_PER_STAGE):
            x = _memory_block(p, x, f"decoder.{first + m}")
        grow = first + MEMORIES_PER_STAGE + 1
        _, frames, rows, columns, width = x.shape
        x = _conv(p, x, f"decoder.{grow}.conv").reshape(n, frames, rows, columns, grown, width)
        x = x.transpose(0, 1, 4, 2, 3, 5).reshape(n, frames * grown, rows, columns, width)
        x = x.repeat(2, axis=2).repeat(2, axis=3)
        x = _conv(p, x, f"decoder.{grow + 1}")
    last = 3 + STAGES * (3 + MEMORIES_PER_STAGE)
    x = _conv(p, jax.nn.relu(x), f"decoder.{last + 1}")
    _, frames, rows, columns, _ = x.shape
    s = AUTOENCODER_PATCH
    x = x.reshape(n, frames, rows, columns, 3, s, s).transpose(0, 1, 2, 5, 3, 6, 4)
    return x.reshape(n, frames, rows * s, columns * s, 3)


def _conv(p: Parameters, x: Array, name: str, stride: int = 1) -> Array:
    """A convolution of every frame: `[n, frames, rows, columns, in]`, or without frames."""
    kernel = p[f"{name}.weight"]
    pad = kernel.shape[-1] // 2
    flat = x.reshape(-1, *x.shape[-3:])
    y = lax.conv_general_dilated(flat, kernel, (stride, stride), [(pad, pad)] * 2, dimension_numbers=("NHWC", "OIHW", "NHWC"))
    if (bias := p.get(f"{name}.bias")) is not None:
        y = y + bias
    return y.reshape(*x.shape[:-3], *y.shape[-3:])


def _memory_block(p: Parameters, x: Array, name: str) -> Array:
    """relu(conv(relu(conv(relu(conv([x, past]))))) + x), past being x one frame earlier, and zero before the first."""
    past = jnp.concatenate([jnp.zeros_like(x[:, :1]), x[:, :-1]], axis=1)
    y = jnp.concatenate([x, past], axis=-1)
    for j in (0, 2):
        y = jax.nn.relu(_conv(p, y, f"{name}.conv.{j}"))
    return jax.nn.relu(_conv(p, y, f"{name}.conv.4") + x)
