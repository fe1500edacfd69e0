"""Runs a graph with every value rounded to its own type, as DirectML does.

ONNX Runtime's CPU provider has no float16 kernels for most operators. It casts their inputs to float32, and leaves out casts between them, so a
float16 sum passes 65504 there without becoming infinite.
"""

import numpy as np
import onnx
from onnx import TensorProto, numpy_helper

from cairn.build.quantise import restored

NUMPY = {TensorProto.FLOAT: np.float32, TensorProto.FLOAT16: np.float16}


def _norm(x, gain, epsilon, axis):
    return x / np.sqrt(np.square(x).mean(axis=axis, keepdims=True) + np.float32(epsilon)) * gain


def _rotation(x, _, cos, sin):
    half = x.shape[-1] // 2
    a, b = x[..., :half], x[..., half:]
    return np.concatenate([a * cos - b * sin, a * sin + b * cos], axis=-1)


def _patches(x, kernel, strides, kernel_shape):
    """A convolution whose kernels do not overlap."""
    assert strides == kernel_shape
    (_, c, h, w), (rows, columns) = x.shape, kernel_shape
    cells = x.reshape(c, h // rows, rows, w // columns, columns).transpose(1, 3, 0, 2, 4)
    return (cells.reshape(h // rows, w // columns, -1) @ kernel.reshape(len(kernel), -1).T).transpose(2, 0, 1)[None]


def _product_of_blocks(a, numbers, scales, K, N, bits, **_):  # noqa: N803: names of the operator
    return a @ restored(numbers.astype(np.uint8), scales, bits)


def _softmax(x, axis):
    e = np.exp(x - x.max(axis=axis, keepdims=True))
    return e / e.sum(axis=axis, keepdims=True)


def _split(x, sizes=None, axis=0, num_outputs=None):
    at = num_outputs if sizes is None else np.cumsum(sizes)[:-1]
    return np.split(x, at, axis=axis)


def _slice(x, start, end, axis):
    index = [slice(None)] * x.ndim
    index[int(axis[0])] = slice(int(start[0]), int(end[0]))
    return x[tuple(index)]


OPERATORS = {
    "Add": np.add,
    "Cast": lambda x, to: x,
    "Concat": lambda *parts, axis: np.concatenate(parts, axis=axis),
    "Conv": _patches,
    "Cos": np.cos,
    "Div": np.divide,
    "FusedMatMul": lambda a, b, alpha, transB: np.float32(alpha) * (a @ b.swapaxes(-1, -2)),  # noqa: N803
    "MatMul": np.matmul,
    "MatMulNBits": _product_of_blocks,
    "Mul": np.multiply,
    "ReduceMean": lambda x, axes, keepdims: x.mean(axis=tuple(int(axis) for axis in axes), keepdims=bool(keepdims)),
    "Reshape": lambda x, shape: x.reshape([int(n) for n in shape]),
    "RotaryEmbedding": lambda x, at, cos, sin, interleaved: _rotation(x, at, cos, sin),
    "Sigmoid": lambda x: 1 / (1 + np.exp(-x)),
    "SimplifiedLayerNormalization": _norm,
    "Sin": np.sin,
    "Slice": _slice,
    "Softmax": _softmax,
    "Split": _split,
    "Sqrt": np.sqrt,
    "Sub": np.subtract,
    "Transpose": lambda x, perm: x.transpose(perm),
}


class RoundedSession:
    """As `onnxruntime.InferenceSession`, with sums in float32 and every result rounded to the type that the graph gives it."""

    def __init__(self, path):
        self.model = onnx.load(path)
        self.values = {}

    def run(self, _, feeds):
        """All outputs; `values` keeps every value of this run."""
        graph = self.model.graph
        values = dict(feeds) | {t.name: numpy_helper.to_array(t) for t in graph.initializer}
        with np.errstate(over="ignore", invalid="ignore"):
            for node in graph.node:
                attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
                inputs = [values[name] for name in node.input]
                kind = NUMPY[attributes["to"]] if node.op_type == "Cast" else inputs[0].dtype
                wide = [v.astype(np.float32) if v.dtype == np.float16 else v for v in inputs]
                made = OPERATORS[node.op_type](*wide, **attributes)
                made = made if isinstance(made, list) else [made]
                values |= {name: np.asarray(value).astype(kind) for name, value in zip(node.output, made, strict=True)}
        self.values = values
        return [values[output.name] for output in graph.output]
