"""Frames between anchors: guidance (motion and depth of a pair of anchors) and presenters."""

from __future__ import annotations

import threading
from ctypes import POINTER, byref, c_float, c_uint8, c_uint16
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from . import _interface as c
from ._handles import Object, field_values
from ._library import call, make, whole
from .errors import InvalidArgument, refuse
from .pictures import Bytes, Floats, Halves, Order, target
from .rollout import Anchor

Motion = Literal["auto", "pictures", "paper", "latents"]
"""Source of motion: the one with the best scores, optical flow of the two pictures, the paper's method on the two latents, or block matching of
the two latents."""

Prefer = Literal["auto", "require", "never"]
"""Whether a generator is used if possible, is required, or is not used."""

_MOTIONS = {"auto": c.MOTION_AUTO, "pictures": c.MOTION_PICTURES, "paper": c.MOTION_PAPER, "latents": c.MOTION_LATENTS}
_PREFERENCES = {"auto": c.PREFER_AUTO, "require": c.PREFER_REQUIRE, "never": c.PREFER_NEVER}
_DEPTHS = {"device": 0, "inverted": c.DEPTH_INVERTED, "linear": c.DEPTH_LINEAR}
_SOURCES = {
    c.FRAME_ANCHOR: "anchor",
    c.FRAME_DECODED: "decoded",
    c.FRAME_GENERATED: "generated",
    c.FRAME_EXTRAPOLATED: "extrapolated",
    c.FRAME_HELD: "held",
}


def _choose(field: str, choice: str, choices: dict[str, int]) -> int:
    if choice not in choices:
        raise refuse(field, f"{choice!r} is no choice", f"Use one of {', '.join(choices)}")
    return choices[choice]


@dataclass(frozen=True)
class GuidanceInfo:
    """Properties of guidance: its size in pixels, the distances of the planes, and the vertical field of view in radians."""

    width: int
    height: int
    near_plane: float
    far_plane: float
    vertical_fov: float


class Guidance(Object):
    """Motion and depth of a pair of anchors, at the anchors' size. Immutable; may be used from any thread."""

    _kind = "guidance"

    @classmethod
    def of_anchors(cls, previous: Anchor, current: Anchor, motion: Motion = "auto") -> Self:
        """Finds motion and depth of two anchors. A presenter does this itself; use this to do it earlier, or to inspect the result.

        Raises `InvalidArgument` for anchors of different sizes, and for anchors without latents if `motion` needs them; `OutOfMemory`.
        """
        source = _choose("motion", motion, _MOTIONS)
        return cls(make(cls._kind, "guidance_create", previous._handle, current._handle, source))

    @classmethod
    def of_arrays(
        cls,
        motion: npt.ArrayLike,
        depth: npt.ArrayLike | None = None,
        *,
        depth_kind: Literal["device", "inverted", "linear"] = "device",
        near_plane: float = 0.0,
        far_plane: float = 0.0,
        vertical_fov: float = 0.0,
    ) -> Self:
        """Makes guidance from your own motion and depth, for example an engine's; both are copied.

        `motion` is `[height, width, 2]` in pixels, x and y from the current anchor to the previous one, y down; it becomes float16. `depth` is
        `[height, width]` and becomes float32: "device" is 0 near and 1 far, "inverted" 1 near and 0 far, "linear" the distance along the view
        axis in the units of `near_plane`. Both planes and `vertical_fov`, which is in radians, are 0 for 0.1, 100 and 60 degrees.

        Raises `InvalidArgument`, `OutOfMemory`.
        """
        flags = _choose("depth_kind", depth_kind, _DEPTHS)
        # A motion too large for a half float becomes infinite, which the library treats as no motion.
        with np.errstate(over="ignore"):
            vectors = np.ascontiguousarray(motion, np.float16)
        if vectors.ndim != 3 or vectors.shape[2] != 2:
            raise refuse("motion", f"has the shape {list(vectors.shape)}", "Give [height, width, 2]")
        height, width = vectors.shape[:2]
        data = c.GuidanceData(
            flags=flags,
            width=width,
            height=height,
            motion=vectors.ctypes.data,
            motion_count=vectors.size,
            near_plane=near_plane,
            far_plane=far_plane,
            vertical_fov=vertical_fov,
        )
        distances: Floats | None = None
        if depth is not None:
            distances = np.ascontiguousarray(depth, np.float32)
            if distances.shape != (height, width):
                raise refuse("depth", f"has the shape {list(distances.shape)}", f"Give [{height}, {width}], as motion")
            data.depth = distances.ctypes.data
            data.depth_count = distances.size
        guidance = cls(make(cls._kind, "guidance_create_from_host", byref(data)))
        # The library has copied both; they had to stay alive until here.
        del vectors, distances
        return guidance

    @property
    def info(self) -> GuidanceInfo:
        """Its properties."""
        return GuidanceInfo(**field_values(self._fill("guidance_get_info", c.GuidanceInfo)))

    def motion(self) -> Halves:
        """The motion: a copy, `float16` `[height, width, 2]`, x and y in pixels from the current anchor to the previous one."""
        info = self.info
        motion = np.empty((info.height, info.width, 2), np.float16)
        call("guidance_read_motion", self._handle, motion.ctypes.data_as(POINTER(c_uint16)), motion.size)
        return motion

    def depth(self) -> Floats:
        """Device depth of the current anchor, 0 near and 1 far: a copy, `float32` `[height, width]`."""
        info = self.info
        depth = np.empty((info.height, info.width), np.float32)
        call("guidance_read_depth", self._handle, depth.ctypes.data_as(POINTER(c_float)), depth.size)
        return depth


@dataclass(frozen=True)
class Frame:
    """A frame of a presenter. `source` is "anchor", "decoded", "generated", "extrapolated" or "held". `position` is its position in the stream:
    anchor i has position i times the multiplier. It is due from `since_ns` to `until_ns`. `previous` and `current` are the numbers of the
    anchors around it, and `t`, 0 to 1, is its phase between them. `cut` is true if it was not generated because of a cut, `repeated` if it
    is the same picture as the one drawn before.
    """

    source: str
    position: int
    since_ns: int
    until_ns: int
    previous: int
    current: int
    t: float
    cut: bool
    repeated: bool

    @classmethod
    def _of(cls, struct: c.Frame) -> Self:
        fields = field_values(struct, ("flags", "source"))
        return cls(
            source=_SOURCES.get(struct.source, str(struct.source)),
            cut=bool(struct.flags & c.FRAME_CUT),
            repeated=bool(struct.flags & c.FRAME_REPEATED),
            **fields,
        )


@dataclass(frozen=True)
class PresenterStatistics:
    """Statistics of a presenter since it was made. `generator` made the last frame, such as "cpu"; `preference` says why one that might be
    better is not used. `waiting` anchors are not due yet. `under_way` frames for Direct3D 12 have not completed; `device_frames` have, and
    took `device_frames_ns` on the device; `device_lists` are the presenter's own command lists, which prepare what frames need. With
    `set_budget`, `made_to_anchor` frames per anchor are made, and `budget_changes` counts the changes of that number. `upscaler` resizes
    frames, such as "spatial", and is empty if they have the anchors' size; `upscaling` says why AMD's upscaler is not used.
    `anchors_under_way` were pushed, and their device has not finished them yet. Of the frames for Direct3D 12, `unprepared` were replaced by
    an anchor because they were not prepared; `objects_made` is the number of objects created while frames were recorded, and `lists_pending`
    is the number of recorded frames that the host's lists may still read.
    """

    anchors: int
    late_anchors: int
    slipped_ns: int
    shown_anchors: int
    shown_decoded: int
    shown_generated: int
    shown_extrapolated: int
    shown_held: int
    repeated: int
    cuts: int
    guidance_ns: int
    generate_ns: int
    resize_ns: int
    generator: str
    preference: str
    waiting: int
    under_way: int
    device_frames: int
    device_frames_ns: int
    device_frame_longest_ns: int
    device_frame_last_ns: int
    device_lists: int
    device_lists_ns: int
    device_list_longest_ns: int
    made_to_anchor: int
    budget_changes: int
    upscaler: str
    upscaling: str
    anchors_under_way: int
    unprepared: int
    objects_made: int
    lists_pending: int


class Presenter(Object):
    """Shows a stream of anchors at a steady rate: receives anchors as they come, decides which frame is due when, and makes it.

    It reads no clock: all times are yours, in nanoseconds from any origin, such as `time.monotonic_ns()`. `draw` is for one call at a time; a
    concurrent call raises `Busy`. Everything else may be called from any thread, also while a frame is drawn.
    """

    _kind = "presenter"

    def __init__(
        self,
        multiplier: int = 2,
        *,
        size: tuple[int, int] = (0, 0),
        interval_ns: int = 0,
        delay_ns: int = 0,
        hold_late: bool = False,
        catch_up: bool = False,
        decoded: bool = True,
        capacity: int = 0,
        motion: Motion = "auto",
        linear: bool = False,
        letterbox: bool = False,
        fsr: Prefer = "auto",
        shader: Prefer = "auto",
        cpu: Prefer = "auto",
        upscaler: Prefer = "auto",
    ) -> None:
        """`multiplier` is the number of frames per anchor: 1, 2, 3, 4 or 6. `size` is width and height of the frames; (0, 0) is the anchors'
        size.

        `interval_ns` is the time between anchors; 0 uses the first anchor's rate. `delay_ns` is the time from the arrival of an anchor until it
        is due; 0 is one interval. `hold_late` holds the last anchor if the next one is late, instead of extrapolating; `catch_up` shows frames
        sooner after a late one; `decoded=False` generates frames even if the anchor has decoded pictures for them. `capacity` is the largest
        number of waiting anchors, 1 to 64; 0 is 4. `linear` writes linear light, into half floats only. `letterbox` adds black bars if frames
        have another aspect ratio than the anchors; otherwise the picture is stretched. `fsr`, `shader` and `cpu` select the generators, and
        `upscaler` selects AMD's upscaler for frames for Direct3D 12 that are larger than anchors.

        Raises `InvalidArgument`; `Unsupported` for a required generator that is not available; `OutOfMemory`.
        """
        width, height = _size(size)
        flags = c.PRESENTER_HOLD_LATE * hold_late | c.PRESENTER_CATCH_UP * catch_up
        flags |= c.PRESENTER_NO_DECODED * (not decoded) | c.PRESENTER_LETTERBOX * letterbox
        options = c.PresenterOptions(
            multiplier=whole("multiplier", multiplier, 0, (1 << 32) - 1, "Use 1, 2, 3, 4 or 6, or 0 for the default"),
            width=width,
            height=height,
            interval_ns=_nanoseconds("interval_ns", interval_ns),
            delay_ns=_nanoseconds("delay_ns", delay_ns),
            flags=flags,
            capacity=whole("capacity", capacity, 0, (1 << 32) - 1, "Give 1 to 64, or 0 for 4"),
            motion=_choose("motion", motion, _MOTIONS),
            colour_space=c.COLOUR_LINEAR if linear else c.COLOUR_SRGB,
            fsr=_choose("fsr", fsr, _PREFERENCES),
            shader=_choose("shader", shader, _PREFERENCES),
            cpu=_choose("cpu", cpu, _PREFERENCES),
            upscaler=_choose("upscaler", upscaler, _PREFERENCES),
        )
        self._wanted, self._anchors = (width, height), (0, 0)
        self._resizing = threading.Lock()
        self._linear = linear
        super().__init__(make(self._kind, "presenter_create", byref(options)))

    def push(self, anchor: Anchor, now_ns: int, guidance: Guidance | None = None) -> bool:
        """Pushes the next anchor, which arrived at `now_ns`. Returns False if the largest number of anchors is waiting; the anchor was not
        added then.

        `guidance` is from the previous anchor to this one; without it the presenter finds its own. It keeps its own references, so both may be
        closed. For an anchor whose number is not one above the last, or that is a cut, nothing is generated before it.

        Raises `InvalidArgument` for another size than the first anchor's, and for a first anchor without a rate if there is no `interval_ns`.
        """
        given = None if guidance is None else guidance._handle
        result = call("presenter_push", self._handle, anchor._handle, given, _nanoseconds("now_ns", now_ns))
        if result == c.OK and self._anchors == (0, 0):
            info = anchor.info
            self._anchors = (info.width, info.height)
        return result == c.OK

    def query(self, now_ns: int) -> Frame | None:
        """The frame that is due if it is shown at `now_ns`; None before the first anchor."""
        frame = c.Frame()
        result = call("presenter_query", self._handle, _nanoseconds("now_ns", now_ns), byref(frame))
        return None if result == c.NOT_READY else Frame._of(frame)

    def draw(
        self, now_ns: int, *, out: Bytes | Halves | None = None, order: Order = "rgba"
    ) -> tuple[Frame, Any] | None:
        """Makes the frame that is due at `now_ns`, and returns its properties and its pixels. None before the first anchor.

        The pixels are `uint8` `[height, width, 4]` in a new array, or `out`, which may also be `float16`. They are display-referred. If the
        presenter was made with `linear`, they are linear light in `float16`, also in a new array.

        Raises `InvalidArgument`, `Busy`, `OutOfMemory`, and `Unsupported` if the presenter requires a generator for Direct3D 12.
        """
        now_ns = _nanoseconds("now_ns", now_ns)
        size = self._frame_size()
        try:
            return self._draw(now_ns, size, out, order)
        except InvalidArgument:
            # Another thread may have resized the frames since the new array was made.
            size_now = self._frame_size()
            if out is not None or size_now == size:
                raise
        return self._draw(now_ns, size_now, out, order)

    def _frame_size(self) -> tuple[int, int]:
        """Width and height of the next frame; (0, 0) before the first anchor."""
        with self._resizing:
            return self._anchors if self._wanted == (0, 0) else self._wanted

    def _draw(self, now_ns: int, size: tuple[int, int], out: Bytes | Halves | None, order: Order) -> tuple[Frame, Any] | None:
        width, height = size
        if width == 0 or height == 0:
            return None
        is_half = self._linear if out is None else isinstance(out, np.ndarray) and out.dtype == np.float16
        struct, pixels = target(out, height, width, order, np.float16 if is_half else np.uint8)
        frame = c.Frame()
        result = call("presenter_draw", self._handle, now_ns, byref(struct), byref(frame))
        return None if result == c.NOT_READY else (Frame._of(frame), pixels)

    def resize(self, size: tuple[int, int] = (0, 0)) -> None:
        """Changes width and height of the frames, for example with a window; (0, 0) is the anchors' size. The stream continues.

        Raises `InvalidArgument`.
        """
        width, height = _size(size)
        # `draw` must not see the library's new size beside the former one here.
        with self._resizing:
            call("presenter_resize", self._handle, width, height)
            self._wanted = (width, height)

    def set_overlay(self, mask: Any | None) -> None:
        """Sets the mask of a static overlay that covers the anchors, such as a HUD, from the next frame on. `mask` is `[height, width]` of the
        anchors' size, with any number but 0 for a covered pixel. None removes the mask: generators then detect static pixels from colours that do
        not change. All generators use it; `reset` removes it.

        Raises `InvalidArgument`.
        """
        if mask is None:
            call("presenter_set_overlay", self._handle, None, 0, 0, 0)
            return
        given = np.ascontiguousarray(np.asarray(mask) != 0, np.uint8)
        if given.ndim != 2:
            raise refuse("mask", f"has {given.ndim} dimensions", "Give [height, width]")
        height, width = given.shape
        pixels = given.ctypes.data_as(POINTER(c_uint8))
        call("presenter_set_overlay", self._handle, pixels, given.size, width, height)

    def set_budget(self, frame_ns: int) -> None:
        """Limits the device time per frame that a Direct3D device makes, in nanoseconds, averaged over an interval; 0 removes the limit. If it
        is too short, fewer frames of an interval are made, and the others repeat the previous one.

        Raises `InvalidArgument`.
        """
        call("presenter_set_budget", self._handle, _nanoseconds("frame_ns", frame_ns))

    def reset(self) -> None:
        """Removes all anchors, their times and the overlay's mask: the next anchor is a first one again."""
        call("presenter_reset", self._handle)
        self._anchors = (0, 0)

    @property
    def statistics(self) -> PresenterStatistics:
        """Its statistics."""
        return PresenterStatistics(**field_values(self._fill("presenter_get_statistics", c.PresenterStatistics)))


def _nanoseconds(field: str, value: int) -> int:
    return whole(field, value, 0, (1 << 64) - 1, "Give nanoseconds, a whole number from 0 to 2**64 - 1")


def _size(size: tuple[int, int]) -> tuple[int, int]:
    width, height = (whole("size", side, 0, (1 << 32) - 1, "Give 1 to 16384 each way, or (0, 0) for the anchors'") for side in size)
    return width, height
