"""The cost of each node of a world's graphs, from the graphs alone: nothing runs. `Bundle::cost` counts the same in Rust."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from pathlib import Path

import onnx

from . import archive
from .conditioning import CONTROLS, PASS, parts
from .errors import BuildError
from .geometry import Geometry
from .quantise import Quantisation
from .reader import read_manifest, read_model
from .sizes import ITEM_BYTES, HasModel, value_sizes
from .writer import build_graphs


@dataclass(frozen=True)
class NodeCost:
    """The cost of one run of a node."""

    name: str
    operator: str
    output: str  # name of its first output
    multiply_adds: int  # of MatMul, FusedMatMul, MatMulNBits and Conv; 0 for others
    read: int  # bytes of all inputs, weights included; a Reshape moves none
    written: int  # bytes of all outputs


def node_costs(graph: HasModel, dimensions: dict[str, int], part: str = PASS) -> list[NodeCost]:
    """The nodes that run, in the graph's order. A node that reads constants only is computed once, when the graph is loaded, and is left out. So are
    the nodes of other parts of a transformer, such as its conditioning."""
    model, sizes = value_sizes(graph, dimensions)
    shapes = {name: shape for name, (shape, _) in sizes.items()}
    bytes_of = {name: count for name, (_, count) in sizes.items()}
    constants = set()
    for tensor in model.graph.initializer:
        shapes[tensor.name] = list(tensor.dims)
        bytes_of[tensor.name] = math.prod(tensor.dims) * ITEM_BYTES[tensor.data_type]
        constants.add(tensor.name)
    for value in model.graph.input:
        tensor = value.type.tensor_type
        shapes[value.name] = [d.dim_value for d in tensor.shape.dim]
        bytes_of[value.name] = math.prod(shapes[value.name]) * ITEM_BYTES[tensor.elem_type]
    costs = []
    for node, own in zip(model.graph.node, parts(model.graph)):
        inputs = [name for name in node.input if name]
        if all(name in constants for name in inputs):
            constants.update(node.output)
            continue
        if own != part:
            continue
        terms = 0
        if node.op_type in ("MatMul", "FusedMatMul", "MatMulNBits"):
            terms = shapes[inputs[0]][-1]
        elif node.op_type == "Conv":
            terms = math.prod(shapes[inputs[1]][1:])
        moves = node.op_type != "Reshape"
        costs.append(
            NodeCost(
                node.name,
                node.op_type,
                node.output[0],
                math.prod(shapes[node.output[0]]) * terms,
                sum(bytes_of[name] for name in inputs) if moves else 0,
                sum(bytes_of[name] for name in node.output) if moves else 0,
            )
        )
    return costs


@dataclass(frozen=True)
class StoredGraph:
    """A graph of a bundle."""

    content: onnx.ModelProto

    def model(self) -> onnx.ModelProto:
        """A copy, which the caller may change."""
        copy = onnx.ModelProto()
        copy.CopyFrom(self.content)
        return copy


def stored_graphs(bundle: Path) -> dict[str, StoredGraph]:
    """The float16 graphs of a bundle, by their kinds: those of an earlier version of the builder may differ from what this one builds.

    Raises `BuildError`, also if the bundle has none.
    """
    with archive.verified_folder(bundle) as folder:
        paths = read_manifest(folder)["graphs"].get("f16")
        if paths is None:
            raise BuildError("it has no f16 graphs", field=str(bundle), remedy="Build it with both precisions.")
        return {kind: StoredGraph(read_model((folder / path).read_bytes(), path)) for kind, path in paths.items()}


def world_costs(g: Geometry, quantisation: Quantisation | None = None, graphs: dict[str, StoredGraph] | None = None) -> dict:
    """Costs of the graphs in float16 at the stock window, for `json`: for each graph a list of its nodes' values. "controls" is the part of the
    transformer that embeds controls. `graphs` are those of a bundle; without them, those that would be built are counted."""
    graphs = {kind: graph for kind, graph in (graphs or build_graphs(g, "f16", quantisation=quantisation)).items() if kind != "joined"}
    dimensions = {"transformer": g.dimensions(g.global_window)}
    costs = {kind: node_costs(graph, dimensions.get(kind, {})) for kind, graph in graphs.items()}
    costs["controls"] = node_costs(graphs["transformer"], dimensions["transformer"], CONTROLS)
    return {"window": g.global_window, "graphs": {kind: [list(astuple(node)) for node in nodes] for kind, nodes in costs.items()}}
