"""A small discriminator of latents: it judges whether a predicted frame has a true one's detail, given the frame before it in the past.

A transformer that is trained on squared errors alone predicts the mean of all that may come, which is a blur. Its parameters are trained
beside the transformer's, under names of their own; hinge loss [Lim and Ye 2017, arXiv:1705.02894].
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from .adversary import LEAK, PREFIX, fooling, hinge

# Width of each layer; kernels of 3 x 3, so that each logit sees 9 x 9 tokens.
WIDTHS = (128, 128, 128, 1)


def initial(channels: int, seed: int) -> dict[str, np.ndarray]:
    """Initial parameters, for latents of `channels` channels."""
    out, width = {}, 2 * channels
    for index, wide in enumerate(WIDTHS):
        rng = np.random.default_rng([seed, index])
        scale = np.float32(np.sqrt(2.0 / (width * 9)))
        out[f"{PREFIX}{index}.weight"] = rng.standard_normal((wide, width, 3, 3), np.float32) * scale
        out[f"{PREFIX}{index}.bias"] = np.zeros(wide, np.float32)
        width = wide
    return out


def features(p: dict[str, Array], before: Array, frames: Array, kind: jnp.dtype) -> list[Array]:
    """Frames and those before them, both `[n, h, w, C]` -> activations of every layer, computed in `kind`; the last are the logits, above
    0 for true frames.
    """
    x, out = jnp.concatenate([before, frames], -1).astype(kind), []
    for index in range(len(WIDTHS)):
        weight, bias = (p[f"{PREFIX}{index}.{name}"].astype(kind) for name in ("weight", "bias"))
        y = lax.conv_general_dilated(x, weight, (1, 1), "SAME", dimension_numbers=("NHWC", "OIHW", "NHWC")) + bias
        out.append(y.astype(jnp.float32))
        x = jax.nn.leaky_relu(y, LEAK)
    return out


def discriminator_loss(p: dict[str, Array], before: Array, true: Array, made: Array, kind: jnp.dtype) -> Array:
    """Hinge loss of the discriminator."""
    return hinge(features(p, jnp.concatenate([before, before]), jnp.concatenate([true, made]), kind))


def generator_loss(p: dict[str, Array], before: Array, true: Array, made: Array, kind: jnp.dtype) -> Array:
    """Loss of the transformer: the negative mean of the logits, and the distance of the discriminator's features from those of the truth."""
    return fooling(features(p, jnp.concatenate([before, before]), jnp.concatenate([true, made]), kind))
