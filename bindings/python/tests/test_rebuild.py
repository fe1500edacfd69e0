"""Bundles that are written again with this version's graphs."""

import hashlib
import json

import numpy as np
import onnx
import pytest
from conftest import TINY, change_manifest, copied
from onnx import TensorProto, helper

from cairn.build import archive, cli
from cairn.build.errors import BuildError
from cairn.build.random_weights import RandomWeights
from cairn.build.stored import StoredWeights, rebuild
from cairn.build.weights import autoencoder_weights, rotation_order, stored_transformer, transformer_weights


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def silent(what, done, total):
    pass


@pytest.fixture
def earlier(tiny, tmp_path):
    """`tiny` as earlier versions stored it: each of the transformer's tensors on its own. The graph is only a list of its weights."""
    folder = tmp_path / "earlier"
    folder.mkdir()
    for name, data in contents(tiny).items():
        (folder / name).write_bytes(data)
    source, model, data = RandomWeights(TINY, 1), onnx.ModelProto(), b""
    for weight in transformer_weights(TINY):
        tensor = TensorProto(name=weight.name, data_type=TensorProto.FLOAT16, dims=weight.shape)
        tensor.data_location = TensorProto.EXTERNAL
        place = {"location": "transformer.bin", "offset": len(data), "length": 2 * weight.count}
        for key, value in place.items():
            tensor.external_data.add(key=key, value=str(value))
        model.graph.initializer.append(tensor)
        data += source.get(weight).tobytes()
        data += bytes(-len(data) % 64)
    model.opset_import.append(helper.make_opsetid("", 18))
    manifest = json.loads((folder / "cairn-world.json").read_text("utf-8"))
    for name, written in (("transformer.bin", data), ("transformer.f32.onnx", model.SerializeToString())):
        (folder / name).write_bytes(written)
        (entry,) = [entry for entry in manifest["files"] if entry["path"] == name]
        entry.update(size=len(written), sha256=hashlib.sha256(written).hexdigest())
    (folder / "cairn-world.json").write_text(json.dumps(manifest), "utf-8")
    return folder


def test_a_bundle_of_this_version_stays_as_it_is(tiny, tmp_path):
    again = rebuild(tiny, tmp_path / "again", progress=silent)
    assert contents(again) == contents(tiny)


def test_a_bundle_of_an_earlier_version_becomes_one_of_this(tiny, earlier, tmp_path):
    assert contents(earlier) != contents(tiny)
    assert contents(rebuild(earlier, tmp_path / "again", progress=silent)) == contents(tiny)
    packed = archive.pack(earlier, tmp_path / "earlier.cairn", False)
    assert cli.main(["rebuild", str(packed), "--out", str(tmp_path / "again.cairn"), "--quiet"]) == 0
    assert contents(archive.unpack(tmp_path / "again.cairn", tmp_path / "unpacked")) == contents(tiny)


def test_every_number_is_read_back(tiny, earlier):
    made = RandomWeights(TINY, 1)
    for folder in (tiny, earlier):
        stored = StoredWeights(TINY, folder)
        for weight in [*transformer_weights(TINY), *autoencoder_weights(TINY)]:
            assert np.array_equal(stored.get(weight), made.get(weight)), weight.name


def test_pairs_are_stored_apart():
    d = TINY.head_width
    assert rotation_order(TINY).tolist() == [*range(0, d, 2), *range(1, d, 2)]
    (packed,) = [p for p in stored_transformer(TINY) if p.whole.name == "blocks.2.attn.qkv_proj.weight"]
    columns = np.arange(packed.whole.shape[1], dtype=np.float32)
    whole = packed.pack([np.broadcast_to(part, w.shape) for part, w in zip(np.split(columns, split(packed)), packed.parts)])
    # The second query head, the first key head, and the values as they are.
    assert whole[0, d : 2 * d].tolist() == (d + rotation_order(TINY)).tolist()
    assert whole[0, TINY.width : TINY.width + d].tolist() == (TINY.width + rotation_order(TINY)).tolist()
    assert whole[0, -d:].tolist() == columns[-d:].tolist()


def split(packed):
    """Where the columns of keys and of values start."""
    q, k, _ = (weight.shape[1] for weight in packed.parts)
    return [q, q + k]


def test_a_bundle_of_another_program_is_refused(tiny, tmp_path):
    folder = copied(tiny, tmp_path / "foreign")
    model = onnx.load(folder / "transformer.f32.onnx", load_external_data=False)
    for tensor in model.graph.initializer:
        tensor.name = "their." + tensor.name
    (folder / "transformer.f32.onnx").write_bytes(model.SerializeToString())
    change_manifest(folder, lambda manifest: None)
    with pytest.raises(BuildError, match="name no such weight"):
        rebuild(folder, tmp_path / "again", progress=silent)
    assert not (tmp_path / "again").exists()
