"""A small writer of ONNX graphs: typed values, constants stored once, weights as external data."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from .quantise import NUMBERS, SCALES, Quantisation
from .weights import Placed

OPSET = 18
IR_VERSION = 8
PRODUCER = "cairn.build"
# The `accuracy_level` of `MatMulNBits` that lets the CPU provider round activations to 8 bits.
INT8_ACTIVATIONS = 4
# Operators allowed in a graph of a bundle: `docs/bundle.md`, section 4. All of them run on DirectML.
OPERATORS = (
    "Add Cast Clip Concat Conv Cos DepthToSpace Div FusedMatMul MatMul MatMulNBits Mul ReduceMean Relu Reshape Resize "
    "RotaryEmbedding Sigmoid SimplifiedLayerNormalization Sin Slice Softmax Split Sqrt Sub Tanh Transpose"
).split()
# Those of ONNX Runtime's own domain. `SimplifiedLayerNormalization` is its own, too, but it keeps it in the default domain.
CONTRIB_DOMAIN = "com.microsoft"
CONTRIB_OPERATORS = ("FusedMatMul", "MatMulNBits", "RotaryEmbedding")
ONNX_TYPE = {"f32": TensorProto.FLOAT, "f16": TensorProto.FLOAT16}
NUMPY_TYPE = {"f32": np.float32, "f16": np.float16}
STORED_TYPE = {"f16": TensorProto.FLOAT16, "u8": TensorProto.UINT8}


class Graph:
    """One graph in one precision. Values are names; `kind` is "f32" or "f16" for each of them, or "u8" for stored integers.

    Writes only the operators of `docs/bundle.md`, section 4.
    """

    def __init__(self, name: str, precision: str, weights: dict[str, Placed], quantisation: Quantisation | None = None):
        self.name = name
        self.precision = precision
        self.weights = weights
        self.quantisation = quantisation
        self.used_weights: set[str] = set()
        self._nodes: list[onnx.NodeProto] = []
        self._inputs: list[onnx.ValueInfoProto] = []
        self._outputs: list[onnx.ValueInfoProto] = []
        self._initializers: list[onnx.TensorProto] = []
        self._constants: dict[tuple, str] = {}
        self._casts: dict[tuple[str, str], str] = {}
        self._kinds: dict[str, str] = {}
        self._names: set[str] = set()
        self._renamed: dict[str, str] = {}

    # Inputs and outputs.

    def input(self, name: str, kind: str, shape: list) -> str:
        """Declares the next input."""
        self._inputs.append(helper.make_tensor_value_info(name, ONNX_TYPE[kind], shape))
        self._kinds[name] = kind
        self._names.add(name)
        return name

    def output(self, value: str, name: str, shape: list) -> None:
        """Declares `value` as the next output, under the name `name`, which no other value may have."""
        if name in self._names or value in self._renamed:
            raise AssertionError(f"{name} and {value} must each name one value")
        self._renamed[value] = name
        self._names.add(name)
        self._outputs.append(helper.make_tensor_value_info(name, ONNX_TYPE[self._kinds[value]], shape))

    def weight(self, name: str, kind: str | None = None) -> str:
        """A stored weight, cast to `kind` (the graph's precision unless given); integers stay as they are."""
        if name not in self.used_weights:
            placed = self.weights[name]
            tensor = TensorProto(name=name, data_type=STORED_TYPE[placed.weight.kind], dims=placed.weight.shape)
            tensor.data_location = TensorProto.EXTERNAL
            for key, value in (("location", placed.file), ("offset", placed.offset), ("length", placed.length)):
                tensor.external_data.add(key=key, value=str(value))
            self._initializers.append(tensor)
            self._kinds[name] = placed.weight.kind
            self._names.add(name)
            self.used_weights.add(name)
        return name if self._kinds[name] == "u8" else self.cast(name, kind or self.precision)

    def number(self, value: float, kind: str) -> str:
        """A scalar constant."""
        return self.constant(f"c.{value:.9g}.{kind}", np.array(value, NUMPY_TYPE[kind]))

    def constant(self, name: str, array: np.ndarray) -> str:
        """A small constant, written into the graph once."""
        key = (name, array.tobytes(), array.shape)
        if key not in self._constants:
            unique = self._unique(name)
            self._initializers.append(numpy_helper.from_array(array, unique))
            self._constants[key] = unique
            if array.dtype != np.int64:
                self._kinds[unique] = "f32" if array.dtype == np.float32 else "f16"
        return self._constants[key]

    # Operators.

    def node(self, operator: str, inputs: list[str], label: str, kind: str | None = None, outputs: int = 1, **attributes):
        """Adds a node. Returns the name of its output, or a list of names if `outputs` is above 1."""
        if operator not in OPERATORS:
            raise AssertionError(f"{operator} is no operator of the bundle format")
        stem = self._unique(label)
        names = [stem] if outputs == 1 else [f"{stem}.{i}" for i in range(outputs)]
        domain = CONTRIB_DOMAIN if operator in CONTRIB_OPERATORS else None
        self._nodes.append(helper.make_node(operator, inputs, names, name=f"{stem}/{operator}", domain=domain, **attributes))
        if kind is None:
            kind = self._kinds[inputs[0]]
        for name in names:
            self._kinds[name] = kind
            self._names.add(name)
        return names[0] if outputs == 1 else names

    def cast(self, value: str, kind: str) -> str:
        """`value` cast to `kind`. Adds no node if it has that kind already, and only one node for each value."""
        if self._kinds[value] == kind:
            return value
        key = (value, kind)
        if key not in self._casts:
            self._casts[key] = self.node("Cast", [value], f"{value}.{kind}", kind, to=ONNX_TYPE[kind])
        return self._casts[key]

    def _binary(self, operator: str, a: str, b: str, label: str) -> str:
        if self._kinds[a] != self._kinds[b]:
            raise AssertionError(f"{label}: {a} is {self._kinds[a]}, {b} is {self._kinds[b]}")
        return self.node(operator, [a, b], label)

    def add(self, a: str, b: str, label: str) -> str:
        """a + b."""
        return self._binary("Add", a, b, label)

    def sub(self, a: str, b: str, label: str) -> str:
        """a - b."""
        return self._binary("Sub", a, b, label)

    def mul(self, a: str, b: str, label: str) -> str:
        """a * b, element by element."""
        return self._binary("Mul", a, b, label)

    def div(self, a: str, b: str, label: str) -> str:
        """a / b, element by element."""
        return self._binary("Div", a, b, label)

    def matmul(self, a: str, b: str, label: str) -> str:
        """The matrix product."""
        return self._binary("MatMul", a, b, label)

    def matmul_turned(self, a: str, b: str, scale: float, label: str) -> str:
        """scale * a b^T over the last two axes."""
        if self._kinds[a] != self._kinds[b]:
            raise AssertionError(f"{label}: {a} is {self._kinds[a]}, {b} is {self._kinds[b]}")
        return self.node("FusedMatMul", [a, b], label, alpha=scale, transB=1)

    def linear(self, x: str, name: str, label: str) -> str:
        """x times the stored matrix `name`, in x's kind."""
        if f"{name}.weight{NUMBERS}" in self.weights:
            return self._linear_of_blocks(x, f"{name}.weight", label)
        return self.matmul(x, self.weight(f"{name}.weight", self._kinds[x]), label)

    def _linear_of_blocks(self, x: str, name: str, label: str) -> str:
        """x times the matrix `name`, which is stored as integers and the scales of its blocks."""
        how = self.quantisation
        rows = self.weights[name + NUMBERS].weight.fan_in
        columns = self.weights[name + NUMBERS].weight.shape[0]
        rounds = how.activation_bits == 8 and self._kinds[x] == "f32"
        attributes = {"K": rows, "N": columns, "bits": how.bits, "block_size": how.block}
        attributes["accuracy_level"] = INT8_ACTIVATIONS if rounds else 0
        inputs = [x, self.weight(name + NUMBERS), self.weight(name + SCALES, self._kinds[x])]
        return self.node("MatMulNBits", inputs, label, **attributes)

    def silu(self, x: str, label: str) -> str:
        """x * sigmoid(x)."""
        return self.mul(x, self.node("Sigmoid", [x], f"{label}.sigmoid"), label)

    def reshape(self, x: str, shape: list[int], label: str) -> str:
        """Reshape; one size may be -1."""
        target = self.constant("shape." + "x".join(str(s) for s in shape), np.array(shape, np.int64))
        return self.node("Reshape", [x, target], label)

    def transpose(self, x: str, perm: list[int], label: str) -> str:
        """Permutes the axes."""
        return self.node("Transpose", [x], label, perm=perm)

    def concat(self, parts: list[str], axis: int, label: str) -> str:
        """Concatenates parts; a single part is returned unchanged."""
        return parts[0] if len(parts) == 1 else self.node("Concat", parts, label, axis=axis)

    def split(self, x: str, parts: int, axis: int, label: str) -> list[str]:
        """Splits into equal parts along an axis; for a single part returns the whole."""
        if parts == 1:
            return [x]
        return self.node("Split", [x], label, outputs=parts, axis=axis, num_outputs=parts)

    def slice(self, x: str, start: int, end: int, axis: int, label: str) -> str:
        """Elements from `start` up to `end` of an axis."""
        bounds = [self.constant(f"at.{v}", np.array([v], np.int64)) for v in (start, end, axis)]
        return self.node("Slice", [x, *bounds], label)

    def split_sizes(self, x: str, sizes: list[int], axis: int, label: str) -> list[str]:
        """Splits into parts of these sizes along an axis."""
        target = self.constant("sizes." + "x".join(str(s) for s in sizes), np.array(sizes, np.int64))
        return self.node("Split", [x, target], label, outputs=len(sizes), axis=axis)

    def _unique(self, label: str) -> str:
        name, n = label, 1
        while name in self._names:
            n += 1
            name = f"{label}~{n}"
        self._names.add(name)
        return name

    def model(self) -> onnx.ModelProto:
        """The finished model."""
        for node in self._nodes:
            node.input[:] = [self._renamed.get(name, name) for name in node.input]
            node.output[:] = [self._renamed.get(name, name) for name in node.output]
        self._renamed = {}
        graph = helper.make_graph(self._nodes, self.name, self._inputs, self._outputs, self._initializers)
        opsets = [helper.make_opsetid("", OPSET)]
        if any(node.domain == CONTRIB_DOMAIN for node in self._nodes):
            opsets.append(helper.make_opsetid(CONTRIB_DOMAIN, 1))
        model = helper.make_model(graph, opset_imports=opsets, producer_name=PRODUCER)
        model.ir_version = IR_VERSION
        return model
