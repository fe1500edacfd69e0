"""Random weights of the autoencoder: nearly linear, smooth and centred, so that pictures have colour and shape.

Channels inside the network come in pairs, relu(z) and relu(-z), whose difference is z. So a layer that reads pairs with opposite signs, and
writes its output as pairs, is linear in z. Kernels are small bells times a random mixing of channels. The memory blocks have random kernels,
which add detail.
"""

from __future__ import annotations

import math

import numpy as np

from .geometry import Geometry
from .stream import Stream
from .weights import DECODER_GROWTH, ENCODER_POOLING, Weight

# Relative size of what a memory block adds to its input.
MEMORY = 0.35
# Relative difference between the frames of one latent.
FRAME = 0.3
# Standard deviation of decoded pictures about 1/2 for latents of deviation 1, and the reverse gain.
CONTRAST = 0.09
GAIN = 1.5
# Difference between the four pixels of a patch, relative to their common value.
TEXTURE = 0.05


class RandomAutoencoder:
    """Makes each tensor of `weights.autoencoder_weights`, in float32."""

    def __init__(self, g: Geometry, stream: Stream):
        self.g = g
        self.stream = stream

    def get(self, weight: Weight) -> np.ndarray:
        """The numbers of one tensor."""
        name = weight.name
        if name == "encoder.0.weight":
            return self.mixing(weight, name, 0.5 * GAIN, reads_pairs=False, writes_pairs=True)
        if name == "encoder.0.bias":
            return self.centre()
        if name == "decoder.22.bias":
            return np.full(weight.shape, 0.5, np.float32)
        if name.endswith(".bias"):
            return self.stream.normal(name, weight.shape, 0.02)
        if name == "decoder.1.weight":
            return self.mixing(weight, name, 1.0, reads_pairs=False, writes_pairs=True)
        if name in ("encoder.17.weight", "decoder.22.weight"):
            return self.last(weight)
        if name.endswith(".conv.weight"):
            return self.over_time(weight)
        if ".conv." in name:
            scale = {"0": 1.0, "2": 1.0, "4": MEMORY}[name.split(".")[3]]
            return self.rough(weight, scale)
        return self.mixing(weight, name, 1.0, reads_pairs=True, writes_pairs=True)

    def mixing(self, weight: Weight, name: str, gain: float, reads_pairs: bool, writes_pairs: bool) -> np.ndarray:
        """A random mixing of channels times a bell; pairs are channel c and c + half."""
        outputs, inputs, size, _ = weight.shape
        n, m = (outputs + 1) // 2 if writes_pairs else outputs, (inputs + 1) // 2 if reads_pairs else inputs
        matrix = self.stream.normal(name, (n, m), gain / math.sqrt(m))
        return self.kernel(self.unfold(matrix, outputs, inputs, reads_pairs, writes_pairs), size)

    def rough(self, weight: Weight, gain: float) -> np.ndarray:
        """A random kernel without a bell, for detail that smooth kernels would remove; pairs as in `mixing`."""
        outputs, inputs, size, _ = weight.shape
        n, m = (outputs + 1) // 2, (inputs + 1) // 2
        kernels = self.stream.normal(weight.name, (n, m, size, size), gain / (size * math.sqrt(m)))
        return self.unfold(kernels, outputs, inputs, True, True)

    @staticmethod
    def unfold(matrix: np.ndarray, outputs: int, inputs: int, reads_pairs: bool, writes_pairs: bool) -> np.ndarray:
        """[n, m] -> [outputs, inputs]: adds both signs for each paired channel."""
        if reads_pairs:
            matrix = np.concatenate([matrix, -matrix], axis=1)[:, :inputs]
        if writes_pairs:
            matrix = np.concatenate([matrix, -matrix], axis=0)[:outputs]
        return matrix

    @staticmethod
    def kernel(matrix: np.ndarray, size: int) -> np.ndarray:
        """The matrix times a bell with sum 1: for size 3, [1, 2, 1] / 4 in each direction."""
        bell = {1: np.array([1.0]), 3: np.array([0.25, 0.5, 0.25])}[size]
        return matrix[:, :, None, None] * np.outer(bell, bell).astype(np.float32)

    def centre(self) -> np.ndarray:
        """The bias that makes 1/2 the middle of the input's range; sums of float16 numbers are exact in float64."""
        g = self.g
        first = Weight("encoder.0.weight", (g.encoder_width, 12, 3, 3), 108)
        total = self.get(first).astype(np.float16).astype(np.float64).sum(axis=(1, 2, 3))
        return (-0.5 * total).astype(np.float32)

    def over_time(self, weight: Weight) -> np.ndarray:
        """A pooling layer averages its frames; a growing layer makes frames that differ slightly."""
        name = weight.name
        outputs, inputs = weight.shape[:2]
        network, layer, _, _ = name.split(".")
        if network == "encoder":
            frames = ENCODER_POOLING[(int(layer) - 2) // 5]
            one = self.frame(f"{name}.0", outputs, inputs // frames, 1.0 / frames)
            parts = [one + self.frame(f"{name}.{k + 1}", outputs, inputs // frames, FRAME / frames) for k in range(frames)]
            return np.concatenate(parts, axis=1)[:, :, None, None]
        frames = DECODER_GROWTH[(int(layer) - 3) // 6]
        one = self.frame(f"{name}.0", outputs // frames, inputs, 1.0)
        parts = [one + self.frame(f"{name}.{k + 1}", outputs // frames, inputs, FRAME) for k in range(frames)]
        return np.concatenate(parts)[:, :, None, None]

    def frame(self, name: str, outputs: int, inputs: int, gain: float) -> np.ndarray:
        """One frame's random mixing of paired channels."""
        matrix = self.stream.normal(name, ((outputs + 1) // 2, (inputs + 1) // 2), gain / math.sqrt((inputs + 1) // 2))
        return self.unfold(matrix, outputs, inputs, True, True)

    def last(self, weight: Weight) -> np.ndarray:
        """The layer that makes latents, or pixels. The four pixels of a patch have nearly the same mixing."""
        name = weight.name
        outputs, inputs, size, _ = weight.shape
        m = (inputs + 1) // 2
        if name.startswith("encoder"):
            matrix = self.stream.normal(name, (outputs, m), 1.0 / math.sqrt(m))
        else:
            colours = self.stream.normal(name, (3, m), CONTRAST / math.sqrt(m))
            texture = self.stream.normal(f"{name}.texture", (outputs, m), TEXTURE * CONTRAST / math.sqrt(m))
            matrix = np.repeat(colours, outputs // 3, axis=0) + texture
        return self.kernel(self.unfold(matrix, outputs, inputs, True, False), size)
