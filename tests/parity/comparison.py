"""Reads the trace program's files and compares them with the oracle."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from oracle import autoencoder, history, transformer
from oracle.geometry import Geometry
from oracle.history import Step, Test
from oracle.weights import Weights


def relative(actual: np.ndarray, expected: np.ndarray, scale: np.ndarray | None = None) -> float:
    """L2 norm of `actual - expected`, divided by the larger of the norms of `expected` and `scale`. Infinite if `actual` has a number
    that is not finite.
    """
    assert actual.shape == expected.shape, f"{actual.shape} is not {expected.shape}"
    if not np.isfinite(actual).all():
        return float("inf")
    size = max(np.linalg.norm(of.astype(np.float64)) for of in (expected, scale) if of is not None)
    return float(np.linalg.norm(actual.astype(np.float64) - expected) / size)


@dataclass(frozen=True)
class Deviation:
    """One comparison."""

    quantity: str  # "v", "k", "value", "ring k", "ring value", "picture", "memory", "appended latent"
    latent: int
    index: int | str  # pass, layer or memory
    distance: float  # relative L2


def worst(deviations: Iterator[Deviation] | list[Deviation], *quantities: str) -> Deviation:
    """The largest deviation of any of `quantities`; there must be one."""
    return max((d for d in deviations if d.quantity in quantities), key=lambda d: d.distance)


class Trace:
    """A recorded rollout, with the geometry and the weights of its bundle."""

    def __init__(self, bundle: Path, folder: Path) -> None:
        self.geometry = Geometry.read(bundle)
        self.weights = Weights.read(bundle)
        self.record = json.loads((folder / "trace.json").read_text(encoding="utf-8"))
        self.tensors = load_file(folder / "trace.safetensors")

    def __getitem__(self, name: str) -> np.ndarray:
        return self.tensors[name]

    @property
    def mode(self) -> str:
        return self.record["cache"]

    @property
    def tested(self) -> list[int]:
        """Latents whose passes were all recorded."""
        return [q for q, step in enumerate(self.record["steps"]) if step["recorded"]]

    @cached_property
    def steps(self) -> list[Step]:
        return [
            Step(
                appended=step["appended"],
                mouse=tuple(step["mouse"]),
                keys=tuple(step["keys"]),
                scroll=step["scroll"],
                latent=self[f"{q}.latent"],
                inputs=[self[f"{q}.{p}.x"] for p in range(step["passes"]) if f"{q}.{p}.x" in self.tensors],
            )
            for q, step in enumerate(self.record["steps"])
        ]

    @cached_property
    def batch(self) -> tuple[transformer.Frames, list[int], list[Test]]:
        return history.frames(self.geometry, self.steps, self.mode, self.record["schedule"], self.tested)

    def oracle(self, *, blind: bool = False) -> transformer.Result:
        """The whole history, recomputed."""
        return transformer.run(
            self.weights.transformer, self.geometry, self.batch[0], self.record["global_window"], blind=blind
        )

    @cached_property
    def expected(self) -> transformer.Result:
        return self.oracle()

    def passes(self) -> Iterator[Deviation]:
        """The velocity and every key and value slab of every recorded pass."""
        _, kept, tests = self.batch
        for row, test in enumerate(tests, start=len(kept)):
            prefix = f"{test.latent}.{test.index}"
            # In f16, v is a difference of rounded numbers: its rounding error scales with x.
            scale = self[f"{prefix}.x"] if self.record["precision"] == "f16" else None
            distance = relative(self[f"{prefix}.v"], self.expected.v[row], scale)
            yield Deviation("v", test.latent, test.index, distance)
            for layer in range(self.geometry.layers):
                for name, slabs in (("k", self.expected.keys), ("value", self.expected.values)):
                    actual = self[f"{prefix}.{name}.{layer}"][0]
                    yield Deviation(name, test.latent, layer, relative(actual, slabs[layer][row]))

    def ring(self) -> Iterator[Deviation]:
        """Every filled slot after every recorded latent, compared with the frame that it should contain."""
        for q in self.tested:
            for layer in range(self.geometry.layers):
                rows = self.expected_slots(layer, q)
                for name, slabs in (("k", self.expected.keys), ("value", self.expected.values)):
                    slots = self.slots(f"{q}.ring.{name}.{layer}")
                    for slot, row in rows.items():
                        yield Deviation(f"ring {name}", q, layer, relative(slots[:, slot], slabs[layer][row]))

    def slots(self, name: str) -> np.ndarray:
        """A ring as `[kv_heads, slots, T, head_width]`."""
        g = self.geometry
        return self[name].reshape(g.kv_heads, -1, g.T, g.head_width)

    def keeps(self, q: int) -> bool:
        """Whether latent `q` enters the ring."""
        return q in self.batch[1]

    def expected_slots(self, layer: int, q: int) -> dict[int, int]:
        """Maps each filled slot to the row of the batch whose frame it should contain after latent `q`."""
        batch, kept, _ = self.batch
        g = self.geometry
        dilation = g.dilation if g.is_global(layer) else 1
        buckets = self.record["global_window"] // dilation if g.is_global(layer) else g.local_window
        rows = {}
        for row, latent in enumerate(kept):
            clock = int(batch.clock[row])
            if latent <= q and clock % dilation == 0:
                rows[clock // dilation % buckets] = row
        return rows

    @cached_property
    def decoded(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Pictures and decoder memories of all latents, decoded as one clip."""
        latents = np.array([step.latent for step in self.steps], dtype=np.float64)
        return autoencoder.decode(self.weights.decoder, latents)

    def pictures(self) -> Iterator[Deviation]:
        """Pictures and decoder memories of every recorded latent, and latents of appended pictures."""
        pictures, memories = self.decoded
        for q in self.tested:
            yield Deviation("picture", q, 0, relative(self[f"{q}.rgb"], pictures[q]))
            for index, memory in enumerate(memories):
                yield Deviation("memory", q, index, relative(self[f"{q}.memory.{index}"][0], memory[q]))
            if self.steps[q].appended:
                yield Deviation("appended latent", q, 0, relative(self.steps[q].latent, self.encoded(q)))

    def displayed(self) -> Iterator[tuple[int, float]]:
        """For every picture at render size, in 8 bits: its latent, and its largest difference from the run's own picture, resized, in levels of
        8 bits."""
        width, height = self.geometry.render
        for q in self.tested:
            for i, picture in enumerate(self[f"{q}.rgb"]):
                exact = autoencoder.resize(picture, width, height).transpose(1, 2, 0) * 255
                actual = self[f"{q}.shown.{i}"]
                assert (actual[:, :, 3] == 255).all(), "pictures are opaque"
                yield q, float(np.abs(actual[:, :, :3] - exact).max())

    def encoded(self, q: int) -> np.ndarray:
        """The latent of appended picture `q`: four equal pictures, stretched to the autoencoder's size."""
        rgba = self[f"{q}.picture"].astype(np.float64) / 255
        picture = autoencoder.resize(rgba[:, :, :3].transpose(2, 0, 1), *self.geometry.decoded)
        return autoencoder.encode(self.weights.encoder, np.repeat(picture[None], self.geometry.temporal, axis=0))

    def variance_from_the_past(self) -> dict[float, float]:
        """For each noise level: the share of the variance of v that a velocity computed without past frames does not explain, at the
        best factor. Over all recorded denoise passes whose local ring is full."""
        blind = self.oracle(blind=True)
        batch, kept, tests = self.batch
        levels: dict[float, list[int]] = {}
        for row, test in enumerate(tests, start=len(kept)):
            if test.index != history.CACHE_PASS and batch.clock[row] >= self.geometry.local_window:
                levels.setdefault(float(batch.sigma[row]), []).append(row)
        return {
            level: 1 - np.corrcoef(self.expected.v[rows].ravel(), blind.v[rows].ravel())[0, 1] ** 2
            for level, rows in levels.items()
        }

    def frozen(self) -> Iterator[tuple[int, str, str, str]]:
        """For every pass that must not write: latent, name, and digests of the ring before and after."""
        for q, step in enumerate(self.record["steps"]):
            for entry in step["frozen"]:
                yield q, entry["name"], entry["before"], entry["after"]


Runner = Callable[..., Trace]
