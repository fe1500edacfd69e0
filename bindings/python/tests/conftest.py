"""Fixtures and helpers that several tests share: one tiny bundle, ONNX Runtime sessions of its graphs, and changed copies."""

import hashlib
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from cairn.build import PRESETS, build_bundle
from cairn.build.manifest import Licence
from cairn.build.random_weights import RandomWeights

ROOT = Path(__file__).parents[3]
TINY = PRESETS["tiny"][1]


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Path:
    """A random bundle of the tiny preset, seed 1."""
    out = tmp_path_factory.mktemp("bundles") / "tiny"
    return build_bundle(
        TINY,
        RandomWeights(TINY, 1),
        out,
        name="tiny",
        provenance={"seed": "1"},
        licence=Licence("CC0-1.0", b"No rights reserved.\n"),
    )


def session(bundle: Path, kind: str, precision: str, dimensions: dict[str, int] | None = None) -> onnxruntime.InferenceSession:
    """One graph on the CPU."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    for name, size in (dimensions or {}).items():
        options.add_free_dimension_override_by_name(name, size)
    path = str(bundle / f"{kind}.{precision}.onnx")
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def relative(a: np.ndarray, b: np.ndarray) -> float:
    """Relative L2 distance of a from b."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def copied(bundle: Path, out: Path) -> Path:
    """A copy of a folder, to change it."""
    return Path(shutil.copytree(bundle, out))


def change_manifest(folder: Path, change: Callable[[dict], object]) -> Path:
    """Changes the manifest, after sizes and checksums of its files were written again where those exist."""
    path = folder / "cairn-world.json"
    manifest = json.loads(path.read_bytes())
    for entry in manifest["files"]:
        if (folder / entry["path"]).is_file():
            data = (folder / entry["path"]).read_bytes()
            entry.update(size=len(data), sha256=hashlib.sha256(data).hexdigest())
    change(manifest)
    path.write_bytes(json.dumps(manifest).encode())
    return folder


def zipped(folder: Path, out: Path) -> Path:
    """An archive of all files of a folder, without any check."""
    with zipfile.ZipFile(out, "w") as entries:
        for path in folder.rglob("*"):
            if path.is_file():
                entries.write(path, path.relative_to(folder).as_posix())
    return out
