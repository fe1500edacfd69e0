"""Writes a bundle: graphs, weights, licence and manifest. The folder is written completely or not at all."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np
import onnx

from . import archive, contrib
from .autoencoder import build_decoder, build_encoder
from .errors import BuildError
from .files import check_free, fresh_folder
from .geometry import Geometry
from .graph import Graph
from .manifest import MANIFEST_FILE, MANIFEST_LIMIT, Licence, check_texts, manifest
from .quantise import Quantisation
from .reader import GRAPH_KINDS, JOINED, checked_name
from .sizes import value_sizes
from .transformer import INTERMEDIATE_LIMIT, build_transformer
from .weights import (
    ALIGNMENT,
    AUTOENCODER_FILE,
    TRANSFORMER_FILE,
    Placed,
    Weight,
    place,
    stored_autoencoder,
    stored_transformer,
)

# Called with the current step, the bytes of weights written so far, and their total.
Progress = Callable[[str, int, int], None]


class WeightSource(Protocol):
    """A source of weights: a checkpoint, or a seed."""

    def get(self, weight: Weight) -> np.ndarray:
        """The float16 numbers of one tensor, in its stored layout."""


def layouts(g: Geometry, quantisation: Quantisation | None = None) -> tuple[dict[str, Placed], dict[str, Placed]]:
    """Positions of the transformer's and the autoencoder's weights in their files."""
    transformer = stored_transformer(g)
    if quantisation is not None:
        transformer = quantisation.stored(transformer)
    return place(transformer, TRANSFORMER_FILE), place(stored_autoencoder(g), AUTOENCODER_FILE)


def build_graphs(
    g: Geometry, precision: str, fourier_rounding: str = "none", quantisation: Quantisation | None = None
) -> dict[str, Graph]:
    """The three graphs of one precision. They only refer to the weights by name, so building them is cheap at any size."""
    transformer, autoencoder = layouts(g, quantisation)
    return {
        "transformer": build_transformer(g, precision, transformer, fourier_rounding, quantisation),
        "encoder": build_encoder(g, precision, autoencoder),
        "decoder": build_decoder(g, precision, autoencoder),
    }


def _written_graphs(g: Geometry, precision: str, fourier_rounding: str, quantisation: Quantisation | None) -> dict[str, Graph]:
    """The graphs of `build_graphs`, and the joined one if the bundle has it."""
    graphs = build_graphs(g, precision, fourier_rounding, quantisation)
    if g.joined:
        graphs[JOINED] = build_transformer(g, precision, layouts(g, quantisation)[0], fourier_rounding, quantisation, joined=True)
    return graphs


def build_bundle(
    g: Geometry,
    source: WeightSource,
    out: Path,
    *,
    name: str,
    provenance: dict[str, str],
    licence: Licence,
    rounding: str = "none",
    precisions: tuple[str, ...] = ("f32", "f16"),
    progress: Progress = lambda what, done, total: None,
    replace: bool = False,
    quantisation: Quantisation | None = None,
) -> Path:
    """Writes the bundle to `out`: a folder, or an archive if the name ends in `.cairn`.

    `rounding` is `bf16` if noise levels, Fourier and RoPE frequencies are rounded to bfloat16, as in the released engine. `quantisation` stores
    the matrices of the transformer's layers in fewer bits. An existing bundle at
    `out` stays until the new one is complete; a failure leaves no incomplete files.
    """
    out = Path(out)
    if g.residual != "float16" and "f16" not in precisions:
        raise BuildError(
            "only f16 graphs have a residual stream of another type than theirs, and none are written",
            field="residual",
            remedy="Write both precisions, or leave it out.",
        )
    check_texts(name, provenance, licence, rounding)
    if licence.text is not None:
        _check_licence_file(licence.file)
    _check_values(g, quantisation)
    check_free(out, replace, as_file=out.suffix == archive.SUFFIX)
    facts = (name, provenance, licence, rounding, precisions, progress, quantisation)
    if out.suffix == archive.SUFFIX:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
            _write(Path(folder), g, source, *facts)
            archive.pack(Path(folder), out, replace)
    else:
        with fresh_folder(out, replace) as folder:
            _write(folder, g, source, *facts)
    return out


def _check_licence_file(name: str) -> None:
    """Checks a file name that may come from another bundle. Names of the builder's own files are refused, also as that of a folder."""
    checked_name(name, "licence.file")
    own = {MANIFEST_FILE, TRANSFORMER_FILE, AUTOENCODER_FILE, *(_graph_file(k, p) for k in (*GRAPH_KINDS, JOINED) for p in ("f32", "f16"))}
    if name.split("/")[0].lower() in own:
        raise BuildError(f"{name} is the name of another file", field="licence.file", remedy="Give it another name, such as LICENSE.txt.")


def _check_values(g: Geometry, quantisation: Quantisation | None) -> None:
    """Checks that every value is as small as the library requires."""
    dimensions = {"transformer": g.dimensions(g.global_max_window), JOINED: g.dimensions(g.global_max_window, 2)}
    for kind, graph in _written_graphs(g, "f32", "none", quantisation).items():
        for name, (shape, _) in value_sizes(graph, dimensions.get(kind, {}))[1].items():
            if (size := 4 * math.prod(shape)) > INTERMEDIATE_LIMIT:
                limit = INTERMEDIATE_LIMIT >> 20
                raise BuildError(
                    f"{shape} has {size / 2**20:.1f} MiB in float32 at the window {g.global_max_window}, at most {limit} are allowed",
                    field=f"value {name} of the {kind}",
                    remedy="Declare a smaller largest window, or choose smaller shapes.",
                )


def _graph_file(kind: str, precision: str) -> str:
    return f"{kind}.{precision}.onnx"


def _write(folder, g, source, name, provenance, licence, rounding, precisions, progress, quantisation) -> None:
    files: dict[str, tuple[int, str]] = {}
    placed = layouts(g, quantisation)
    total = sum(p.length for group in placed for p in group.values())
    done = 0
    for group in placed:
        done = _write_weights(folder, group, source, files, progress, done, total)
    contrib.register()
    graphs: dict[str, dict[str, str]] = {}
    for precision in precisions:
        progress(f"graphs, {precision}", done, total + 1)
        graphs[precision] = {}
        for kind, graph in _written_graphs(g, precision, rounding, quantisation).items():
            file = _graph_file(kind, precision)
            data = graph.model().SerializeToString(deterministic=True)
            _write_file(folder, file, data, files)
            onnx.checker.check_model(str(folder / file))
            graphs[precision][kind] = file
    if licence.text is not None:
        _write_file(folder, licence.file, licence.text, files)
    content = manifest(
        g,
        name=name,
        graphs=graphs,
        files=files,
        licence=licence,
        provenance=provenance,
        rounding=rounding,
        quantisation=quantisation,
    )
    # Bytes, as text has other line ends on Windows.
    data = (json.dumps(content, indent=2) + "\n").encode()
    if len(data) > MANIFEST_LIMIT:
        cause = f"it has {len(data)} bytes, at most {MANIFEST_LIMIT} are allowed"
        raise BuildError(cause, field=MANIFEST_FILE, remedy="Shorten its provenance.")
    (folder / MANIFEST_FILE).write_bytes(data)
    progress("complete", total, total)


def _write_weights(folder, group, source, files, progress, done: int, total: int) -> int:
    """Writes one file of weights. Only the parts of one tensor, or of the tensors that share them, are in memory at a time."""
    file = next(iter(group.values())).file
    digest, size = hashlib.sha256(), 0
    with open(folder / file, "wb") as sink:
        for weights, tensors in itertools.groupby(group.values(), key=lambda p: p.packed.parts):
            parts = [checked(source.get(weight), weight) for weight in weights]
            for p in tensors:
                progress(f"{file}: {p.weight.name}", done, total)
                data = np.ascontiguousarray(p.packed.pack(parts)).tobytes()
                data += bytes(-len(data) % ALIGNMENT)
                digest.update(data)
                sink.write(data)
                size += len(data)
                done += p.length
    files[file] = (size, digest.hexdigest())
    return done


def _write_file(folder: Path, name: str, data: bytes, files: dict[str, tuple[int, str]]) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    files[name] = (len(data), hashlib.sha256(data).hexdigest())


def checked(array: np.ndarray, weight: Weight) -> np.ndarray:
    """The array as little-endian float16 in C order, after a check of its shape and its numbers."""
    if array.shape != weight.shape or array.dtype != np.float16:
        raise BuildError(
            f"got {array.dtype} {array.shape}, expected float16 {weight.shape}",
            field=weight.name,
            remedy="The source of weights does not fit the geometry.",
        )
    if not np.isfinite(array).all():
        raise BuildError("a number is infinite or not a number", field=weight.name, remedy="The weights are damaged.")
    return np.ascontiguousarray(array).astype("<f2", copy=False)
