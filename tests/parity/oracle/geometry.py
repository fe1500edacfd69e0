"""Shapes of a world, from its manifest."""

import json
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Geometry:
    """The numbers of `docs/bundle.md` section 3 that the oracle needs, by their short names."""

    layers: int
    D: int
    heads: int
    kv_heads: int
    head_width: int
    C: int
    h: int
    w: int
    patch: tuple[int, int]
    T: int
    local_window: int
    global_window: int
    dilation: int
    period: int
    offset: int
    control_period: int
    nyquist_fraction: float
    rope_rounding: str
    time_base: float
    time_multiplier: int
    decoded: tuple[int, int]
    render: tuple[int, int]
    schedule: tuple[float, ...]
    sigma_rounding: str
    temporal: int

    @classmethod
    def read(cls, bundle: Path) -> "Geometry":
        manifest = json.loads((bundle / "cairn-world.json").read_text(encoding="utf-8"))
        g = manifest["geometry"]
        return cls(
            layers=g["layers"],
            D=g["width"],
            heads=g["heads"],
            kv_heads=g["kv_heads"],
            head_width=g["head_width"],
            C=g["latent"]["channels"],
            h=g["latent"]["height"],
            w=g["latent"]["width"],
            patch=tuple(g["patch"]),
            T=g["tokens"],
            local_window=g["local"]["window"],
            global_window=g["global"]["window"],
            dilation=g["global"]["dilation"],
            period=g["global"]["period"],
            offset=g["global"]["offset"],
            control_period=g["control_period"],
            nyquist_fraction=g["rope"]["nyquist_fraction"],
            rope_rounding=g["rope"]["rounding"],
            time_base=g["rope"]["time_base"],
            time_multiplier=manifest["rates"]["time_multiplier"],
            decoded=tuple(manifest["picture"]["decoded"]),
            render=tuple(manifest["picture"]["render"]),
            schedule=tuple(manifest["sampler"]["schedule"]),
            sigma_rounding=manifest["sampler"]["sigma_rounding"],
            temporal=g["autoencoder"]["temporal"],
        )

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the token grid."""
        return self.h // self.patch[0], self.w // self.patch[1]

    def is_global(self, layer: int) -> bool:
        return (layer - self.offset) % self.period == 0

    def sees_controls(self, layer: int) -> bool:
        return layer % self.control_period == 0
