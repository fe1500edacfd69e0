"""The runtime's rollouts against the whole history recomputed; see README.md for what is compared and why."""

import numpy as np
import pytest

from cases import BOUND, CASES, F32, PICTURES, WINDOW
from comparison import Runner, Trace, worst


@pytest.fixture(params=[pytest.param(options, id=name) for name, options in CASES.items()])
def trace(request: pytest.FixtureRequest, run: Runner) -> Trace:
    """Every case in turn."""
    return run(**request.param)


@pytest.fixture
def real_windows(run: Runner) -> Trace:
    """The bundle with the released model's windows, through two wraps of its global ring."""
    return run(**WINDOW)


def bound(trace: Trace) -> float:
    return BOUND[trace.record["precision"]]


def check_passes(trace: Trace) -> None:
    deviations = list(trace.passes())
    assert len(deviations) > len(trace.tested) * 2 * trace.geometry.layers
    for quantity in ("v", "k", "value"):
        found = worst(deviations, quantity)
        assert found.distance <= bound(trace), found


def check_ring(trace: Trace) -> None:
    deviations = list(trace.ring())
    for quantity in ("ring k", "ring value"):
        found = worst(deviations, quantity)
        assert found.distance <= bound(trace), found


def check_flags(trace: Trace) -> None:
    layers = range(trace.geometry.layers)
    kinds = [next(i for i in layers if trace.geometry.is_global(i) == wide) for wide in (False, True)]
    for q, step in enumerate(trace.record["steps"]):
        for layer, flags in zip(kinds, step["written"]):
            assert {slot for slot, flag in enumerate(flags) if flag} == set(trace.expected_slots(layer, q)), (q, layer)


def check_frozen(trace: Trace) -> None:
    names = set()
    for latent, name, before, after in trace.frozen():
        assert before == after, f"latent {latent}: {name} changed the ring"
        names.add(name)
    assert {"pass 0", "denoise passes"} <= names
    for q in trace.tested:
        step = trace.record["steps"][q]["step"]
        assert (step["before"] != step["after"]) == trace.keeps(q), f"latent {q}"


def test_velocity_and_slabs_of_every_pass(trace: Trace) -> None:
    check_passes(trace)


def test_every_slot_holds_the_latent_it_should(trace: Trace) -> None:
    check_ring(trace)


def test_written_flags(trace: Trace) -> None:
    check_flags(trace)


def test_only_a_commit_changes_the_ring(trace: Trace) -> None:
    check_frozen(trace)


@pytest.mark.parametrize("case", PICTURES)
def test_pictures_and_decoder_memories(run: Runner, case: str) -> None:
    trace = run(**CASES[case])
    deviations = list(trace.pictures())
    for quantity in {d.quantity for d in deviations}:
        found = worst(deviations, quantity)
        assert found.distance <= bound(trace), found
    assert {"picture", "memory", "appended latent"} == {d.quantity for d in deviations}


@pytest.mark.parametrize("case", PICTURES)
def test_pictures_as_they_are_shown(run: Runner, case: str) -> None:
    trace = run(**CASES[case])
    # Half a level for rounding to 8 bits. A picture is resized in float32 also where the decoder's numbers are float16.
    latent, levels = max(trace.displayed(), key=lambda found: found[1])
    assert levels <= 0.5 + 255 * F32, f"latent {latent}"


def test_steps_end_where_their_passes_lead(trace: Trace) -> None:
    """The latent of a step equals the Euler sum of the velocities from the separate frozen passes."""
    for q in trace.tested:
        if not trace.steps[q].appended:
            passes = trace.record["steps"][q]["passes"]
            end = trace[f"{q}.{passes}.x"]
            assert np.linalg.norm(trace.steps[q].latent - end) <= bound(trace) * np.linalg.norm(end), q


def test_the_past_carries_the_velocity(trace: Trace) -> None:
    """Otherwise no comparison here could detect a fault in the ring."""
    for level, share in trace.variance_from_the_past().items():
        assert share >= 0.3, f"noise level {level}"


def test_real_windows_velocity_and_slabs(real_windows: Trace) -> None:
    check_passes(real_windows)


def test_real_windows_slots_and_flags(real_windows: Trace) -> None:
    check_ring(real_windows)
    check_flags(real_windows)
    check_frozen(real_windows)
    layer = next(i for i in range(real_windows.geometry.layers) if real_windows.geometry.is_global(i))
    first, last = real_windows.expected_slots(layer, 127), real_windows.expected_slots(layer, 260)
    assert len(first) == len(last) == 16 and not set(first.values()) & set(last.values()), "the global ring wrapped"


def test_real_windows_past_carries_the_velocity(real_windows: Trace) -> None:
    assert min(real_windows.variance_from_the_past().values()) >= 0.3
