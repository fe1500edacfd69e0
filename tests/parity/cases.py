"""The rollouts that are checked, by name; each has options of the trace program."""

import os

# Where the rollouts run: `cpu`, `d3d12` for DirectML, or `webgpu` for the WebGPU provider.
DEVICE = os.environ.get("PARITY_DEVICE", "cpu")
# Two short rollouts instead of all, for test runs on a device that the processor emulates.
SHORT = os.environ.get("PARITY_CASES") == "short"

F32 = 1e-4
F16 = 1e-2
BOUND = {"f32": F32, "f16": F16}
# A mutant must miss its bound by this factor.
MISSED_BY = 10

# Longer than the local window, and over two writes of a global layer: slots are filled, hidden and overwritten.
SHORT_CASES: dict[str, dict] = {
    "short": {"latents": 6, "append": "0,3", "schedule": "explicit:1:0.5:0"},
    "short, half precision": {"latents": 6, "append": "0,3", "schedule": "explicit:1:0.5:0", "precision": "f16"},
    "short, half precision, residual stream in float32": {
        "bundle": "tiny-residual",
        "latents": 6,
        "append": "0,3",
        "schedule": "explicit:1:0.5:0",
        "precision": "f16",
    },
}

# `tiny` has a local window of 4 latents and a global window of 16: both rings wrap twice in 32 commits.
LONG_CASES: dict[str, dict] = {
    "separate cache pass": {"latents": 36},
    "fused cache pass": {"latents": 36, "cache": "fused", "schedule": "refined:6"},
    "every second latent kept": {
        "latents": 68,
        "cache": "interval:2",
        "schedule": "explicit:1:0.7:0.4:0",
        "record": "0,1,2,3,4,5,9,10,13,14,31,32,33,34,40,47,48,61,62,63,64,65,66,67",
    },
    "pictures appended on the way": {"latents": 36, "append": "0,5,6,21"},
    "pictures appended on the way, every third latent kept": {
        "latents": 80,
        "append": "0,9,40",
        "cache": "interval:3",
        "schedule": "explicit:1:0.5:0",
        "record": "0,1,2,3,8,9,10,11,12,13,14,40,41,42,43,44,60,70,77,78,79",
    },
    "no picture at the start": {"latents": 20, "append": "3"},
    "larger global window": {"latents": 40, "global_window": 32, "schedule": "explicit:1:0.5:0"},
    "half precision": {"latents": 36, "append": "0,21", "precision": "f16"},
    "half precision, residual stream in float32": {
        "bundle": "tiny-residual",
        "latents": 36,
        "append": "0,21",
        "precision": "f16",
    },
    "half precision, fused": {"latents": 36, "cache": "fused", "schedule": "refined:6", "precision": "f16"},
}

CASES = SHORT_CASES if SHORT else LONG_CASES

# The autoencoder does not depend on cache modes and windows.
PICTURES = tuple(CASES) if SHORT else ("no picture at the start", "pictures appended on the way", "half precision")

# The released windows, 16 / 8 / 128. Two wraps of the global ring take 256 latents; a schedule of two passes keeps the run short.
WINDOW: dict = {
    "bundle": "window",
    "latents": 261,
    "append": "0,100",
    "schedule": "explicit:1:0.5:0",
    "record": "0,1,7,8,9,15,16,17,31,32,33,100,101,119,120,121,127,128,129,135,136,137,247,248,249,255,256,257,260",
}
