"""Bundles with weights in 8 and 4 bits: rounding, the error of a pass, and invalid options."""

import json

import jsonschema
import numpy as np
import onnx
import onnxruntime
import pytest
from conftest import ROOT, TINY, relative, session
from onnx import numpy_helper
from rollout import Rollout

import cairn
import runtime
from cairn.build import PRESETS, archive, build_bundle, cli, costs, quantise, rates
from cairn.build.errors import BuildError
from cairn.build.manifest import Licence
from cairn.build.quantise import NUMBERS, SCALES, Quantisation, counts, restored, rounded, unpacked_bytes, unpacked_numbers
from cairn.build.random_weights import RandomWeights
from cairn.build.stored import rebuild
from cairn.build.weights import stored_transformer
from cairn.build.writer import build_graphs

MINIATURE = ROOT / "samples" / "worlds" / "miniature.cairn"


def silent(what, done, total):
    pass


def quantised(bundle, out, *options):
    assert cli.main(["quantise", str(bundle), "--out", str(out), "--quiet", *map(str, options)]) == 0
    return out


@pytest.mark.parametrize("bits, bound", [(8, 0.006), (4, 0.1)])
@pytest.mark.parametrize("block", [16, 32, 256])
def test_rounding_is_close_and_keeps_every_number_in_its_place(bits, bound, block):
    matrix = (np.random.default_rng(1).standard_normal((256, 96)) * np.geomspace(1e-3, 10, 96)).astype(np.float16)
    matrix[:, 3] = 0
    matrix[:16, 5] = 2**-24
    numbers, scales = rounded(matrix, bits, block)
    assert (numbers.dtype, numbers.shape) == (np.uint8, (96, 256 // block, block * bits // 8))
    assert (scales.dtype, scales.shape) == (np.float16, (96, 256 // block))
    assert np.isfinite(scales).all() and (scales > 0).all()
    back = restored(numbers, scales, bits)
    assert back.shape == matrix.shape and (back[:, 3] == 0).all()
    columns = [j for j in range(96) if j not in (3, 5)]
    assert max(relative(back[:, j], matrix[:, j]) for j in columns) < bound * (1 + block / 256)
    # No number is further away than half a step, except those that 4 bits clip.
    step = np.repeat(scales.astype(np.float32), block, axis=1).T
    worst = np.abs(back - matrix.astype(np.float32)) / step
    assert np.quantile(worst, 0.9) <= 0.5 + 1e-3 and (bits == 4 or worst.max() <= 0.5 + 2e-2)


def test_every_matrix_is_read_and_rounded_once(tmp_path, monkeypatch):
    read, rounds = [], []

    class Counting(RandomWeights):
        def get(self, weight):
            read.append(weight.name)
            return super().get(weight)

    def counted(*arguments):
        rounds.append(arguments)
        return rounded(*arguments)

    monkeypatch.setattr(quantise, "rounded", counted)
    facts = {"name": "w", "provenance": {}, "licence": Licence("CC0-1.0"), "precisions": ("f32",)}
    quantisation = Quantisation(8)
    build_bundle(TINY, Counting(TINY, 1), tmp_path / "w", quantisation=quantisation, **facts)
    assert len(read) == len(set(read)) > 20
    assert len(rounds) == sum(quantisation.quantises(packed.whole) for packed in stored_transformer(TINY))


def test_the_largest_numbers_of_float16_stay_finite():
    matrix = np.full((32, 2), 65504, np.float16) * np.array([1, -1], np.float16)
    for bits in (8, 4):
        numbers, scales = rounded(matrix, bits, 32)
        assert np.isfinite(scales).all()
        assert relative(restored(numbers, scales, bits), matrix) < 0.05


def random_passes(folder, g, precision):
    """The outputs of a step's passes and the cache pass, from a random past; inputs depend on nothing else."""
    rollout, rng = Rollout(folder, g, precision), np.random.default_rng(5)
    for past in rollout.past:
        for half in past:
            half[:] = rng.standard_normal(half.shape)
    for seen in rollout.seen.values():
        seen[:] = True
    x = rollout.noise(rng)
    levels = zip(g.schedule, [*g.schedule[1:], 0.0])
    return [rollout.run(x, sigma, lower - sigma) for sigma, lower in levels]


def errors(folder, truth, g, precision="f32"):
    """Relative error of x_next in each pass of a step, and of all keys and values in each pass with the cache pass."""
    passes = random_passes(folder, g, precision)
    latents = [relative(small[0], full[0]) for small, full in zip(passes, truth)][:-1]
    flat = [[np.concatenate([v.ravel() for v in outputs[1:]]) for outputs in both] for both in zip(passes, truth)]
    return latents, [relative(*both) for both in flat]


@pytest.mark.parametrize("options, bounds", [((8,), (0.01, 0.01)), ((8, "--activations", 8), (0.02, 0.015)), ((4,), (0.15, 0.12))])
def test_a_pass_of_a_random_world_stays_close(tiny, tmp_path, options, bounds):
    small = quantised(tiny, tmp_path / "small", "--weights", *options, "--keep-16", "none")
    truth = random_passes(tiny, TINY, "f32")
    for precision in ("f32", "f16"):
        latents, states = errors(small, truth, TINY, precision)
        assert 0 < max(latents) < bounds[0] and 0 < max(states) < bounds[1], (precision, latents, states)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """The embedded world, unpacked, and the inputs and outputs of the passes of a latent after a walk of eight."""
    folder = archive.unpack(MINIATURE, tmp_path_factory.mktemp("miniature") / "world")
    g = archive.read_geometry(folder)
    rollout, rng = Rollout(folder, g), np.random.default_rng(2)
    picture = np.linspace(0.2, 0.8, 3 * 128 * 256, dtype=np.float32).reshape(1, 3, 128, 256)
    seed = session(folder, "encoder", "f32").run(None, {"rgb": np.repeat(picture, 4, 0)})[0]
    rollout.commit(rollout.run(seed, 0.0, 0.0))
    controls = np.zeros((1, g.control_width), np.float32)
    controls[0, [0, 2 + 87]] = 6, 1  # a turn to the right, and the key W
    for _ in range(8):
        rollout.step(rollout.noise(rng), controls)
    x, passes = rollout.noise(rng), []
    for sigma, lower in zip(g.schedule, [*g.schedule[1:], 0.0]):
        outputs = rollout.run(x, sigma, lower - sigma, controls)
        passes.append(((x, sigma, lower - sigma, controls), outputs))
        x = outputs[0]
    return folder, rollout, passes


@pytest.mark.parametrize("options, bound", [((8,), 0.01), ((8, "--activations", 8), 0.01), ((4,), 0.1)])
def test_a_pass_of_the_embedded_world_stays_within_the_bound(walk, tmp_path, options, bound):
    folder, full, passes = walk
    small = Rollout(quantised(folder, tmp_path / "small", "--weights", *options), full.g)
    small.past, small.seen, small.clock = full.past, full.seen, full.clock
    found = [relative(small.run(*inputs)[0], outputs[0]) for inputs, outputs in passes[:-1]]
    print([f"{100 * error:.2f} %" for error in found])
    assert 0 < max(found) <= bound, found


def test_the_kept_layers_carry_most_of_the_error(walk, tmp_path):
    folder, full, passes = walk
    small = Rollout(quantised(folder, tmp_path / "small", "--weights", 8, "--keep-16", "none"), full.g)
    small.past, small.seen, small.clock = full.past, full.seen, full.clock
    found = [relative(small.run(*inputs)[0], outputs[0]) for inputs, outputs in passes[:-1]]
    assert max(found) > 0.01, "the matrices that stay in 16 bits by default need no exception any more"


def test_a_graph_reads_the_stored_numbers(tiny, tmp_path):
    small = quantised(tiny, tmp_path / "small", "--weights", 4, "--keep-16", "blocks.0,blocks.2.mlp.fc1")
    quantisation = archive.read_quantisation(small)
    assert quantisation == Quantisation(4, 32, 16, ("blocks.0", "blocks.2.mlp.fc1"))
    source = RandomWeights(TINY, 1)
    stored = {packed.whole.name: packed for packed in stored_transformer(TINY)}
    for precision in ("f32", "f16"):
        model = onnx.load(small / f"transformer.{precision}.onnx")
        tensors = {t.name: numpy_helper.to_array(t) for t in model.graph.initializer}
        products = [n for n in model.graph.node if n.op_type == "MatMulNBits"]
        names = {n.input[1].removesuffix(NUMBERS) for n in products}
        expected = {name for name, packed in stored.items() if quantisation.quantises(packed.whole)}
        assert names == expected and len(products) == len(expected) > 20
        assert not any(name.startswith(("blocks.0", "blocks.2.mlp.fc1")) for name in names)
        assert {f"{name}{suffix}" for name in names for suffix in (NUMBERS, SCALES)} <= tensors.keys()
        name = "blocks.1.attn.qkv_proj.weight"
        matrix = stored[name].pack([source.get(part) for part in stored[name].parts])
        back = restored(tensors[name + NUMBERS], tensors[name + SCALES], 4)
        assert np.array_equal(back, restored(*rounded(matrix, 4, 32), 4)) and relative(back, matrix) < 0.1


def test_the_manifest_and_the_files_follow_the_schema(tiny, tmp_path):
    small = quantised(tiny, tmp_path / "small.cairn", "--weights", 8, "--activations", 8)
    folder = archive.unpack(small, tmp_path / "unpacked")
    manifest, original = (json.loads((f / "cairn-world.json").read_text("utf-8")) for f in (folder, tiny))
    schema = json.loads((ROOT / "docs" / "bundle.schema.json").read_text("utf-8"))
    jsonschema.Draft202012Validator(schema).validate(manifest)
    assert manifest["quantisation"] == {
        "bits": 8,
        "block": 32,
        "activation_bits": 8,
        "kept_in_16_bits": ["blocks.0.ctrl_mlpfusion"],
    }
    assert (manifest["name"], manifest["licence"]) == ("tiny, 8-bit weights", original["licence"])
    origin = manifest["provenance"]["quantised_from"]
    assert origin.startswith("tiny, ") and len(origin.split(", ")[1]) == 64
    rounds = {
        precision: {a.i for n in model.graph.node for a in n.attribute if a.name == "accuracy_level"}
        for precision in ("f32", "f16")
        if (model := onnx.load(folder / f"transformer.{precision}.onnx", load_external_data=False))
    }
    assert rounds == {"f32": {4}, "f16": {0}}
    smaller, everything = counts(TINY, Quantisation(8, kept=("blocks.0.ctrl_mlpfusion",)))
    sizes = [next(f["size"] for f in m["files"] if f["path"] == "transformer.bin") for m in (manifest, original)]
    # A scale of 2 bytes for 32 numbers; the rest is the alignment of each tensor.
    assert 0 <= sizes[0] - (sizes[1] - smaller * (1 - 2 / 32)) < 64 * 200 and smaller > everything / 2


def test_the_same_bundle_gives_the_same_bytes(tiny, tmp_path):
    first, again = (quantised(tiny, tmp_path / name, "--weights", 4) for name in ("first", "again"))
    assert all(path.read_bytes() == (again / path.name).read_bytes() for path in first.iterdir())


def test_describe_states_the_bits(tiny, tmp_path, capsys):
    small = quantised(tiny, tmp_path / "small", "--weights", 8, "--activations", 8)
    assert cli.main(["describe", str(small)]) == 0
    text = capsys.readouterr().out
    assert "in 8 bits, blocks of 32, activations in 8 bits on the CPU; in 16 bits: blocks.0.ctrl_mlpfusion" in text


def test_a_product_of_blocks_costs_as_much_and_reads_less(tiny):
    dimensions = TINY.dimensions(TINY.global_window)
    full, small = (
        {n.output: n for n in costs.node_costs(build_graphs(TINY, "f16", quantisation=q)["transformer"], dimensions)}
        for q in (None, Quantisation(8))
    )
    assert full.keys() == small.keys()
    products = [n for n in small.values() if n.operator == "MatMulNBits"]
    assert products and all(n.multiply_adds == full[n.output].multiply_adds and n.read < full[n.output].read for n in products)


@pytest.mark.parametrize(
    "options, message",
    [
        (("--weights", 8, "--keep-16", "blocks.9"), "blocks.9: no stored tensor has this name"),
        (("--weights", 8, "--keep-16", "blocks.0,"), "no stored tensor has this name"),
        (("--weights", 8, "--keep-16", "block"), "block: no stored tensor has this name"),
        (("--weights", 8, "--keep-16", ",".join(f"blocks.{i}" for i in range(8))), "blocks.7: with these names every matrix of the layers stays"),
    ],
)
def test_names_of_no_layer_are_refused(tiny, tmp_path, capsys, options, message):
    assert cli.main(["quantise", str(tiny), "--out", str(tmp_path / "out"), "--quiet", *map(str, options)]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_blocks_that_fit_no_matrix_are_refused():
    # Its matrices have fewer rows than a block.
    g = TINY.with_(width=8, heads=1, kv_heads=1, mlp_ratio=1)
    with pytest.raises(BuildError, match="no matrix of the layers has a multiple of 256 rows") as refusal:
        build_graphs(g, "f32", quantisation=Quantisation(8, 256, kept=()))
    assert refusal.value.field == "--block 256"


@pytest.mark.parametrize("how", [(5, 32, 16), (8, 24, 16), (8, 32, 4)])
def test_other_forms_are_refused(how):
    with pytest.raises(BuildError, match="is none of"):
        Quantisation(*how)


def test_a_bundle_is_quantised_once(tiny, tmp_path):
    small = quantised(tiny, tmp_path / "small", "--weights", 8)
    with pytest.raises(BuildError, match=r"8 bits.* are lost\. Name the bundle that it was made from: tiny, [0-9a-f]{64}"):
        rebuild(small, tmp_path / "again", progress=silent, quantisation=Quantisation(4))
    with pytest.raises(BuildError, match="16-bit numbers are lost"):
        rebuild(small, tmp_path / "again", progress=silent)
    assert not (tmp_path / "again").exists()


def test_rates_count_the_bytes_of_small_weights(capsys):
    g = PRESETS["demo"][1]
    worlds = [rates.World("demo", g, q) for q in (None, Quantisation(8), Quantisation(4))]
    stock = rates.PRESETS_OF_THE_LIBRARY[0]
    moved = [world.one_pass(stock.window).bytes for world in worlds]
    smaller, _ = counts(g, Quantisation(8))
    memory = [world.memory(stock.window) * 2**30 for world in worlds]
    assert memory[0] - memory[1] == pytest.approx(smaller * (1 - 2 / 32) - unpacked_bytes(g, Quantisation(8), "f16"))
    of_a_pass = unpacked_numbers(g, Quantisation(8))
    assert of_a_pass < smaller
    assert moved[0] - moved[1] == of_a_pass * (1 - 2 / 32) and moved[1] - moved[2] == of_a_pass / 2
    assert len({world.one_pass(stock.window).flops for world in worlds}) == 1
    assert cli.main(["rates", "--preset", "tiny", "--weights", "8"]) == 0
    assert "tiny, 8-bit weights" in capsys.readouterr().out


@pytest.mark.parametrize("options", [(8,), (8, "--activations", 8), (4,)])
def test_memory_counts_the_unpacked_matrix_as_the_library_does(tiny, tmp_path, capsys, options):
    small = quantised(tiny, tmp_path / "small", "--weights", *options)
    quantisation = archive.read_quantisation(small)
    # The largest of a pass, and the largest that embeds controls, which are of another graph.
    numbers = TINY.width**2 * (TINY.mlp_ratio + 1)
    counted = {precision: unpacked_bytes(TINY, quantisation, precision) for precision in ("f32", "f16")}
    assert counted == {"f32": 4 * numbers if options == (8,) else 0, "f16": 2 * numbers}
    runtime.need_library()
    with cairn.Device.cpu(threads=1) as device, device.load_world(tiny) as full, device.load_world(small) as world:
        assert world.memory.intermediates - full.memory.intermediates == counted["f32"]
        assert world.memory.total < full.memory.total
    assert cli.main(["describe", str(small)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for precision, count in counted.items():
        head, first = (next(line for line in lines if line.startswith(word)) for word in ("MiB", precision))
        columns, row = ([line[at : at + 13].strip() for at in range(11, len(line), 13)] for line in (head, first))
        assert float(dict(zip(columns, row, strict=True))["unpacked"]) == pytest.approx(count / 2**20, abs=0.051)


def test_the_cpu_provider_multiplies_no_eight_bit_floats():
    """`docs/bundle.md` says so: if this fails, the format may have them."""
    number = onnx.TensorProto.FLOAT8E4M3FN
    nodes = [
        onnx.helper.make_node("Cast", ["x"], ["x8"], to=number),
        onnx.helper.make_node("GemmFloat8", ["x8", "w", "", "s", "s"], ["y"], domain="com.microsoft", dtype=1),
    ]
    x, y = (onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [4, 16]) for name in "xy")
    w = onnx.helper.make_tensor("w", number, [16, 16], [1.0] * 256)
    scale = onnx.helper.make_tensor("s", onnx.TensorProto.FLOAT, [], [1.0])
    opsets = [onnx.helper.make_opsetid("", 21), onnx.helper.make_opsetid("com.microsoft", 1)]
    model = onnx.helper.make_model(onnx.helper.make_graph(nodes, "g", [x], [y], [w, scale]), opset_imports=opsets, ir_version=10)
    with pytest.raises(onnxruntime.capi.onnxruntime_pybind11_state.NotImplemented, match="GemmFloat8"):
        onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
