"""`python -m cairn doctor`: checks whether Cairn works here, and explains what to do if it does not."""

from __future__ import annotations

import os
import platform
import sys
import textwrap
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

from . import _library, _onnxruntime
from .controls import Controls
from .errors import Error, Unsupported
from .world import Device, Requirement, World, adapters, requirements

_T = TypeVar("_T")

_WIDTH = 100

# The reason for each requirement, for users who want to repair an installation.
_WHY = {
    "python": "The package needs Python 3.11 or newer. It calls the library through ctypes, so both must have 64 bits.",
    "library": "Cairn itself: one shared library in Rust, with the C interface of include/cairn.h. This package is a thin layer over it.",
    "onnxruntime": "ONNX Runtime runs the world's neural networks. It is not part of Cairn and is loaded when a device is made.",
    "platform": "The processor and the system the library was built for.",
    "memory": "A world keeps its weights and its memory of the past in the system's memory; `world.memory` has the figures.",
    "fsr": "AMD's signed libraries generate frames if they are installed. They are not part of Cairn; its own generators do not need them.",
    "fsr-provider": "A provider is AMD's implementation of frame generation: in its libraries, or, often newer, in a Radeon's driver.",
    "fsr-system": "Providers with a neural network (ml) need Windows 11 and an RDNA 4 adapter; those without (analytic) need neither.",
    "fsr-direct3d": "A program selects a newer Direct3D 12 (Agility SDK) by exporting D3D12SDKVersion and D3D12SDKPath.",
    "fsr-shaders": "A provider's shaders need a shader model, which adapter, driver and Direct3D 12 must support.",
    "device": "A device is what a world runs on. The CPU device works on every system.",
    "webgpu": "With this provider of ONNX Runtime, worlds run on graphics adapters: by Vulkan on Linux, by Direct3D 12 or Vulkan on Windows.",
    "adapter": "A graphics adapter makes latents many times faster than a processor.",
    "auto": "What `Device.auto` and `--device auto` take.",
    "world": "A world is a bundle: graphs, weights, licence and checksums (docs/bundle.md).",
    "float16": "Graphs in f16 run on graphics adapters. A value above 65504 is infinite there, so a latent is made in f32 as well and compared.",
    "step": "A step makes the next latent of a rollout from the player's controls, and pictures of it.",
}

_REMEDIES = {
    "onnxruntime": f"Run `python -m pip install {_onnxruntime.REQUIREMENT}`, in which it is found by itself; or `cargo xtask setup` in a clone "
    "of Cairn, which fetches it; or set CAIRN_ONNXRUNTIME to the library file of ONNX Runtime 1.24 or newer",
    "fsr": "Put AMD's libraries, from Kits/FidelityFX/signedbin of its FidelityFX SDK, into one folder, and set CAIRN_FFX_DIR to it",
    "fsr-provider": "Use a newer release of AMD's libraries, a newer driver or another adapter",
    "fsr-system": "Use analytic, which Windows 10 is enough for, or Windows 11",
    "fsr-direct3d": "Ship the Agility SDK (NuGet: Microsoft.Direct3D.D3D12) with the program, or use Windows 11",
    "fsr-shaders": "Use a newer driver, and the Agility SDK or Windows 11",
    "webgpu": "Run `python -m pip install cairn[gpu]`",
    "adapter": "Install the Vulkan driver of the graphics adapter, and the package libvulkan1; in a container, let it see the adapter "
    "(--device /dev/dri)",
    "memory": "Close other programs, or load the world at an operating point with a shorter window, such as baseline-112",
}


@dataclass
class Report:
    """The findings so far; prints each line at once."""

    good: bool = True

    def line(self, mark: str, what: str, found: str) -> None:
        self.good &= mark != "FAIL"
        head = f"{mark:5}{what:13}"
        print(textwrap.fill(found, _WIDTH, initial_indent=head, subsequent_indent=" " * len(head), break_on_hyphens=False))

    def explain(self, *texts: str) -> None:
        for text in filter(None, texts):
            indent = " " * 18
            print(textwrap.fill(text, _WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False))

    def fail(self, what: str, found: str, remedy: str) -> None:
        self.line("FAIL", what, found)
        self.explain(_WHY.get(what, ""), f"What to do: {remedy}." if remedy else "")


def run(world: str | None = None, onnxruntime: str | None = None, *, verbose: bool = False, half: bool = False) -> bool:
    """Checks everything from Python up to a step of a world: the world at `path`, or the embedded one. Prints the findings, and returns whether
    all is well. `half` also loads the world in f16, and checks that float16 is enough for it.
    """
    report = Report()

    def good(what: str, found: str) -> None:
        report.line("ok", what, found)
        if verbose:
            report.explain(_WHY.get(what, ""))

    bits = 64 if sys.maxsize > 1 << 32 else 32
    found = f"{platform.python_version()}, {bits} bits, {sys.platform} on {platform.machine()}"
    if sys.version_info < (3, 11) or bits != 64:
        report.fail("python", found, "Use Python 3.11 or newer, of 64 bits")
    else:
        good("python", found)

    if not _library_is_there(report, good, verbose):
        return False
    for requirement in _try(report, "device", lambda: requirements(onnxruntime=onnxruntime)) or []:
        _requirement(report, requirement, good)
    if not report.good:
        return False
    device = _try(report, "device", lambda: Device.cpu(onnxruntime=onnxruntime))
    if device is None:
        return False
    if any(adapter.kind == "d3d12" for adapter in _try(report, "device", adapters) or []):
        for requirement in _try(report, "device", lambda: requirements("d3d12", onnxruntime=onnxruntime)) or []:
            if requirement.what.startswith("fsr"):
                _requirement(report, requirement, good)
    if sys.platform == "linux":
        for requirement in _try(report, "device", lambda: requirements("webgpu", onnxruntime=onnxruntime)) or []:
            if requirement.what in ("webgpu", "adapter"):
                _requirement(report, replace(requirement, met=requirement.met or None), good)
    best = _try(report, "auto", lambda: Device.auto(onnxruntime=onnxruntime))
    if best is not None:
        with best:
            good("auto", "; ".join([best.description, *best.refusals]))
    with device:
        good("device", device.description)
        try:
            loaded = _try(report, "world", lambda: device.load_world(world), but=Unsupported if world is None else ())
        except Unsupported:
            well = "All is well. " if report.good else ""
            print(f"\n{well}This library has no world inside; to try another: python -m cairn doctor --world PATH")
            return report.good
        if loaded is None:
            return False
        with loaded:
            _world(report, loaded, good)
        if half:
            checked = _try(report, "float16", lambda: device.load_world(world, precision="f16", check_precision=True))
            if checked is not None:
                checked.close()
                good("float16", "it is enough for this world: no value passes 65504, and a latent is near that of f32 on this device")
    if report.good:
        print("\nAll is well.")
    return report.good


def _library_is_there(report: Report, good: Callable[[str, str], None], verbose: bool) -> bool:
    try:
        library = _library.library()
    except Error as error:
        places = _library.search_paths()
        cause, _, _ = (error.cause or str(error)).partition("; looked at ")
        report.fail("library", cause, error.remedy)
        report.explain("Looked for, in this order:", *(f"- {p}{'' if p.is_file() else ' (not there)'}" for p in places))
        if not os.environ.get(_library.VARIABLE):
            report.explain(f"{_library.VARIABLE} is not set.")
        return False
    version = _library.version_text(library.version)
    good("library", f"{library.path}, version {version}, binary interface {library.abi_version}")
    if verbose and os.environ.get(_library.VARIABLE):
        report.explain(f"{_library.VARIABLE} names it.")
    return True


def _requirement(report: Report, requirement: Requirement, good: Callable[[str, str], None]) -> None:
    text = f"{requirement.found or 'nothing found'} (needed: {requirement.needed})"
    if requirement.met:
        good(requirement.what, text)
    elif requirement.met is None:
        report.line("?", requirement.what, text)
        is_optional = requirement.what.startswith("fsr") or requirement.what in ("webgpu", "adapter")
        remedy = _REMEDIES.get(requirement.what, "") if is_optional else ""
        report.explain(_WHY.get(requirement.what, ""), f"What to do, where it is wanted: {remedy}." if remedy else "")
    else:
        remedy = _REMEDIES.get(requirement.what, "")
        if requirement.what == "onnxruntime":
            remedy = ". ".join([remedy, *_onnxruntime.hints(requirement.found)])
        report.fail(requirement.what, text, remedy)


def _world(report: Report, world: World, good: Callable[[str, str], None]) -> None:
    import numpy as np

    info = world.info
    mebibytes = world.memory.total / (1 << 20)
    good("world", f"{info.name}, {info.render_width}x{info.render_height} pixels, {info.licence}, needs {mebibytes:.0f} MiB")
    grey = np.full((info.render_height, info.render_width, 4), 128, np.uint8)

    def step() -> str:
        with world.rollout() as rollout:
            rollout.append(grey)
            began = time.perf_counter()
            rollout.step(Controls())
            seconds = time.perf_counter() - began
            with rollout.anchor() as anchor:
                shown = anchor.picture()
        real = info.latents_per_second * seconds
        pace = f"{real:.1f} times as long as the world's own time" if real > 1 else "as fast as the world's own time"
        return f"{seconds:.3f} s, {pace}; its picture is {shown.shape[1]}x{shown.shape[0]}"

    made = _try(report, "step", step)
    if made is not None:
        good("step", made)


def _try(report: Report, what: str, work: Callable[[], _T], but: type[Error] | tuple[()] = ()) -> _T | None:
    """The result of `work`. If it fails, prints a line and returns `None`; but an error of type `but` is raised."""
    try:
        return work()
    except Error as error:
        if isinstance(error, but):
            raise
        place = f"{error.field}: " if error.field else ""
        report.fail(what, f"{place}{error.cause or error} ({error.name})", error.remedy)
        return None
