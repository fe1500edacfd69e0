"""Seeded random weights: the same bytes on every machine.

Each tensor is computed element by element from random streams of its own, so that no result depends on the order of a summation.
`random_transformer` and `random_autoencoder` define scales and structure, without which a random network shows grey or noise.
"""

from __future__ import annotations

import numpy as np

from .geometry import Geometry
from .random_autoencoder import RandomAutoencoder
from .random_transformer import RandomTransformer
from .stream import Stream
from .weights import Weight


class RandomWeights:
    """A source of weights for one geometry: `get(weight)` gives its float16 numbers in stored layout."""

    def __init__(self, geometry: Geometry, seed: int):
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
