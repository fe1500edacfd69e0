"""The weights of a bundle's f32 models, by name, in float64.

A bundle stores matrices as `[in, out]`. Here they are transposed to `[out, in]`, as papers write them, and are used as `x @ W.T`. It stores
queries, keys and values as one matrix, with the first elements of all rotation pairs of a head before the second ones; here they are three,
with the elements of a pair side by side, as in a checkpoint.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper


@dataclass(frozen=True)
class BlockWeights:
    """One transformer layer."""

    q: np.ndarray  # [D, D]
    k: np.ndarray  # [kv_heads * head_width, D]
    v: np.ndarray  # [kv_heads * head_width, D]
    out: np.ndarray  # [D, D]
    value_mix: float  # how much of layer 0's values goes into this layer's
    bias_in: np.ndarray  # [D]
    fc1: np.ndarray  # [mlp_ratio * D, D]
    fc2: np.ndarray  # [D, mlp_ratio * D]
    control_x: np.ndarray | None  # [D, D], in layers that see the controls
    control_c: np.ndarray | None
    control_fc2: np.ndarray | None


@dataclass(frozen=True)
class TransformerWeights:
    patchify: np.ndarray  # [D, C, ph, pw]
    noise_fc1: np.ndarray  # [4 * D, features]
    noise_fc2: np.ndarray  # [D, 4 * D]
    control_fc1: np.ndarray  # [mlp_ratio * D, controls]
    control_fc2: np.ndarray  # [D, mlp_ratio * D]
    condition: list[np.ndarray]  # six [D, D]: scale, shift, gate of attention, then of the MLP; shared by all layers
    blocks: list[BlockWeights]
    out_norm: np.ndarray  # [2 * D, D]
    unpatchify: np.ndarray  # [C * ph * pw, D]
    unpatchify_bias: np.ndarray  # [C * ph * pw]


@dataclass(frozen=True)
class Convolution:
    weight: np.ndarray  # [out, in, side, side]
    bias: np.ndarray | None  # [out]


@dataclass(frozen=True)
class MemoryBlock:
    conv0: Convolution  # inputs: channels of this time step, then those of the step before
    conv2: Convolution
    conv4: Convolution


@dataclass(frozen=True)
class EncoderStage:
    pool: Convolution  # combines neighbouring time steps
    down: Convolution  # halves both sides
    memory: list[MemoryBlock]


@dataclass(frozen=True)
class DecoderStage:
    memory: list[MemoryBlock]
    grow: Convolution  # makes one or two time steps from one
    project: Convolution


@dataclass(frozen=True)
class EncoderWeights:
    first: Convolution
    stages: list[EncoderStage]
    last: Convolution


@dataclass(frozen=True)
class DecoderWeights:
    first: Convolution
    stages: list[DecoderStage]
    last: Convolution


@dataclass(frozen=True)
class Weights:
    transformer: TransformerWeights
    encoder: EncoderWeights
    decoder: DecoderWeights

    @classmethod
    def read(cls, bundle: Path) -> "Weights":
        manifest = json.loads((bundle / "cairn-world.json").read_text(encoding="utf-8"))
        graphs, geometry = manifest["graphs"]["f32"], manifest["geometry"]
        return cls(
            transformer=_transformer(_tensors(bundle, graphs["transformer"]), geometry),
            encoder=_encoder(_tensors(bundle, graphs["encoder"])),
            decoder=_decoder(_tensors(bundle, graphs["decoder"])),
        )


def _tensors(bundle: Path, model: str) -> dict[str, np.ndarray]:
    """All stored numbers of one model, by name."""
    graph = onnx.load(bundle / model).graph
    return {t.name: numpy_helper.to_array(t).astype(np.float64) for t in graph.initializer}


def _side_by_side(rows: np.ndarray, head_width: int) -> np.ndarray:
    """Rows of heads whose pairs are elements j and P + j, with pairs at 2j and 2j + 1 instead."""
    halves = rows.reshape(-1, 2, head_width // 2, rows.shape[1])
    return halves.swapaxes(1, 2).reshape(rows.shape)


def _transformer(t: dict[str, np.ndarray], geometry: dict) -> TransformerWeights:
    width = geometry["head_width"]
    queries, keys = geometry["heads"] * width, geometry["kv_heads"] * width

    def block(i: int) -> BlockWeights:
        joined = t[f"blocks.{i}.attn.qkv_proj.weight"].T

        def matrix(name: str) -> np.ndarray | None:
            stored = t.get(f"blocks.{i}.{name}.weight")
            return None if stored is None else stored.T

        return BlockWeights(
            q=_side_by_side(joined[:queries], width),
            k=_side_by_side(joined[queries : queries + keys], width),
            v=joined[queries + keys :],
            out=matrix("attn.out_proj"),
            # Layer 0 mixes its values with themselves, whatever the factor.
            value_mix=t[f"blocks.{i}.attn.v_lamb"].item() if i > 0 else 0.0,
            bias_in=t["cond_head.bias_in"][i],
            fc1=matrix("mlp.fc1"),
            fc2=matrix("mlp.fc2"),
            control_x=matrix("ctrl_mlpfusion.fc1_x"),
            control_c=matrix("ctrl_mlpfusion.fc1_c"),
            control_fc2=matrix("ctrl_mlpfusion.fc2"),
        )

    return TransformerWeights(
        patchify=t["patchify.weight"],
        noise_fc1=t["denoise_step_emb.mlp.fc1.weight"].T,
        noise_fc2=t["denoise_step_emb.mlp.fc2.weight"].T,
        control_fc1=t["ctrl_emb.mlp.fc1.weight"].T,
        control_fc2=t["ctrl_emb.mlp.fc2.weight"].T,
        condition=[matrix.T for matrix in t["cond_head.cond_proj.weight"]],
        blocks=[block(i) for i in range(geometry["layers"])],
        out_norm=t["out_norm.fc.weight"].T,
        unpatchify=t["unpatchify.weight"].T,
        unpatchify_bias=t["unpatchify.bias"],
    )


def _convolution(t: dict[str, np.ndarray], name: str) -> Convolution:
    return Convolution(t[f"{name}.weight"], t.get(f"{name}.bias"))


def _memory(t: dict[str, np.ndarray], name: str) -> MemoryBlock:
    return MemoryBlock(*(_convolution(t, f"{name}.conv.{j}") for j in (0, 2, 4)))


def _encoder(t: dict[str, np.ndarray]) -> EncoderWeights:
    """Numbers are positions in the released order: convolution, ReLU, then three times (pool, halve, three memories)."""
    stages = [
        EncoderStage(
            pool=_convolution(t, f"encoder.{at}.conv"),
            down=_convolution(t, f"encoder.{at + 1}"),
            memory=[_memory(t, f"encoder.{at + j}") for j in (2, 3, 4)],
        )
        for at in (2, 7, 12)
    ]
    return EncoderWeights(_convolution(t, "encoder.0"), stages, _convolution(t, "encoder.17"))


def _decoder(t: dict[str, np.ndarray]) -> DecoderWeights:
    """Clamp, convolution, ReLU, then three times (three memories, upsample, grow, project), ReLU, convolution."""
    stages = [
        DecoderStage(
            memory=[_memory(t, f"decoder.{at + j}") for j in (0, 1, 2)],
            grow=_convolution(t, f"decoder.{at + 4}.conv"),
            project=_convolution(t, f"decoder.{at + 5}"),
        )
        for at in (3, 9, 15)
    ]
    return DecoderWeights(_convolution(t, "decoder.1"), stages, _convolution(t, "decoder.22"))
