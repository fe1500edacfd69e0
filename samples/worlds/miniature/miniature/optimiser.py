"""Adam with decoupled weight decay, a clipped gradient and a running mean of the parameters, as pure functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

Parameters = dict[str, Array]


class State(NamedTuple):
    """All that training changes from step to step."""

    parameters: Parameters
    mean: Parameters  # running mean of the parameters: what is evaluated and exported
    first: Parameters  # Adam's first moments
    second: Parameters  # and second
    step: Array  # int32 []


@dataclass(frozen=True)
class Settings:
    """How fast to learn. The rate rises over `warm_up` steps, stays, and falls to zero over the last `cool_down` of all steps."""

    rate: float
    steps: int
    warm_up: int = 100
    cool_down: float = 0.3
    decay: float = 0.0
    betas: tuple[float, float] = (0.9, 0.99)
    clip: float = 1.0
    horizon: float = 500.0  # of the running mean, in steps


def start(parameters: dict) -> State:
    """The state before the first step."""
    # Four arrays of their own for each: a step takes the state's memory over.
    copies = [{name: jnp.array(value) for name, value in parameters.items()} for _ in range(2)]
    zeros = [{name: jnp.zeros_like(value) for name, value in copies[0].items()} for _ in range(2)]
    return State(*copies, *zeros, jnp.zeros((), jnp.int32))


def rate(s: Settings, step: Array) -> Array:
    """The learning rate at a step."""
    rising = jnp.minimum(1.0, (step + 1) / s.warm_up)
    falling = jnp.clip((s.steps - step) / (s.cool_down * s.steps), 0.0, 1.0)
    return s.rate * rising * falling


def update(s: Settings, state: State, gradient: Parameters) -> tuple[State, Array]:
    """The next state, and the norm of the gradient. A gradient that is not finite moves nothing."""
    norm = jnp.sqrt(sum(jnp.sum(jnp.square(g)) for g in gradient.values()))
    good = jnp.isfinite(norm)
    scale = jnp.where(good, jnp.minimum(1.0, s.clip / (norm + 1e-9)), 0.0)
    gradient = jax.tree.map(lambda g: jnp.where(good, g, 0.0) * scale, gradient)
    b1, b2 = s.betas
    n = state.step + 1
    first = jax.tree.map(lambda m, g: b1 * m + (1 - b1) * g, state.first, gradient)
    second = jax.tree.map(lambda v, g: b2 * v + (1 - b2) * g * g, state.second, gradient)
    lr = rate(s, state.step)

    def moved(p: Array, m: Array, v: Array) -> Array:
        direction = (m / (1 - b1**n)) / (jnp.sqrt(v / (1 - b2**n)) + 1e-8)
        return p - lr * (direction + (s.decay * p if p.ndim > 1 else 0.0))

    parameters = jax.tree.map(moved, state.parameters, first, second)
    # A young mean follows fast, so that it holds nothing of the beginning.
    keep = jnp.minimum(1 - 1 / s.horizon, n / (n + 9.0))
    mean = jax.tree.map(lambda e, p: keep * e + (1 - keep) * p, state.mean, parameters)
    return State(parameters, mean, first, second, n), norm
