"""Tensors in files, by name: safetensors files, whole or in shards, and torch's zip files, behind one interface."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open

from .errors import BuildError
from .torch_zip import TorchFile

_SIZES = {"F32": 4, "F16": 2, "BF16": 2}
HALF_LIMIT = 65504.0


class TensorFiles:
    """All tensors of one model: `shapes` by name; `get` reads one of them as float32."""

    def __init__(self) -> None:
        self.shapes: dict[str, tuple[int, ...]] = {}
        self._kinds: dict[str, str] = {}
        self._readers: dict[str, object] = {}

    def get(self, name: str) -> np.ndarray:
        """The numbers of one tensor, exact in float32."""
        data, kind, shape = self._readers[name](name), self._kinds[name], self.shapes[name]
        if kind == "F32":
            return np.frombuffer(data, "<f4").reshape(shape)
        if kind == "F16":
            return np.frombuffer(data, "<f2").astype(np.float32).reshape(shape)
        # A bfloat16 is the upper half of a float32.
        return (np.frombuffer(data, "<u2").astype(np.uint32) << 16).view(np.float32).reshape(shape)

    def _add(self, file: Path, name: str, kind: str, shape: tuple[int, ...], reader) -> None:
        if kind not in _SIZES:
            raise BuildError(f"its numbers are {kind}", field=f"{file.name}: {name}", remedy="Store it as BF16, F16 or F32.")
        if name in self.shapes:
            raise BuildError("it is in two files", field=name, remedy="Remove one of them.")
        self.shapes[name], self._kinds[name], self._readers[name] = shape, kind, reader

    def add_safetensors(self, file: Path) -> None:
        """Adds every tensor of one safetensors file. The library checks the header; numbers are read on demand."""
        try:
            with safe_open(str(file), "numpy") as opened:
                for name in opened.keys():
                    part = opened.get_slice(name)
                    self._add(file, name, part.get_dtype(), tuple(part.get_shape()), lambda n: read(n))
        except SafetensorError as error:
            raise BuildError(f"it is no sound safetensors file ({error})", field=str(file), remedy="Fetch it again.") from error
        with open(file, "rb") as source:
            length = int.from_bytes(source.read(8), "little")
            header, start = json.loads(source.read(length)), 8 + length

        def read(name: str) -> bytes:
            begin, end = header[name]["data_offsets"]
            wanted = math.prod(self.shapes[name]) * _SIZES[self._kinds[name]]
            with open(file, "rb") as source:
                source.seek(start + begin)
                data = source.read(end - begin)
            if len(data) != wanted:
                raise BuildError(f"{len(data)} bytes, {wanted} expected", field=f"{file.name}: {name}", remedy="Fetch it again.")
            return data

    def add_torch(self, file: Path) -> None:
        """Adds every tensor of torch's zip file."""
        opened = TorchFile(file)
        for name, tensor in opened.tensors.items():
            self._add(file, name, tensor.kind, tensor.shape, opened.read)


def open_weights(directory: Path) -> TensorFiles:
    """Opens `model.safetensors`, or the shards that `model.safetensors.index.json` lists."""
    files = TensorFiles()
    single, index = directory / "model.safetensors", directory / "model.safetensors.index.json"
    if single.is_file():
        files.add_safetensors(single)
        return files
    if not index.is_file():
        raise BuildError(
            "it holds neither model.safetensors nor model.safetensors.index.json",
            field=str(directory),
            remedy="Name the directory of a downloaded checkpoint.",
        )
    try:
        names = json.loads(index.read_text(encoding="utf-8"))["weight_map"]
        shards = sorted(set(names.values()))
        if not shards or any(Path(s).name != s for s in shards):
            raise ValueError("a shard is no plain file name")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BuildError(f"it is no index ({error!r})", field=str(index), remedy="Fetch it again.") from error
    for shard in shards:
        if not (directory / shard).is_file():
            raise BuildError("this shard is missing", field=shard, remedy="Finish the download.")
        files.add_safetensors(directory / shard)
    if files.shapes.keys() != names.keys():
        wrong = sorted(files.shapes.keys() ^ names.keys())
        raise BuildError("index and shards disagree about it", field=wrong[0], remedy="Fetch the checkpoint again.")
    return files


def to_half(numbers: np.ndarray, name: str) -> tuple[np.ndarray, int]:
    """Converts to float16, and counts the numbers that were too small and became 0. Numbers that are too large are an error."""
    top = float(np.max(np.abs(numbers))) if numbers.size else 0.0
    if not math.isfinite(top):
        raise BuildError("it holds an infinity or a not-a-number", field=name, remedy="The checkpoint is damaged: fetch it again.")
    if top >= HALF_LIMIT + 16:
        raise BuildError(
            f"its largest number, {top:g}, is beyond float16's {HALF_LIMIT:g}",
            field=name,
            remedy="A bundle stores float16: this checkpoint needs rescaling first.",
        )
    half = numbers.astype(np.float16)
    return half, int(np.count_nonzero(numbers) - np.count_nonzero(half))
