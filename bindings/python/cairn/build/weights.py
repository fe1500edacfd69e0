"""The tensors of a world, how a bundle stores them, and their positions in the file.

Names are the released checkpoint's, shortened where the checkpoint has copies. Matrices are `[in, out]`, as MatMul takes them: the
transpose of the checkpoint's `[out, in]`. Convolution kernels stay `[out, in, rows, columns]`. Tensors that the graph reads together are stored
as one (`Packed`), with the same numbers in another order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .geometry import AUTOENCODER_PATCH, CONDITIONER_RATIO, FOURIER_WIDTH, MEMORIES_PER_STAGE, STAGES, Geometry

TRANSFORMER_FILE = "transformer.bin"
AUTOENCODER_FILE = "autoencoder.bin"
ALIGNMENT = 64
ITEM_BYTES = {"f16": 2, "u8": 1}
MODULATIONS = ("attn scale", "attn shift", "attn gate", "mlp scale", "mlp shift", "mlp gate")


@dataclass(frozen=True)
class Weight:
    """One stored tensor: its name, its stored shape, the number of inputs that each output number sums, and its kind: "f16" or "u8"."""

    name: str
    shape: tuple[int, ...]
    fan_in: int
    kind: str = "f16"

    @property
    def count(self) -> int:
        """Its number of elements."""
        total = 1
        for size in self.shape:
            total *= size
        return total

    @property
    def length(self) -> int:
        """Its bytes in a file."""
        return self.count * ITEM_BYTES[self.kind]


@dataclass(frozen=True)
class Packed:
    """A tensor as it is stored: one weight, or several that one product or one norm reads together.

    `pack` makes its numbers from those of its parts, and `unpack` those of the parts from it.
    """

    whole: Weight
    parts: tuple[Weight, ...]
    pack: Callable[[list[np.ndarray]], np.ndarray]
    unpack: Callable[[np.ndarray], list[np.ndarray]]


@dataclass(frozen=True)
class Placed:
    """A stored tensor and the position of its bytes."""

    packed: Packed
    file: str
    offset: int

    @property
    def weight(self) -> Weight:
        """The tensor as it is stored."""
        return self.packed.whole

    @property
    def length(self) -> int:
        """Bytes in the file."""
        return self.weight.length


def _linear(name: str, inputs: int, outputs: int) -> Weight:
    return Weight(f"{name}.weight", (inputs, outputs), inputs)


def _conv(name: str, inputs: int, outputs: int, size: int, bias: bool) -> Iterator[Weight]:
    yield Weight(f"{name}.weight", (outputs, inputs, size, size), inputs * size * size)
    if bias:
        yield Weight(f"{name}.bias", (outputs,), inputs * size * size)


def _memory_block(name: str, width: int) -> Iterator[Weight]:
    yield from _conv(f"{name}.conv.0", 2 * width, width, 3, True)
    yield from _conv(f"{name}.conv.2", width, width, 3, True)
    yield from _conv(f"{name}.conv.4", width, width, 3, True)


def transformer_weights(g: Geometry) -> list[Weight]:
    """The transformer's tensors. `cond_proj`, which all layers share, is stored once. `stored_transformer` says how they are stored."""
    D, hidden = g.width, g.width * g.mlp_ratio
    out = [
        Weight("patchify.weight", (D, g.latent_channels, *g.patch), g.patch_width),
        _linear("denoise_step_emb.mlp.fc1", FOURIER_WIDTH, CONDITIONER_RATIO * D),
        _linear("denoise_step_emb.mlp.fc2", CONDITIONER_RATIO * D, D),
        _linear("ctrl_emb.mlp.fc1", g.control_width, hidden),
        _linear("ctrl_emb.mlp.fc2", hidden, D),
        Weight("cond_head.bias_in", (g.layers, D), 1),
    ]
    out += [_linear(f"cond_head.cond_proj.{j}", D, D) for j in range(len(MODULATIONS))]
    for i in range(g.layers):
        block = f"blocks.{i}"
        out += [
            _linear(f"{block}.attn.q_proj", D, D),
            _linear(f"{block}.attn.k_proj", D, g.kv_width),
            _linear(f"{block}.attn.v_proj", D, g.kv_width),
            _linear(f"{block}.attn.out_proj", D, D),
        ]
        if i > 0:
            # Layer 0 mixes its values with themselves: its factor has no effect and is not stored.
            out.append(Weight(f"{block}.attn.v_lamb", (1,), 1))
        if g.sees_controls(i):
            out += [_linear(f"{block}.ctrl_mlpfusion.{leaf}", D, D) for leaf in ("fc1_x", "fc1_c", "fc2")]
        out += [_linear(f"{block}.mlp.fc1", D, hidden), _linear(f"{block}.mlp.fc2", hidden, D)]
    out += [
        _linear("out_norm.fc", D, 2 * D),
        _linear("unpatchify", D, g.patch_width),
        Weight("unpatchify.bias", (g.patch_width,), 1),
    ]
    return out


def autoencoder_weights(g: Geometry) -> list[Weight]:
    """TAEHV-1.5's tensors, encoder first, with its own names."""
    e, shuffled = g.encoder_width, 3 * AUTOENCODER_PATCH**2
    out = list(_conv("encoder.0", shuffled, e, 3, True))
    for stage, frames in enumerate(ENCODER_POOLING):
        first = 2 + stage * (2 + MEMORIES_PER_STAGE)
        out += _conv(f"encoder.{first}.conv", frames * e, e, 1, False)
        out += _conv(f"encoder.{first + 1}", e, e, 3, False)
        for m in range(MEMORIES_PER_STAGE):
            out += _memory_block(f"encoder.{first + 2 + m}", e)
    out += _conv(f"encoder.{2 + STAGES * (2 + MEMORIES_PER_STAGE)}", e, g.latent_channels, 3, True)

    widths = g.decoder_widths
    out += _conv("decoder.1", g.latent_channels, widths[0], 3, True)
    for stage, frames in enumerate(DECODER_GROWTH):
        first = 3 + stage * (3 + MEMORIES_PER_STAGE)
        for m in range(MEMORIES_PER_STAGE):
            out += _memory_block(f"decoder.{first + m}", widths[stage])
        # The upsampling between them has no weights.
        out += _conv(f"decoder.{first + MEMORIES_PER_STAGE + 1}.conv", widths[stage], frames * widths[stage], 1, False)
        out += _conv(f"decoder.{first + MEMORIES_PER_STAGE + 2}", widths[stage], widths[stage + 1], 3, False)
    out += _conv(f"decoder.{3 + STAGES * (3 + MEMORIES_PER_STAGE) + 1}", widths[3], shuffled, 3, True)
    return out


# Number of frames that a temporal pooling layer joins, and that a growing layer makes, stage by stage.
ENCODER_POOLING = (2, 2, 1)
DECODER_GROWTH = (1, 2, 2)


def _alone(weight: Weight) -> Packed:
    return Packed(weight, (weight,), lambda parts: parts[0], lambda whole: [whole])


def _stacked(name: str, weights: list[Weight], shape: tuple[int, ...]) -> Packed:
    """Equal tensors, one after the other, with the shape `shape`."""
    whole = Weight(name, shape, weights[0].fan_in)

    def unpack(array: np.ndarray) -> list[np.ndarray]:
        return [part.reshape(w.shape) for part, w in zip(array.reshape(len(weights), -1), weights)]

    return Packed(whole, tuple(weights), lambda parts: np.stack(parts).reshape(shape), unpack)


def rotation_order(g: Geometry) -> np.ndarray:
    """The elements of a head in stored order: the first elements of all rotation pairs, then the second ones."""
    return np.arange(g.head_width).reshape(-1, 2).T.reshape(-1)


def _attention(g: Geometry, block: str, parts: tuple[Weight, ...]) -> Packed:
    """Queries, keys and values of one layer as one matrix [D, (H + 2 G) d]; heads of queries and keys in `rotation_order`."""
    order = rotation_order(g)
    back = np.argsort(order)
    sizes = np.cumsum([w.shape[1] for w in parts])

    def turned(array: np.ndarray, by: np.ndarray) -> np.ndarray:
        return array.reshape(g.width, -1, g.head_width)[:, :, by].reshape(g.width, -1)

    def pack(arrays: list[np.ndarray]) -> np.ndarray:
        q, k, v = arrays
        return np.concatenate([turned(q, order), turned(k, order), v], axis=1)

    def unpack(whole: np.ndarray) -> list[np.ndarray]:
        q, k, v = np.split(whole, sizes[:-1], axis=1)
        return [turned(q, back), turned(k, back), v]

    return Packed(Weight(f"{block}.attn.qkv_proj.weight", (g.width, int(sizes[-1])), g.width), parts, pack, unpack)


def stored_transformer(g: Geometry) -> list[Packed]:
    """The transformer's tensors as they are stored, in file order."""
    weights = {w.name: w for w in transformer_weights(g)}
    shared = [weights[f"cond_head.cond_proj.{j}.weight"] for j in range(len(MODULATIONS))]
    first = {shared[0].name: _stacked("cond_head.cond_proj.weight", shared, (len(shared), g.width, g.width))}
    for i in range(g.layers):
        parts = tuple(weights[f"blocks.{i}.attn.{n}_proj.weight"] for n in "qkv")
        first[parts[0].name] = _attention(g, f"blocks.{i}", parts)
    packed = {w.name for p in first.values() for w in p.parts}
    return [first[name] if name in first else _alone(w) for name, w in weights.items() if name in first or name not in packed]


def stored_autoencoder(g: Geometry) -> list[Packed]:
    """The autoencoder's tensors as they are stored, in file order."""
    return [_alone(weight) for weight in autoencoder_weights(g)]


def place(tensors: list[Packed], file: str) -> dict[str, Placed]:
    """Assigns each stored tensor a position in one file, at a multiple of `ALIGNMENT`."""
    placed, offset = {}, 0
    for packed in tensors:
        placed[packed.whole.name] = Placed(packed, file, offset)
        offset += -(-packed.whole.length // ALIGNMENT) * ALIGNMENT
    return placed


def file_size(placed: dict[str, Placed]) -> int:
    """Bytes of a file with these weights."""
    return max(-(-(p.offset + p.length) // ALIGNMENT) * ALIGNMENT for p in placed.values())


def parameter_count(g: Geometry) -> tuple[int, int]:
    """The number of values that the transformer and the autoencoder store."""
    return sum(w.count for w in transformer_weights(g)), sum(w.count for w in autoencoder_weights(g))
