"""TAEHV-1.5 as two ONNX graphs: an encoder of clips or of a stream, and a streaming decoder whose nine memories are inputs and outputs.

Frames lie along the batch axis, oldest first. A memory layer combines each frame with the same layer's input one frame earlier; the decoder's
memories are those inputs at the last frame of the previous call.
"""

from __future__ import annotations

import numpy as np

from .geometry import AUTOENCODER_PATCH, AUTOENCODER_TEMPORAL, MEMORIES_PER_STAGE, STAGES, Geometry
from .graph import Graph
from .weights import DECODER_GROWTH, ENCODER_POOLING, Placed

# The decoder's first step bounds the latent softly: tanh(x / 3) * 3.
SOFT_LIMIT = 3.0
_SCALES = np.array([1, 1, 2, 2], np.float32)


def build_encoder(g: Geometry, precision: str, weights: dict[str, Placed]) -> Graph:
    """`rgb [4, 3, H, W]` in [0, 1] -> `latent [1, C, h, w]`. Memories start at zero, or are inputs and outputs as in the decoder."""
    o = Graph("encoder", precision, weights)
    width, height = g.decoded
    frames, p = AUTOENCODER_TEMPORAL, AUTOENCODER_PATCH
    x = o.input("rgb", precision, [frames, 3, height, width])
    # Pixel unshuffle: channel, row in patch, column in patch. Frames and channels share an axis to stay within rank 5.
    height, width = height // p, width // p
    x = o.reshape(x, [frames * 3, height, p, width, p], "unshuffle.split")
    x = o.transpose(x, [0, 2, 4, 1, 3], "unshuffle.turned")
    x = o.reshape(x, [frames, 3 * p * p, height, width], "unshuffle")
    past = [o.input(f"past_mem.{j}", precision, [1, *shape]) for j, shape in enumerate(g.encoder_memories)]
    present = []
    x = _relu(o, _conv(o, x, "encoder.0", 3), "encoder.1")
    for stage, pooled in enumerate(ENCODER_POOLING):
        first = 2 + stage * (2 + MEMORIES_PER_STAGE)
        if pooled > 1:
            frames //= pooled
            x = o.reshape(x, [frames, pooled * g.encoder_width, height, width], f"encoder.{first}.joined")
        x = _conv(o, x, f"encoder.{first}.conv", 1)
        x = _conv(o, x, f"encoder.{first + 1}", 3, stride=2)
        height, width = height // 2, width // 2
        if not past:
            start = _frame(o, x, frames, 0, f"stage.{stage}.first")
            empty = o.sub(start, start, f"stage.{stage}.empty")
        for m in range(MEMORIES_PER_STAGE):
            name = f"encoder.{first + 2 + m}"
            if past:
                present.append(_frame(o, x, frames, frames - 1, f"{name}.last"))
            memory = past[stage * MEMORIES_PER_STAGE + m] if past else empty
            x = _memory_block(o, x, memory, frames, name)
    x = _conv(o, x, f"encoder.{2 + STAGES * (2 + MEMORIES_PER_STAGE)}", 3)
    o.output(x, "latent", [1, g.latent_channels, g.latent_height, g.latent_width])
    for j, (memory, shape) in enumerate(zip(present, g.encoder_memories)):
        o.output(memory, f"present_mem.{j}", [1, *shape])
    return o


def build_decoder(g: Geometry, precision: str, weights: dict[str, Placed]) -> Graph:
    """`latent [1, C, h, w]` and nine memories -> `rgb [4, 3, H, W]` in [0, 1] and nine memories."""
    o = Graph("decoder", precision, weights)
    height, width = g.latent_height, g.latent_width
    x = o.input("latent", precision, [1, g.latent_channels, height, width])
    past = [o.input(f"past_mem.{j}", precision, [1, *shape]) for j, shape in enumerate(g.memories)]
    limit = o.number(SOFT_LIMIT, precision)
    x = o.mul(o.node("Tanh", [o.div(x, limit, "soft.scaled")], "soft.tanh"), limit, "soft")
    x = _relu(o, _conv(o, x, "decoder.1", 3), "decoder.2")
    frames, present = 1, []
    for stage, grown in enumerate(DECODER_GROWTH):
        first = 3 + stage * (3 + MEMORIES_PER_STAGE)
        for m in range(MEMORIES_PER_STAGE):
            present.append(_frame(o, x, frames, frames - 1, f"decoder.{first + m}.last"))
            x = _memory_block(o, x, past[stage * MEMORIES_PER_STAGE + m], frames, f"decoder.{first + m}")
        # The growing layer is a 1 x 1 convolution, which commutes with nearest upsampling. It is done before the upsampling, on a quarter of the
        # pixels, with the same result.
        grow = first + MEMORIES_PER_STAGE + 1
        x = _conv(o, x, f"decoder.{grow}.conv", 1)
        frames *= grown
        if grown > 1:
            x = o.reshape(x, [frames, g.decoder_widths[stage], height, width], f"decoder.{grow}.frames")
        x = _upsample(o, x, f"decoder.{grow - 1}")
        height, width = 2 * height, 2 * width
        x = _conv(o, x, f"decoder.{grow + 1}", 3)
    last = 3 + STAGES * (3 + MEMORIES_PER_STAGE)
    x = _conv(o, _relu(o, x, f"decoder.{last}"), f"decoder.{last + 1}", 3)
    # CRD: channel, row in patch, column in patch, as pixel shuffle orders them.
    x = o.node("DepthToSpace", [x], "shuffle", blocksize=AUTOENCODER_PATCH, mode="CRD")
    x = o.node("Clip", [x, o.number(0.0, precision), o.number(1.0, precision)], "unit")
    o.output(x, "rgb", [AUTOENCODER_TEMPORAL, 3, *reversed(g.decoded)])
    for j, (memory, shape) in enumerate(zip(present, g.memories)):
        o.output(memory, f"present_mem.{j}", [1, *shape])
    return o


def _conv(o: Graph, x: str, name: str, size: int, stride: int = 1) -> str:
    inputs = [x, o.weight(f"{name}.weight")]
    if f"{name}.bias" in o.weights:
        inputs.append(o.weight(f"{name}.bias"))
    pad = size // 2
    return o.node("Conv", inputs, name, kernel_shape=[size, size], strides=[stride, stride], pads=[pad] * 4)


def _relu(o: Graph, x: str, label: str) -> str:
    return o.node("Relu", [x], label)


def _frame(o: Graph, x: str, frames: int, index: int, label: str) -> str:
    return x if frames == 1 else o.slice(x, index, index + 1, 0, label)


def _memory_block(o: Graph, x: str, memory: str, frames: int, name: str) -> str:
    """relu(conv(relu(conv(relu(conv([x, past]))))) + x), where past is the memory followed by x's earlier frames."""
    past = memory
    if frames > 1:
        past = o.concat([memory, o.slice(x, 0, frames - 1, 0, f"{name}.earlier")], 0, f"{name}.past")
    y = o.concat([x, past], 1, f"{name}.pair")
    for j in (0, 2):
        y = _relu(o, _conv(o, y, f"{name}.conv.{j}", 3), f"{name}.conv.{j + 1}")
    return _relu(o, o.add(_conv(o, y, f"{name}.conv.4", 3), x, f"{name}.skip"), f"{name}.act")


def _upsample(o: Graph, x: str, label: str) -> str:
    """Nearest upsampling by two in each direction."""
    scales = o.constant("upsample.scales", _SCALES)
    return o.node(
        "Resize",
        [x, "", scales],
        label,
        mode="nearest",
        coordinate_transformation_mode="asymmetric",
        nearest_mode="floor",
    )
