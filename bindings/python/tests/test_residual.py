"""Transformers in f16 whose residual stream is float32: their form, their error beside that of plain f16 ones, and sums that pass float16."""

import json

import jsonschema
import numpy as np
import onnx
import pytest
from conftest import ROOT, TINY, relative, session
from half import RoundedSession
from rollout import Rollout
from test_graphs import random_feeds

import cairn
import runtime
from cairn import doctor
from cairn.build import archive, build_bundle, cli, costs, table
from cairn.build.errors import BuildError
from cairn.build.geometry import RESIDUALS
from cairn.build.manifest import Licence
from cairn.build.random_weights import RandomWeights
from cairn.build.writer import build_graphs

MINIATURE = ROOT / "samples" / "worlds" / "miniature.cairn"
WIDE = TINY.with_(residual="float32")


def made(command, out, *options):
    assert cli.main([command, *map(str, options), "--out", str(out), "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def wide(tmp_path_factory):
    """The world of the fixture `tiny` with a float32 residual stream."""
    return made("random", tmp_path_factory.mktemp("residual") / "wide", "--preset", "tiny", "--residual", "float32")


class LoudWeights(RandomWeights):
    """Random weights, except that what each layer adds to the residual stream is `factor` times as large."""

    def __init__(self, g, seed, factor):
        super().__init__(g, seed)
        self.factor = np.float32(factor)

    def get(self, weight):
        array = super().get(weight)
        is_last = weight.name.startswith("blocks.") and weight.name.endswith(("attn.out_proj.weight", "mlp.fc2.weight"))
        return (array * self.factor).astype(np.float16) if is_last else array


@pytest.fixture(scope="module")
def loud(tmp_path_factory):
    """Two worlds of the same weights, by the type of the residual stream: the sums of their last layers pass 65504."""
    folder, facts = tmp_path_factory.mktemp("loud"), {"name": "loud", "provenance": {}, "licence": Licence("CC0-1.0")}
    return {r: build_bundle(TINY.with_(residual=r), LoudWeights(TINY, 1, 5e4), folder / r, **facts) for r in RESIDUALS}


def sums(g, precision):
    """Types of the sums `[1, T, D]` of a graph's residual stream, by name."""
    model, sizes = table.value_sizes(build_graphs(g, precision)["transformer"], g.dimensions(g.global_window))
    types = {v.name: v.type.tensor_type.elem_type for v in model.graph.value_info}
    found = {name: types[name] for name in types if name.endswith((".attn.sum", ".ctrl.sum", ".mlp.sum"))}
    assert len(found) == sum(2 + g.sees_controls(i) for i in range(g.layers))
    assert all(sizes[name][0] == [1, g.tokens, g.width] for name in found)
    return set(found.values())


def test_only_the_residual_stream_changes_its_type():
    assert sums(TINY, "f16") == {onnx.TensorProto.FLOAT16} and sums(WIDE, "f16") == {onnx.TensorProto.FLOAT}
    plain, wide = (build_graphs(g, "f16") for g in (TINY, WIDE))
    for kind in ("encoder", "decoder"):
        assert plain[kind].model() == wide[kind].model()
    nodes = [[n for n in graphs["transformer"].model().graph.node if n.op_type != "Cast"] for graphs in (plain, wide)]
    assert [n.op_type for n in nodes[0]] == [n.op_type for n in nodes[1]]
    sizes = [table.value_sizes(graphs["transformer"], TINY.dimensions(16))[1] for graphs in (plain, wide)]
    products = [n.output[0] for n in nodes[0] if n.op_type in ("MatMul", "FusedMatMul")]
    assert all(sizes[0][name] == sizes[1][name] for name in products) and len(products) > 50
    assert build_graphs(TINY, "f32")["transformer"].model() == build_graphs(WIDE, "f32")["transformer"].model()


def test_the_manifest_states_it_and_follows_the_schema(tiny, wide):
    manifest, plain = (json.loads((f / "cairn-world.json").read_text("utf-8")) for f in (wide, tiny))
    assert manifest["residual"] == "float32" and "residual" not in plain
    schema = jsonschema.Draft202012Validator(json.loads((ROOT / "docs" / "bundle.schema.json").read_text("utf-8")))
    schema.validate(manifest)
    schema.validate(plain)
    for wrong in (plain | {"residual": "float16"}, manifest | {"graphs": {"f32": manifest["graphs"]["f32"]}}):
        with pytest.raises(jsonschema.ValidationError):
            schema.validate(wrong)
    assert archive.read_geometry(wide) == WIDE


def test_every_command_keeps_and_changes_it(tiny, wide, tmp_path, capsys):
    again = made("rebuild", tmp_path / "again", wide)
    assert all(path.read_bytes() == (again / path.name).read_bytes() for path in wide.iterdir())
    assert archive.read_geometry(made("quantise", tmp_path / "small.cairn", wide, "--weights", 8)) == WIDE
    changed = made("rebuild", tmp_path / "changed", tiny, "--residual", "float32")
    graph = "transformer.f16.onnx"
    assert (changed / graph).read_bytes() == (wide / graph).read_bytes() != (tiny / graph).read_bytes()
    back = made("rebuild", tmp_path / "back", wide, "--residual", "float16")
    assert (back / graph).read_bytes() == (tiny / graph).read_bytes()
    small = made("quantise", tmp_path / "small", tiny, "--weights", 4, "--residual", "float32")
    assert archive.read_geometry(small) == WIDE
    refused = ["random", "--out", str(tmp_path / "none"), "--precision", "f32", "--residual", "float32"]
    assert cli.main(refused) == 2 and "residual: only f16 graphs" in capsys.readouterr().err
    with pytest.raises(BuildError, match="float16, float32"):
        TINY.with_(residual="bfloat16")


def test_costs_count_the_wider_sums():
    plain, wide = (sum(row[4] + row[5] for row in costs.world_costs(g)["graphs"]["transformer"]) for g in (TINY, WIDE))
    values = TINY.tokens * TINY.width * sum(2 + TINY.sees_controls(i) for i in range(TINY.layers))
    assert wide - plain > 2 * values


def half_passes(bundle, full, passes):
    """Relative errors of x_next and of all keys and values of passes in f16, from the past and the inputs of those in f32."""
    half = Rollout(bundle, full.g, "f16")
    half.past = [[part.astype(np.float16) for part in both] for both in full.past]
    half.seen, half.clock, half.model = full.seen, full.clock, RoundedSession(bundle / "transformer.f16.onnx")
    errors = []
    for inputs, truth in passes:
        found = half.run(*inputs)
        flat = [np.concatenate([v.ravel() for v in outputs[1:]]) for outputs in (found, truth)]
        errors.append((relative(found[0], truth[0]), relative(*flat)))
    return np.array(errors).T


def walk(folder):
    """A rollout of the f32 graphs after a seed and four latents, and the passes of the next latent: inputs and outputs."""
    g = archive.read_geometry(folder)
    full, rng, (width, height) = Rollout(folder, g), np.random.default_rng(2), g.decoded
    picture = np.linspace(0.2, 0.8, 3 * height * width, dtype=np.float32).reshape(1, 3, height, width)
    full.commit(full.run(session(folder, "encoder", "f32").run(None, {"rgb": np.repeat(picture, 4, 0)})[0], 0.0, 0.0))
    controls = np.zeros((1, g.control_width), np.float32)
    controls[0, [0, 2 + 87]] = 6, 1  # a turn to the right, and the key W
    for _ in range(4):
        full.step(full.noise(rng), controls)
    x, passes = full.noise(rng), []
    for sigma, lower in zip(g.schedule, [*g.schedule[1:], 0.0]):
        # The same input for both: it is rounded to float16 in advance.
        x = x.astype(np.float16).astype(np.float32)
        outputs = full.run(x, sigma, lower - sigma, controls)
        passes.append(((x, sigma, lower - sigma, controls), outputs))
        x = outputs[0]
    return full, passes


@pytest.mark.parametrize("world", ["tiny", "miniature"])
def test_errors_are_no_larger_than_without(world, tiny, tmp_path):
    plain = tiny if world == "tiny" else archive.unpack(MINIATURE, tmp_path / "plain")
    wide = made("rebuild", tmp_path / "wide", plain, "--residual", "float32")
    full, passes = walk(plain)
    found = {name: half_passes(bundle, full, passes) for name, bundle in (("float16", plain), ("float32", wide))}
    for name, (latents, states) in found.items():
        print(f"{world}, {name}: latents {latents}, keys and values {states}")
    assert (found["float32"] <= found["float16"]).all() and found["float16"][0].max() > 2e-4
    assert found["float32"][0].sum() < 0.95 * found["float16"][0].sum()


def test_sums_that_pass_float16_need_float32(loud):
    truth = RoundedSession(loud["float16"] / "transformer.f32.onnx")
    wanted = truth.run(None, random_feeds(TINY))
    largest = {name: np.abs(value).max() for name, value in truth.values.items() if value.dtype == np.float32}
    assert max(largest[name] for name in largest if name.endswith(".sum")) > 65504
    assert max(value for name, value in largest.items() if not name.endswith(".sum")) < 65504
    plain, wide = (
        RoundedSession(loud[r] / "transformer.f16.onnx").run(None, random_feeds(TINY, np.float16)) for r in RESIDUALS
    )
    assert not np.isfinite(plain[0]).all(), "the sums of the plain f16 graph overflow"
    assert all(np.isfinite(v).all() for v in wide) and relative(wide[0], wanted[0]) < 2e-3


def test_the_library_reads_both_forms(tiny, wide):
    runtime.need_library()
    with cairn.Device.cpu(threads=1) as device:
        latents = []
        for bundle, precision in ((tiny, "f32"), (tiny, "f16"), (wide, "f16")):
            with device.load_world(bundle, precision=precision) as world, world.rollout(seed=3) as rollout:
                rollout.append(runtime.pattern(72, 128))
                rollout.step(cairn.Controls())
                with rollout.anchor() as anchor:
                    latents.append(anchor.latent())
    # The CPU provider computes both float16 graphs in float32, but for what one graph gives to another: their latents may be equal.
    forms = [json.loads((bundle / "cairn-world.json").read_text(encoding="utf-8")).get("residual") for bundle in (tiny, wide)]
    assert forms == [None, "float32"]
    assert max(relative(latent, latents[0]) for latent in latents[1:]) < 5e-3 and not np.array_equal(latents[0], latents[1])


def test_the_check_at_load_names_the_sum_that_passes_float16(loud, capsys):
    runtime.need_library()
    with cairn.Device.cpu(threads=1) as device:
        device.load_world(loud["float16"], precision="f16").close()
        device.load_world(loud["float16"], precision="f32", check_precision=True).close()
        with pytest.raises(cairn.Unsupported, match="a sum of the residual stream reaches") as raised:
            device.load_world(loud["float16"], precision="f16", check_precision=True)
        assert raised.value.field.startswith("blocks.") and raised.value.field.endswith(".sum")
        assert "--residual float32" in raised.value.remedy
        stages = []
        device.load_world(
            loud["float32"], precision="f16", check_precision=True, progress=lambda *at: stages.append(at)
        ).close()
        assert stages[-1] == ("preparing", 6, 6), "three graphs, two of the conditioning, and one for the check"
    assert doctor.run(str(loud["float32"]), half=True)
    assert "float16 " in capsys.readouterr().out
    assert not doctor.run(str(loud["float16"]), half=True)
    assert "--residual float32" in " ".join(capsys.readouterr().out.split())
