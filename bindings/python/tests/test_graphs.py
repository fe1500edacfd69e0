"""Names, types and shapes of the graphs, the size of their intermediate values, and the operators that they use."""

import json
import re

import jsonschema
import numpy as np
import onnx
import pytest
from conftest import ROOT, TINY, relative, session

from cairn.build import PRESETS, build_bundle, table, transformer
from cairn.build.cli import main
from cairn.build.graph import OPERATORS
from cairn.build.manifest import Licence
from cairn.build.random_weights import RandomWeights
from cairn.build.weights import file_size, parameter_count
from cairn.build.writer import build_graphs, layouts

FLOAT = {"f32": onnx.TensorProto.FLOAT, "f16": onnx.TensorProto.FLOAT16}


def signature(values):
    """(name, type, dimensions) of a graph's inputs or outputs."""
    return [
        (v.name, v.type.tensor_type.elem_type, [d.dim_param or d.dim_value for d in v.type.tensor_type.shape.dim]) for v in values
    ]


def expected(g, precision):
    """Section 4 of docs/bundle.md for one geometry, written down independently."""
    F, f32 = FLOAT[precision], onnx.TensorProto.FLOAT
    P, T, (W, H) = g.head_width // 2, g.tokens, g.decoded
    latent = [1, g.latent_channels, g.latent_height, g.latent_width]
    inputs = [
        ("x", F, latent),
        ("sigma", f32, [1]),
        ("dsigma", f32, [1]),
        ("rope_cos", f32, [1, 1, T, P]),
        ("rope_sin", f32, [1, 1, T, P]),
        ("controls", f32, [1, 259]),
        ("local_mask", F, [1, 1, 1, "local_keys"]),
        ("global_mask", F, [1, 1, 1, "global_keys"]),
    ]
    outputs = [("x_next", F, latent)]
    for i in range(g.layers):
        ring = "global_past" if (i + 1) % 4 == 0 else "local_past"
        inputs += [(f"past.{i}.{n}", F, [1, g.kv_heads, ring, g.head_width]) for n in "kv"]
        outputs += [(f"present.{i}.{n}", F, [1, g.kv_heads, T, g.head_width]) for n in "kv"]
    clip = [4, 3, H, W]
    w, h, wide = g.latent_width, g.latent_height, g.decoder_widths
    memories = [[1, wide[s], h * 2**s, w * 2**s] for s in range(3) for _ in range(3)]
    return {
        "transformer": (inputs, outputs),
        "encoder": ([("rgb", F, clip)], [("latent", F, latent)]),
        "decoder": (
            [("latent", F, latent), *((f"past_mem.{j}", F, m) for j, m in enumerate(memories))],
            [("rgb", F, clip), *((f"present_mem.{j}", F, m) for j, m in enumerate(memories))],
        ),
    }


def expected_joined(g, precision):
    """The same for the joined graph."""
    inputs, outputs = expected(g, precision)["transformer"]
    two = {
        "sigma": [2],
        "rope_cos": [1, 1, 2 * g.tokens, g.head_width // 2],
        "rope_sin": [1, 1, 2 * g.tokens, g.head_width // 2],
        "controls": [2, 259],
        "local_mask": [1, 2, 1, "local_keys"],
        "global_mask": [1, 2, 1, "global_keys"],
    }
    inputs = [(name, kind, two.get(name, shape)) for name, kind, shape in inputs]
    return [inputs[0], ("finished", *inputs[0][1:]), *inputs[1:]], outputs


@pytest.mark.parametrize("precision", ["f32", "f16"])
@pytest.mark.parametrize("preset", ["tiny", "demo", "360p", "720p"])
def test_the_joined_graph_has_two_latents(preset, precision):
    g = PRESETS[preset][1]
    graph = transformer.build_transformer(g, precision, layouts(g)[0], joined=True)
    model = graph.model()
    inputs, outputs = expected_joined(g, precision)
    assert signature(model.graph.input) == inputs and signature(model.graph.output) == outputs
    assert {n.op_type for n in model.graph.node} <= set(OPERATORS)
    sizes = table.value_sizes(graph, g.dimensions(g.global_max_window, 2))[1]
    assert max(4 * np.prod(shape) for shape, _ in sizes.values()) <= transformer.INTERMEDIATE_LIMIT


@pytest.mark.parametrize("precision", ["f32", "f16"])
def test_a_joined_pass_is_a_cache_pass_and_the_next_denoise_pass(tmp_path, precision):
    g, kind = TINY.with_(joined=True), np.float32 if precision == "f32" else np.float16
    bundle = build_bundle(
        g, RandomWeights(g, 1), tmp_path / "joined", name="joined", provenance={}, licence=Licence("CC0-1.0", b"No rights reserved.\n")
    )
    rng, T, slot = np.random.default_rng(5), g.tokens, 1
    single, joined = (session(bundle, graph, precision) for graph in ("transformer", "joined"))

    def run(graph, feeds):
        return dict(zip((o.name for o in graph.get_outputs()), graph.run(None, feeds)))

    def mask(visible, *current):
        return np.where(np.repeat(np.append(visible, current), T), 0, -1e4).astype(kind)[None, None, None]

    finished, following = random_feeds(g, kind), random_feeds(g, kind)
    for name in ("x", "controls", "rope_cos", "rope_sin"):
        following[name] = rng.standard_normal(following[name].shape).astype(following[name].dtype)
    finished["sigma"] = finished["dsigma"] = np.zeros(1, np.float32)
    following["sigma"], following["dsigma"] = np.array([0.9], np.float32), np.array([-0.15], np.float32)
    both = {name: value for name, value in finished.items() if name.startswith("past")}
    for name in ("local", "global"):
        before = rng.random(finished[f"{name}_mask"].shape[-1] // T - 1) > 0.3
        after, hidden = before.copy(), before.copy()
        after[slot], hidden[slot] = True, False
        finished[f"{name}_mask"], following[f"{name}_mask"] = mask(before, True), mask(after, True)
        both[f"{name}_mask"] = np.concatenate([mask(before, True, False), mask(hidden, True, True)], 1)
    made = run(single, finished)
    for i in range(g.layers):
        for part in "kv":
            past = following[f"past.{i}.{part}"] = finished[f"past.{i}.{part}"].copy()
            past[:, :, slot * T : (slot + 1) * T] = made[f"present.{i}.{part}"]
    both |= {"x": following["x"], "finished": finished["x"], "dsigma": following["dsigma"]}
    both |= {name: np.concatenate([finished[name], following[name]], 2) for name in ("rope_cos", "rope_sin")}
    both |= {name: np.concatenate([finished[name], following[name]], 0) for name in ("sigma", "controls")}
    found, bound = run(joined, both), {"f32": 1e-5, "f16": 5e-3}[precision]
    assert relative(found.pop("x_next"), run(single, following)["x_next"]) < bound
    assert max(relative(value, made[name]) for name, value in found.items()) < bound


def test_joined_graphs_are_added_and_kept(tiny, tmp_path):
    def rebuilt(source, name, *options):
        out = tmp_path / name
        assert main(["rebuild", str(source), "--out", str(out), "--quiet", *options]) == 0
        return out, json.loads((out / "cairn-world.json").read_text("utf-8"))

    schema = jsonschema.Draft202012Validator(json.loads((ROOT / "docs" / "bundle.schema.json").read_text(encoding="utf-8")))
    added, manifest = rebuilt(tiny, "added", "--joined")
    kept, again = rebuilt(added, "kept")
    assert manifest == again and manifest["graphs"]["f16"]["joined"] == "joined.f16.onnx"
    schema.validate(manifest)
    for file in manifest["files"]:
        old = tiny / file["path"]
        assert old.is_file() != file["path"].startswith("joined")
        assert not old.is_file() or old.read_bytes() == (added / file["path"]).read_bytes()
    del again["graphs"]["f16"]["joined"]
    (kept / "cairn-world.json").write_text(json.dumps(again), encoding="utf-8")
    assert main(["rebuild", str(kept), "--out", str(tmp_path / "halved"), "--quiet"]) == 2


@pytest.mark.parametrize("precision", ["f32", "f16"])
@pytest.mark.parametrize("preset", ["tiny", "demo", "720p"])
def test_inputs_and_outputs_are_the_contract(preset, precision):
    g = PRESETS[preset][1]
    for kind, graph in build_graphs(g, precision).items():
        model = graph.model()
        inputs, outputs = expected(g, precision)[kind]
        assert signature(model.graph.input) == inputs
        assert signature(model.graph.output) == outputs
        domains = [("", True), ("com.microsoft", False)] if kind == "transformer" else [("", True)]
        assert [(o.domain, 17 <= o.version <= 20) for o in model.opset_import] == domains
        assert {n.op_type for n in model.graph.node if n.domain} <= {"FusedMatMul", "RotaryEmbedding"}
        assert 8 <= model.ir_version <= 10
        assert not model.functions


def test_operators_are_those_of_the_format():
    page = (ROOT / "docs" / "bundle.md").read_text(encoding="utf-8")
    listed = re.search(r"Operators must be on this list:(.*?)\.\n", page, re.S)[1]
    assert re.findall(r"`(\w+)`", listed) == OPERATORS
    used = {n.op_type for p in FLOAT for g in build_graphs(TINY, p).values() for n in g.model().graph.node}
    # Graphs with smaller weights use that one.
    assert used == set(OPERATORS) - {"MatMulNBits"}


@pytest.mark.parametrize("precision", ["f32", "f16"])
def test_weights_are_external_once_and_shared(precision):
    g = PRESETS["720p"][1]
    graphs = {k: graph.model() for k, graph in build_graphs(g, precision).items()}
    stored = {p.weight.name: p for group in layouts(g) for p in group.values()}
    seen = {}
    for model in graphs.values():
        for t in model.graph.initializer:
            if t.data_location != onnx.TensorProto.EXTERNAL:
                assert len(t.SerializeToString()) < 64 << 10, t.name
                continue
            entry = {e.key: e.value for e in t.external_data}
            place = stored[t.name]
            assert (entry["location"], int(entry["offset"]), int(entry["length"])) == (place.file, place.offset, place.length)
            assert t.data_type == onnx.TensorProto.FLOAT16 and t.name not in seen
            seen[t.name] = place
    assert seen.keys() == stored.keys()
    ends = sorted((p.file, p.offset, p.offset + p.length) for p in seen.values())
    assert all(a[0] != b[0] or a[2] <= b[1] for a, b in zip(ends, ends[1:]))


def test_released_shapes_have_the_published_size():
    g = PRESETS["720p"][1]
    transformer_count, autoencoder_count = parameter_count(g)
    assert transformer_count == 1_281_958_039  # "1.28 B"
    assert autoencoder_count == 11_372_012  # 22.7 MB in two bytes each
    sizes = [file_size(group) for group in layouts(g)]
    assert sizes[0] >= 2 * transformer_count and sizes[1] >= 2 * autoencoder_count
    assert PRESETS["360p"][1].tokens == 128 and g.tokens == 512


LIMIT = 256 << 20


@pytest.mark.parametrize("preset", ["tiny", "demo", "360p", "720p"])
def test_no_intermediate_passes_the_limit_at_the_largest_window(preset):
    g = PRESETS[preset][1]
    for kind, graph in build_graphs(g, "f32").items():
        dimensions = g.dimensions(g.global_max_window) if kind == "transformer" else {}
        model, sizes = table.value_sizes(graph, dimensions)
        stored = {i.name for i in model.graph.initializer}
        weights = {n.output[0] for n in model.graph.node if n.op_type == "Cast" and n.input[0] in stored}
        made = {o for n in model.graph.node for o in n.output} - weights
        assert made and made <= sizes.keys()
        worst = max(made, key=lambda name: sizes[name][1])
        assert sizes[worst][1] <= LIMIT, (kind, worst, sizes[worst])
        assert all(0 < d for name in made for d in sizes[name][0])


def test_attention_is_cut_only_as_far_as_needed():
    g = PRESETS["720p"][1]
    assert transformer.attention_chunks(g, 3) == (16, 1)  # global: one head is 130 MiB
    assert transformer.attention_chunks(g, 0) == (4, 1)
    huge = g.with_(global_max_window=2048)
    heads, rows = transformer.attention_chunks(huge, 3)
    assert heads == 16 and rows > 1
    assert all(transformer.attention_chunks(TINY, i) == (1, 1) for i in range(8))


@pytest.mark.parametrize("limit, parts", [(4 * 16 * 40, (2, 1)), (4 * 8 * 40, (2, 2))])
def test_cutting_attention_changes_no_number(tiny, tmp_path, monkeypatch, limit, parts):
    monkeypatch.setattr(transformer, "INTERMEDIATE_LIMIT", limit)
    small = TINY.with_(global_max_window=16)
    assert transformer.attention_chunks(small, 0) == transformer.attention_chunks(small, 3) == parts
    graph = build_graphs(small, "f32")["transformer"].model()
    assert sum(n.op_type == "Softmax" for n in graph.graph.node) > TINY.layers
    (tmp_path / "transformer.f32.onnx").write_bytes(graph.SerializeToString())
    (tmp_path / "transformer.bin").write_bytes((tiny / "transformer.bin").read_bytes())
    feeds = random_feeds(TINY)
    whole, cut = (session(b, "transformer", "f32").run(None, feeds) for b in (tiny, tmp_path))
    assert all(relative(b, a) < 1e-6 for a, b in zip(whole, cut))


def random_feeds(g, kind=np.float32):
    """Inputs of about unit size."""
    rng = np.random.default_rng(3)
    d = g.dimensions(g.global_window)
    feeds = {}
    for name, elem, shape in expected(g, "f32")["transformer"][0]:
        shape = [d[s] if isinstance(s, str) else s for s in shape]
        free = name in ("sigma", "dsigma", "rope_cos", "rope_sin", "controls")
        feeds[name] = rng.standard_normal(shape).astype(np.float32 if free else kind)
    feeds["sigma"], feeds["dsigma"] = np.array([0.75], np.float32), np.array([-1], np.float32)
    for name in ("local_mask", "global_mask"):
        feeds[name] = np.where(feeds[name] > 1.0, -1e4, 0).astype(kind)
    return feeds


def test_half_precision_stays_close_to_single(tiny):
    full = session(tiny, "transformer", "f32").run(None, random_feeds(TINY))
    half = session(tiny, "transformer", "f16").run(None, random_feeds(TINY, np.float16))
    assert all(np.isfinite(h).all() for h in half)
    assert max(relative(h, f) for h, f in zip(half, full)) < 5e-3
    for kind in ("encoder", "decoder"):
        full, half = session(tiny, kind, "f32"), session(tiny, kind, "f16")
        rng = np.random.default_rng(4)
        feeds = {i.name: rng.random(i.shape).astype(np.float32) for i in full.get_inputs()}
        a = full.run(None, feeds)
        b = half.run(None, {n: v.astype(np.float16) for n, v in feeds.items()})
        assert max(relative(h, f) for h, f in zip(b, a)) < 5e-3


def test_extreme_controls_and_hidden_keys_stay_finite(tiny):
    feeds = random_feeds(TINY, np.float16)
    feeds["controls"] = np.full((1, 259), 1e5, np.float32)
    feeds["local_mask"][:] = feeds["global_mask"][:] = -1e4
    assert all(np.isfinite(v).all() for v in session(tiny, "transformer", "f16").run(None, feeds))


def test_a_hidden_key_has_no_weight(tiny):
    model = session(tiny, "transformer", "f32")
    feeds = random_feeds(TINY)
    for name in ("local_mask", "global_mask"):
        feeds[name][..., : TINY.tokens] = -1e4
    before = model.run(None, feeds)
    for i in range(TINY.layers):
        feeds[f"past.{i}.k"][:, :, : TINY.tokens] = 7.0
        feeds[f"past.{i}.v"][:, :, : TINY.tokens] = -7.0
    assert all(np.array_equal(a, b) for a, b in zip(before, model.run(None, feeds)))


def test_manifest_matches_its_schema(tiny):
    schema = json.loads((ROOT / "docs" / "bundle.schema.json").read_text(encoding="utf-8"))
    content = json.loads((tiny / "cairn-world.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, schema, cls=jsonschema.Draft202012Validator)
    broken = {**content, "surprise": 1}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, schema, cls=jsonschema.Draft202012Validator)


LIMITS = [
    (("rates", "latents_per_second"), 1000),
    (("picture", "render", 0), 16_384),
    (("geometry", "layers"), 512),
    (("geometry", "width"), 65_536),
    (("geometry", "heads"), 4096),
    (("geometry", "kv_heads"), 4096),
    (("geometry", "head_width"), 1024),
    (("geometry", "mlp_ratio"), 64),
    (("geometry", "latent", "channels"), 4096),
    (("geometry", "patch", 1), 64),
    (("geometry", "tokens"), 65_536),
    (("geometry", "local", "window"), 65_536),
    (("geometry", "global", "max_window"), 65_536),
    (("geometry", "global", "dilation"), 4096),
    (("geometry", "global", "period"), 4096),
    (("geometry", "control_period"), 4096),
    (("geometry", "autoencoder", "memories", 8, 2), 16_384),
]
"""Members of a manifest, with their largest value."""


@pytest.mark.parametrize(("path", "limit"), LIMITS, ids=lambda value: ".".join(map(str, value)) if isinstance(value, tuple) else "")
def test_the_schema_has_the_limits_of_the_specification(tiny, path, limit):
    schema = jsonschema.Draft202012Validator(json.loads((ROOT / "docs" / "bundle.schema.json").read_text(encoding="utf-8")))
    content = json.loads((tiny / "cairn-world.json").read_text(encoding="utf-8"))
    *folders, member = path
    place = content
    for folder in folders:
        place = place[folder]
    step = 8 if member == "head_width" else 1
    for value, allowed in ((limit, True), (limit + step, False), (0, False)):
        place[member] = value
        assert schema.is_valid(content) == allowed, value


@pytest.mark.parametrize("name", ["nul", "a/Com1.bin", "a.", "a./b", "..", "a/../b", "CON/a", "/a", "a//b", "C:a", "ä"])
def test_the_schema_refuses_names_that_no_bundle_may_have(tiny, name):
    schema = jsonschema.Draft202012Validator(json.loads((ROOT / "docs" / "bundle.schema.json").read_text(encoding="utf-8")))
    content = json.loads((tiny / "cairn-world.json").read_text(encoding="utf-8"))
    for allowed in ("com10", "console.bin", "..a", "a..b", "weights.bin", "-"):
        content["files"][0]["path"] = allowed
        schema.validate(content)
    content["files"][0]["path"] = name
    assert not schema.is_valid(content)
