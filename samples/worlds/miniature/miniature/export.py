"""Exports a trained miniature as a checkpoint in Waypoint-1.5's released layout, for `python -m cairn.build checkpoint`.

    model.safetensors       the transformer, float16
    config.yaml             shapes, rates and schedule
    taehv1_5.safetensors    the autoencoder, float16
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from cairn.build.geometry import Geometry
from cairn.build.weights import MODULATIONS
from safetensors.numpy import save_file


def write_checkpoint(directory: Path, g: Geometry, transformer: dict, autoencoder: dict) -> None:
    """Writes the directory's three files."""
    directory.mkdir(parents=True, exist_ok=True)
    _write_safetensors(directory / "model.safetensors", released_names(g, transformer))
    _write_safetensors(directory / "taehv1_5.safetensors", autoencoder)
    (directory / "config.yaml").write_text(config(g), encoding="utf-8")


def released_names(g: Geometry, p: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Parameters by the released names: matrices `[out, in]`, and the matrices that all layers share once in each layer."""
    half = len(MODULATIONS) // 2
    out: dict[str, np.ndarray] = {}
    for name, value in p.items():
        value = np.asarray(value)
        if name.startswith("cond_head."):
            continue
        turned = value.T if value.ndim == 2 else value
        if name == "unpatchify.weight":
            turned = value.reshape(g.width, g.latent_channels, *g.patch)
        elif name.endswith("v_lamb"):
            turned = value.reshape(())
        if name.startswith("blocks."):
            name = "transformer." + name.replace(".mlp.", ".dit_mlp.")
        out[name] = turned
    for i in range(g.layers):
        block = f"transformer.blocks.{i}"
        for j in range(len(MODULATIONS)):
            matrix = np.asarray(p[f"cond_head.cond_proj.{j}.weight"]).T
            out[f"{block}.{'attn' if j < half else 'mlp'}_cond_head.cond_proj.{j % half}.weight"] = matrix
        for head in ("attn", "mlp"):
            out[f"{block}.{head}_cond_head.bias_in"] = np.asarray(p["cond_head.bias_in"])[i]
    # Layer 0 mixes its values with themselves: its factor has no effect, and the released file has it all the same.
    out["transformer.blocks.0.attn.v_lamb"] = np.zeros((), np.float32)
    # Of training alone there: what stands for dropped controls. Here dropped controls are zeros.
    out["ctrl_cfg.null_emb"] = np.zeros((1, 1, g.width), np.float32)
    return out


def config(g: Geometry) -> str:
    """`config.yaml`; JSON is YAML too, and flow style keeps this free of a YAML library."""
    rows, columns = g.grid
    content = {
        "model_type": "waypoint-1.5",
        "inference_fps": 4 * g.latents_per_second,
        "base_fps": g.latents_per_second * g.time_multiplier,
        "temporal_compression": 4,
        "taehv_ae": True,
        "prompt_conditioning": None,
        "channels": g.latent_channels,
        "n_layers": g.layers,
        "n_heads": g.heads,
        "n_kv_heads": g.kv_heads,
        "d_model": g.width,
        "mlp_ratio": g.mlp_ratio,
        "causal": True,
        "moe": False,
        "n_buttons": g.buttons,
        "tokens_per_frame": g.tokens,
        "height": rows,
        "width": columns,
        "patch": list(g.patch),
        "local_window": g.local_window,
        "global_window": g.global_window,
        "global_pinned_dilation": g.global_dilation,
        "global_attn_period": g.global_period,
        "global_attn_offset": g.global_offset,
        "n_frames": 512,
        "rope_impl": "ortho",
        "rope_nyquist_frac": g.nyquist_fraction,
        "rope_theta": g.time_base,
        "value_residual": True,
        "gated_attn": False,
        "noise_conditioning": "wan",
        "ctrl_conditioning": True,
        "ctrl_conditioning_period": g.control_period,
        "scheduler_sigmas": list(g.schedule),
    }
    return json.dumps(content, indent=2) + "\n"


def _write_safetensors(path: Path, tensors: dict[str, np.ndarray]) -> None:
    """Writes tensors as float16."""
    halves = {name: np.ascontiguousarray(np.asarray(value).astype(np.float16)) for name, value in tensors.items()}
    for name, value in halves.items():
        if not np.isfinite(value).all():
            raise ValueError(f"{name} has numbers that float16 cannot hold")
    save_file(halves, path)
