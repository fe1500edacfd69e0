"""The weights of an existing bundle, to write it again: with the graphs of this version of the builder, or with smaller weights."""

from __future__ import annotations

import hashlib
import json
import tempfile
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto

from . import archive
from .errors import BuildError
from .geometry import Geometry
from .manifest import MANIFEST_FILE, Licence
from .quantise import Quantisation, of_manifest
from .weights import Packed, Weight, stored_autoencoder, stored_transformer
from .writer import Progress, build_bundle

# The entry of a provenance that names the 16-bit bundle: its name, and its digest.
ORIGIN = "quantised_from"
NAME_LIMIT = 100


class StoredWeights:
    """The weights of the bundle in `folder`, as a source: of this version, or of an earlier one that stored each of them on its own."""

    def __init__(self, geometry: Geometry, folder: Path):
        manifest = json.loads((folder / MANIFEST_FILE).read_text(encoding="utf-8"))
        if (quantisation := of_manifest(manifest)) is not None:
            raise BuildError(
                f"its weights have {quantisation.bits} bits, and their 16-bit numbers are lost",
                field="quantisation",
                remedy=f"Name the bundle that it was made from{_origin(manifest)}.",
            )
        self._stored: dict[str, tuple[Path, int, tuple[int, ...]]] = {}
        for name in manifest["graphs"]["f32"].values():
            graph = folder / name
            for tensor in onnx.load(graph, load_external_data=False).graph.initializer:
                if tensor.data_location == TensorProto.EXTERNAL:
                    place = {entry.key: entry.value for entry in tensor.external_data}
                    file = graph.parent / place["location"]
                    self._stored[tensor.name] = (file, int(place.get("offset", 0)), tuple(tensor.dims))
        tensors = [*stored_transformer(geometry), *stored_autoencoder(geometry)]
        self._packed: dict[str, Packed] = {part.name: packed for packed in tensors for part in packed.parts}

    def get(self, weight: Weight) -> np.ndarray:
        """The float16 numbers of one tensor."""
        if weight.name in self._stored:
            return self._read(weight.name).reshape(weight.shape)
        packed = self._packed[weight.name]
        parts = packed.unpack(self._read(packed.whole.name).reshape(packed.whole.shape))
        return np.ascontiguousarray(parts[packed.parts.index(weight)])

    def _read(self, name: str) -> np.ndarray:
        if name not in self._stored:
            raise BuildError(
                "the bundle's graphs name no such weight",
                field=name,
                remedy="Only bundles made by cairn.build can be written again.",
            )
        file, offset, shape = self._stored[name]
        return np.fromfile(file, "<f2", count=int(np.prod(shape)), offset=offset)


def _origin(manifest: dict) -> str:
    stated = manifest.get("provenance", {}).get(ORIGIN)
    return "" if stated is None else f": {stated}"


def rebuild(
    bundle: Path,
    out: Path,
    *,
    progress: Progress,
    replace: bool = False,
    quantisation: Quantisation | None = None,
    residual: str | None = None,
) -> Path:
    """Writes `bundle`, a folder or an archive, to `out` with the graphs of this version. Its numbers and its manifest's facts stay as they are,
    except that `quantisation` stores the matrices of its layers in fewer bits, and then the name says so. `residual` is the type of the residual
    stream in f16 graphs, if it is to change."""
    with tempfile.TemporaryDirectory() as work:
        folder = bundle if bundle.is_dir() else archive.unpack(bundle, Path(work) / "bundle")
        geometry = archive.read_geometry(folder)
        geometry = geometry if residual is None else geometry.with_(residual=residual)
        content = (folder / MANIFEST_FILE).read_bytes()
        manifest = json.loads(content)
        name, provenance = manifest["name"], manifest["provenance"]
        if quantisation is not None:
            provenance = provenance | {ORIGIN: f"{name}, {hashlib.sha256(content).hexdigest()}"}
            suffix = f", {quantisation.bits}-bit weights"
            name = name[: NAME_LIMIT - len(suffix)] + suffix
        licence, file = manifest["licence"], manifest["licence"]["file"]
        terms = Licence(licence["spdx"]) if file is None else Licence(licence["spdx"], (folder / file).read_text("utf-8"), file)
        return build_bundle(
            geometry,
            StoredWeights(geometry, folder),
            out,
            name=name,
            provenance=provenance,
            licence=terms,
            rounding=manifest["sampler"]["sigma_rounding"],
            precisions=tuple(p for p in ("f32", "f16") if p in manifest["graphs"]),
            progress=progress,
            replace=replace,
            quantisation=quantisation,
        )
