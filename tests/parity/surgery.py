"""Puts faults into a bundle's f32 transformer, as a wrong exporter would make them."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import onnx


def without_value_residual(graph: onnx.GraphProto) -> int:
    """Removes the value residual: nodes that read `v + lamb * (v0 - v)` read v instead."""
    makers = {name: node for node in graph.node for name in node.output}
    mixers = [node for node in graph.node if any(name.endswith("attn.v_lamb") for name in _origins(node, makers))]
    sums = [user for mixer in mixers for user in _users(graph, mixer.output[0])]
    for node in sums:
        assert node.op_type == "Add"
        scaled = {mixer.output[0] for mixer in mixers}
        (own,) = [name for name in node.input if name not in scaled]
        _replace(graph, node.output[0], own)
    return len(sums)


def keys_before_their_norm(graph: onnx.GraphProto) -> int:
    """Removes the norm of keys: nodes that read the norm's result read its input instead."""
    makers = {name: node for node in graph.node for name in node.output}
    projections = [node for node in graph.node if any(n.endswith("attn.k_proj.weight") for n in _origins(node, makers))]
    done = 0
    for projection in (node for node in projections if node.op_type == "MatMul"):
        node = projection
        while node.op_type != "Div":
            # The norm divides the heads by their root mean square: the only Div between projection and use.
            onward = ("Reshape", "Transpose", "Cast", "Div")
            node = next(user for user in _users(graph, node.output[0]) if user.op_type in onward)
        _replace(graph, node.output[0], node.input[0])
        done += 1
    return done


FAULTS: dict[str, Callable[[onnx.GraphProto], int]] = {
    "value residual dropped": without_value_residual,
    "K before its norm": keys_before_their_norm,
}


def faulty_bundle(bundle: Path, fault: str, out: Path) -> Path:
    """Copies `bundle` with `fault` in its f32 transformer, and corrects the manifest's checksum."""
    shutil.copytree(bundle, out)
    manifest = json.loads((out / "cairn-world.json").read_text(encoding="utf-8"))
    path = manifest["graphs"]["f32"]["transformer"]
    model = onnx.load(out / path, load_external_data=False)
    assert FAULTS[fault](model.graph) > 0, f"{fault}: the graph has no such place"
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


def _replace(graph: onnx.GraphProto, old: str, new: str) -> None:
    for node in graph.node:
        node.input[:] = [new if name == old else name for name in node.input]


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
