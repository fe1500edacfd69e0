"""The conditioning of a transformer, as the library finds it: `src/bundle/onnx/conditioning.rs`. It runs once for each noise level, not in passes."""

from __future__ import annotations

import onnx

# The input that has the noise levels.
LEVELS = "sigma"
_PRODUCTS = ("MatMul", "Gemm", "MatMulNBits")


def conditioning(graph: onnx.GraphProto) -> list[bool]:
    """For each node, whether its values depend on noise levels alone and a product with weights needs them or is the node itself."""
    outputs = {value.name for value in graph.output}
    constants = {tensor.name for tensor in graph.initializer}
    of_levels = {LEVELS}
    is_product = [False] * len(graph.node)
    for i, node in enumerate(graph.node):
        read = {name for name in node.input if name}
        if read <= constants:
            constants.update(node.output)
        elif read <= constants | of_levels and not outputs & set(node.output):
            of_levels.update(node.output)
            is_product[i] = node.op_type in _PRODUCTS and bool(read & constants)
    needed: set[str] = set()
    found = [False] * len(graph.node)
    for i, node in reversed(list(enumerate(graph.node))):
        found[i] = is_product[i] or any(name in of_levels and name in needed for name in node.output)
        if found[i]:
            needed.update(node.input)
    return found


def weights_of_passes(graph: onnx.GraphProto) -> set[str]:
    """Names of the weights that passes need, directly or through nodes that only read weights."""
    found = conditioning(graph)
    constants = {tensor.name for tensor in graph.initializer}
    folded = {}
    for node in graph.node:
        if all(name in constants for name in node.input if name):
            constants.update(node.output)
            folded |= dict.fromkeys(node.output, node)
    read = {name for node, is_found in zip(graph.node, found) if not is_found for name in node.input if node.output[0] not in folded}
    pending = list(read & folded.keys())
    while pending:
        more = set(folded[pending.pop()].input) - read
        read |= more
        pending += more & folded.keys()
    return read
