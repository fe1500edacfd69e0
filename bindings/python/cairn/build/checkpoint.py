"""A Waypoint-1.5 checkpoint directory as a source of weights.

All names and shapes are checked from the files' headers before any number is read: every name must be known, every tensor of the bundle must be
present exactly once, and every shape must be right.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .config import read_config
from .errors import BuildError
from .geometry import Geometry
from .names import Meaning, meaning
from .tensor_files import TensorFiles, open_weights, to_half
from .weights import Weight, autoencoder_weights, transformer_weights

AUTOENCODER_NAMES = ("taehv1_5.pth", "taehv1_5.safetensors")
_GROWN = "decoder.7.conv.weight"


def open_checkpoint(directory: Path, autoencoder: Path | None = None, max_window: int = 512) -> "Checkpoint":
    """Reads config and headers. Numbers are read later, while the bundle is written."""
    if not directory.is_dir():
        raise BuildError("it is no directory", field=str(directory), remedy="Name the directory of a downloaded checkpoint.")
    weights = open_weights(directory)
    pictures = _open_autoencoder(directory, autoencoder)
    geometry = read_config(directory / "config.yaml", max_window, **_autoencoder_widths(pictures))
    return Checkpoint(geometry, weights, pictures)


def _open_autoencoder(directory: Path, given: Path | None) -> TensorFiles:
    found = [given] if given is not None else [directory / n for n in AUTOENCODER_NAMES if (directory / n).is_file()]
    if not found or not found[0].is_file():
        raise BuildError(
            "the autoencoder is missing",
            field=str(given or directory / AUTOENCODER_NAMES[0]),
            remedy="Put taehv1_5.pth there, or name it with --autoencoder.",
        )
    files = TensorFiles()
    (files.add_safetensors if found[0].suffix == ".safetensors" else files.add_torch)(found[0])
    return files


def _autoencoder_widths(files: TensorFiles) -> dict:
    names = ("encoder.0.weight", "decoder.1.weight", "decoder.8.weight", "decoder.14.weight", "decoder.20.weight")
    for name in names:
        if len(files.shapes.get(name, ())) != 4:
            raise BuildError("it is missing or no convolution", field=name, remedy="Give TAEHV-1.5's file, taehv1_5.pth.")
    widths = [files.shapes[name][0] for name in names]
    return {"encoder_width": widths[0], "decoder_widths": tuple(widths[1:])}


class Checkpoint:
    """A source of weights: `geometry`, `provenance`, and `get(weight)`."""

    def __init__(self, geometry: Geometry, transformer: TensorFiles, autoencoder: TensorFiles):
        self.geometry = geometry
        self.transformer = transformer
        self.autoencoder = autoencoder
        self.too_small = 0
        self._sources = self._match_transformer()
        self._match_autoencoder()

    @property
    def provenance(self) -> dict[str, str]:
        """The provenance for the manifest."""
        return {
            "tool": "cairn.build",
            "weights": f"Waypoint-1.5 checkpoint of {len(self.transformer.shapes)} tensors, "
            f"autoencoder of {len(self.autoencoder.shapes)}",
        }

    def get(self, weight: Weight) -> np.ndarray:
        """The float16 numbers of one tensor in stored layout."""
        if weight.name.startswith(("encoder.", "decoder.")):
            numbers = self.autoencoder.get(weight.name)
            if weight.name == _GROWN:
                # Some files have the rows of more frames than the decoder makes; the last ones are used.
                numbers = numbers[-weight.shape[0] :]
        elif weight.name == "cond_head.bias_in":
            numbers = np.stack([self._part(f"{weight.name}.{i}") for i in range(self.geometry.layers)])
        else:
            numbers = self._stored(weight, self._part(weight.name))
        half, lost = to_half(numbers, weight.name)
        self.too_small += lost
        return half

    def _part(self, slot: str) -> np.ndarray:
        """The numbers of one slot in the file's orientation. Copies must be equal."""
        (name, what), *others = self._sources[slot]
        whole = self.transformer.get(name)
        for other, _ in others:
            if not np.array_equal(whole, self.transformer.get(other)):
                raise BuildError(
                    f"it differs from {name}, and all layers share this matrix",
                    field=other,
                    remedy="The checkpoint is of another kind or damaged.",
                )
        return self._cut(whole, what, slot)

    def _cut(self, whole: np.ndarray, what: Meaning, slot: str) -> np.ndarray:
        if len(what.slots) == 1:
            return whole
        sizes = [self._file_shape(s)[what.axis] for s in what.slots]
        start = sum(sizes[: what.slots.index(slot)])
        return whole.take(range(start, start + sizes[what.slots.index(slot)]), axis=what.axis)

    def _stored(self, weight: Weight, numbers: np.ndarray) -> np.ndarray:
        """Converts from the file's orientation to the bundle's."""
        g, name = self.geometry, weight.name
        if name == "unpatchify.weight":
            # [D, C, rows, columns] is the bundle's order already; [C rows columns, D] is its transpose.
            return numbers.reshape(g.width, -1) if numbers.ndim == 4 else numbers.T
        if name == "unpatchify.bias" and numbers.size == g.latent_channels:
            return np.repeat(numbers, g.patch[0] * g.patch[1])
        if numbers.ndim == 2:
            return numbers.T
        return numbers.reshape(weight.shape)

    # Before any weights are read.

    def _match_transformer(self) -> dict[str, list[tuple[str, Meaning]]]:
        needed = {w.name: w for w in transformer_weights(self.geometry)}
        slots = [s for s in needed if s != "cond_head.bias_in"]
        slots += [f"cond_head.bias_in.{i}" for i in range(self.geometry.layers)]
        # Layer 0's mixing factor has no effect, but the released file contains it.
        known = {*slots, "blocks.0.attn.v_lamb"}
        found: dict[str, list[tuple[str, Meaning]]] = {}
        for name, shape in self.transformer.shapes.items():
            what = meaning(name)
            if what is None or not known.issuperset(what.slots):
                raise BuildError(
                    "no tensor of this name belongs to a Waypoint-1.5 model of these shapes",
                    field=name,
                    remedy="See `python -m cairn.build checkpoint --help` for the names that are read.",
                )
            self._check_shape(name, shape, what)
            for slot in what.slots:
                found.setdefault(slot, []).append((name, what))
        missing = [s for s in slots if s not in found]
        if missing:
            raise BuildError(
                f"the checkpoint lacks {len(missing)} tensors, this one first",
                field=missing[0],
                remedy="Fetch the checkpoint again; compare config.yaml with it.",
            )
        return {slot: self._choose(entries) for slot, entries in found.items()}

    @staticmethod
    def _choose(entries: list[tuple[str, Meaning]]) -> list[tuple[str, Meaning]]:
        top = max(what.rank for _, what in entries)
        best = sorted(((name, what) for name, what in entries if what.rank == top), key=lambda e: (len(e[0]), e[0]))
        if len(best) > 1 and not all(what.copy for _, what in best):
            raise BuildError(f"{best[0][0]} means the same tensor", field=best[1][0], remedy="Remove one of the two.")
        return best

    def _check_shape(self, name: str, shape: tuple[int, ...], what: Meaning) -> None:
        g = self.geometry
        if not what.slots:
            return
        wanted = [self._file_shape(s) for s in what.slots]
        if len(wanted) > 1:
            first = list(wanted[0])
            first[what.axis] = sum(w[what.axis] for w in wanted)
            allowed = [tuple(first)]
        elif name == "unpatchify.weight":
            allowed = [(g.width, g.latent_channels, *g.patch), (g.patch_width, g.width)]
        elif name == "unpatchify.bias":
            allowed = [(g.latent_channels,), (g.patch_width,)]
        elif what.slots[0].endswith("v_lamb"):
            allowed = [(), (1,)]
        else:
            allowed = wanted
        if shape not in allowed:
            raise BuildError(
                f"its shape is {list(shape)}, expected {' or '.join(str(list(a)) for a in allowed)}",
                field=name,
                remedy="config.yaml belongs to another checkpoint, or the file is damaged.",
            )

    def _file_shape(self, slot: str) -> tuple[int, ...]:
        """The shape of a slot as a file orients it."""
        g = self.geometry
        if slot.startswith("cond_head.bias_in."):
            return (g.width,)
        if slot.endswith("v_lamb"):
            return (1,)
        shape = next(w.shape for w in transformer_weights(g) if w.name == slot)
        return tuple(reversed(shape)) if len(shape) == 2 else shape

    def _match_autoencoder(self) -> None:
        shapes = dict(self.autoencoder.shapes)
        for weight in autoencoder_weights(self.geometry):
            shape = shapes.pop(weight.name, None)
            if shape is None:
                raise BuildError("the autoencoder lacks it", field=weight.name, remedy="Give TAEHV-1.5's file, taehv1_5.pth.")
            more = weight.name == _GROWN and shape[1:] == weight.shape[1:] and shape[0] % weight.shape[0] == 0
            if shape != weight.shape and not more:
                raise BuildError(
                    f"its shape is {list(shape)}, expected {list(weight.shape)}",
                    field=weight.name,
                    remedy="The autoencoder does not belong to this checkpoint.",
                )
        if shapes:
            raise BuildError("TAEHV-1.5 has no tensor of this name", field=min(shapes), remedy="Give TAEHV-1.5's file.")
