"""The measurement of which layers to keep in 16 bits: its errors beside those of bundles that are quantised so, and the list it proposes."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, TINY, relative, session
from rollout import rope

from cairn.build import cli, sensitivity
from cairn.build.errors import BuildError
from cairn.build.quantise import KEPT, Quantisation, is_kept
from cairn.build.sensitivity import measure, rope_tables
from cairn.build.weights import stored_transformer

MINIATURE = ROOT / "samples" / "worlds" / "miniature.cairn"


@pytest.fixture(scope="module")
def report(tiny):
    return measure(tiny, 8, bound=0.003, walks=2, threads=1)


def error_of(bundle, tiny, walks=2):
    """The error of a quantised bundle's own graph in the passes that the measurement of `tiny` uses."""
    measurement = sensitivity._Measurement(tiny, Quantisation(8, kept=()), walks, 1, lambda *_: None)
    graph = session(bundle, "transformer", "f32", TINY.dimensions(TINY.global_dilation))
    worst = [
        max(relative(graph.run(None, inputs)[0], truth) for inputs, truth in zip(walk, truths))
        for walk, truths in zip(measurement.walks, measurement.truth)
    ]
    return np.sqrt(np.mean(np.square(worst)))


def quantised(tiny, out, kept):
    assert cli.main(["quantise", str(tiny), "--weights", "8", "--keep-16", kept, "--out", str(out), "--quiet"]) == 0
    return out


def test_every_matrix_that_quantise_takes_is_measured(tiny, report):
    names = {f"{name}.weight" for name in report.matrices}
    everything = Quantisation(8, kept=())
    taken = {packed.whole.name for packed in stored_transformer(TINY) if everything.quantises(packed.whole)}
    assert names == taken and len(names) == 41 and list(report.layers) == [f"blocks.{i}" for i in range(8)]
    errors = list(report.matrices.values())
    assert errors == sorted(errors, reverse=True) and errors[-1] > 0
    # Errors are nearly independent: those of the matrices add up to that of all of them by their squares.
    assert report.all == pytest.approx(np.sqrt(np.sum(np.square(errors))), rel=0.3)


def test_errors_are_those_of_quantised_bundles(tiny, report, tmp_path):
    assert error_of(quantised(tiny, tmp_path / "all", "none"), tiny) == pytest.approx(report.all, rel=1e-3)
    first = next(iter(report.matrices))
    others = ",".join(name for name in report.matrices if name != first)
    assert error_of(quantised(tiny, tmp_path / "one", others), tiny) == pytest.approx(report.matrices[first], rel=1e-3)
    others = ",".join(layer for layer in report.layers if layer != "blocks.2")
    assert error_of(quantised(tiny, tmp_path / "layer", others), tiny) == pytest.approx(report.layers["blocks.2"], rel=1e-3)


def test_the_proposed_list_keeps_to_the_bound(tiny, report, tmp_path):
    assert report.left <= 0.003 < report.all and 0 < report.kept_share < 0.5
    found = error_of(quantised(tiny, tmp_path / "kept", ",".join(report.kept)), tiny)
    assert found == pytest.approx(report.left, rel=1e-3)


def test_a_bound_that_all_matrices_keep_to_needs_no_list(tiny):
    loose = measure(tiny, 8, bound=0.5, walks=1, threads=1)
    assert loose.kept == () and loose.left == loose.all and "--keep-16 none\n" in sensitivity.table(loose)


def test_no_error_can_be_asked_for_with_everything_in_16_bits(tiny):
    strict = measure(tiny, 4, bound=1e-7, walks=1, threads=1)
    assert strict.kept == tuple(f"blocks.{i}" for i in range(8)) and (strict.left, strict.kept_share) == (0.0, 1.0)
    text = sensitivity.table(strict)
    assert "for at most 0.000 %: nothing can be quantised; the least error of one matrix is " in text and "--keep-16" not in text


def test_a_matrix_that_fits_alone_is_found():
    """The large matrix is the last that the order keeps in 16 bits, and is beyond the bound; a small one is within."""
    measurement = object.__new__(sensitivity._Measurement)
    errors, sizes = {"blocks.0.large": 0.5, "blocks.1.small": 0.001, "blocks.1.other": 0.002}, (10**9, 4, 2)
    measurement.quantisation, measurement.names, measurement.layers = Quantisation(8, kept=()), list(errors), ["blocks.0", "blocks.1"]
    measurement.model = SimpleNamespace(matrices={name: SimpleNamespace(size=size) for name, size in zip(errors, sizes)})
    measurement.progress, measurement.total = (lambda *_: None), 1
    measurement.error = lambda names, what: float(np.sqrt(sum(errors[name] ** 2 for name in names)))
    report = measurement.report(0.01)
    assert (report.kept, report.left) == (("blocks.0", "blocks.1.other"), 0.001)
    assert "--keep-16 blocks.0,blocks.1.other\n" in sensitivity.table(report)


def test_the_default_of_the_embedded_world_is_found():
    report = measure(MINIATURE, 8, walks=2)
    assert all(is_kept(name, KEPT) for name in list(report.matrices)[:2]), "the two matrices with the largest errors"
    assert report.left <= sensitivity.BOUND < report.all
    assert all(any(is_kept(name, [kept]) for kept in KEPT) for name in report.kept)


def test_names_are_shortened_only_where_all_within_are_kept():
    names = [f"blocks.{i}.{part}" for i in range(2) for part in ("attn.qkv", "attn.out", "mlp.fc1")]
    shortened = sensitivity._shortened
    assert shortened(names[:2], names) == ("blocks.0.attn",)
    assert shortened([names[4], *names[:3]], names) == ("blocks.0", "blocks.1.attn.out")
    assert shortened([], names) == ()
    assert not is_kept("blocks.10.mlp", ["blocks.1"])


def test_the_command_prints_the_table_and_its_progress(tiny, capsys):
    assert cli.main(["sensitivity", str(tiny), "--bound", "0.003", "--walks", "1", "--threads", "1"]) == 0
    done = capsys.readouterr()
    lines = done.out.splitlines()
    assert lines[0].startswith("in 8 bits") and lines[1].endswith("%  yes") and "--keep-16 blocks.0" in done.out
    assert done.err.splitlines()[-1].startswith("100.0 %  [####################]") and " passes " in done.err


@pytest.mark.parametrize("options, field", [(("--bound", "0"), "--bound"), (("--bound", "nan"), "--bound"), (("--walks", "0"), "--walks")])
def test_other_options_are_refused(tiny, capsys, options, field):
    assert cli.main(["sensitivity", str(tiny), "--quiet", *options]) == 2
    assert f"error: {field}: " in capsys.readouterr().err


def test_a_bundle_with_smaller_weights_is_refused(tiny, tmp_path):
    small = quantised(tiny, tmp_path / "small", "none")
    with pytest.raises(BuildError, match="16-bit numbers are lost"):
        measure(small, 8)


@pytest.mark.parametrize("rounding", ["none", "bf16"])
@pytest.mark.parametrize("time", [0, 7])
def test_rotation_tables_are_those_of_the_format(rounding, time):
    tables, expected = rope_tables(TINY, time, rounding), rope(TINY, time)
    worst = max(np.abs(found - wanted).max() for found, wanted in zip(tables, expected))
    assert worst == 0 if rounding == "none" else 0 < worst < 0.1
