"""The names of a checkpoint's tensors in all accepted spellings, and the bundle's tensors that they fill.

The released file spells blocks `transformer.blocks.{i}.`, the MLP `dit_mlp`, and the conditioning head as two halves `attn_cond_head` (slots 0
to 2) and `mlp_cond_head` (slots 3 to 5), each with a copy of the matrices that all layers share. The names into which the engine converts them
at loading are accepted, too (`blocks.{i}.`, `mlp`, `cond_head`, `ctrl_mlpfusion.mlp`, `attn.qkv_proj`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_BLOCK = re.compile(r"(?:transformer\.)?blocks\.(0|[1-9]\d*)\.(.+)")
_TOP = {
    "patchify.weight",
    "unpatchify.weight",
    "unpatchify.bias",
    "out_norm.fc.weight",
    *(f"{n}.mlp.fc{j}.weight" for n in ("denoise_step_emb", "ctrl_emb") for j in (1, 2)),
}
_COND = re.compile(r"(attn_|mlp_|)cond_head\.cond_proj\.([0-5])\.weight")
_FIRST_SLOT = {"attn_": 0, "mlp_": 3, "": 0}
# Later ones take precedence, as in the released engine.
_BIAS = ("attn_cond_head.bias_in", "mlp_cond_head.bias_in", "cond_head.bias_in")
_BLOCK_SLOTS = {
    **{f"attn.{p}_proj.weight": f"attn.{p}_proj.weight" for p in ("q", "k", "v", "out")},
    "attn.v_lamb": "attn.v_lamb",
    **{f"{m}.fc{j}.weight": f"mlp.fc{j}.weight" for m in ("dit_mlp", "mlp") for j in (1, 2)},
    **{f"ctrl_mlpfusion.{p}.weight": f"ctrl_mlpfusion.{p}.weight" for p in ("fc1_x", "fc1_c", "fc2")},
    "ctrl_mlpfusion.mlp.fc2.weight": "ctrl_mlpfusion.fc2.weight",
}
# Tensors that combine several slots: axis and order.
_BLOCK_FUSED = {
    "attn.qkv_proj.weight": (0, ("attn.q_proj.weight", "attn.k_proj.weight", "attn.v_proj.weight")),
    "ctrl_mlpfusion.mlp.fc1.weight": (1, ("ctrl_mlpfusion.fc1_x.weight", "ctrl_mlpfusion.fc1_c.weight")),
}


@dataclass(frozen=True)
class Meaning:
    """The bundle's tensors that a tensor of the file fills.

    `slots` are these tensors; if there are several, the file's tensor is split along `axis`; if there are none, it has no effect. If several
    tensors fill a slot, that of the highest `rank` is used; `copy` marks one of several equal copies. `layer` is set for the rows of the
    stacked biases.
    """

    slots: tuple[str, ...]
    axis: int = 0
    rank: int = 0
    copy: bool = False
    layer: int | None = None


def meaning(name: str) -> Meaning | None:
    """The meaning of a transformer's tensor; `None` for an unknown name."""
    if ".cond_heads." in name or name == "ctrl_cfg.null_emb":
        # Used in training only; the engine drops them too.
        return Meaning(())
    if name in _TOP:
        return Meaning((name,))
    found = _BLOCK.fullmatch(name)
    if found is None:
        return None
    layer, part = int(found[1]), found[2]
    if part in _BLOCK_SLOTS:
        return Meaning((f"blocks.{layer}.{_BLOCK_SLOTS[part]}",))
    if part in _BLOCK_FUSED:
        axis, slots = _BLOCK_FUSED[part]
        return Meaning(tuple(f"blocks.{layer}.{s}" for s in slots), axis)
    if part in _BIAS:
        return Meaning((f"cond_head.bias_in.{layer}",), rank=_BIAS.index(part), layer=layer)
    found = _COND.fullmatch(part)
    if found is not None and (found[1] == "" or int(found[2]) < 3):
        return Meaning((f"cond_head.cond_proj.{_FIRST_SLOT[found[1]] + int(found[2])}.weight",), copy=True)
    return None
