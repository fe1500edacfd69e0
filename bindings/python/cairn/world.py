"""Devices, and worlds that run on them."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes import POINTER, byref, c_uint32, create_string_buffer, sizeof
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal, Self

from . import _interface as c
from . import _onnxruntime
from ._handles import Object, field_values
from ._library import call, encoded, make, read_text, whole
from .errors import Cancelled, refuse

if TYPE_CHECKING:
    from .rollout import Rollout

Precision = Literal["f32", "f16"]
_PRECISIONS = {"f32": c.PRECISION_F32, "f16": c.PRECISION_F16}
_PRECISION_NAMES = {number: name for name, number in _PRECISIONS.items()}
_KINDS = {"cpu": c.DEVICE_CPU, "d3d12": c.DEVICE_D3D12, "webgpu": c.DEVICE_WEBGPU}
_KIND_NAMES = {number: name for name, number in _KINDS.items()}

Progress = Callable[[str, int, int], object]
"""`progress(stage, done, total)`: stage is "reading" in bytes, then "preparing" in graphs. Returning `False` cancels the load."""


@dataclass(frozen=True)
class Adapter:
    """A processor or an adapter on which a device can be created. `kind` is "cpu", "d3d12" or "webgpu"; `memory` is in bytes, 0 if unknown.
    `str(index)` names a "webgpu" adapter for `Device.gpu`.
    """

    kind: str
    index: int
    name: str
    memory: int
    luid: int


@dataclass(frozen=True)
class Requirement:
    """One requirement of a device. `what` is "platform", "onnxruntime", "memory", "shaders", "webgpu" or "adapter", for AMD's FSR "fsr",
    "fsr-provider", "fsr-system", "fsr-direct3d" or "fsr-shaders", or the number of one that is newer than this package. `met` is None if it
    depends on the world, if the system does not report it, and if a device can be created without it.
    """

    what: str
    met: bool | None
    needed: str
    found: str


def adapters() -> list[Adapter]:
    """Lists what devices can be created on: always the processor, on Windows Direct3D 12 adapters, and on Linux the adapters that Vulkan lists,
    which need `pip install cairn[gpu]`.
    """
    found = _list(c.Adapter, lambda *array: call("adapters", *array))
    return [
        Adapter(_KIND_NAMES.get(a.kind, str(a.kind)), a.index, a.name.decode(errors="replace"), a.memory, a.luid)
        for a in found
    ]


def requirements(kind: str = "cpu", *, onnxruntime: str | os.PathLike[str] | None = None) -> list[Requirement]:
    """Lists the requirements of a device of kind "cpu", "d3d12" or "webgpu", with what was found for each. A requirement that is not met raises no error."""
    if kind not in _KINDS:
        raise refuse("kind", f"{kind!r} is no kind of device", 'Use "cpu", "d3d12" or "webgpu"')
    options = c.DeviceOptions(
        flags=c.DEVICE_ENVIRONMENT, onnxruntime=_onnxruntime.library_path(onnxruntime), webgpu=_onnxruntime.webgpu_path(None)
    )
    found = _list(c.Requirement, lambda *array: call("device_requirements", _KINDS[kind], byref(options), *array))
    names = {
        c.REQUIREMENT_PLATFORM: "platform",
        c.REQUIREMENT_ONNXRUNTIME: "onnxruntime",
        c.REQUIREMENT_MEMORY: "memory",
        c.REQUIREMENT_FSR_LIBRARIES: "fsr",
        c.REQUIREMENT_FSR_PROVIDER: "fsr-provider",
        c.REQUIREMENT_FSR_SYSTEM: "fsr-system",
        c.REQUIREMENT_FSR_DIRECT3D: "fsr-direct3d",
        c.REQUIREMENT_FSR_SHADER_MODEL: "fsr-shaders",
        c.REQUIREMENT_SHADERS: "shaders",
        c.REQUIREMENT_WEBGPU: "webgpu",
        c.REQUIREMENT_ADAPTER: "adapter",
    }
    met = {c.REQUIREMENT_MET: True, c.REQUIREMENT_NOT_MET: False}
    return [
        Requirement(
            names.get(r.what, str(r.what)),
            met.get(r.status),
            r.needed.decode(errors="replace"),
            r.found.decode(errors="replace"),
        )
        for r in found
    ]


def _list(kind: type[c.Sized], fill: Callable[..., int]) -> list[Any]:
    """An array of structs that the library fills; a second call may return more elements than the first."""
    count = c_uint32()
    fill(POINTER(kind)(), sizeof(kind), 0, byref(count))
    while True:
        capacity = count.value
        array = (kind * capacity)()
        for element in array:
            element.struct_size = sizeof(kind)
        fill(array, sizeof(kind), capacity, byref(count))
        if count.value <= capacity:
            return list(array[: count.value])


def _device_options(threads: int, deterministic: bool, onnxruntime: str | os.PathLike[str] | None, webgpu: bytes | None) -> c.DeviceOptions:
    remedy = f"Give 1 to {c.MAX_THREADS}, or 0 for each physical core"
    return c.DeviceOptions(
        threads=whole("threads", threads, 0, c.MAX_THREADS, remedy),
        flags=c.DEVICE_ENVIRONMENT | (c.DEVICE_DETERMINISTIC if deterministic else 0),
        onnxruntime=_onnxruntime.library_path(onnxruntime),
        webgpu=webgpu,
    )


@contextmanager
def _deferred_interrupt() -> Iterator[list[tuple[int, FrameType | None]]]:
    """Collects Ctrl+C in the given list during the block, and calls its handler after the block. Python would otherwise call the handler, which
    raises `KeyboardInterrupt`, at the start of a callback from the library: ctypes drops that exception.
    """
    received: list[tuple[int, FrameType | None]] = []
    former = signal.getsignal(signal.SIGINT)
    # Python sets and calls handlers on the main thread only.
    if not callable(former) or threading.current_thread() is not threading.main_thread():
        yield received
        return
    signal.signal(signal.SIGINT, lambda number, frame: received.append((number, frame)))
    try:
        yield received
    finally:
        signal.signal(signal.SIGINT, former)
        if received:
            former(*received[0])


class Device(Object):
    """A device that runs worlds. May be used from any thread.

    `refusals`: of a device from `auto`, why better kinds of devices were not taken, for people.
    """

    _kind = "device"
    refusals: tuple[str, ...] = ()

    @classmethod
    def cpu(
        cls,
        threads: int = 0,
        *,
        deterministic: bool = False,
        onnxruntime: str | os.PathLike[str] | None = None,
    ) -> Self:
        """Creates a device on this machine's processor; loads ONNX Runtime.

        `threads` share one pass, 1 to 1024; 0 is one for each physical core. The last bits of a rollout depend on it. `deterministic` uses ONNX
        Runtime's deterministic kernels only. `onnxruntime` is the path of its library file; None is the one in the environment variable
        CAIRN_ONNXRUNTIME, else the one in the installed package `onnxruntime` if that is 1.24 or newer, else the first beside this library or in the
        user's cache directory.

        Raises `RuntimeMissing` if ONNX Runtime 1.24 or newer is missing or computes wrongly; `Unsupported` if this process already uses another file of it;
        `InvalidArgument`; `DeviceError` if it does not start.
        """
        options = _device_options(threads, deterministic, onnxruntime, None)
        with _onnxruntime.with_hints():
            return cls(make(cls._kind, "device_create_cpu", byref(options)))

    @classmethod
    def gpu(
        cls,
        adapter: str | None = None,
        *,
        deterministic: bool = False,
        onnxruntime: str | os.PathLike[str] | None = None,
        webgpu: str | os.PathLike[str] | None = None,
    ) -> Self:
        """Creates a device on a graphics adapter, by ONNX Runtime's WebGPU provider. Experimental.

        `webgpu` is the path of the provider's library; None is the one in the environment variable CAIRN_WEBGPU, else the one in the installed
        package `onnxruntime-ep-webgpu` (`pip install cairn[gpu]`), else the one beside ONNX Runtime's. `adapter` is a part of its name, its vendor
        such as "0x1002", or its number among those that Vulkan lists; None is the fastest. An adapter that the processor emulates is used only if
        it is named. The other arguments are those of `cpu`.

        Raises `RuntimeMissing` if ONNX Runtime or the provider's library is missing; `Unsupported` if there is no such adapter or this process
        already uses another one; `InvalidArgument`; `DeviceError` if the adapter does not work.
        """
        options = _device_options(0, deterministic, onnxruntime, _onnxruntime.webgpu_path(webgpu))
        name = encoded(adapter, "adapter")
        with _onnxruntime.with_hints():
            return cls(make(cls._kind, "device_create_gpu", name, byref(options)))

    @classmethod
    def auto(
        cls,
        threads: int = 0,
        *,
        deterministic: bool = False,
        onnxruntime: str | os.PathLike[str] | None = None,
        webgpu: str | os.PathLike[str] | None = None,
    ) -> Self:
        """Creates the best device of this machine: on Windows on the first Direct3D 12 adapter, else as `gpu` with no adapter named, else as `cpu`.

        `refusals` has the reasons why better ones were not taken. The arguments and errors are those of `gpu` and `cpu`.
        """
        options = _device_options(threads, deterministic, onnxruntime, _onnxruntime.webgpu_path(webgpu))
        refusals = create_string_buffer(1 << 16)
        with _onnxruntime.with_hints():
            device = cls(make(cls._kind, "device_create_auto", byref(options), refusals, len(refusals), None))
        device.refusals = tuple(refusals.value.decode(errors="replace").splitlines())
        return device

    def _info(self) -> c.DeviceInfo:
        return self._fill("device_get_info", c.DeviceInfo)

    @property
    def description(self) -> str:
        """Description for people, such as "ONNX Runtime 1.24.4 CPU, 8 threads"."""
        return str(self._info().description.decode(errors="replace"))

    @property
    def kind(self) -> str:
        """ "cpu", "d3d12" or "webgpu"."""
        return _KIND_NAMES[self._info().kind]

    @property
    def precision(self) -> str:
        """Default precision of worlds: "f32" or "f16"."""
        return _PRECISION_NAMES[self._info().precision]

    @property
    def threads(self) -> int:
        """Threads that share one pass."""
        return int(self._info().threads)

    @property
    def memory(self) -> tuple[int, int]:
        """MiB of its adapter's memory that the system grants to this process at present, and that the process uses; (0, 0) if unknown."""
        info = self._info()
        return int(info.memory_budget_mib), int(info.memory_used_mib)

    def load_world(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        precision: Precision | None = None,
        operating_point: str | None = None,
        memory_limit: int = 0,
        fit_window: bool = False,
        check_precision: bool = False,
        slices: int = 0,
        longest_submission_us: int = 0,
        progress: Progress | None = None,
    ) -> World:
        """Loads a world: reads and checks the bundle, compares the memory it needs with the memory available, and prepares its graphs. Takes
        seconds to minutes with real weights; other threads continue meanwhile.

        `path` is a bundle, a folder or a file; None is the world embedded in the library, if there is one. `precision` None is the device's
        default. `operating_point` is a preset with changes after commas, such as "coherence" or "stock,g64,native"; None is "stock" with the
        bundle's own window. `memory_limit` is in bytes for the world and one rollout; 0 for the memory that the system has available. `fit_window` narrows
        the global window if it does not fit that memory, instead of failing; the rollout's operating point names it. `check_precision` makes one
        latent in "f16" and in "f32", and raises `Unsupported` with the tensor or layer if float16 is not enough for the bundle on this device:
        a value passes 65504, or the latent's relative error is more than 3 %. For a while that needs about twice the memory of the weights; one
        load of a bundle and a device needs it.

        `slices` divides the transformer, 1 to the number of its layers: graphs of consecutive layers that run one after the other, so that other
        work gets its turn on a device and a cancelled step ends sooner. On the processor every number gives the same bits in "f32"; more need more
        memory. 0 is 1 or, with `longest_submission_us`, as many as keep the longest slice within so many microseconds: passes are measured at
        load, which takes several times as long then. `World.info` has the number and the time. `progress` is called on this thread.

        Ctrl+C during a load on the main thread cancels the load, and then calls the program's handler of SIGINT.

        Raises `InvalidArgument`, `FileError`, `InvalidBundle`, `Unsupported`, `OutOfMemory` with the numbers, `DeviceError`; `Cancelled` if
        `progress` returned False, and after a Ctrl+C whose handler raised nothing; and what `progress` and the handler raise.
        """
        if precision is not None and precision not in _PRECISIONS:
            raise refuse("precision", f"{precision!r} is no precision", 'Use "f32" or "f16", or None')
        raised: list[BaseException] = []

        def on_progress(state: Any, _user: object) -> int:
            # An exception must not pass through the library: it is stored, the load ends, and it is raised afterwards.
            try:
                at = state.contents
                stage = "reading" if at.stage == c.LOAD_READING else "preparing"
                is_refused = progress is not None and progress(stage, at.done, at.total) is False
                return int(is_refused or bool(received))
            except BaseException as error:
                raised.append(error)
                return 1

        options = c.WorldOptions(
            precision=_PRECISIONS.get(precision or "", 0),
            path=encoded(path, "path"),
            operating_point=encoded(operating_point, "operating_point"),
            memory_limit=whole("memory_limit", memory_limit, 0, (1 << 64) - 1, "Give bytes, or 0 for no limit of your own"),
            flags=c.WORLD_FIT_WINDOW * fit_window | c.WORLD_CHECK_PRECISION * check_precision,
            # Set even without a caller's callback, because it ends the load after Ctrl+C.
            progress=c.load_callback(on_progress),
            slices=whole("slices", slices, 0, (1 << 32) - 1),
            longest_submission_us=whole("longest_submission_us", longest_submission_us, 0, (1 << 32) - 1),
        )
        with _deferred_interrupt() as received:
            try:
                return World(make(World._kind, "world_load", self._handle, byref(options)))
            except Cancelled:
                if raised:
                    raise raised[0] from None
                raise


@dataclass(frozen=True)
class WorldInfo:
    """Properties of a world. Sizes are in pixels; rates are per second of world time; windows are in latents.

    `render_*` is the size of an anchor's pictures, in square pixels, and `decoded_*` that of the autoencoder's pictures, whose pixels may not
    be square. `latent_*` is the shape of a latent. `global_window` is the context window of a global layer, as loaded; `keys` is one more than
    the highest virtual-key code that the model knows; `digest` is the bundle's identity. `slices` are those of the transformer, and
    `longest_slice_us` is the time of the longest as measured at load; 0 if no number of slices had to be chosen.
    """

    name: str
    licence: str
    digest: str
    precision: str
    render_width: int
    render_height: int
    decoded_width: int
    decoded_height: int
    latent_channels: int
    latent_height: int
    latent_width: int
    tokens: int
    layers: int
    pictures_per_latent: int
    local_window: int
    global_window: int
    max_global_window: int
    global_dilation: int
    latents_per_second: int
    keys: int
    slices: int
    longest_slice_us: int


@dataclass(frozen=True)
class WorldMemory:
    """Bytes that a world and one rollout need. Each further rollout needs `ring`, `slabs` and a part of
    `intermediates`."""

    bundle: int
    weights: int
    ring: int
    slabs: int
    intermediates: int
    autoencoder: int
    arena: int
    total: int


class World(Object):
    """A loaded world. It may have any number of rollouts, which share its weights. May be used from any thread."""

    _kind = "world"

    @property
    def info(self) -> WorldInfo:
        """Its properties."""
        fields = field_values(self._fill("world_get_info", c.WorldInfo))
        return WorldInfo(**{**fields, "precision": _PRECISION_NAMES[fields["precision"]]})

    @property
    def memory(self) -> WorldMemory:
        """The memory that it needs with one rollout, as computed before loading."""
        return WorldMemory(**field_values(self._fill("world_get_memory", c.WorldMemory)))

    @property
    def licence_text(self) -> str:
        """The text of its licence; empty if the bundle has none."""
        return read_text("world_get_licence", self._handle)

    def rollout(self, seed: int = 0, *, operating_point: str | None = None, queue_capacity: int = 0) -> Rollout:
        """Creates a rollout without latents: append a seed picture first.

        `seed` of 64 bits decides all noise: the same seed, world, device and controls give the same pictures, bit for bit. `operating_point`
        must have the world's global window; None is the world's. `queue_capacity` is the largest number of steps that wait, run, or have a
        result not yet fetched, 1 to 64; 0 is 4.

        Raises `InvalidArgument`, `OutOfMemory` with the numbers, `DeviceError`.
        """
        from .rollout import Rollout

        options = c.RolloutOptions(
            seed=whole("seed", seed, 0, (1 << 64) - 1, "Give a whole number from 0 to 2**64 - 1"),
            queue_capacity=whole("queue_capacity", queue_capacity, 0, c.MAX_QUEUE, f"Give 1 to {c.MAX_QUEUE}, or 0 for 4"),
            operating_point=encoded(operating_point, "operating_point"),
        )
        return Rollout(make(Rollout._kind, "rollout_create", self._handle, byref(options)))
