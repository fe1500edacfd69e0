"""The rules by which a rollout's latents enter the ring, and the batch of all frames that follows from them.

| cache mode | the frame that a generated latent commits |
|---|---|
| `separate` | the clean latent at noise level 0, with the same controls |
| `fused` | the input of its last denoise pass, at that pass's level |
| `interval:k` | every k-th generated latent as in `separate`; the others commit nothing and do not advance the ring clock |

An appended picture always commits its clean latent at level 0 with all controls zero.
"""

from dataclasses import dataclass

import numpy as np

from .geometry import Geometry
from .sigmas import table
from .transformer import Frames


@dataclass(frozen=True)
class Step:
    """One latent of a rollout, from the script: nothing here comes from the runtime's plan."""

    appended: bool
    mouse: tuple[float, float]
    keys: tuple[int, ...]
    scroll: float
    latent: np.ndarray  # [C, h, w] the clean latent, teacher-forced
    inputs: list[np.ndarray]  # the input of each denoise pass, teacher-forced; empty where it was not recorded


CACHE_PASS = "cache"


@dataclass(frozen=True)
class Test:
    """A frame under test: denoise pass number `index` of latent `latent`, or its cache pass on the clean latent."""

    latent: int
    index: int | str


def controls(step: Step) -> np.ndarray:
    """Mouse, one number per Windows virtual key, sign of the wheel; all zero for an appended picture."""
    row = np.zeros(2 + 256 + 1)
    if step.appended:
        return row
    row[0:2] = step.mouse
    row[[2 + key for key in step.keys]] = 1
    row[-1] = np.sign(step.scroll)
    return row


def commits(steps: list[Step], mode: str) -> list[bool]:
    """For each latent, whether it enters the ring."""
    name, _, interval = mode.partition(":")
    generated, out = 0, []
    for step in steps:
        generated += not step.appended
        out.append(step.appended or name != "interval" or generated % int(interval) == 0)
    return out


def frames(
    geometry: Geometry, steps: list[Step], mode: str, schedule: str, tested: list[int]
) -> tuple[Frames, list[int], list[Test]]:
    """The whole history as one batch: first the kept frames, then the frames under test, those of the latents `tested`.

    Returns the batch, the latent number of each kept frame, and a description of each frame under test.
    """
    levels = table(geometry.schedule, schedule, geometry.sigma_rounding)
    passes = len(levels) - 1
    kept_flags = commits(steps, mode)
    clocks = np.concatenate(([0], np.cumsum(kept_flags)))

    rows: list[tuple] = []

    def add(q: int, index: int | str, kept: bool) -> None:
        step = steps[q]
        x, sigma = (step.latent, 0.0) if index == CACHE_PASS else (step.inputs[index], levels[index])
        rows.append((x, sigma, q * geometry.time_multiplier, clocks[q], controls(step), kept))

    kept = [q for q, flag in enumerate(kept_flags) if flag]
    for q in kept:
        add(q, passes - 1 if mode == "fused" and not steps[q].appended else CACHE_PASS, True)

    tests = []
    for q in tested:
        own_pass = kept_flags[q] and (mode != "fused" or steps[q].appended)
        for index in [*range(0 if steps[q].appended else passes), *([CACHE_PASS] if own_pass else [])]:
            tests.append(Test(q, index))
            add(q, index, False)

    x, sigma, time, clock, control, keeps = zip(*rows)
    batch = Frames(
        x=np.array(x, dtype=np.float64),
        sigma=np.array(sigma, dtype=np.float64),
        time=np.array(time, dtype=np.float64),
        clock=np.array(clock, dtype=np.int64),
        controls=np.array(control),
        kept=np.array(keeps),
    )
    return batch, kept, tests
