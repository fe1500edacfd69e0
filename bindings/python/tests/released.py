"""Makes checkpoints in the released layout, at any shapes, from the lists of names in `data/`."""

import io
import json
import pickle
import sys
import types
import zipfile
from pathlib import Path

import numpy as np
import yaml
from safetensors.numpy import save_file

DATA = Path(__file__).parent / "data"


def names(file: str) -> dict[str, tuple[int, ...]]:
    """Names and shapes of a released file."""
    return {n: tuple(s) for n, s in json.loads((DATA / file).read_text(encoding="utf-8"))["tensors"].items()}


def transformer_names(g) -> dict[str, tuple[int, ...]]:
    """The released transformer's list, shrunk to the shapes of `g`: each layer gets the names of a released one."""
    sizes = {2048: g.width, 1024: g.kv_width, 8192: g.width * g.mlp_ratio, 4096: 2 * g.width, 32: g.latent_channels}
    out = {}
    for name, shape in names("waypoint-1.5-1b.json").items():
        layer = name.split(".")[2] if name.startswith("transformer.blocks.") else "0"
        if int(layer) < g.layers:
            out[name] = tuple(sizes.get(s, s) for s in shape)
    return out


def autoencoder_names(g) -> dict[str, tuple[int, ...]]:
    """The released autoencoder's list, shrunk likewise."""
    theirs, ours = (64, 256, 128, 64, 64), (g.encoder_width, *g.decoder_widths)

    def width(room: str, layer: int) -> int:
        """Which of the five widths a layer works at."""
        return 0 if room == "encoder" else 1 + min((layer - 3) // 6, 3) if layer >= 3 else 1

    out = {}
    for name, shape in names("taehv1_5.json").items():
        room, layer = name.split(".")[0], int(name.split(".")[1])
        inside = width(room, layer)
        outside = inside + 1 if room == "decoder" and layer in (8, 14, 20) else inside
        new = list(shape)
        for axis, at in ((0, outside), (1, inside))[: len(shape)]:
            edge = (room, layer, axis) in {("encoder", 0, 1), ("decoder", 22, 0)}
            latent = (room, layer, axis) in {("encoder", 17, 0), ("decoder", 1, 1)}
            new[axis] = shape[axis] if edge else g.latent_channels if latent else shape[axis] * ours[at] // theirs[at]
        out[name] = tuple(new)
    return out


def numbers(shapes: dict[str, tuple[int, ...]], seed: int = 0) -> dict[str, np.ndarray]:
    """Small float32 numbers that bfloat16 represents exactly; the matrices that all layers share are equal in all layers."""
    rng = np.random.default_rng(seed)
    shared, out = {}, {}
    for name, shape in sorted(shapes.items()):
        value = np.asarray(rng.integers(-64, 64, shape) / 256, np.float32)
        if ".cond_proj." in name:
            value = shared.setdefault(name.split(".", 3)[3], value)
        out[name] = value
    return out


def stored(values: np.ndarray, kind: str) -> bytes:
    """Little-endian bytes as F32, F16 or BF16."""
    if kind == "F32":
        return values.astype("<f4").tobytes()
    if kind == "F16":
        return values.astype("<f2").tobytes()
    return (np.ascontiguousarray(values).view(np.uint32) >> 16).astype("<u2").tobytes()


def write_safetensors(path: Path, tensors: dict[str, np.ndarray], kind: str) -> None:
    """Writes a file with the safetensors library as an independent implementation of the format. Its numpy part cannot write BF16."""
    if kind != "BF16":
        save_file({n: np.array(v, np.float32 if kind == "F32" else np.float16) for n, v in tensors.items()}, str(path))
        return
    header, data = {"__metadata__": {"format": "pt"}}, b""
    for name, value in tensors.items():
        numbers = stored(value, kind)
        header[name] = {"dtype": kind, "shape": list(value.shape), "data_offsets": [len(data), len(data) + len(numbers)]}
        data += numbers
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(len(text).to_bytes(8, "little") + text + data)


def _fake_torch() -> dict[str, types.ModuleType]:
    torch, utils = types.ModuleType("torch"), types.ModuleType("torch._utils")
    for name in ("FloatStorage", "HalfStorage", "BFloat16Storage", "LongStorage"):
        setattr(torch, name, type(name, (), {"__module__": "torch"}))

    def _rebuild_tensor_v2():
        """Stands for torch's; only its name is pickled."""

    _rebuild_tensor_v2.__module__, _rebuild_tensor_v2.__qualname__ = "torch._utils", "_rebuild_tensor_v2"
    utils._rebuild_tensor_v2 = _rebuild_tensor_v2
    return {"torch": torch, "torch._utils": utils}


class _Tensor:
    def __init__(self, value, key, kind, modules):
        self.value, self.key, self.kind, self.modules = value, key, kind, modules

    def __reduce__(self):
        from collections import OrderedDict

        strides = tuple(s // self.value.itemsize for s in self.value.strides)
        storage = _Storage(self.value.size, self.key, self.kind, self.modules)
        return self.modules["torch._utils"]._rebuild_tensor_v2, (storage, 0, self.value.shape, strides, False, OrderedDict())


class _Storage:
    def __init__(self, count, key, kind, modules):
        self.count, self.key, self.kind, self.modules = count, key, kind, modules


class _Pickler(pickle.Pickler):
    def persistent_id(self, value):
        if isinstance(value, _Storage):
            names = {"F32": "FloatStorage", "F16": "HalfStorage", "BF16": "BFloat16Storage"}
            return ("storage", getattr(value.modules["torch"], names[value.kind]), value.key, "cpu", value.count)
        return None


def torch_entries(tensors: dict[str, np.ndarray], kind: str = "F16") -> dict[str, bytes]:
    """What `torch.save` of a state dictionary puts into its zip: pickled by Python's own pickler, `_metadata` included."""
    from collections import OrderedDict

    modules = _fake_torch()
    before = {n: sys.modules.get(n) for n in modules}
    sys.modules.update(modules)
    try:
        state = OrderedDict((n, _Tensor(v, str(i), kind, modules)) for i, (n, v) in enumerate(tensors.items()))
        state._metadata = OrderedDict({"": {"version": 1}})
        sink = io.BytesIO()
        _Pickler(sink, protocol=2).dump(state)
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module
    entries = {"archive/data.pkl": sink.getvalue(), "archive/byteorder": b"little", "archive/version": b"3\n"}
    return entries | {f"archive/data/{i}": stored(v, kind) for i, v in enumerate(tensors.values())}


def write_zip(path: Path, entries: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    """A zip of these entries."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


def config(g) -> dict:
    """The released config.yaml's members for the shapes of `g`."""
    rows, columns = g.grid
    return {
        "model_type": "waypoint-1.5",
        "inference_fps": 60,
        "temporal_compression": 4,
        "taehv_ae": True,
        "ae_uri": "Overworld-Models/taehv1_5",
        "prompt_conditioning": None,
        "channels": g.latent_channels,
        "n_layers": g.layers,
        "n_heads": g.heads,
        "n_kv_heads": g.kv_heads,
        "d_model": g.width,
        "mlp_ratio": g.mlp_ratio,
        "causal": True,
        "moe": False,
        "n_buttons": 256,
        "tokens_per_frame": g.tokens,
        "height": rows,
        "width": columns,
        "conv_kw": {"kernel_size": list(g.patch), "stride": list(g.patch)},
        "patch": list(g.patch),
        "base_fps": 15,
        "local_window": g.local_window,
        "global_window": g.global_window,
        "global_pinned_dilation": g.global_dilation,
        "global_attn_period": 4,
        "global_attn_offset": -1,
        "n_frames": 512,
        "rope_impl": "ortho",
        "value_residual": True,
        "gated_attn": False,
        "noise_conditioning": "wan",
        "ctrl_conditioning": True,
        "ctrl_cond_dropout": 0.0,
        "ctrl_conditioning_period": 3,
        "scheduler_sigmas": [1.0, 0.9, 0.75, 0.3, 0.0],
    }


def write_checkpoint(directory: Path, g, kind: str = "BF16", shards: int = 1, change=None) -> dict[str, np.ndarray]:
    """A whole directory; `change` may edit the transformer's tensors first. Gives all tensors."""
    directory.mkdir(parents=True)
    tensors = numbers(transformer_names(g))
    pictures = numbers(autoencoder_names(g), 1)
    if change is not None:
        change(tensors)
    if shards == 1:
        write_safetensors(directory / "model.safetensors", tensors, kind)
    else:
        where = {n: f"model-{i % shards + 1:05}-of-{shards:05}.safetensors" for i, n in enumerate(sorted(tensors))}
        for file in set(where.values()):
            write_safetensors(directory / file, {n: v for n, v in tensors.items() if where[n] == file}, kind)
        (directory / "model.safetensors.index.json").write_text(json.dumps({"metadata": {}, "weight_map": where}))
    (directory / "config.yaml").write_text(yaml.safe_dump(config(g)))
    write_zip(directory / "taehv1_5.pth", torch_entries(pictures))
    return tensors | pictures
