"""A training state on disk, in one file that is replaced atomically, and the training loop that writes it."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from .adversary import PREFIX
from .optimiser import State

# Seconds between two writes of the state.
KEEP_EVERY = 110.0
_PARTS = ("parameters", "mean", "first", "second")


def save(path: Path, state: State, facts: dict) -> None:
    """Writes the state to a temporary file, flushes it, and renames it: a kill leaves the old state or the new one."""
    arrays = {f"{part}/{name}": np.asarray(v) for part in _PARTS for name, v in getattr(state, part).items()}
    arrays["step"], arrays["facts"] = np.asarray(state.step), np.frombuffer(json.dumps(facts).encode(), np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as file:
        np.savez(file, **arrays)
        file.flush()
        os.fsync(file.fileno())
    os.replace(partial, path)


def load(path: Path) -> tuple[State, dict]:
    """Reads a file of `save`."""
    with np.load(path) as file:
        parts: dict[str, dict] = {part: {} for part in _PARTS}
        for key in file.files:
            part, _, name = key.partition("/")
            if name:
                parts[part][name] = jnp.asarray(file[key])
        facts = json.loads(file["facts"].tobytes())
        return State(**parts, step=jnp.asarray(file["step"])), facts


def mean_parameters(path: Path) -> dict[str, np.ndarray]:
    """The running mean without the discriminator, which is evaluated and exported."""
    with np.load(path) as file:
        names = [key.removeprefix("mean/") for key in file.files if key.startswith("mean/")]
        return {name: file[f"mean/{name}"] for name in names if not name.startswith(PREFIX)}


class Interrupted:
    """Turns SIGTERM and SIGINT into a request to stop after the current step."""

    def __init__(self) -> None:
        self.requested = False

    def __enter__(self) -> "Interrupted":
        self._before = {s: signal.signal(s, self._request) for s in (signal.SIGTERM, signal.SIGINT)}
        return self

    def __exit__(self, *_) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _request(self, *_) -> None:
        self.requested = True


def train(
    path: Path,
    initial: Callable[[], State],
    one_step: Callable[[State, int], tuple[State, dict[str, jax.Array]]],
    steps: int,
    minutes: float,
    flops: Callable[[int], float],
    say: Callable[[str], None] = print,
    every: int = 20,
) -> State:
    """Runs `one_step(state, number)` from the state at `path`, or from the start, up to `steps` or until `minutes` have passed.

    The work of step n depends on the state and on n alone, so that an interrupted run continues with the same results.
    `facts` beside the state count hours and floating-point operations of all runs together.
    """
    state, facts = load(path) if path.is_file() else (initial(), {"seconds": 0.0, "flops": 0.0})
    began = kept = printed = time.monotonic()
    sums: dict[str, float] = {}
    counted = 0
    with Interrupted() as stop:
        while (n := int(state.step)) < steps:
            state, figures = one_step(state, n)
            sums = {name: sums.get(name, 0.0) + float(v) for name, v in figures.items()}
            counted += 1
            now = time.monotonic()
            facts["flops"] += flops(n)
            ends = stop.requested or now - began > 60 * minutes or n + 1 >= steps
            if counted >= every or ends:
                text = "  ".join(f"{name} {value / counted:.4g}" for name, value in sums.items())
                hours = (facts["seconds"] + now - began) / 3600
                say(f"step {n + 1}/{steps}  {text}  {hours:.2f} h  {facts['flops']:.3g} FLOP  {(now - printed) / counted:.2f} s/step")
                sums, counted, printed = {}, 0, now
            if ends or now - kept > KEEP_EVERY:
                save(path, state, {**facts, "seconds": facts["seconds"] + now - began})
                kept = now
            if ends:
                break
    return state
