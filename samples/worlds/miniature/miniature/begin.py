"""Training states from a bundle's weights, to continue the training of a world whose training state is lost."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from cairn.build import archive
from cairn.build.geometry import MEMORIES_PER_STAGE, Geometry
from cairn.build.stored import StoredWeights
from cairn.build.weights import DECODER_GROWTH, ENCODER_POOLING, autoencoder_weights, transformer_weights

from . import autoencoder as networks
from . import latent_adversary, optimiser, store, train_autoencoder, train_world
from .shapes import AutoencoderPlan


class OtherShapes(ValueError):
    """The bundle's networks have other shapes than the preset's."""


Parameters = dict[str, np.ndarray]


def weights(bundle: Path, g: Geometry) -> tuple[Parameters, Parameters]:
    """Parameters of `bundle`, a folder or one file, in training's layout: the transformer's and the autoencoder's."""
    found = archive.read_geometry(bundle)
    if found.with_(encoder_width=g.encoder_width, decoder_widths=g.decoder_widths) != g:
        raise OtherShapes(f"{bundle} has other shapes than this preset: {found}, not {g}")
    here = (found.encoder_width, *found.decoder_widths)
    if any(wide < narrow for wide, narrow in zip((g.encoder_width, *g.decoder_widths), here)):
        raise OtherShapes(f"{bundle} has a wider autoencoder than this preset: {found}, not {g}")
    with tempfile.TemporaryDirectory() as name:
        folder = bundle if bundle.is_dir() else archive.unpack(bundle, Path(name) / "bundle")
        source = StoredWeights(found, folder)
        named = (transformer_weights(found), autoencoder_weights(found))
        transformer, pictures = ({w.name: source.get(w).astype(np.float32) for w in group} for group in named)
    # The bundle has the last bias for each pixel of a patch, training for each channel.
    transformer["unpatchify.bias"] = transformer["unpatchify.bias"][:: g.patch[0] * g.patch[1]]
    return transformer, widened(pictures, g)


def widened(narrow: Parameters, g: Geometry) -> Parameters:
    """An autoencoder of `g` that computes what `narrow` does: its channels are kept, and weights that read a new channel start at zero.

    The weights that compute a new channel start at random, so that those zeros have a gradient from the first step on.
    """
    out, start = {}, networks.initial(g, train_autoencoder.SEED)
    parts = _joined_parts()
    for weight in autoencoder_weights(g):
        old, new = narrow[weight.name], start[weight.name].copy()
        outputs, inputs = parts.get(weight.name, (1, 1))
        kept = _kept_channels(old.shape[0], new.shape[0], outputs)
        if new.ndim == 1:
            new[kept] = old
        else:
            new[kept] = 0
            new[np.ix_(kept, _kept_channels(old.shape[1], new.shape[1], inputs))] = old
        out[weight.name] = new
    return out


def _joined_parts() -> dict[str, tuple[int, int]]:
    """Output and input counts of frames for tensors whose channels are those of several frames in a row."""
    out = {}
    for stage, frames in enumerate(ENCODER_POOLING):
        first = 2 + stage * (2 + MEMORIES_PER_STAGE)
        out[f"encoder.{first}.conv.weight"] = (1, frames)
        out |= {f"encoder.{first + 2 + m}.conv.0.weight": (1, 2) for m in range(MEMORIES_PER_STAGE)}
    for stage, frames in enumerate(DECODER_GROWTH):
        first = 3 + stage * (3 + MEMORIES_PER_STAGE)
        out |= {f"decoder.{first + m}.conv.0.weight": (1, 2) for m in range(MEMORIES_PER_STAGE)}
        out[f"decoder.{first + MEMORIES_PER_STAGE + 1}.conv.weight"] = (frames, 1)
    return out


def _kept_channels(narrow: int, wide: int, parts: int) -> np.ndarray:
    """Indices of a narrow axis' channels in a wide one; each of `parts` parts is widened at its end."""
    return np.concatenate([part * (wide // parts) + np.arange(narrow // parts) for part in range(parts)])


def states(bundle: Path, g: Geometry, plan: AutoencoderPlan, autoencoder: Path, world: Path, judged: bool = False) -> None:
    """Writes initial states with the parameters of `bundle`; `judged` adds a discriminator of latents."""
    transformer, pictures = weights(bundle, g)
    facts = {"seconds": 0.0, "flops": 0.0, "begun": bundle.name}
    store.save(autoencoder, train_autoencoder.start(pictures, plan), facts)
    judge = latent_adversary.initial(g.latent_channels, train_world.SEED) if judged else {}
    store.save(world, optimiser.start(transformer | judge, train_world.by_muon), facts)
