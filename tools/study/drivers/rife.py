"""The picture midway between two, by RIFE HDv3, without torch: its network as an ONNX graph on ONNX Runtime.

    python rife.py WEIGHTS WIDTH HEIGHT PREVIOUS CURRENT OUT

WEIGHTS is the published flownet.pkl; the others are files of raw 8-bit RGB. The graph is written down here from the
published network's structure: three blocks from coarse to fine, each run in both directions of time, each adding to a flow
from the middle to either picture and to a mask between the two.
"""

from __future__ import annotations

import pickle
import sys
from collections import OrderedDict
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

SCALES = (4, 2, 1)
# Both sides are padded to a multiple of this, as the coarsest block halves four times.
MULTIPLE = 32


class Storage:
    """What a tensor of the file says about its numbers before they are read."""

    def __init__(self, key: str, count: int) -> None:
        self.key, self.count = key, count
        self.values = np.empty(0, np.float32)


class Tensor:
    """A view of a storage."""

    def __init__(self, storage: Storage, offset: int, shape: tuple[int, ...], strides: tuple[int, ...], *_: object) -> None:
        self.storage, self.offset, self.shape, self.strides = storage, offset, shape, strides

    def array(self) -> np.ndarray:
        """The numbers, copied."""
        values = self.storage.values[self.offset :]
        return np.lib.stride_tricks.as_strided(values, self.shape, [4 * s for s in self.strides]).copy()


class Reader(pickle.Unpickler):
    """Knows the three names that a dictionary of float tensors needs, and refuses every other."""

    def __init__(self, file: object) -> None:
        super().__init__(file)
        self.storages: dict[str, Storage] = {}

    def find_class(self, module: str, name: str) -> object:
        known = {
            ("collections", "OrderedDict"): OrderedDict,
            ("torch._utils", "_rebuild_tensor_v2"): Tensor,
            ("torch", "FloatStorage"): "floats",
        }
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of a dictionary of tensors")
        return known[module, name]

    def persistent_load(self, pid: object) -> Storage:
        kind, what, key, _device, count, view = pid
        if kind != "storage" or what != "floats" or view is not None:
            raise pickle.UnpicklingError(f"{pid} is no storage of floats")
        return self.storages.setdefault(key, Storage(key, count))


def read_weights(path: Path) -> dict[str, np.ndarray]:
    """The tensors of a file in torch's format of before 1.6: five pickles, then the storages one after the other."""
    with path.open("rb") as file:
        for _ in range(3):  # a magic number, a version, sizes of C types
            Reader(file).load()
        reader = Reader(file)
        tensors = reader.load()
        for key in Reader(file).load():
            storage = reader.storages[key]
            count = int.from_bytes(file.read(8), "little")
            if count != storage.count:
                raise SystemExit(f"{path}: a storage of {count} numbers where {storage.count} are announced")
            storage.values = np.frombuffer(file.read(4 * count), "<f4")
    return {name.removeprefix("module."): tensor.array() for name, tensor in tensors.items()}


class Graph:
    """An ONNX graph that grows node by node; values are named by numbers."""

    def __init__(self, weights: dict[str, np.ndarray]) -> None:
        self.weights, self.nodes, self.constants = weights, [], {}

    def add(self, operator: str, *inputs: str, **attributes: object) -> str:
        """Adds a node and names its output."""
        name = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    def constant(self, values: object, dtype: type = np.float32) -> str:
        """A constant."""
        name = f"c{len(self.constants)}"
        self.constants[name] = np.asarray(values, dtype)
        return name

    def weight(self, name: str) -> str:
        """A weight of the file."""
        self.constants[name] = self.weights[name]
        return name

    def join(self, *values: str) -> str:
        return self.add("Concat", *values, axis=1)

    def channels(self, value: str, start: int, end: int) -> str:
        bounds = [self.constant([bound], np.int64) for bound in (start, end, 1)]
        return self.add("Slice", value, *bounds)

    def scale(self, value: str, factor: float) -> str:
        return self.add("Mul", value, self.constant(factor))

    def resize(self, value: str, factor: float) -> str:
        if factor == 1:
            return value
        scales = self.constant([1, 1, factor, factor])
        return self.add("Resize", value, "", scales, mode="linear", coordinate_transformation_mode="half_pixel")

    def slopes(self, value: str, name: str) -> str:
        slope = self.constant(self.weights[name].reshape(-1, 1, 1))
        return self.add("PRelu", value, slope)

    def conv(self, value: str, name: str, stride: int = 1) -> str:
        """A 3x3 convolution with its activation."""
        weights = (self.weight(f"{name}.0.weight"), self.weight(f"{name}.0.bias"))
        out = self.add("Conv", value, *weights, strides=[stride, stride], pads=[1, 1, 1, 1])
        return self.slopes(out, f"{name}.1.weight")

    def up(self, value: str, name: str) -> str:
        """Twice a transposed 4x4 convolution, an activation between."""
        for layer in (0, 2):
            weights = (self.weight(f"{name}.{layer}.weight"), self.weight(f"{name}.{layer}.bias"))
            value = self.add("ConvTranspose", value, *weights, strides=[2, 2], pads=[1, 1, 1, 1])
            if layer == 0:
                value = self.slopes(value, f"{name}.1.weight")
        return value

    def block(self, name: str, pictures: str, flow: str, scale: int) -> tuple[str, str]:
        """One block: what it adds to flow and mask."""
        small = self.resize(pictures, 1 / scale)
        small_flow = self.scale(self.resize(flow, 1 / scale), 1 / scale)
        value = self.join(small, small_flow)
        for layer in (0, 1):
            value = self.conv(value, f"{name}.conv0.{layer}", stride=2)
        for part in range(4):
            inner = value
            for layer in (0, 1):
                inner = self.conv(inner, f"{name}.convblock{part}.{layer}")
            value = self.add("Add", inner, value)
        flow, mask = self.up(value, f"{name}.conv1"), self.up(value, f"{name}.conv2")
        return self.scale(self.resize(flow, scale), scale), self.resize(mask, scale)

    def warp(self, picture: str, flow: str, grid: str, steps: str) -> str:
        """The picture sampled at each pixel moved by the flow."""
        moved = self.add("Add", self.add("Transpose", self.add("Mul", flow, steps), perm=[0, 2, 3, 1]), grid)
        return self.add("GridSample", picture, moved, mode="bilinear", padding_mode="border", align_corners=1)


def network(weights: dict[str, np.ndarray], width: int, height: int) -> bytes:
    """The whole network for pictures of one size, padded already: float RGB in [0, 1], NCHW."""
    g = Graph(weights)
    across = np.linspace(-1, 1, width, dtype=np.float32)[None, :].repeat(height, 0)
    down = np.linspace(-1, 1, height, dtype=np.float32)[:, None].repeat(width, 1)
    grid = g.constant(np.stack([across, down], -1)[None])
    steps = g.constant(np.array([2 / (width - 1), 2 / (height - 1)]).reshape(1, 2, 1, 1))
    first, second = "first", "second"
    flow = g.constant(np.zeros((1, 4, height, width)))
    mask = g.constant(np.zeros((1, 1, height, width)))
    warped = (first, second)
    swap = lambda value: g.join(g.channels(value, 2, 4), g.channels(value, 0, 2))
    for index, scale in enumerate(SCALES):
        name = f"block{index}"
        ahead = g.block(name, g.join(*warped, mask), flow, scale)
        back = g.block(name, g.join(*reversed(warped), g.add("Neg", mask)), swap(flow), scale)
        flow = g.add("Add", flow, g.scale(g.add("Add", ahead[0], swap(back[0])), 0.5))
        mask = g.add("Add", mask, g.scale(g.add("Sub", ahead[1], back[1]), 0.5))
        parts = (g.channels(flow, 0, 2), g.channels(flow, 2, 4))
        warped = tuple(g.warp(p, f, grid, steps) for p, f in zip((first, second), parts))
    share = g.add("Sigmoid", mask)
    rest = g.add("Sub", g.constant(1), share)
    g.add("Add", g.add("Mul", warped[0], share), g.add("Mul", warped[1], rest))
    shape = [1, 3, height, width]
    value = lambda name: helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
    constants = [numpy_helper.from_array(array, name) for name, array in g.constants.items()]
    graph = helper.make_graph(
        g.nodes, "rife", [value(first), value(second)], [value(g.nodes[-1].output[0])], constants
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.checker.check_model(model)
    return model.SerializeToString()


def main() -> None:
    weights, width, height = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    padded = [-(-side // MULTIPLE) * MULTIPLE for side in (width, height)]
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    model = network(read_weights(weights), *padded)
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    pictures = []
    for path in sys.argv[4:6]:
        rgb = np.fromfile(path, np.uint8).reshape(height, width, 3).transpose(2, 0, 1)[None]
        room = ((0, 0), (0, 0), (0, padded[1] - height), (0, padded[0] - width))
        # Filled up with black, as the published program does.
        pictures.append(np.pad(rgb.astype(np.float32) / 255, room))
    (out,) = session.run(None, dict(zip(("first", "second"), pictures)))
    # To the nearest code value; the published program rounds towards zero, which costs it some tenths of a decibel.
    rgb = np.rint(out[0, :, :height, :width].transpose(1, 2, 0).clip(0, 1) * 255).astype(np.uint8)
    rgb.tofile(sys.argv[6])


if __name__ == "__main__":
    main()
