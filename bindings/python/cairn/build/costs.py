"""The cost of each node of a world's graphs, from the graphs alone: nothing runs. `Bundle::cost` counts the same in Rust."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

from .conditioning import CONTROLS, PASS, parts
from .geometry import Geometry
from .graph import Graph
from .quantise import Quantisation
from .sizes import ITEM_BYTES, value_sizes
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


def node_costs(graph: Graph, dimensions: dict[str, int], part: str = PASS) -> list[NodeCost]:
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


def world_costs(g: Geometry, quantisation: Quantisation | None = None) -> dict:
    """Costs of the graphs in float16 at the stock window, for `json`: for each graph a list of its nodes' values. "controls" is the part of the
    transformer that embeds controls."""
    graphs = build_graphs(g, "f16", quantisation=quantisation)
    dimensions = {"transformer": g.dimensions(g.global_window)}
    costs = {kind: node_costs(graph, dimensions.get(kind, {})) for kind, graph in graphs.items()}
    costs["controls"] = node_costs(graphs["transformer"], dimensions["transformer"], CONTROLS)
    return {"window": g.global_window, "graphs": {kind: [list(astuple(node)) for node in nodes] for kind, nodes in costs.items()}}
