"""A small patch discriminator over three consecutive pictures: it judges detail, and how detail moves.

Its parameters are trained beside the autoencoder's, under names of their own; hinge loss [Lim and Ye 2017, arXiv:1705.02894].
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

PREFIX = "adversary."
PICTURES = 3
# Width, kernel and stride of each layer; each logit sees 54 x 54 pixels.
LAYERS = ((32, 4, 2), (64, 4, 2), (96, 4, 2), (96, 3, 1), (1, 3, 1))
LEAK = 0.2


def initial(seed: int) -> dict[str, np.ndarray]:
    """Initial parameters."""
    out, width = {}, 3 * PICTURES
    for index, (wide, kernel, _) in enumerate(LAYERS):
        rng = np.random.default_rng([seed, index])
        scale = np.float32(np.sqrt(2.0 / (width * kernel * kernel)))
        out[f"{PREFIX}{index}.weight"] = rng.standard_normal((wide, width, kernel, kernel), np.float32) * scale
        out[f"{PREFIX}{index}.bias"] = np.zeros(wide, np.float32)
        width = wide
    return out


def features(p: dict[str, Array], pictures: Array) -> list[Array]:
    """`[n, 3, H, W, 3]` in [0, 1] -> activations of every layer; the last are the logits, above 0 for true pictures."""
    n, frames, H, W, _ = pictures.shape
    assert frames == PICTURES
    x = pictures.transpose(0, 2, 3, 1, 4).reshape(n, H, W, 3 * frames) * 2 - 1
    out = []
    for index, (_, kernel, stride) in enumerate(LAYERS):
        pad = (kernel - 1) // 2
        y = lax.conv_general_dilated(
            x, p[f"{PREFIX}{index}.weight"], (stride, stride), [(pad, pad)] * 2, dimension_numbers=("NHWC", "OIHW", "NHWC")
        )
        out.append(y + p[f"{PREFIX}{index}.bias"])
        x = jax.nn.leaky_relu(out[-1], LEAK)
    return out


def discriminator_loss(p: dict[str, Array], true: Array, made: Array) -> Array:
    """Hinge loss of the discriminator."""
    return hinge(features(p, jnp.concatenate([true, made])))


def generator_loss(p: dict[str, Array], true: Array, made: Array) -> Array:
    """Loss of the decoder: the negative mean of the logits, and the distance of the discriminator's features from those of the truth."""
    return fooling(features(p, jnp.concatenate([true, made])))


def hinge(both: list[Array]) -> Array:
    """Hinge loss of a discriminator, from its activations of true samples and as many made ones after them."""
    true, made = jnp.split(both[-1], 2)
    return jnp.mean(jax.nn.relu(1 - true)) + jnp.mean(jax.nn.relu(1 + made))


def fooling(both: list[Array]) -> Array:
    """Loss of what a discriminator judges, from the same activations: the logits' negative mean, and the features' distance from the truth's."""
    pairs = [jnp.split(f, 2) for f in both]
    return sum(jnp.mean(jnp.abs(made - lax.stop_gradient(true))) for true, made in pairs[:-1]) - jnp.mean(pairs[-1][1])
