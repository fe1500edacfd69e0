"""Ten faults. Each must exceed the bound of a comparison by a factor of ten, which shows that the comparisons detect faults."""

from pathlib import Path

import pytest

from cases import F32, MISSED_BY
from surgery import FAULTS, faulty_bundle
from comparison import Runner, Trace, worst

# Long enough that both rings are full and have begun to wrap; pictures are appended on the way.
ROLLOUT: dict = {"latents": 24, "append": "0,9", "record": "0,1,4,5,9,10,11,16,17,18,19,20,21,22,23"}
IN_PLANS = (
    "slot-off-by-one",
    "evicted-slot-visible",
    "bucket-floor-for-ceil",
    "rope-time-off-by-one",
    "control-of-neighbour-step",
    "sigma-of-neighbour-step",
)


def passes(trace: Trace) -> float:
    """The largest deviation of a velocity or slab, divided by the bound."""
    return worst(list(trace.passes()), "v", "k", "value").distance / F32


def pictures(trace: Trace) -> float:
    """The largest deviation of a picture, divided by the bound."""
    return worst(list(trace.pictures()), "picture").distance / F32


@pytest.fixture
def report(record_property, request: pytest.FixtureRequest):
    """Records the factor in the test's result, for `--junit-xml` and `-rP`."""

    def report(factor: float) -> float:
        record_property("missed_by", factor)
        print(f"{request.node.name}: misses the bound {factor:.0f}-fold")
        return factor

    return report


def test_without_a_fault_all_bounds_are_kept(run: Runner) -> None:
    trace = run(**ROLLOUT)
    assert passes(trace) <= 1
    assert pictures(trace) <= 1
    assert all(before == after for _, _, before, after in trace.frozen())


@pytest.mark.parametrize("mutant", IN_PLANS)
def test_fault_in_the_plan_shows_in_velocity_or_slabs(run: Runner, report, mutant: str) -> None:
    assert report(passes(run(**ROLLOUT, mutant=mutant))) >= MISSED_BY


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_in_the_graph_shows_in_velocity_or_slabs(
    run: Runner, report, bundles: Path, tmp_path: Path, fault: str
) -> None:
    bundle = faulty_bundle(bundles / "tiny", fault, tmp_path / "bundle")
    assert report(passes(run(bundle=bundle, **ROLLOUT, oracle_bundle=bundles / "tiny"))) >= MISSED_BY


def test_slot_written_on_a_frozen_pass_shows_in_the_rings_bytes(run: Runner) -> None:
    trace = run(**ROLLOUT, mutant="slot-written-on-frozen-pass")
    changed = {(q, name) for q, name, before, after in trace.frozen() if before != after}
    assert changed == {(q, "denoise passes") for q in trace.tested if not trace.steps[q].appended}


def test_unprimed_decoder_shows_in_the_pictures(run: Runner, report) -> None:
    assert report(pictures(run(**ROLLOUT, mutant="unprimed-decoder"))) >= MISSED_BY
