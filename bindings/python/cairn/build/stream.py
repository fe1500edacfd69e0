"""Random numbers by name and seed, the same on every machine.

Numbers are sums of four 16-bit integers: nearly normal, and exact in integer arithmetic, whereas a logarithm could differ by platform. Each
name has a stream of its own, so that the numbers do not depend on the order or sizes of other tensors.
"""

from __future__ import annotations

import hashlib
import math

import numpy as np

# Four uniform 16-bit integers: mean 2 * 65535, variance 4 * (65536^2 - 1) / 12.
_MEAN = 2 * 65535
_DEVIATION = math.sqrt(4 * (65536**2 - 1) / 12)
# Numbers generated at a time; bounds the memory for large matrices.
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
        """Nearly normal numbers of mean 0 and standard deviation `deviation`, in float32."""
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
