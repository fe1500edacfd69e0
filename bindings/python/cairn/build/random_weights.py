"""Seeded random weights: the same bytes on every machine.

Each tensor has a random stream of its own, keyed by the seed and the tensor's name, so that neither the order nor the
sizes of the others matter. Numbers are sums of four 16-bit integers: close to normal, and exact in integer arithmetic,
where a logarithm could differ by platform. What is done with them afterwards is element by element, for the same reason.

The scales and the structure, without which a random network shows grey or noise, are in `random_transformer` and
`random_autoencoder`.
"""

from __future__ import annotations

import hashlib
import math

import numpy as np

from .geometry import Geometry
from .weights import Weight

# Four uniform 16-bit integers: mean 2 * 65535, variance 4 * (65536^2 - 1) / 12.
_MEAN = 2 * 65535
_DEVIATION = math.sqrt(4 * (65536**2 - 1) / 12)
# Numbers made at once: bounds memory for the large matrices.
_BLOCK = 1 << 22


class Stream:
    """Random numbers of one seed, by name."""

    def __init__(self, seed: int):
        self.seed = seed

    def bits(self, name: str) -> np.random.Philox:
        """The raw generator of one name."""
        key = hashlib.sha256(f"cairn:{self.seed}:{name}".encode()).digest()[:16]
        return np.random.Philox(key=int.from_bytes(key, "little"))

    def normal(self, name: str, shape: tuple[int, ...], deviation: float) -> np.ndarray:
        """About normal numbers of mean 0, in float32."""
        bits, count = self.bits(name), math.prod(shape)
        out = np.empty(count, np.float32)
        factor = np.float32(deviation / _DEVIATION)
        for start in range(0, count, _BLOCK):
            raw = bits.random_raw(min(_BLOCK, count - start)).astype("<u8", copy=False)
            total = raw.view("<u2").reshape(-1, 4).sum(axis=1, dtype=np.int32) - _MEAN
            out[start : start + len(raw)] = total.astype(np.float32) * factor
        return out.reshape(shape)

    def signs(self, name: str, count: int) -> np.ndarray:
        """+1 or -1, in float32."""
        raw = self.bits(name).random_raw(count)
        return np.where(raw & np.uint64(1), np.float32(1), np.float32(-1))


class RandomWeights:
    """A source of weights for one geometry: `get(weight)` gives its float16 numbers in stored layout."""

    def __init__(self, geometry: Geometry, seed: int):
        from .random_autoencoder import RandomAutoencoder
        from .random_transformer import RandomTransformer

        self.seed = seed
        stream = Stream(seed)
        self._transformer = RandomTransformer(geometry, stream)
        self._autoencoder = RandomAutoencoder(geometry, stream)

    def get(self, weight: Weight) -> np.ndarray:
        """The numbers of one tensor."""
        maker = self._autoencoder if weight.name.startswith(("encoder.", "decoder.")) else self._transformer
        array = maker.get(weight)
        if array.shape != weight.shape:
            raise AssertionError(f"{weight.name}: made {array.shape}, wanted {weight.shape}")
        return array.astype(np.float16)
