"""Checkpoints in the released layout: they are read completely, and faults are refused with the tensor's name."""

import json
import math

import numpy as np
import pytest
import yaml
from conftest import TINY, relative, session
from released import (
    DATA,
    autoencoder_names,
    config,
    names,
    numbers,
    torch_entries,
    write_checkpoint,
    write_safetensors,
    write_zip,
)
from rollout import Rollout

from cairn.build import PRESETS, BuildError
from cairn.build.checkpoint import Checkpoint, open_checkpoint
from cairn.build.cli import main
from cairn.build.config import read_config
from cairn.build.names import meaning
from cairn.build.tensor_files import TensorFiles, to_half
from cairn.build.weights import autoencoder_weights, transformer_weights


class Headers(TensorFiles):
    """Names and shapes without numbers."""

    def __init__(self, shapes):
        super().__init__()
        self.shapes = dict(shapes)


def test_the_lists_are_the_released_files():
    tensors = names("waypoint-1.5-1b.json")
    assert len(tensors) == 393 and sum(math.prod(s) for s in tensors.values()) == 1_860_823_096
    pictures = names("taehv1_5.json")
    assert len(pictures) == 128 and sum(math.prod(s) for s in pictures.values()) == 11_372_012
    assert set(json.loads((DATA / "taehv1_5.json").read_text())) == {"about", "tensors"}


def test_every_released_name_is_read_at_full_size():
    g = PRESETS["720p"][1]
    found = Checkpoint(g, Headers(names("waypoint-1.5-1b.json")), Headers(names("taehv1_5.json")))
    read = {name for entries in found._sources.values() for name, _ in entries}
    without_effect = {"ctrl_cfg.null_emb", *(f"transformer.blocks.{i}.attn_cond_head.bias_in" for i in range(24))}
    assert names("waypoint-1.5-1b.json").keys() - read == without_effect
    assert {w.name for w in autoencoder_weights(g)} == names("taehv1_5.json").keys()
    copies = [entries for slot, entries in found._sources.items() if slot.startswith("cond_head.cond_proj.")]
    assert [len(c) for c in copies] == [24] * 6


@pytest.mark.parametrize("kind, shards", [("BF16", 1), ("F16", 1), ("F32", 3)])
def test_a_checkpoint_is_read_number_by_number(tmp_path, kind, shards):
    tensors = write_checkpoint(tmp_path / "c", TINY, kind, shards)
    found = open_checkpoint(tmp_path / "c", max_window=64)
    assert found.geometry == TINY.with_(render=(160, 90))
    made = {w.name: found.get(w) for w in [*transformer_weights(TINY), *autoencoder_weights(TINY)]}
    assert all(a.dtype == np.float16 for a in made.values())

    def theirs(name):
        return tensors[name].astype(np.float16)

    block = "transformer.blocks.3."
    assert np.array_equal(made["blocks.3.attn.q_proj.weight"], theirs(block + "attn.q_proj.weight").T)
    assert np.array_equal(made["blocks.3.attn.v_lamb"], theirs(block + "attn.v_lamb")[None])
    assert np.array_equal(made["blocks.3.ctrl_mlpfusion.fc1_c.weight"], theirs(block + "ctrl_mlpfusion.fc1_c.weight").T)
    assert np.array_equal(made["blocks.3.mlp.fc1.weight"], theirs(block + "dit_mlp.fc1.weight").T)
    assert np.array_equal(made["cond_head.cond_proj.4.weight"], theirs(block + "mlp_cond_head.cond_proj.1.weight").T)
    assert np.array_equal(made["cond_head.bias_in"][3], theirs(block + "mlp_cond_head.bias_in"))
    C, (a, b) = TINY.latent_channels, TINY.patch
    matrix = theirs("unpatchify.weight").transpose(1, 2, 3, 0).reshape(C * a * b, TINY.width)
    assert np.array_equal(made["unpatchify.weight"], matrix.T)
    assert np.array_equal(made["unpatchify.bias"], np.repeat(theirs("unpatchify.bias"), a * b))
    assert np.array_equal(made["patchify.weight"], theirs("patchify.weight"))
    for name in autoencoder_names(TINY):
        assert np.array_equal(made[name], theirs(name)), name


def renamed(tensors):
    """The engine's own spelling after loading: no prefix, fused matrices, one conditioning head, no copies."""
    for name in list(tensors):
        if not name.startswith("transformer."):
            continue
        value = tensors.pop(name)
        head, layer, part = name.removeprefix("transformer.").split(".", 2)
        part = part.replace("dit_mlp.", "mlp.").replace("mlp_cond_head.bias_in", "cond_head.bias_in")
        part = part.replace("attn_cond_head.cond_proj", "cond_head.cond_proj")
        part = part.replace("ctrl_mlpfusion.fc2", "ctrl_mlpfusion.mlp.fc2")
        for j in range(3):
            part = part.replace(f"mlp_cond_head.cond_proj.{j}", f"cond_head.cond_proj.{j + 3}")
        if "cond_proj" in part and layer != "0" or part == "attn_cond_head.bias_in":
            continue
        tensors[f"{head}.{layer}.{part}"] = value
    for i in range(TINY.layers):
        q, k, v = (tensors.pop(f"blocks.{i}.attn.{n}_proj.weight") for n in "qkv")
        tensors[f"blocks.{i}.attn.qkv_proj.weight"] = np.concatenate([q, k, v])
        if i % 3 == 0:
            x, c = (tensors.pop(f"blocks.{i}.ctrl_mlpfusion.fc1_{n}.weight") for n in "xc")
            tensors[f"blocks.{i}.ctrl_mlpfusion.mlp.fc1.weight"] = np.concatenate([x, c], axis=1)
    C, (a, b) = TINY.latent_channels, TINY.patch
    tensors["unpatchify.weight"] = tensors["unpatchify.weight"].transpose(1, 2, 3, 0).reshape(C * a * b, TINY.width)
    tensors["unpatchify.bias"] = np.repeat(tensors["unpatchify.bias"], a * b)


def test_other_spellings_make_the_same_weights(tmp_path):
    write_checkpoint(tmp_path / "a", TINY)
    write_checkpoint(tmp_path / "b", TINY, change=renamed)
    a, b = (open_checkpoint(tmp_path / d, max_window=64) for d in "ab")
    assert not set(a.transformer.shapes) & {n for n in b.transformer.shapes if n.startswith("blocks")}
    for weight in transformer_weights(TINY):
        assert np.array_equal(a.get(weight), b.get(weight)), weight.name


def drop(name):
    return lambda tensors: tensors.pop(name)


def put(name, value):
    return lambda tensors: tensors.update({name: np.asarray(value, np.float32)})


BLOCK = "transformer.blocks."
UNKNOWN = "no tensor of this name"
SHARED = "transformer.blocks.5.attn_cond_head.cond_proj.2.weight"
BROKEN = [
    (drop("transformer.blocks.7.attn.k_proj.weight"), "blocks.7.attn.k_proj.weight", "lacks"),
    (drop("transformer.blocks.6.ctrl_mlpfusion.fc2.weight"), "blocks.6.ctrl_mlpfusion.fc2.weight", "lacks"),
    (drop("transformer.blocks.2.mlp_cond_head.bias_in"), None, None),  # the other half's copy stands in
    (put(BLOCK + "8.attn.q_proj.weight", np.zeros((64, 64))), BLOCK + "8.attn.q_proj.weight", UNKNOWN),
    (put(BLOCK + "1.ctrl_mlpfusion.fc2.weight", np.zeros((64, 64))), "blocks.1.ctrl_mlpfusion", UNKNOWN),
    (put(BLOCK + "1.gate.weight", [1.0]), BLOCK + "1.gate.weight", UNKNOWN),
    (put("blocks.1.attn.v_lamb", 0.5), "transformer.blocks.1.attn.v_lamb", "means the same tensor"),
    (put(BLOCK + "1.attn.v_proj.weight", np.zeros((64, 64))), BLOCK + "1.attn.v_proj.weight", "expected [32, 64]"),
    (put("patchify.weight", np.zeros((64, 4, 2, 1))), "patchify.weight", "expected [64, 4, 2, 2]"),
    (put(SHARED, np.zeros((64, 64))), SHARED, "differs"),
    (put("out_norm.fc.weight", np.full((128, 64), 1e6)), "out_norm.fc.weight", "beyond float16"),
    (put("out_norm.fc.weight", np.full((128, 64), np.inf)), "out_norm.fc.weight", "infinity"),
]


@pytest.mark.parametrize("change, field, cause", BROKEN, ids=[str(i) for i in range(len(BROKEN))])
def test_a_wrong_checkpoint_is_refused_by_name(tmp_path, capsys, change, field, cause):
    write_checkpoint(tmp_path / "c", TINY, "F32", change=change)
    result = main(["checkpoint", str(tmp_path / "c"), "--out", str(tmp_path / "out"), "--max-window", "64", "--quiet"])
    message = capsys.readouterr().err
    if field is None:
        assert result == 0 and (tmp_path / "out" / "cairn-world.json").is_file()
        return
    assert result == 2 and field in message and cause in message
    assert [p.name for p in tmp_path.iterdir()] == ["c"]  # nothing half done stays


@pytest.mark.parametrize(
    "name, value",
    [
        ("model_type", "waypoint-1"),
        ("moe", True),
        ("prompt_conditioning", "umt5"),
        ("gated_attn", 1),
        ("tokens_per_frame", 9),
        ("n_heads", 5),
        ("n_layers", "8"),
        ("n_layers", 10**9),
        ("scheduler_sigmas", [1.0, 1.0, 0.0]),
        ("inference_fps", 59),
        ("patch", [2]),
        ("conv_kw", {"kernel_size": [1, 1], "stride": [1, 1]}),
        ("global_window", 130),
        ("global_window", 65544),
        ("rope_nyquist_frac", 1.5),
        ("rope_theta", 1.0),
        ("d_model", None),
    ],
)
def test_a_wrong_config_is_refused_by_name(tmp_path, capsys, name, value):
    write_checkpoint(tmp_path / "c", TINY)
    (tmp_path / "c" / "config.yaml").write_text(yaml.safe_dump(config(TINY) | {name: value}))
    assert main(["checkpoint", str(tmp_path / "c"), "--out", str(tmp_path / "out"), "--max-window", "256", "--quiet"]) == 2
    message = capsys.readouterr().err
    # Heads that do not divide the width are a fault of the width.
    assert message.startswith("error: config.yaml: ") and ("d_model" if name == "n_heads" else name) in message
    assert not (tmp_path / "out").exists()


def test_a_window_beyond_the_limit_is_refused(tmp_path, capsys):
    write_checkpoint(tmp_path / "c", TINY)
    assert main(["checkpoint", str(tmp_path / "c"), "--out", str(tmp_path / "out"), "--max-window", "80000", "--quiet"]) == 2
    assert capsys.readouterr().err == "error: --max-window: 80000 is not a whole number from 1 to 65536. Give one in that range.\n"


@pytest.mark.parametrize(
    "change, name",
    [
        ({"quilt_factor": 2}, "config.yaml: quilt_factor"),
        ({"n_experts": None}, "config.yaml: n_experts"),
        ({"N_layers": 8}, "config.yaml: N_layers"),
        ({7: 8}, "config.yaml: 7"),
        ({"conv_kw": {"kernel_size": [2, 2], "stride": [2, 2], "dilation": [2, 2]}}, "config.yaml: conv_kw: dilation"),
    ],
)
def test_a_key_that_the_builder_does_not_know_is_refused_by_name(tmp_path, capsys, change, name):
    write_checkpoint(tmp_path / "c", TINY)
    (tmp_path / "c" / "config.yaml").write_text(yaml.safe_dump(config(TINY) | change))
    assert main(["checkpoint", str(tmp_path / "c"), "--out", str(tmp_path / "out"), "--max-window", "64", "--quiet"]) == 2
    message = capsys.readouterr().err
    assert name in message and "does not know" in message
    assert not (tmp_path / "out").exists()


# Defaults of the released engine for missing keys.
DEFAULTS = {
    "auto_aspect_ratio": True,
    "prompt_encoder_uri": "google/umt5-xl",
    "rope_nyquist_frac": 0.8,
    "rope_theta": 10000.0,
}


@pytest.mark.parametrize("grid", [(16, 32), (8, 16)])
@pytest.mark.parametrize("further", [{}, DEFAULTS])
def test_the_released_configurations_are_read(tmp_path, grid, further):
    path = tmp_path / "config.yaml"
    path.write_text(yaml.safe_dump(config(PRESETS["720p"][1]) | {
        "height": grid[0], "width": grid[1], "tokens_per_frame": grid[0] * grid[1]
    } | further))
    geometry = read_config(path, 512)
    assert geometry.tokens == grid[0] * grid[1]
    assert geometry == PRESETS["720p" if grid == (16, 32) else "360p"][1]


def test_missing_files_are_named(tmp_path, capsys):
    for missing in ("model.safetensors", "config.yaml", "taehv1_5.pth"):
        directory = tmp_path / missing.split(".")[0]
        write_checkpoint(directory, TINY)
        (directory / missing).unlink()
        assert main(["checkpoint", str(directory), "--out", str(tmp_path / "out"), "--max-window", "64"]) == 2
        assert missing in capsys.readouterr().err
    write_checkpoint(tmp_path / "sharded", TINY, shards=2)
    (tmp_path / "sharded" / "model-00002-of-00002.safetensors").unlink()
    with pytest.raises(BuildError, match="shard is missing"):
        open_checkpoint(tmp_path / "sharded", max_window=64)


@pytest.mark.parametrize("cut", [0, 4, 9, 200, -1])
def test_a_truncated_safetensors_file_is_refused(tmp_path, cut):
    write_checkpoint(tmp_path / "c", TINY)
    file = tmp_path / "c" / "model.safetensors"
    file.write_bytes(file.read_bytes()[:cut])
    with pytest.raises(BuildError, match="safetensors"):
        open_checkpoint(tmp_path / "c", max_window=64)


def test_values_that_are_nested_too_deeply_have_a_message(tmp_path):
    write_checkpoint(tmp_path / "c", TINY)
    (tmp_path / "c" / "config.yaml").write_text("[" * 20_000)
    with pytest.raises(BuildError, match="it is no YAML"):
        open_checkpoint(tmp_path / "c")
    (tmp_path / "c" / "model.safetensors").unlink()
    (tmp_path / "c" / "model.safetensors.index.json").write_text("[" * 100_000)
    with pytest.raises(BuildError, match="it is no index"):
        open_checkpoint(tmp_path / "c")


@pytest.mark.parametrize("value", ["2001-99-99", "9" * 5000, "1" + ":00" * 400 + ".5", '!!int ""', "!!bool x", "!!timestamp x"], ids=["date", "int", "float", "no int", "no bool", "no time"])
def test_values_that_python_has_not_have_a_message(tmp_path, value):
    path = tmp_path / "config.yaml"
    path.write_text(f"n_layers: {value}\n")
    with pytest.raises(BuildError, match="it is no YAML"):
        read_config(path, 64)


@pytest.mark.parametrize(
    "name, value",
    [("n_layers", "x" * 100_000), ("d_model", "0x" + "f" * 5000), ("model_type", str(list(range(9999)))), ("y" * 9999, "1"), ("conv_kw", "z" * 9999)],
    ids=["text", "int", "list", "key", "convolution"],
)
def test_messages_about_long_values_are_short(tmp_path, name, value):
    path = tmp_path / "config.yaml"
    others = {key: of for key, of in config(TINY).items() if key != name}
    path.write_text(f"{yaml.safe_dump(others)}? {name}\n: {value}\n")
    with pytest.raises(BuildError) as refusal:
        read_config(path, 64)
    assert len(str(refusal.value)) < 500 and name[:9] in refusal.value.field


def test_an_index_cannot_lead_outside(tmp_path):
    write_checkpoint(tmp_path / "c", TINY, shards=2)
    index = tmp_path / "c" / "model.safetensors.index.json"
    index.write_text(json.dumps({"weight_map": {"a": "../b.safetensors"}}))
    with pytest.raises(BuildError, match="plain file name"):
        open_checkpoint(tmp_path / "c", max_window=64)


def test_the_autoencoder_may_be_safetensors_or_carry_more_rows(tmp_path):
    tensors = write_checkpoint(tmp_path / "c", TINY)
    pictures = numbers(autoencoder_names(TINY), 1)
    (tmp_path / "c" / "taehv1_5.pth").unlink()
    grown = pictures["decoder.7.conv.weight"]
    wide = pictures | {"decoder.7.conv.weight": np.concatenate([grown + 1, grown])}
    write_safetensors(tmp_path / "c" / "taehv1_5.safetensors", wide, "BF16")
    found = open_checkpoint(tmp_path / "c", max_window=64)
    for weight in autoencoder_weights(TINY):
        assert np.array_equal(found.get(weight), tensors[weight.name].astype(np.float16)), weight.name
    elsewhere = write_zip(tmp_path / "other.pth", torch_entries(pictures, "F32"))
    assert open_checkpoint(tmp_path / "c", elsewhere, 64).autoencoder.shapes == {n: v.shape for n, v in pictures.items()}
    write_zip(elsewhere, torch_entries(pictures | {"decoder.23.weight": np.zeros(3, np.float32)}))
    with pytest.raises(BuildError, match="decoder.23.weight"):
        open_checkpoint(tmp_path / "c", elsewhere, 64)


def test_half_precision_limits():
    half, lost = to_half(np.array([65504.0, -65504.0, 1e-9, 0.0, 65519.0], np.float32), "w")
    assert np.isfinite(half).all() and lost == 1
    with pytest.raises(BuildError, match="beyond float16"):
        to_half(np.array([65520.0], np.float32), "w")
    with pytest.raises(BuildError, match="not-a-number"):
        to_half(np.array([np.nan], np.float32), "w")


def test_names_that_mean_nothing():
    parts = ("attn_cond_head.cond_proj.3.weight", "cond_head.cond_proj.6.weight", "dit_mlp.router.weight")
    strange = ("blocks.01.attn.q_proj.weight", "blocks.x.attn.q_proj.weight", "encoder.0.weight", "")
    for name in (*strange, *(f"{BLOCK}0.{part}" for part in parts)):
        assert meaning(name) is None, name


def test_a_checkpoint_becomes_a_bundle_that_runs(tmp_path):
    def gentle(tensors):
        for value in tensors.values():
            value *= 0.5

    write_checkpoint(tmp_path / "c", TINY, change=gentle)
    (tmp_path / "c" / "LICENSE").write_text("terms")
    out = tmp_path / "out"
    assert main(["checkpoint", str(tmp_path / "c"), "--out", str(out), "--max-window", "64", "--quiet"]) == 0
    content = json.loads((out / "cairn-world.json").read_text())
    assert content["geometry"]["rope"]["rounding"] == "bf16"
    assert content["sampler"]["sigma_rounding"] == "bf16" and content["licence"] == {"spdx": "Apache-2.0", "file": "LICENSE.txt"}
    rng = np.random.default_rng(1)
    full, half = (Rollout(out, TINY, p) for p in ("f32", "f16"))
    x = full.noise(rng)
    a, b = (w.run(x, 1.0, -1.0) for w in (full, half))
    assert all(np.isfinite(v).all() for v in a + b)
    assert relative(b[0], a[0]) < 1e-2
    assert session(out, "decoder", "f16") is not None


def test_fourier_frequencies_round_as_the_released_engine():
    from cairn.build.transformer import fourier_frequencies

    exact, rounded = fourier_frequencies("none"), fourier_frequencies("bf16")
    assert exact[0] == 1 and exact[-1] == np.float32(1e-4) and len(exact) == 256
    assert not (rounded.view(np.uint32) & 0xFFFF).any()
    assert 0 < np.abs(rounded / exact - 1).max() <= 2**-8
