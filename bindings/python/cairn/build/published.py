"""Rates of Waypoint-1.5 that others published with the GPU's name. None of them was measured here.

Four pictures make a latent: sources that count pictures per second are divided by four. All ran the stock schedule, four passes and the
cache pass.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Point:
    """One published rate."""

    gpu: str
    model: str  # of `PRESETS`
    bits: int  # of the products of the transformer: 16 or 8
    precision: str
    program: str
    source: str
    rate: float  # latents per second
    decoder: bool = True  # whether it includes the decoder
    latents: int = 0  # past latents in every layer, where the program keeps fewer than the stock windows


_ENGINE = "`world_engine`, PyTorch"
_CARD = "[the model's page](https://huggingface.co/Overworld/Waypoint-1.5-1B)"
_QUARK = "[quark](https://github.com/Overworldai/quark), page WAYPOINT_15"
_CUDA = "`worldmodel.cu`, CUDA, 8 past latents"
_REPOSITORY = "[its repository](https://github.com/Wimacs/worldmodel.cu)"
_CUDA_PAGE = f"{_REPOSITORY}, page cuda_w8a8_optimization"
_MSTAR = "[its repository](https://github.com/mstar-project/mstar), page OPTIMIZATION_BACKLOG"
_NOTES = "a user's notes; no page to name"

POINTS = (
    Point("GeForce RTX 5090", "720p", 16, "bfloat16", _ENGINE, _CARD, 56 / 4),
    Point("GeForce RTX 5090", "720p", 16, "bfloat16", _ENGINE, _QUARK, 7.6, decoder=False),
    Point("GeForce RTX 4080 Laptop", "360p", 16, "bfloat16", _ENGINE, _NOTES, 74 / 4),
    Point(
        "GeForce RTX 4090 D", "360p", 16, "float16 weights", _CUDA, f"{_REPOSITORY}, page cuda_cutlass_kernels", 102.2 / 4, latents=8
    ),
    Point("GeForce RTX 4090 D", "360p", 16, "float16 weights", _CUDA, _CUDA_PAGE, 98.94 / 4, latents=8),
    Point("GeForce RTX 4090 D", "720p", 16, "float16 weights", _CUDA, f"{_REPOSITORY}, an earlier version", 32 / 4, latents=8),
    Point("GeForce RTX 4090 D", "720p", 16, "float16 weights", _CUDA, _CUDA_PAGE, 29.10 / 4, latents=8),
    Point(
        "GeForce RTX 4090 D",
        "360p",
        16,
        "float16 weights",
        "`worldmodel.cu`, Vulkan, 8 past latents",
        f"{_REPOSITORY}, page vulkan_optimization",
        42.25 / 4,
        latents=8,
    ),
    Point("H100", "360p", 16, "bfloat16", "`mstar`, a server that streams pictures", _MSTAR, 3.268 * 15),
    Point("H100", "720p", 16, "bfloat16", "`mstar`, a server that streams pictures", _MSTAR, 0.570 * 15),
    Point("GeForce RTX 5090", "720p", 8, "w8a8", _ENGINE, _CARD, 72 / 4),
    Point("GeForce RTX 3090", "720p", 8, "w8a8", _ENGINE, _CARD, 30 / 4),
    Point("GeForce RTX 5090", "720p", 8, "float8", "`quark`", _QUARK, 13.8, decoder=False),
    Point("GeForce RTX 4090", "720p", 8, "float8", "`quark`", _QUARK, 12.2, decoder=False),
    Point("GeForce RTX 4080 Laptop", "360p", 8, "float8", _ENGINE, _NOTES + "; 21.8 to 23.3", 87 / 4),
    Point("GeForce RTX 4090 D", "720p", 8, "int8", _CUDA, _CUDA_PAGE, 46.81 / 4, latents=8),
    Point("GeForce RTX 4090 D", "360p", 8, "int8", _CUDA, _CUDA_PAGE, 109.27 / 4, latents=8),
)
