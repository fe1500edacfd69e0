"""Tests of the oracle: its rules, compared with other formulations of them."""

import numpy as np
import pytest

from oracle import autoencoder, sigmas, visibility
from oracle.geometry import Geometry
from oracle.weights import Weights

STOCK = (1.0, 0.9, 0.75, 0.3, 0.0)


def ring_of_slots(frames: int, buckets: int, dilation: int) -> np.ndarray:
    """Which frames see which, by the released engine's rules: a ring of slots, each hidden before it is overwritten."""
    frame_of_slot: dict[int, int] = {}
    table = np.zeros((frames, frames), dtype=bool)
    for clock in range(frames):
        slot = (clock + dilation - 1) // dilation % buckets
        writes = clock % dilation == 0
        for other, frame in frame_of_slot.items():
            table[clock, frame] = not (writes and other == slot)
        if writes:
            frame_of_slot[slot] = clock
    return table


@pytest.mark.parametrize(("window", "dilation"), [(4, 1), (16, 1), (16, 4), (64, 4), (128, 8), (8, 8), (384, 8)])
def test_visibility_tables_agree_with_a_ring_of_slots(window: int, dilation: int) -> None:
    clocks = np.arange(3 * window + 5)
    expected = ring_of_slots(len(clocks), window // dilation, dilation)
    assert np.array_equal(visibility.global_table(clocks, clocks, window, dilation), expected)
    if dilation == 1:
        assert np.array_equal(visibility.local_table(clocks, clocks, window), expected)


@pytest.mark.parametrize(
    ("schedule", "expected"),
    [
        ("stock", [1, 0.9, 0.75, 0.3, 0]),
        ("explicit:1:0.5:0", [1, 0.5, 0]),
        ("refined:9", [1, 0.9, 0.825, 0.75, 0.6375, 0.525, 0.4125, 0.3, 0.15, 0]),
        ("refined:10", [1, 0.9, 0.825, 0.75, 0.6375, 0.525, 0.4125, 0.3, 0.225, 0.15, 0]),
        ("refined:12", [1, 0.9, 0.825, 0.75, 0.69375, 0.6375, 0.525, 0.4125, 0.3, 0.225, 0.15, 0.075, 0]),
    ],
)
def test_schedules(schedule: str, expected: list[float]) -> None:
    assert np.array_equal(sigmas.table(STOCK, schedule, "none"), np.array(expected, dtype=np.float32))


def test_noise_levels_round_to_bfloat16_as_the_released_engine_runs_them() -> None:
    assert sigmas.table(STOCK, "stock", "bf16").tolist() == [1.0, 0.8984375, 0.75, 0.30078125, 0.0]


def test_decoding_does_not_look_ahead_and_depends_on_the_past(bundles) -> None:
    """A longer clip changes no earlier picture; another first latent changes later ones."""
    weights, geometry = Weights.read(bundles / "tiny").decoder, Geometry.read(bundles / "tiny")
    latents = np.random.default_rng(1).standard_normal((3, geometry.C, geometry.h, geometry.w))
    pictures, _ = autoencoder.decode(weights, latents)
    shorter, _ = autoencoder.decode(weights, latents[:2])
    assert np.array_equal(pictures[:2], shorter)
    other, _ = autoencoder.decode(weights, np.concatenate((latents[:1] + 1, latents[1:])))
    assert not np.allclose(pictures[1], other[1], atol=1e-4)


def test_enlarging_keeps_flat_pictures_flat_and_centres_in_place() -> None:
    flat = np.full((3, 5, 7), 0.25)
    assert np.allclose(autoencoder.resize(flat, 16, 9), 0.25)
    ramp = np.tile(np.arange(4.0), (1, 2, 1))
    assert np.allclose(autoencoder.resize(ramp, 8, 2)[0, 0], [0, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3])
