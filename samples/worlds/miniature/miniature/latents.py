"""Training data of the transformer: clips as latents, with the controls that caused them.

A file holds one walk, as it is and mirrored (walks through a level only as they are: a mirrored level is another place): `moving`
`[2, N, h, w, C]`, the latents of steps 1 to N; `still` `[2, N // STILL_EVERY + 1, h, w, C]`, the latents of stills, as a rollout's seed is one, at the ends of steps 0, STILL_EVERY and so on;
and `controls` `[2, N, 3 + 256]`. float16.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from . import autoencoder
from .clips import BUTTONS, PICTURES_PER_LATENT, Clip

# Key codes that a mirror swaps: A and D.
LEFT, RIGHT = 65, 68
# Latent steps between two possible starts of a rollout. Each start needs a still, which costs as much to encode as a latent step.
STILL_EVERY = 4
# Clips of four pictures that are encoded at once.
AT_ONCE = 16
Arrays = dict[str, np.ndarray]


def mirrored(controls: np.ndarray) -> np.ndarray:
    """The controls that cause the mirrored walk."""
    out = controls.copy()
    out[:, 0] = -out[:, 0]
    out[:, [2 + LEFT, 2 + RIGHT]] = out[:, [2 + RIGHT, 2 + LEFT]]
    assert out.shape[1] == 2 + BUTTONS + 1
    return out


@jax.jit
def _encode(parameters: dict, rgb: jax.Array) -> jax.Array:
    return autoencoder.encode(parameters, rgb.astype(jnp.float32) / 255).astype(jnp.float16)


class Encoder:
    """Encodes clips with one set of parameters."""

    def __init__(self, parameters: dict, at_once: int = AT_ONCE):
        self._parameters = {name: jnp.asarray(value) for name, value in parameters.items()}
        self._at_once = at_once

    def __call__(self, quads: np.ndarray) -> np.ndarray:
        """`[n, 4, H, W, 3]` uint8 -> `[n, h, w, C]` float16."""
        n, step = len(quads), self._at_once
        parts = []
        for i in range(0, n, step):
            part = quads[i : i + step]
            if len(part) < step:
                part = np.concatenate([part, np.repeat(part[-1:], step - len(part), 0)])
            parts.append(np.asarray(_encode(self._parameters, part)))
        return np.concatenate(parts)[:n]


def encode(encoder: Encoder, clip: Clip, mirror: bool = True) -> Arrays:
    """The latents of a clip, as a file holds them."""
    pictures = clip.pictures()
    steps = (len(pictures) - 1) // PICTURES_PER_LATENT
    controls = clip.controls()
    if len(controls) != steps:
        raise ValueError(f"{clip.path} has {steps} steps of pictures and {len(controls)} of controls")
    moving, still = [], []
    for turn in (1, -1) if mirror else (1,):
        turned = pictures[:, :, ::turn]
        quads = turned[1:].reshape(steps, PICTURES_PER_LATENT, *pictures.shape[1:])
        moving.append(encoder(quads))
        still.append(encoder(np.repeat(turned[:: PICTURES_PER_LATENT * STILL_EVERY, None], PICTURES_PER_LATENT, 1)))
    sides = [controls, mirrored(controls)] if mirror else [controls]
    return {"moving": np.stack(moving), "still": np.stack(still), "controls": np.stack(sides).astype(np.float16)}


def encode_clip(encoder: Encoder, clip: Clip, path: Path, mirror: bool = True) -> None:
    """Writes the latents of a clip, whole or not at all."""
    arrays = encode(encoder, clip, mirror)
    partial = path.with_name(path.name + ".partial")
    path.parent.mkdir(parents=True, exist_ok=True)
    with partial.open("wb") as file:
        np.savez(file, **arrays)
    os.replace(partial, path)


class Walks:
    """All walks of a folder in memory, and windows cut out of them."""

    def __init__(self, walks: dict[str, dict[str, np.ndarray]]):
        self.names, self.walks = tuple(walks), tuple(walks.values())
        self.steps = np.array([w["moving"].shape[1] for w in self.walks])

    @classmethod
    def read(cls, folder: Path, checked: Callable[[list[Path]], object] = list) -> "Walks":
        """Reads all walks of a folder; `checked` raises for files that must not be among them."""
        walks = {}
        paths = sorted(folder.glob("*.npz"))
        checked(paths)
        for path in paths:
            with np.load(path) as file:
                walks[path.stem] = {name: file[name] for name in ("moving", "still", "controls")}
        if not walks:
            raise FileNotFoundError(f"{folder} holds no latents")
        return cls(walks)

    def among(self, names: set[str]) -> "Walks":
        """The walks with these names, in the same order."""
        return Walks({name: walk for name, walk in zip(self.names, self.walks) if name in names})

    def window(self, rng: np.random.Generator, frames: int, more_of: str = "", times: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """A rollout of `frames` latents from a seed: `([frames, h, w, C], [frames, 3 + 256])`; the seed has no controls. Windows of
        the family `more_of` are sampled `times` as often as those of another.
        """
        long_enough = np.flatnonzero(self.steps >= frames - 1)
        if not len(long_enough):
            raise ValueError(f"no walk has {frames - 1} steps; the longest has {self.steps.max()}")
        # A long walk has more windows than a short one, but shows one scene only, so its share is the square root of their number.
        starts = (self.steps[long_enough] - frames + 1) // STILL_EVERY + 1
        share = np.sqrt(starts)
        share = share * [times if self.names[walk].partition("-")[0] == more_of else 1.0 for walk in long_enough]
        chosen = rng.choice(len(long_enough), p=share / share.sum())
        walk = self.walks[long_enough[chosen]]
        side, start = rng.integers(len(walk["moving"])), int(rng.integers(starts[chosen]))
        at = start * STILL_EVERY
        latents = np.concatenate([walk["still"][side, start : start + 1], walk["moving"][side, at : at + frames - 1]])
        controls = walk["controls"][side, at : at + frames - 1]
        return latents, np.concatenate([np.zeros_like(controls[:1]), controls])
