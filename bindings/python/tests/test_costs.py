"""The cost of each node: its arithmetic, and the command."""

import json
import math

import pytest
from conftest import TINY, copied

from cairn.build import archive
from cairn.build.cli import main
from cairn.build.conditioning import CONTROLS, LEVELS, PASS, parts, weights_of
from cairn.build.costs import node_costs
from cairn.build.writer import build_graphs


@pytest.fixture(scope="module")
def transformer():
    """Costs of the tiny world's transformer by the names of its nodes."""
    return {n.name: n for n in node_costs(build_graphs(TINY, "f16")["transformer"], TINY.dimensions(TINY.global_window))}


def test_a_product_reads_its_operands_and_writes_its_result(transformer):
    g = TINY
    out = transformer["blocks.0.attn.out/MatMul"]
    assert out.multiply_adds == g.tokens * g.width * g.width
    assert (out.read, out.written) == (2 * (g.tokens * g.width + g.width * g.width), 2 * g.tokens * g.width)
    keys = g.past_tokens(0, g.global_window) + g.tokens
    softmax = transformer["blocks.0.attn.shares/Softmax"]
    assert (softmax.multiply_adds, softmax.read) == (0, 2 * g.heads * g.tokens * keys)
    scores = transformer["blocks.0.attn.scores/FusedMatMul"]
    assert scores.multiply_adds == g.heads * g.tokens * keys * g.head_width


def test_a_reshape_moves_nothing(transformer):
    reshapes = [n for n in transformer.values() if n.operator == "Reshape"]
    assert reshapes and all((n.read, n.written, n.multiply_adds) == (0, 0, 0) for n in reshapes)


def test_nodes_that_need_only_weights_levels_or_controls_do_not_run_in_a_pass(transformer):
    graph = build_graphs(TINY, "f16")["transformer"].model().graph
    weights = {tensor.name for tensor in graph.initializer}
    casts = {node.name for node in graph.node if node.op_type == "Cast" and node.input[0] in weights}
    assert casts and not casts & transformer.keys()
    left_out = {node.name for node in graph.node} - casts - transformer.keys()
    products = {name.removesuffix("/MatMul") for name in left_out if name.endswith("/MatMul")}
    of_layers = {f"blocks.{i}.ctrl.c" for i in range(TINY.layers) if TINY.sees_controls(i)}
    of_levels = {"sigma.hidden", "cond", "cond.modulations", "out.modulation"}
    assert of_layers and products == of_levels | of_layers | {"ctrl.hidden", "ctrl.emb.unit"}


def test_a_pass_has_no_weights_of_its_conditioning():
    graph = build_graphs(TINY, "f16")["transformer"]
    model = graph.model().graph
    of_levels, of_controls, of_pass = ({*graph.used_weights} & weights_of(model, part) for part in (LEVELS, CONTROLS, PASS))
    assert of_levels | of_controls | of_pass == graph.used_weights
    assert not of_levels & (of_controls | of_pass) and not of_controls & of_pass
    expected = {"denoise_step_emb.mlp.fc1", "denoise_step_emb.mlp.fc2", "cond_head.cond_proj", "out_norm.fc"}
    assert of_levels == {f"{name}.weight" for name in expected} | {"cond_head.bias_in"}
    layers = {f"blocks.{i}.ctrl_mlpfusion.fc1_c" for i in range(TINY.layers) if TINY.sees_controls(i)}
    assert of_controls == {f"{name}.weight" for name in layers | {"ctrl_emb.mlp.fc1", "ctrl_emb.mlp.fc2"}}
    # A part ends with its products: what only divides their results among layers runs in a pass.
    assert {node.op_type for node, part in zip(model.node, parts(model)) if part != PASS}.isdisjoint({"Split", "Slice"})


def test_the_command_prints_every_graph_of_every_world(capsys):
    assert main(["costs", "--preset", "tiny"]) == 0
    world = json.loads(capsys.readouterr().out)["tiny"]
    assert world["window"] == TINY.global_window and world["graphs"].keys() == {"transformer", "controls", "encoder", "decoder"}
    name, operator, output, multiply_adds, read, written = world["graphs"]["decoder"][0]
    assert name.endswith(f"/{operator}") and output and multiply_adds >= 0
    assert math.prod((read, written)) > 0 or operator == "Reshape"


def test_worlds_are_told_apart_by_their_names(tiny, tmp_path, capsys):
    """A dot in a folder's name is a part of the name."""
    bundles = [copied(tiny, tmp_path / name) for name in ("waypoint-1.5", "waypoint-1.6")]
    assert main(["costs", *map(str, bundles)]) == 0
    assert json.loads(capsys.readouterr().out).keys() == {"waypoint-1.5", "waypoint-1.6"}
    packed = archive.pack(tiny, tmp_path / "waypoint-1.5.cairn")
    for command in ("costs", "rates"):
        assert main([command, str(bundles[0]), str(packed)]) == 2
        assert "several worlds are called waypoint-1.5" in capsys.readouterr().err


def test_a_bundle_without_f16_graphs_is_refused(tmp_path, capsys):
    bundle = tmp_path / "single"
    assert main(["random", "--precision", "f32", "--out", str(bundle), "--quiet"]) == 0
    assert main(["costs", str(bundle)]) == 2
    assert "single: it has no f16 graphs" in capsys.readouterr().err


def test_a_command_without_a_world_is_refused(capsys):
    assert main(["costs"]) == 2
    assert "no world is named" in capsys.readouterr().err
