"""Weights of the transformer's layers in 8 or 4 bits: `docs/bundle.md`, section 4.

A matrix [K, N] is divided into blocks of `block` rows of one column. A block stores one positive scale, and for each number an unsigned integer q
that stands for (q - 2^(bits - 1)) * scale. The rounding needs no data but the matrix.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from .errors import BuildError
from .geometry import Geometry
from .weights import Packed, Weight, stored_transformer

BITS = (8, 4)
BLOCKS = (16, 32, 64, 128, 256)
# Matrices that stay in 16 bits unless the caller chooses others. Their share of the error was measured: docs/bundle.md.
KEPT = ("blocks.0.ctrl_mlpfusion",)
# Suffixes of the two tensors that replace a matrix.
NUMBERS, SCALES = ".quantised", ".scales"
# Shares of a block's range that are tried as its range in 4 bits: clipping its few largest numbers can round all others better.
_SHARES = np.linspace(0.7, 1.0, 13)
# In the names of the matrices that embed controls, which run once in a step.
_EMBEDS_CONTROLS = ".ctrl_mlpfusion.fc1_c."
# Numbers that are rounded at a time, so that a large matrix needs little more memory than its own.
_CHUNK = 1 << 22


@dataclass(frozen=True)
class Quantisation:
    """How the matrices of the layers are stored: bits of a number, rows of a block, bits of the activations that the CPU provider
    multiplies them by (16 stands for the graph's own precision), and the layers or matrices that stay in 16 bits."""

    bits: int
    block: int = 32
    activation_bits: int = 16
    kept: tuple[str, ...] = KEPT

    def __post_init__(self):
        for field, value, allowed in (
            ("--weights", self.bits, BITS),
            ("--block", self.block, BLOCKS),
            ("--activations", self.activation_bits, (16, 8)),
        ):
            if value not in allowed:
                raise BuildError(f"{value} is none of {', '.join(map(str, allowed))}", field=field, remedy="Choose one of these.")

    def quantises(self, weight: Weight) -> bool:
        """Whether a stored tensor becomes smaller: a matrix of a layer, of whole blocks, that is not to stay in 16 bits."""
        is_matrix = weight.name.startswith("blocks.") and len(weight.shape) == 2 and weight.shape[0] % self.block == 0
        return is_matrix and not is_kept(weight.name, self.kept)

    def stored(self, tensors: list[Packed]) -> list[Packed]:
        """The tensors as they are stored, with two in place of each matrix that becomes smaller. The library requires at least one."""
        for prefix in self.kept:
            if not any(is_kept(packed.whole.name, [prefix]) for packed in tensors):
                raise BuildError(
                    "no stored tensor has this name, or starts with it",
                    field=f"--keep-16 {prefix}",
                    remedy="Name layers or matrices, such as blocks.0, blocks.3.mlp or blocks.1.attn.qkv_proj.",
                )
        if not any(self.quantises(packed.whole) for packed in tensors):
            if self.kept and any(replace(self, kept=()).quantises(packed.whole) for packed in tensors):
                cause = "with these names every matrix of the layers stays in 16 bits, so nothing is quantised"
                raise BuildError(cause, field=f"--keep-16 {','.join(self.kept)}", remedy="Name fewer layers or matrices.")
            cause = f"no matrix of the layers has a multiple of {self.block} rows, so nothing is quantised"
            raise BuildError(cause, field=f"--block {self.block}", remedy="Use smaller blocks.")
        return [part for packed in tensors for part in (self._divided(packed) if self.quantises(packed.whole) else [packed])]

    def _divided(self, packed: Packed) -> list[Packed]:
        whole = packed.whole
        rows, columns = whole.shape
        blocks = rows // self.block
        numbers = Weight(whole.name + NUMBERS, (columns, blocks, self.block * self.bits // 8), whole.fan_in, "u8")
        scales = Weight(whole.name + SCALES, (columns, blocks), whole.fan_in)

        rounding = _Rounding(packed, self.bits, self.block)

        def refuse(_):
            raise AssertionError("the 16-bit numbers of a rounded matrix are lost")

        return [Packed(numbers, packed.parts, rounding.numbers, refuse), Packed(scales, packed.parts, rounding.scales, refuse)]

    def manifest(self) -> dict:
        """The member `quantisation` of a manifest."""
        return {
            "bits": self.bits,
            "block": self.block,
            "activation_bits": self.activation_bits,
            "kept_in_16_bits": list(self.kept),
        }


class _Rounding:
    """Rounds a stored matrix. If `scales` is called after `numbers` with the same list of arrays, the matrix is rounded once."""

    def __init__(self, packed: Packed, bits: int, block: int):
        self._packed, self._bits, self._block = packed, bits, block
        # The arrays that `numbers` was called with, and their scales.
        self._last: tuple[list[np.ndarray], np.ndarray] | None = None

    def numbers(self, arrays: list[np.ndarray]) -> np.ndarray:
        """The integers, as they are stored."""
        numbers, scales = rounded(self._packed.pack(arrays), self._bits, self._block)
        self._last = arrays, scales
        return numbers

    def scales(self, arrays: list[np.ndarray]) -> np.ndarray:
        """The scales, as they are stored."""
        # The arrays are released, so that those of one matrix at a time are in memory.
        last, self._last = self._last, None
        if last is not None and last[0] is arrays:
            return last[1]
        return rounded(self._packed.pack(arrays), self._bits, self._block)[1]


def of_manifest(content: dict) -> Quantisation | None:
    """The quantisation that a manifest states; `None` where all weights have 16 bits."""
    stated = content.get("quantisation")
    if stated is None:
        return None
    try:
        kept = tuple(map(str, stated["kept_in_16_bits"]))
        return Quantisation(stated["bits"], stated["block"], stated["activation_bits"], kept)
    except (KeyError, TypeError) as error:
        cause = f"a member is missing or of another kind: {error!r}"
        raise BuildError(cause, field="quantisation", remedy="See docs/bundle.md, section 2.") from error


def counts(g: Geometry, quantisation: Quantisation) -> tuple[int, int]:
    """The transformer's numbers that become smaller, and all of its numbers."""
    weights = [packed.whole for packed in stored_transformer(g)]
    return sum(w.count for w in weights if quantisation.quantises(w)), sum(w.count for w in weights)


def unpacked_bytes(g: Geometry, quantisation: Quantisation | None, precision: str) -> int:
    """Bytes of the largest matrix in 8 or 4 bits, as a pass unpacks it, and of the largest that embeds controls: `Bundle::memory_need` counts the same
    in Rust. Providers unpack one at a time in each graph.

    DirectML, which runs the graphs in f16, unpacks each to float16. The CPU provider, which runs those in f32, unpacks one of 8 bits to float32
    unless activations have 8 bits, too, and never one of 4 bits.
    """
    if quantisation is None or (precision == "f32" and (quantisation.bits == 4 or quantisation.activation_bits == 8)):
        return 0
    sizes: tuple[list[int], list[int]] = ([], [])
    for packed in _quantised(g, quantisation):
        sizes[_EMBEDS_CONTROLS in packed.whole.name].append(packed.whole.count)
    return sum(max(of_graph, default=0) for of_graph in sizes) * (2 if precision == "f16" else 4)


def unpacked_numbers(g: Geometry, quantisation: Quantisation | None) -> int:
    """Numbers of all matrices in 8 or 4 bits that a pass unpacks one after the other."""
    if quantisation is None:
        return 0
    return sum(packed.whole.count for packed in _quantised(g, quantisation) if _EMBEDS_CONTROLS not in packed.whole.name)


def _quantised(g: Geometry, quantisation: Quantisation) -> list[Packed]:
    """The matrices that become smaller."""
    return [packed for packed in stored_transformer(g) if quantisation.quantises(packed.whole)]


def rounded(matrix: np.ndarray, bits: int, block: int) -> tuple[np.ndarray, np.ndarray]:
    """A float16 matrix [K, N] as integers uint8 [N, K / block, block * bits / 8] and scales float16 [N, K / block].

    Two numbers of 4 bits share a byte, the first one in its low half.
    """
    rows, columns = matrix.shape
    width = max(1, _CHUNK // rows)
    parts = [_rounded_columns(matrix[:, at : at + width], bits, block) for at in range(0, columns, width)]
    return np.concatenate([q for q, _ in parts]), np.concatenate([s for _, s in parts])


def restored(numbers: np.ndarray, scales: np.ndarray, bits: int) -> np.ndarray:
    """The float32 matrix [K, N] that the integers and scales stand for."""
    if bits == 4:
        numbers = np.stack([numbers & 15, numbers >> 4], axis=-1).reshape(*numbers.shape[:2], -1)
    values = (numbers.astype(np.float32) - 2 ** (bits - 1)) * scales.astype(np.float32)[:, :, None]
    return np.ascontiguousarray(values.reshape(values.shape[0], -1).T)


def _rounded_columns(matrix: np.ndarray, bits: int, block: int) -> tuple[np.ndarray, np.ndarray]:
    middle = 2 ** (bits - 1)
    blocks = matrix.T.astype(np.float32).reshape(matrix.shape[1], -1, block)
    largest = np.maximum(blocks.max(axis=2) / (middle - 1), -blocks.min(axis=2) / middle)

    def steps(scales: np.ndarray) -> np.ndarray:
        return np.clip(np.rint(blocks / scales.astype(np.float32)[:, :, None]), -middle, middle - 1)

    scales = _positive(largest)
    if bits == 4:
        least = np.full(scales.shape, np.inf, np.float32)
        for share in _SHARES:
            tried = _positive(largest * share)
            error = np.square(steps(tried) * tried.astype(np.float32)[:, :, None] - blocks).sum(axis=2)
            scales = np.where(error < least, tried, scales)
            least = np.minimum(error, least)
    numbers = (steps(scales) + middle).astype(np.uint8)
    if bits == 4:
        numbers = numbers[:, :, 0::2] | numbers[:, :, 1::2] << 4
    return numbers, scales


def _positive(scales: np.ndarray) -> np.ndarray:
    """float16 scales. A block of zeroes, or of numbers that are too small for a scale of their own, gets the smallest scale there is."""
    return np.maximum(scales.astype(np.float16), np.float16(2.0**-24))


def is_kept(name: str, kept: Iterable[str]) -> bool:
    """Whether a matrix, or a layer or module around it, is among `kept`."""
    return any(name == prefix or name.startswith(prefix + ".") for prefix in kept)
