"""Reads `config.yaml` of a checkpoint: shapes, rates, and the variants of the model that it selects."""

from __future__ import annotations

import reprlib
from pathlib import Path

import yaml

from .errors import BuildError
from .geometry import AUTOENCODER_TEMPORAL, Geometry

# Values that this builder's graph requires; a checkpoint with others is of a different model.
_FIXED = {
    "model_type": "waypoint-1.5",
    "rope_impl": "ortho",
    "noise_conditioning": "wan",
    "value_residual": True,
    "gated_attn": False,
    "moe": False,
    "prompt_conditioning": None,
    "ctrl_conditioning": True,
    "taehv_ae": True,
    "causal": True,
    "temporal_compression": AUTOENCODER_TEMPORAL,
    "n_buttons": 256,
    "auto_aspect_ratio": True,
}
_REQUIRED = (
    "model_type n_layers n_heads n_kv_heads d_model mlp_ratio channels tokens_per_frame height width patch local_window "
    "global_window global_pinned_dilation global_attn_period global_attn_offset ctrl_conditioning_period scheduler_sigmas "
    "base_fps inference_fps temporal_compression"
).split()
# Whole numbers of the geometry, and their keys.
_GEOMETRY = {
    "layers": "n_layers",
    "width": "d_model",
    "heads": "n_heads",
    "kv_heads": "n_kv_heads",
    "latent_channels": "channels",
    "mlp_ratio": "mlp_ratio",
    "local_window": "local_window",
    "global_window": "global_window",
    "global_dilation": "global_pinned_dilation",
    "global_period": "global_attn_period",
    "global_offset": "global_attn_offset",
    "control_period": "ctrl_conditioning_period",
}
# Where a user finds a value that the geometry refuses.
_FIELDS = {name: f"config.yaml: {key}" for name, key in _GEOMETRY.items()} | {
    "nyquist_fraction": "config.yaml: rope_nyquist_frac",
    "time_base": "config.yaml: rope_theta",
    "schedule": "config.yaml: scheduler_sigmas",
    "patch": "config.yaml: patch",
    "global_max_window": "--max-window",
}
# Optional keys.
_OPTIONAL = ("rope_nyquist_frac", "rope_theta", "conv_kw")
# Keys that do not affect the graphs: where the autoencoder was published, training settings, and settings of the prompt, which a model
# without `prompt_conditioning` does not have.
_WITHOUT_EFFECT = (
    "ae_uri n_frames ctrl_cond_dropout prompt_cond_dropout prompt_conditioning_period prompt_embedding_dim prompt_encoder_uri"
).split()
_KNOWN = frozenset((*_FIXED, *_REQUIRED, *_OPTIONAL, *_WITHOUT_EFFECT))
_KNOWN_OF_CONVOLUTION = frozenset(("kernel_size", "stride"))
_LIMIT = 1 << 20


def read_config(path: Path, max_window: int, **autoencoder) -> Geometry:
    """The shapes of the checkpoint. `autoencoder` has the widths of its autoencoder, which the file does not contain."""
    if not path.is_file():
        raise BuildError("it is missing", field=str(path), remedy="Fetch the checkpoint's config.yaml.")
    if path.stat().st_size > _LIMIT:
        raise BuildError("it is longer than 1 MiB", field=str(path), remedy="Fetch the checkpoint's config.yaml.")
    try:
        config = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, LookupError, AttributeError) as error:
        # PyYAML converts scalars unchecked: impossible dates and numbers, and tags that do not suit a text, raise any of these.
        raise BuildError(f"it is no YAML ({error!s:.300})", field=str(path), remedy="Fetch it again.") from error
    if not isinstance(config, dict):
        raise BuildError("it is no mapping", field=str(path), remedy="Fetch it again.")
    missing = [name for name in _REQUIRED if name not in config]
    if missing:
        raise BuildError("config.yaml does not name it", field=missing[0], remedy="Fetch it again.")
    _refuse_unknown(config, _KNOWN, "config.yaml")
    for name, wanted in _FIXED.items():
        if name in config and (config[name] != wanted or isinstance(config[name], bool) != isinstance(wanted, bool)):
            raise BuildError(
                f"{_shown(config[name])} is another model; only {wanted!r} can be read",
                field=f"config.yaml: {name}",
                remedy="Only Waypoint-1.5 checkpoints can become bundles.",
            )
    return _geometry(config, max_window, autoencoder)


def _refuse_unknown(config: dict, known: frozenset[str], place: str) -> None:
    """Refuses unknown keys: a later model may keep every name and add one. A bundle built without it would run, but show something else."""
    for name in config:
        if name not in known:
            raise BuildError(
                "this builder does not know it, so the checkpoint may be of another model",
                field=f"{place}: {name if isinstance(name, str) and len(name) <= 100 else _shown(name)}",
                remedy="Use a newer builder, or remove the key if the model does not depend on it.",
            )


def _geometry(config: dict, max_window: int, autoencoder: dict) -> Geometry:
    patch = _numbers(config, "patch", 2, int)
    rows, columns = _number(config, "height"), _number(config, "width")
    if _number(config, "tokens_per_frame") != rows * columns:
        raise BuildError(
            f"{config['tokens_per_frame']} is not height * width, {rows} * {columns}",
            field="config.yaml: tokens_per_frame",
            remedy="Fetch config.yaml again.",
        )
    latents, rest = divmod(_number(config, "inference_fps"), AUTOENCODER_TEMPORAL)
    if rest or latents == 0 or _number(config, "base_fps") % latents:
        raise BuildError(
            f"{config['inference_fps']} pictures per second do not make latents of {AUTOENCODER_TEMPORAL} that divide base_fps",
            field="config.yaml: inference_fps",
            remedy="Fetch config.yaml again.",
        )
    values = {name: _number(config, key) for name, key in _GEOMETRY.items()}
    try:
        geometry = Geometry(
            **values,
            latent_height=rows * patch[0],
            latent_width=columns * patch[1],
            patch=patch,
            global_max_window=max_window,
            nyquist_fraction=_number(config, "rope_nyquist_frac", float, 0.8),
            time_base=_number(config, "rope_theta", float, 10000.0),
            latents_per_second=latents,
            time_multiplier=config["base_fps"] // latents,
            schedule=_numbers(config, "scheduler_sigmas", None, float),
            **autoencoder,
        )
    except BuildError as error:
        if error.field not in _FIELDS:
            raise
        raise BuildError(error.cause, field=_FIELDS[error.field], remedy=error.remedy) from error
    conv = config.get("conv_kw", {})
    if isinstance(conv, dict):
        _refuse_unknown(conv, _KNOWN_OF_CONVOLUTION, "config.yaml: conv_kw")
    if not isinstance(conv, dict) or any(conv.get(k, list(patch)) != list(patch) for k in _KNOWN_OF_CONVOLUTION):
        raise BuildError(f"{_shown(conv)} is not the patch {list(patch)}", field="config.yaml: conv_kw", remedy="Fetch it again.")
    return geometry


def _number(config: dict, name: str, kind: type = int, default=None):
    value = config.get(name, default)
    if not _is_number(value, kind):
        raise BuildError(f"{_shown(value)} is no number of the right kind", field=f"config.yaml: {name}", remedy="Fetch it again.")
    return kind(value)


def _numbers(config: dict, name: str, count: int | None, kind: type) -> tuple:
    value = config[name]
    good = isinstance(value, list) and all(_is_number(v, kind) for v in value)
    if not good or (count is not None and len(value) != count):
        raise BuildError(f"{_shown(value)} is no list of numbers", field=f"config.yaml: {name}", remedy="Fetch it again.")
    return tuple(kind(v) for v in value)


def _is_number(value: object, kind: type) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, kind)):
        return False
    # A longer int may have no text and no float.
    return not isinstance(value, int) or abs(value) < 1 << 63


def _shown(value: object) -> str:
    """A value of the file for a message, shortened."""
    try:
        return reprlib.repr(value)
    except ValueError:
        return "an int of more digits than Python writes"
