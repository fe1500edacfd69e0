"""Puts faults into a bundle's f32 transformer, as a wrong exporter would make them."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
from onnx import helper, numpy_helper


def without_value_residual(graph: onnx.GraphProto, kv_heads: int) -> int:
    """Removes the value residual: `v + lamb * (v0 - v)` becomes v, in this frame and in its slab."""
    makers = {name: node for node in graph.node for name in node.output}
    mixers = [node for node in graph.node if any(name.endswith("attn.v_lamb") for name in _origins(node, makers))]
    scaled = {mixer.output[0] for mixer in mixers}
    sums = [user for mixer in mixers for user in _users(graph, mixer.output[0])]
    for node in sums:
        assert node.op_type == "Add"
        (own,) = [name for name in node.input if name not in scaled]
        # The sum may be the slab itself, so its name stays: a cast to the type that it has.
        node.CopyFrom(helper.make_node("Cast", [own], list(node.output), name=node.name, to=onnx.TensorProto.FLOAT))
    return len(sums)


def keys_before_their_norm(graph: onnx.GraphProto, kv_heads: int) -> int:
    """Removes the norm of keys: the heads of keys are turned as they were before it."""
    done = 0
    for rotation in [node for node in graph.node if node.op_type == "RotaryEmbedding"]:
        (norm,) = [node for node in graph.node if rotation.input[0] in node.output]
        assert norm.op_type == "SimplifiedLayerNormalization"
        # Queries and keys are normed at once, along axis 1; the keys are the last heads.
        stem = f"fault.{done}"
        bounds = {"first": -kv_heads, "last": np.iinfo(np.int64).max, "all": 0, "axis": 1}
        for name, value in bounds.items():
            graph.initializer.append(numpy_helper.from_array(np.array([value]), f"{stem}.{name}"))

        def part(of: str, start: str, end: str, name: str) -> onnx.NodeProto:
            inputs = [of, *(f"{stem}.{bound}" for bound in (start, end, "axis"))]
            return helper.make_node("Slice", inputs, [f"{stem}.{name}"], name=f"{stem}.{name}")

        added = [
            part(norm.output[0], "all", "first", "queries"),
            part(norm.input[0], "first", "last", "keys"),
            helper.make_node("Concat", [f"{stem}.queries", f"{stem}.keys"], [stem], name=stem, axis=1),
        ]
        at = list(graph.node).index(rotation)
        rotation.input[0] = stem
        for node in reversed(added):
            graph.node.insert(at, node)
        done += 1
    return done


FAULTS: dict[str, Callable[[onnx.GraphProto, int], int]] = {
    "value residual dropped": without_value_residual,
    "K before its norm": keys_before_their_norm,
}


def faulty_bundle(bundle: Path, fault: str, out: Path) -> Path:
    """Copies `bundle` with `fault` in its f32 transformer, and corrects the manifest's checksum."""
    shutil.copytree(bundle, out)
    manifest = json.loads((out / "cairn-world.json").read_text(encoding="utf-8"))
    path = manifest["graphs"]["f32"]["transformer"]
    model = onnx.load(out / path, load_external_data=False)
    assert FAULTS[fault](model.graph, manifest["geometry"]["kv_heads"]) > 0, f"{fault}: the graph has no such place"
    _drop_unused(model.graph)
    contents = model.SerializeToString()
    (out / path).write_bytes(contents)
    for entry in manifest["files"]:
        if entry["path"] == path:
            entry["size"] = len(contents)
            entry["sha256"] = hashlib.sha256(contents).hexdigest()
    (out / "cairn-world.json").write_text(json.dumps(manifest), encoding="utf-8")
    return out


def _origins(node: onnx.NodeProto, makers: dict[str, onnx.NodeProto]) -> list[str]:
    """Names of a node's inputs, or, where an input is a cast, of the value that is cast."""
    names = []
    for name in node.input:
        while name in makers and makers[name].op_type == "Cast":
            name = makers[name].input[0]
        names.append(name)
    return [] if node.op_type == "Cast" else names


def _users(graph: onnx.GraphProto, name: str) -> list[onnx.NodeProto]:
    return [node for node in graph.node if name in node.input]


def _drop_unused(graph: onnx.GraphProto) -> None:
    """Removes nodes and initializers that nothing reads any more."""
    wanted = {output.name for output in graph.output}
    while True:
        needed = wanted | {name for node in graph.node for name in node.input}
        kept = [node for node in graph.node if any(name in needed for name in node.output)]
        if len(kept) == len(graph.node):
            break
        del graph.node[:]
        graph.node.extend(kept)
    stored = [t for t in graph.initializer if t.name in needed]
    del graph.initializer[:]
    graph.initializer.extend(stored)
