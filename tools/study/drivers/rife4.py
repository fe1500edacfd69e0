"""Pictures between two, by RIFE 4.0, without torch: its network as an ONNX graph on ONNX Runtime.

    python rife4.py WEIGHTS WIDTH HEIGHT PREVIOUS CURRENT OUT [--[no-]ensemble] [--[no-]refine] PHASE...

WEIGHTS is the published flownet.pkl; PREVIOUS, CURRENT and OUT are files of raw 8-bit RGB; each PHASE, inside (0, 1), adds one
picture to OUT. The graph is written down here from the published network's structure: four blocks from coarse to fine, which get
the phase as a channel; each adds to a flow from the middle to either picture and to a mask between the two. A second network
refines the mixture. `rife.py` has what RIFE HDv3 has in common with it.
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from rife import Graph, Reader, Storage

SCALES = (8, 4, 2, 1)
# Both sides are padded to a multiple of this, as in the published program.
MULTIPLE = 128
# Motion in pixels that the second block may still add; above it all scales are doubled, as in the published program.
LARGEST = 32
# Settings of the published program. The best of the four pairs on the scenes' seed for tuning: `study quality --tune rife4`.
ENSEMBLE = True
REFINE = False


class ZipReader(Reader):
    """Of a file in torch's format since 1.6, which keeps the numbers of each storage in a file of their own."""

    def __init__(self, file: object, numbers: zipfile.ZipFile) -> None:
        super().__init__(file)
        self.numbers = numbers

    def persistent_load(self, pid: object) -> Storage:
        storage = super().persistent_load((*pid, None))
        storage.values = np.frombuffer(self.numbers.read(f"archive/data/{storage.key}"), "<f4")
        if len(storage.values) != storage.count:
            raise SystemExit(f"a storage of {len(storage.values)} numbers where {storage.count} are announced")
        return storage


def read_weights(path: Path) -> dict[str, np.ndarray]:
    """The tensors of the file by name."""
    with zipfile.ZipFile(path) as file, file.open("archive/data.pkl") as pickled:
        tensors = ZipReader(pickled, file).load()
    return {name.removeprefix("module."): tensor.array() for name, tensor in tensors.items()}


class Network(Graph):
    """The graph of RIFE 4.0 for pictures of one padded size."""

    def __init__(self, weights: dict[str, np.ndarray], width: int, height: int) -> None:
        super().__init__(weights)
        self.width, self.height = width, height

    def block4(self, name: str, value: str, flow: str | None, scale: int) -> tuple[str, str]:
        """One block: what it adds to flow and mask."""
        value = self.resize(value, 1 / scale)
        if flow is not None:
            value = self.join(value, self.scale(self.resize(flow, 1 / scale), 1 / scale))
        for layer in (0, 1):
            value = self.conv(value, f"{name}.conv0.{layer}", stride=2)
        inner = value
        for layer in range(8):
            inner = self.conv(inner, f"{name}.convblock.{layer}")
        value = self.transposed(self.add("Add", inner, value), f"{name}.lastconv")
        value = self.resize(value, 2 * scale)
        return self.scale(self.channels(value, 0, 4), 2 * scale), self.channels(value, 4, 5)

    def transposed(self, value: str, name: str) -> str:
        """A transposed 4x4 convolution, which doubles both sides."""
        weights = (self.weight(f"{name}.weight"), self.weight(f"{name}.bias"))
        return self.add("ConvTranspose", value, *weights, strides=[2, 2], pads=[1, 1, 1, 1])

    def twice(self, value: str, name: str) -> str:
        """Two convolutions, the first of which halves both sides."""
        return self.conv(self.conv(value, f"{name}.conv1", stride=2), f"{name}.conv2")

    def warp_by(self, value: str, flow: str, level: int) -> str:
        """The value, whose sides are halved `level` times, sampled at each pixel moved by the flow in its own pixels."""
        width, height = self.width >> level, self.height >> level
        across = np.linspace(-1, 1, width, dtype=np.float32)[None, :].repeat(height, 0)
        down = np.linspace(-1, 1, height, dtype=np.float32)[:, None].repeat(width, 1)
        steps = self.constant(np.array([2 / (width - 1), 2 / (height - 1)]).reshape(1, 2, 1, 1))
        return self.warp(value, flow, self.constant(np.stack([across, down], -1)[None]), steps)

    def context(self, value: str, flow: str) -> list[str]:
        """Features of a picture at four sizes, moved by the flow."""
        features = []
        for level in range(1, 5):
            value = self.twice(value, f"contextnet.conv{level}")
            flow = self.scale(self.resize(flow, 0.5), 0.5)
            features.append(self.warp_by(value, flow, level))
        return features

    def refinement(self, pictures: tuple[str, str], warped: tuple[str, str], mask: str, flow: str) -> str:
        """What is added to the mixture."""
        parts = (self.channels(flow, 0, 2), self.channels(flow, 2, 4))
        contexts = [self.context(*pair) for pair in zip(pictures, parts)]
        down = [self.twice(self.join(*pictures, *warped, mask, flow), "unet.down0")]
        for level in range(1, 4):
            down.append(self.twice(self.join(down[-1], *(c[level - 1] for c in contexts)), f"unet.down{level}"))
        value = self.join(down[3], *(c[3] for c in contexts))
        for level in range(4):
            if level > 0:
                value = self.join(value, down[3 - level])
            value = self.transposed(value, f"unet.up{level}.0")
            value = self.slopes(value, f"unet.up{level}.1.weight")
        weights = (self.weight("unet.conv.weight"), self.weight("unet.conv.bias"))
        value = self.add("Sigmoid", self.add("Conv", value, *weights, pads=[1, 1, 1, 1]))
        return self.add("Sub", self.scale(value, 2), self.constant(1))


def network(
    weights: dict[str, np.ndarray], width: int, height: int, wide: bool, ensemble: bool, refine: bool
) -> bytes:
    """The whole network for pictures of one size, padded already: float RGB in [0, 1], NCHW.

    With `wide` all scales are doubled. With `ensemble` each block is run in both directions of time.
    """
    g = Network(weights, width, height)
    first, second, phase = "first", "second", "phase"
    ahead = g.add("Expand", phase, g.constant([1, 1, height, width], np.int64))
    back = g.add("Sub", g.constant(1), ahead)
    swap = lambda value: g.join(g.channels(value, 2, 4), g.channels(value, 0, 2))
    mean = lambda a, b: g.scale(g.add("Add", a, b), 0.5)
    warped, flow, mask, largest = (first, second), None, None, None
    for index, scale in enumerate(SCALES):
        name, scale = f"block{index}", scale * (2 if wide else 1)
        masks = (mask, g.add("Neg", mask)) if mask else ()
        added = g.block4(name, g.join(*warped, ahead, *masks[:1]), flow, scale)
        if index == 1:
            sides = [g.add("Abs", g.channels(added[0], *side)) for side in ((0, 2), (2, 4))]
            largest = g.add("Min", *(g.add("ReduceMax", side, keepdims=0) for side in sides))
        # The published program's first block at double scale looks in one direction only.
        if ensemble and not (wide and index == 0):
            swapped = None if flow is None else swap(flow)
            other = g.block4(name, g.join(*reversed(warped), back, *masks[1:]), swapped, scale)
            added = (mean(added[0], swap(other[0])), g.scale(g.add("Sub", added[1], other[1]), 0.5))
        flow, mask = added if flow is None else [g.add("Add", *pair) for pair in zip((flow, mask), added)]
        parts = (g.channels(flow, 0, 2), g.channels(flow, 2, 4))
        warped = tuple(g.warp_by(p, f, 0) for p, f in zip((first, second), parts))
    share = g.add("Sigmoid", mask)
    rest = g.add("Sub", g.constant(1), share)
    out = g.add("Add", g.add("Mul", warped[0], share), g.add("Mul", warped[1], rest))
    if refine:
        out = g.add("Add", out, g.refinement((first, second), warped, mask, flow))
    value = lambda name, shape: helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
    picture = [1, 3, height, width]
    inputs = [value(first, picture), value(second, picture), value(phase, [1, 1, 1, 1])]
    constants = [numpy_helper.from_array(array, name) for name, array in g.constants.items()]
    graph = helper.make_graph(g.nodes, "rife4", inputs, [value(out, picture), value(largest, [])], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.checker.check_model(model)
    return model.SerializeToString()


class Rife:
    """The network for pictures of one size."""

    def __init__(self, weights: Path, width: int, height: int, ensemble: bool = ENSEMBLE, refine: bool = REFINE) -> None:
        self.weights, self.size = read_weights(weights), (height, width)
        self.padded = [-(-side // MULTIPLE) * MULTIPLE for side in (width, height)]
        self.settings, self.sessions = (ensemble, refine), {}

    def run(self, wide: bool, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        if wide not in self.sessions:
            options = onnxruntime.SessionOptions()
            options.log_severity_level = 3
            model = network(self.weights, *self.padded, wide, *self.settings)
            providers = ["CPUExecutionProvider"]
            self.sessions[wide] = onnxruntime.InferenceSession(model, options, providers=providers)
        return self.sessions[wide].run(None, inputs)

    def between(self, previous: np.ndarray, current: np.ndarray, phase: float) -> np.ndarray:
        """The picture at `phase` between two of 8-bit RGB, HWC: float RGB in [0, 1], HWC."""
        height, width = self.size
        room = ((0, 0), (0, 0), (0, self.padded[1] - height), (0, self.padded[0] - width))
        # Filled up with black, as the published program does.
        planes = [np.pad(p.transpose(2, 0, 1)[None].astype(np.float32) / 255, room) for p in (previous, current)]
        inputs = {"first": planes[0], "second": planes[1], "phase": np.full((1, 1, 1, 1), phase, np.float32)}
        out, largest = self.run(False, inputs)
        if largest > LARGEST:
            out, _ = self.run(True, inputs)
        return out[0, :, :height, :width].transpose(1, 2, 0).clip(0, 1)


def main() -> None:
    weights, width, height = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    pictures = [np.fromfile(path, np.uint8).reshape(height, width, 3) for path in sys.argv[4:6]]
    words = sys.argv[7:]
    chosen = lambda name, usual: (usual or f"--{name}" in words) and f"--no-{name}" not in words
    rife = Rife(weights, width, height, chosen("ensemble", ENSEMBLE), chosen("refine", REFINE))
    with Path(sys.argv[6]).open("wb") as file:
        for phase in (word for word in words if not word.startswith("--")):
            # To the nearest code value.
            file.write(np.rint(rife.between(*pictures, float(phase)) * 255).astype(np.uint8).tobytes())


if __name__ == "__main__":
    main()
