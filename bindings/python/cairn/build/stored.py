"""The weights of an existing bundle, to write it again: with the graphs of this version of the builder, or with smaller weights."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
from onnx import TensorProto

from . import archive
from .errors import BuildError
from .files import check_free
from .geometry import Geometry
from .manifest import NAME_LIMIT, Licence
from .quantise import Quantisation, of_manifest
from .reader import external_data, manifest_bytes, parse_manifest, read_manifest, read_model
from .weights import Packed, Weight, stored_autoencoder, stored_transformer
from .writer import Progress, build_bundle

# The entry of a provenance that names the 16-bit bundle: its name, and its digest.
ORIGIN = "quantised_from"


class StoredWeights:
    """The weights of the bundle in `folder`, as a source: of this version, or of an earlier one that stored each of them on its own."""

    def __init__(self, geometry: Geometry, folder: Path):
        manifest = read_manifest(folder)
        if (quantisation := of_manifest(manifest)) is not None:
            raise BuildError(
                f"its weights have {quantisation.bits} bits, and their 16-bit numbers are lost",
                field="quantisation",
                remedy=f"Name the bundle that it was made from{_origin(manifest)}.",
            )
        self._stored: dict[str, tuple[Path, int, TensorProto]] = {}
        for graph in manifest["graphs"]["f32"].values():
            for tensor in read_model((folder / graph).read_bytes(), graph).graph.initializer:
                if tensor.data_location == TensorProto.EXTERNAL:
                    file, offset = external_data(tensor, graph, manifest)
                    self._stored[tensor.name] = (folder / file, offset, tensor)
        tensors = [*stored_transformer(geometry), *stored_autoencoder(geometry)]
        self._packed: dict[str, Packed] = {part.name: packed for packed in tensors for part in packed.parts}

    def get(self, weight: Weight) -> np.ndarray:
        """The float16 numbers of one tensor."""
        if weight.name in self._stored:
            return self._read(weight)
        packed = self._packed[weight.name]
        return np.ascontiguousarray(packed.unpack(self._read(packed.whole))[packed.parts.index(weight)])

    def _read(self, weight: Weight) -> np.ndarray:
        if weight.name not in self._stored:
            raise BuildError(
                "the bundle's graphs name no such weight",
                field=weight.name,
                remedy="Only bundles made by cairn.build can be written again.",
            )
        file, offset, tensor = self._stored[weight.name]
        if tensor.data_type != TensorProto.FLOAT16 or math.prod(tensor.dims) != weight.count:
            kind = TensorProto.DataType.Name(tensor.data_type) if tensor.data_type in TensorProto.DataType.values() else "unknown"
            raise BuildError(
                f"it has the type {kind} and the shape {list(tensor.dims)}, the geometry needs FLOAT16 {list(weight.shape)}",
                field=weight.name,
                remedy="Only bundles made by cairn.build can be written again.",
            )
        # Checked before the array is allocated.
        if offset + weight.length > file.stat().st_size:
            cause = f"{file.name} ends before its {weight.length} bytes at {offset}"
            raise BuildError(cause, field=weight.name, remedy="Fetch the bundle again.")
        array = np.fromfile(file, "<f2", count=weight.count, offset=offset)
        if array.size != weight.count:
            raise BuildError(f"{file.name} was cut off while it was read", field=weight.name, remedy="Try again.")
        return array.reshape(weight.shape)


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
    joined: bool = False,
) -> Path:
    """Writes `bundle`, a folder or an archive, to `out` with the graphs of this version. Its numbers and its manifest's facts stay as they are,
    except that `quantisation` stores the matrices of its layers in fewer bits, and then the name says so. `residual` is the type of the residual
    stream in f16 graphs, if it is to change. `joined` adds joined graphs; a bundle that has them keeps them.

    Raises `BuildError`.
    """
    # Before all of the bundle is read.
    check_free(out, replace, as_file=out.suffix == archive.SUFFIX)
    with archive.verified_folder(bundle) as folder:
        geometry = archive.read_geometry(folder)
        geometry = geometry if residual is None else geometry.with_(residual=residual)
        geometry = geometry.with_(joined=True) if joined else geometry
        content = manifest_bytes(folder)
        manifest = parse_manifest(content)
        name, provenance = manifest["name"], manifest["provenance"]
        if quantisation is not None:
            provenance = provenance | {ORIGIN: f"{name}, {hashlib.sha256(content).hexdigest()}"}
            suffix = f", {quantisation.bits}-bit weights"
            name = name[: NAME_LIMIT - len(suffix)] + suffix
        spdx, file = manifest["licence"].get("spdx"), manifest["licence"].get("file")
        licence = Licence(spdx) if file is None else Licence(spdx, (folder / file).read_bytes(), file)
        return build_bundle(
            geometry,
            StoredWeights(geometry, folder),
            out,
            name=name,
            provenance=provenance,
            licence=licence,
            rounding=manifest["sampler"]["sigma_rounding"],
            precisions=tuple(p for p in ("f32", "f16") if p in manifest["graphs"]),
            progress=progress,
            replace=replace,
            quantisation=quantisation,
        )
