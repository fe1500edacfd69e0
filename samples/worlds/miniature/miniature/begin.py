"""Training states of a bundle's weights: what goes on from a world that is there, where its own training state is not."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from cairn.build import archive
from cairn.build.geometry import Geometry
from cairn.build.weights import Placed
from cairn.build.writer import layouts

from . import optimiser, store, train_world


class OtherShapes(ValueError):
    """A bundle whose networks are not shaped like those that are trained."""


Parameters = dict[str, np.ndarray]


def weights(bundle: Path, g: Geometry) -> tuple[Parameters, Parameters]:
    """The numbers of `bundle`, a folder or one file, as training has them: the transformer's and the autoencoder's."""
    if (found := archive.read_geometry(bundle)) != g:
        raise OtherShapes(f"{bundle} has other shapes than this preset: {found}, not {g}")
    with tempfile.TemporaryDirectory() as name:
        folder = bundle if bundle.is_dir() else archive.unpack(bundle, Path(name) / "bundle")
        transformer, pictures = ({name: _read(folder, placed) for name, placed in group.items()} for group in layouts(g))
    # The bundle has the last bias once for each pixel of a patch, training once for each channel.
    transformer["unpatchify.bias"] = transformer["unpatchify.bias"][:: g.patch[0] * g.patch[1]]
    return transformer, pictures


def states(bundle: Path, g: Geometry, autoencoder: Path, world: Path) -> None:
    """Writes the states before a first step from the numbers of `bundle`."""
    transformer, pictures = weights(bundle, g)
    facts = {"seconds": 0.0, "flops": 0.0, "begun": bundle.name}
    store.save(autoencoder, optimiser.start(pictures), facts)
    store.save(world, optimiser.start(transformer, train_world.by_muon), facts)


def _read(folder: Path, placed: Placed) -> np.ndarray:
    """One tensor, float32."""
    halves = np.fromfile(folder / placed.file, "<f2", placed.weight.count, offset=placed.offset)
    return halves.reshape(placed.weight.shape).astype(np.float32)
