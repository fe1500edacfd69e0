"""The parts of a transformer, as the library divides it: `src/bundle/onnx/conditioning.rs`."""

from __future__ import annotations

import onnx

# The inputs that the conditioning depends on. What noise levels alone give is computed once for each level, what controls alone give once in each step.
LEVELS, CONTROLS = "sigma", "controls"
# Everything else runs in each pass.
PASS = "pass"
_PRODUCTS = ("MatMul", "Gemm", "MatMulNBits")


def parts(graph: onnx.GraphProto) -> list[str]:
    """For each node, the part that it belongs to: LEVELS, CONTROLS or PASS."""
    found = [PASS] * len(graph.node)
    for part in (LEVELS, CONTROLS):
        found = [part if is_own else other for is_own, other in zip(_nodes_of(graph, part), found)]
    return found


def _nodes_of(graph: onnx.GraphProto, part: str) -> list[bool]:
    """For each node, whether its values depend on one input alone and a product with weights needs them or makes them."""
    outputs = {value.name for value in graph.output}
    constants = {tensor.name for tensor in graph.initializer}
    of_input = {part}
    is_product = [False] * len(graph.node)
    for i, node in enumerate(graph.node):
        read = {name for name in node.input if name}
        if read <= constants:
            constants.update(node.output)
        elif read <= constants | of_input and not outputs & set(node.output):
            of_input.update(node.output)
            is_product[i] = node.op_type in _PRODUCTS and bool(read & constants)
    needed: set[str] = set()
    found = [False] * len(graph.node)
    for i, node in reversed(list(enumerate(graph.node))):
        found[i] = is_product[i] or any(name in of_input and name in needed for name in node.output)
        if found[i]:
            needed.update(node.input)
    return found


def weights_of(graph: onnx.GraphProto, part: str) -> set[str]:
    """Names of the weights that a part needs, directly or through nodes that read nothing else."""
    constants = {tensor.name for tensor in graph.initializer}
    folded = {}
    for node in graph.node:
        if all(name in constants for name in node.input if name):
            constants.update(node.output)
            folded |= dict.fromkeys(node.output, node)
    nodes = [node for node, own in zip(graph.node, parts(graph)) if own == part and node.output[0] not in folded]
    read = {name for node in nodes for name in node.input}
    pending = list(read & folded.keys())
    while pending:
        more = set(folded[pending.pop()].input) - read
        read |= more
        pending += more & folded.keys()
    return read
