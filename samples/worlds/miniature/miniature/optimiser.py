"""Adam, or for matrices Muon, with decoupled weight decay, a clipped gradient and a running mean of the parameters, as pure functions.

Muon [Jordan et al. 2024, https://kellerjordan.github.io/posts/muon/] updates a matrix by the orthogonal matrix nearest to its momentum, here
scaled as in [Liu et al. 2025, arXiv:2502.16982] to the size of Adam's updates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

Parameters = dict[str, Array]


class State(NamedTuple):
    """Parameters and state of the optimiser."""

    parameters: Parameters
    mean: Parameters  # running mean of the parameters, which is evaluated and exported
    first: Parameters  # Adam's first moments
    second: Parameters  # Adam's second moments; empty for parameters that Muon updates
    step: Array  # int32 []


@dataclass(frozen=True)
class Settings:
    """Settings of the optimiser.

    The learning rate rises over `warm_up` steps, stays, and falls to zero over the last share `cool_down` of all steps.
    """

    rate: float
    steps: int
    warm_up: int = 100
    cool_down: float = 0.3
    decay: float = 0.0
    betas: tuple[float, float] = (0.9, 0.99)
    clip: float = 1.0
    horizon: float = 250.0  # of the running mean, in steps: spans the last stages, each of which trains a part only
    muon_rate: float = 3e-3
    muon_momentum: float = 0.95


def start(parameters: dict, by_muon: Callable[[str], bool] = lambda _: False) -> State:
    """The state before the first step; Muon updates the matrices for whose names `by_muon` is true."""
    # Separate arrays, because a step reuses the memory of the state.
    copies = [{name: jnp.array(value) for name, value in parameters.items()} for _ in range(2)]
    first = {name: jnp.zeros_like(value) for name, value in copies[0].items()}
    second = {name: jnp.zeros((0,)) if by_muon(name) else jnp.zeros_like(value) for name, value in copies[0].items()}
    return State(*copies, first, second, jnp.zeros((), jnp.int32))


def rate_factor(s: Settings, step: Array) -> Array:
    """Learning rate of a step, relative to the full rate."""
    rising = jnp.minimum(1.0, (step + 1) / s.warm_up)
    falling = jnp.clip((s.steps - step) / (s.cool_down * s.steps), 0.0, 1.0)
    return rising * falling


def orthogonal(x: Array) -> Array:
    """Approximately the nearest orthogonal matrix: five steps of the Newton-Schulz iteration with Muon's coefficients."""
    wide = x if x.shape[0] <= x.shape[1] else x.T
    wide = wide / (jnp.linalg.norm(wide) + 1e-7)
    for _ in range(5):
        square = wide @ wide.T
        wide = 3.4445 * wide + (-4.7750 * square + 2.0315 * (square @ square)) @ wide
    return wide if x.shape[0] <= x.shape[1] else wide.T


def orthogonal_by_shape(matrices: Parameters) -> Parameters:
    """`orthogonal` of every matrix; those of one shape are computed together, which spares a GPU hundreds of small kernels."""
    shapes: dict[tuple[int, ...], list[str]] = {}
    for name, x in matrices.items():
        shapes.setdefault(x.shape, []).append(name)
    out = {}
    for names in shapes.values():
        out |= zip(names, jax.vmap(orthogonal)(jnp.stack([matrices[name] for name in names])))
    return out


def update(s: Settings, state: State, gradient: Parameters, at: Array | None = None) -> tuple[State, Array]:
    """The next state, and the norm of the gradient. A gradient that is not finite counts as zero. The learning rate is that of step `at`,
    the state's own unless given: a training that is planned by time has no number of steps.
    """
    norm = jnp.sqrt(sum(jnp.sum(jnp.square(g)) for g in gradient.values()))
    good = jnp.isfinite(norm)
    scale = jnp.where(good, jnp.minimum(1.0, s.clip / (norm + 1e-9)), 0.0)
    gradient = jax.tree.map(lambda g: jnp.where(good, g, 0.0) * scale, gradient)
    n = state.step + 1
    now = rate_factor(s, state.step if at is None else at)
    parameters, first, second = {}, {}, {}
    by_muon = [name for name, p in state.parameters.items() if state.second[name].shape != p.shape]
    momenta = {name: s.muon_momentum * state.first[name] + gradient[name] for name in by_muon}
    directions = orthogonal_by_shape({name: gradient[name] + s.muon_momentum * m for name, m in momenta.items()})
    for name, p in state.parameters.items():
        g, m, v = gradient[name], state.first[name], state.second[name]
        if v.shape == p.shape:
            b1, b2 = s.betas
            m, v = b1 * m + (1 - b1) * g, b2 * v + (1 - b2) * g * g
            direction, speed = (m / (1 - b1**n)) / (jnp.sqrt(v / (1 - b2**n)) + 1e-8), s.rate
        else:
            m = momenta[name]
            direction, speed = 0.2 * max(p.shape) ** 0.5 * directions[name], s.muon_rate
        parameters[name] = p - now * speed * (direction + (s.decay * p if p.ndim > 1 else 0.0))
        first[name], second[name] = m, v
    # At first the mean follows fast, so that it forgets the initial parameters.
    keep = jnp.minimum(1 - 1 / s.horizon, n / (n + 9.0))
    mean = jax.tree.map(lambda e, p: keep * e + (1 - keep) * p, state.mean, parameters)
    return State(parameters, mean, first, second, n), norm
