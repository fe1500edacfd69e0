"""Rollouts, which make anchors from controls, and anchors."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import AsyncIterator, Iterable, Iterator, Sequence
from ctypes import POINTER, Array, byref, c_char, c_float, c_size_t, c_uint64, c_void_p
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

from . import _awaiting, _display
from . import _interface as c
from ._handles import Object, plain
from ._library import call, encoded, make
from .controls import Controls
from .errors import Error, refuse
from .pictures import Bytes, Floats, Order, source, target

if TYPE_CHECKING:
    from .presenter import Presenter
    from .world import World

# Interval between two checks for Ctrl+C, because a call into the library cannot be interrupted.
_GLANCE_NS = 100_000_000


@dataclass(frozen=True)
class AnchorInfo:
    """What an anchor is. `cut` says that nothing leads to it from the anchor before. `latent` is the number of its latent in the
    rollout, from 0; `latents_per_second` is 0 for a picture of your own, and so are the sizes of its latent."""

    cut: bool
    latent: int
    latents_per_second: int
    pictures: int
    width: int
    height: int
    latent_channels: int
    latent_height: int
    latent_width: int


class Anchor(Object):
    """An anchor: a copy that stays as it is, whatever becomes of its rollout. May be used from any thread."""

    _kind = "anchor"

    @classmethod
    def of_picture(cls, picture: npt.ArrayLike, number: int, *, cut: bool = False, order: Order = "rgba") -> Self:
        """An anchor of a picture of your own, `uint8` `[height, width, 4]` or `[height, width, 3]`, which is copied.

        `number` counts up by one from anchor to anchor; `cut` says that nothing leads to it from the one before.
        Raises `InvalidArgument`, `OutOfMemory`.
        """
        struct, owner = source(picture, order)
        anchor = cls(make("anchor_create", byref(struct), number, c.ANCHOR_CUT if cut else 0))
        del owner
        return anchor

    @property
    def info(self) -> AnchorInfo:
        """What it is."""
        struct = self._filled("anchor_get_info", c.AnchorInfo)
        return AnchorInfo(cut=bool(struct.flags & c.ANCHOR_CUT), **plain(struct, ("flags",)))

    def picture(self, index: int = -1, *, out: Bytes | None = None, order: Order = "rgba") -> Bytes:
        """One of its pictures, `uint8` `[height, width, 4]`: a copy, yours for good.

        `index` is in order of time and counts from the end where negative; the last is the anchor itself. `out` takes the pixels
        where given, also a part of a larger array, and is given back. Raises `InvalidArgument`.
        """
        info = self.info
        number = index + info.pictures if index < 0 else index
        if not 0 <= number < info.pictures:
            raise refuse("index", f"{index} is none of {info.pictures} pictures", f"Give 0 to {info.pictures - 1}, or -1")
        struct, out = target(out, info.height, info.width, order)
        call("anchor_read_picture", self._handle, number, byref(struct))
        return out

    def pictures(self, *, order: Order = "rgba") -> list[Bytes]:
        """All its pictures, in order of time."""
        return [self.picture(i, order=order) for i in range(self.info.pictures)]

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """What a notebook shows: all its pictures beside each other, in order of time."""
        return _display.anchor(self)

    def _repr_png_(self) -> bytes | None:
        """The anchor itself, its last picture, as a PNG; None where it is closed."""
        return None if self.closed else _display.png(self.picture())

    def latent(self) -> Floats:
        """Its latent, `float32` `[channels, height, width]`: a copy. Raises `Unsupported` for a picture of your own."""
        info = self.info
        latent = np.empty((info.latent_channels, info.latent_height, info.latent_width), np.float32)
        call("anchor_read_latent", self._handle, latent.ctypes.data_as(POINTER(c_float)), latent.size)
        return latent


@dataclass(frozen=True)
class StepInfo:
    """What a step did. `committed` says that keys and values went into the ring; times are nanoseconds of wall time."""

    committed: bool
    latent: int
    denoise_passes: int
    cache_passes: int
    encode_ns: int
    denoise_ns: int
    cache_ns: int
    commit_ns: int
    decode_ns: int
    ring_bytes: int

    @classmethod
    def _of(cls, struct: c.StepInfo) -> Self:
        return cls(committed=bool(struct.flags & c.STEP_COMMITTED), **plain(struct, ("flags",)))


@dataclass(frozen=True)
class RolloutInfo:
    """What a rollout is, and how far: `latents` made so far, its `seed`, its rates, and how it runs in full."""

    latents: int
    seed: int
    pictures_per_latent: int
    latents_per_second: int
    presented_rate: int
    operating_point: str


@dataclass(frozen=True)
class RolloutStatistics:
    """What a rollout has done since it was made, as of the end of its last step; `queue_depth` is of now. Times are nanoseconds."""

    queue_depth: int
    latents: int
    denoise_passes: int
    cache_passes: int
    decode_passes: int
    encode_ns: int
    denoise_ns: int
    cache_ns: int
    commit_ns: int
    decode_ns: int
    resize_ns: int
    uploaded_bytes: int
    copied_bytes: int
    read_bytes: int
    ring_bytes: int
    device_passes: int
    device_passes_ns: int
    device_pass_longest_ns: int
    device_decodes: int
    device_decodes_ns: int
    device_decode_longest_ns: int
    device_commits: int
    device_commits_ns: int
    runtime_ns: int
    waited_ns: int
    yields: int
    captured_passes: int
    other_passes: int
    governed_frame_ns: int
    governed_latents: int
    governed_frames: int
    governed_less: int
    governed_more: int
    governed_short_of_memory: int
    governed_beyond: int
    governed_passes: int
    governed_window: int
    governed_made: int


def _array(pictures: Sequence[npt.ArrayLike], order: Order) -> tuple[Array[c.Picture], list[object]]:
    """Pictures as the library reads them, and what owns their memory."""
    made = [source(picture, order) for picture in pictures]
    # At least one element: for an empty list the library gets a valid pointer and reports the count of 0.
    structs = (c.Picture * max(1, len(made)))(*(struct for struct, _ in made))
    return structs, [owner for _, owner in made]


class Rollout(Object):
    """One running instance of a world: its memory of the past, its clocks and its noise.

    `append`, `step`, `reset` and `restore` are one at a time: beside another of them, or while steps are queued, they raise
    `Busy`. All else may be called from any thread at any time; queries raise `Busy` while a step is running.
    """

    _kind = "rollout"

    @property
    def info(self) -> RolloutInfo:
        """What it is, and how far."""
        return RolloutInfo(**plain(self._filled("rollout_get_info", c.RolloutInfo)))

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """What a notebook shows: how far it is, and the pictures of its last anchor."""
        return _display.rollout(self)

    @property
    def statistics(self) -> RolloutStatistics:
        """What it has done so far; does not wait for a step that is running."""
        return RolloutStatistics(**plain(self._filled("rollout_get_statistics", c.RolloutStatistics)))

    def append(self, picture: npt.ArrayLike, *, order: Order = "rgba") -> StepInfo:
        """Appends a picture of any size: the seed, or later an edit of the scene. It is `uint8` `[height, width, 4]` or
        `[height, width, 3]`, and is copied. Raises `InvalidArgument`, `Busy`, `OutOfMemory`, `DeviceError`, `Cancelled`."""
        struct, owner = source(picture, order)
        info = c.StepInfo()
        call("rollout_append", self._handle, byref(struct), byref(info))
        del owner
        return StepInfo._of(info)

    def append_pictures(self, pictures: Sequence[npt.ArrayLike], *, order: Order = "rgba") -> StepInfo:
        """Appends pictures that follow each other, the oldest first, as one latent: the 4 of a latent, so that a scene that moves goes on
        moving, or 1, a still. See `append`."""
        structs, owners = _array(pictures, order)
        info = c.StepInfo()
        call("rollout_append_pictures", self._handle, structs, len(pictures), byref(info))
        del owners
        return StepInfo._of(info)

    def keep_encoder_stream(self, keep: bool) -> None:
        """Whether the encoder goes on from one appended picture to the next, as the released engine's does, or starts anew with each, as it
        does unless told so. The stream starts here, and again with `reset`; it is part of a saved state.

        Raises `Unsupported` where the bundle was built without `--streaming-encoder`, and `Busy` while steps are queued.
        """
        call("rollout_keep_encoder_stream", self._handle, int(keep))

    def rest(self) -> None:
        """Lets others use the device's memory of a rollout that makes no latents for a while: rings, latents and pictures are evicted after
        what is under way, and the next call that needs them brings them back, or raises `OutOfMemory` with all as it was. `pause` has a
        rollout whose queue was used rest too. Nothing happens on a processor. Raises `Busy` while steps are queued."""
        call("rollout_rest", self._handle)

    def step(self, controls: Controls = Controls()) -> StepInfo:  # noqa: B008 (it does not change)
        """Makes the next latent; the controls stand for one latent's span of world time. Raises `InvalidArgument`, `Busy`,
        `Unsupported` for a key that the world does not know, `OutOfMemory`, `DeviceError`, `Cancelled`."""
        info = c.StepInfo()
        call("rollout_step", self._handle, byref(controls._struct()), byref(info))
        return StepInfo._of(info)

    def anchor(self) -> Anchor:
        """A copy of the last anchor. Raises `InvalidArgument` before the first latent; `Busy` while a step is running."""
        return Anchor(make("rollout_get_anchor", self._handle))

    def set_budget(self, latent_ns: int, schedules: Sequence[str]) -> None:
        """Holds latents to `latent_ns` nanoseconds of wall time each: they are made by the first of `schedules`, such as
        `["stock", "explicit:1:0.5:0"]`, until that takes too long, and then by one with fewer passes. It goes by the times of the
        latents before, so that the same controls may give other pictures the next time. No schedules end it.

        Raises `InvalidArgument`, and `Busy` while steps are queued.
        """
        if not 0 <= latent_ns < 1 << 64:
            raise refuse("latent_ns", f"{latent_ns} is no time", "Give nanoseconds")
        call("rollout_set_budget", self._handle, latent_ns, " ".join(schedules).encode())

    def govern(
        self,
        frame_ns: int = 0,
        *,
        memory_mib: int = 0,
        multiplier: int = 0,
        schedules: Sequence[str] = (),
        worlds: Sequence[World] = (),
        presenter: Presenter | None = None,
    ) -> None:
        """Holds the rollout, and a presenter's frames, to a budget: `frame_ns` nanoseconds of the device's time for each frame that is
        shown, and `memory_mib`; 0 for no limit. From the times so far it picks the passes of latents, the window, one of `worlds`, which are
        of the same bundle, or the rollout's own, and how many frames to an anchor are made; it loads no world itself. Passes are given up
        first, then frames, the window last, and all come back where there is time. `multiplier` are the frames that are shown for each
        anchor: 0 for the presenter's own, and for 1 without. `statistics` says what it did. It takes the place of `set_budget`, which
        ends it.

        Raises `InvalidArgument`; `OutOfMemory` where even the narrowest window needs too much; `Busy` while steps are queued.
        """
        for name, number, most in (("frame_ns", frame_ns, 1 << 64), ("memory_mib", memory_mib, 1 << 64), ("multiplier", multiplier, 65)):
            if not 0 <= number < most:
                raise refuse(name, f"{number} is out of range", f"Give 0 to {most - 1}")
        handles = (c_void_p * len(worlds))(*(world._handle for world in worlds))
        budget = c.Budget(
            multiplier=multiplier,
            frame_ns=frame_ns,
            memory_mib=memory_mib,
            schedules=" ".join(schedules).encode() or None,
            worlds=handles,
            world_count=len(worlds),
            presenter=None if presenter is None else presenter._handle,
        )
        call("rollout_govern", self._handle, byref(budget))

    def ungovern(self) -> None:
        """Ends what `govern` began, and leaves things as they are. Raises `Busy` while steps are queued."""
        call("rollout_govern", self._handle, None)

    def reset(self) -> None:
        """Back to the start with the same seed: no latents, empty memory."""
        call("rollout_reset", self._handle)

    def submit(self, controls: Controls = Controls()) -> int | None:  # noqa: B008 (it does not change)
        """Queues a step for the rollout's own thread, and returns at once: the ticket to ask for the result with, or None when
        the queue is full. A step that fails takes those queued behind it with it."""
        return self._submitted("rollout_submit", controls._struct())

    def submit_picture(self, picture: npt.ArrayLike, *, order: Order = "rgba") -> int | None:
        """Queues the append of a picture, which is copied; see `append` and `submit`."""
        struct, owner = source(picture, order)
        ticket = self._submitted("rollout_submit_picture", struct)
        del owner
        return ticket

    def submit_pictures(self, pictures: Sequence[npt.ArrayLike], *, order: Order = "rgba") -> int | None:
        """Queues the append of pictures, which are copied, as one latent; see `append_pictures` and `submit`."""
        structs, owners = _array(pictures, order)
        ticket = c_uint64()
        result = call("rollout_submit_pictures", self._handle, structs, len(pictures), byref(ticket))
        del owners
        return None if result == c.QUEUE_FULL else ticket.value

    def _submitted(self, function: str, struct: c.Sized) -> int | None:
        ticket = c_uint64()
        result = call(function, self._handle, byref(struct), byref(ticket))
        return None if result == c.QUEUE_FULL else ticket.value

    def poll(self, ticket: int) -> tuple[StepInfo, Anchor] | None:
        """The result of a queued step, without waiting; None while it waits or runs. A result is given once.

        Raises what the step raised; `InvalidArgument` for a ticket that was given its result.
        """
        return self._result("rollout_poll", ticket)

    def wait(self, ticket: int, timeout: float | None = None) -> tuple[StepInfo, Anchor] | None:
        """As `poll`, and waits for the step to end: `timeout` seconds at most, None for as long as it takes.

        None when the time is over. Closing the rollout ends the wait with `Cancelled`.
        """
        if timeout is not None and not timeout >= 0:
            raise refuse("timeout", f"{timeout} is no time to wait", "Give seconds, or None for as long as it takes")
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = _GLANCE_NS if end is None else min(_GLANCE_NS, max(0, round((end - time.monotonic()) * 1e9)))
            result = self._result("rollout_wait", ticket, left)
            if result is not None or left < _GLANCE_NS:
                return result

    def _result(self, function: str, *arguments: int) -> tuple[StepInfo, Anchor] | None:
        info, anchor = c.StepInfo(), c_void_p()
        result = call(function, self._handle, *arguments, byref(info), byref(anchor))
        if result == c.NOT_READY or anchor.value is None:
            return None
        return StepInfo._of(info), Anchor(anchor.value)

    def play(self, controls: Iterable[Controls]) -> Iterator[Anchor]:
        """Makes a step of each of the controls and gives the anchors in order, keeping the queue full meanwhile: the world
        works on the next steps while the caller looks at an anchor.

        When the iteration is given up, what is queued is cancelled.
        """
        tickets: deque[int] = deque()
        steps = iter(controls)
        following = next(steps, None)
        try:
            while tickets or following is not None:
                while following is not None and (ticket := self.submit(following)) is not None:
                    tickets.append(ticket)
                    following = next(steps, None)
                if not tickets:
                    raise refuse("queue", "is full of steps that others submitted", "Take their results first")
                result = self.wait(tickets[0])
                tickets.popleft()
                assert result is not None, "a wait without a timeout ended without a result"
                yield result[1]
        finally:
            if tickets and not self.closed:
                self._give_up(tickets)

    def _give_up(self, tickets: Iterable[int]) -> None:
        """Ends queued steps, and takes their results so that the queue is empty."""
        self.cancel()
        for ticket in tickets:
            try:
                self.wait(ticket)
            except Error:
                # The step was cancelled, or discarded after a failed step that has reported its error.
                continue

    async def result_async(self, ticket: int) -> tuple[StepInfo, Anchor]:
        """Awaits a queued step, as `wait` waits for it; the event loop goes on meanwhile, and no thread is used.

        Where the awaiting task is cancelled, also by a timeout, the rollout is, as by `cancel`: this step and all others that are
        queued are not made, and the one in progress ends before its next pass. The task ends when the rollout is at rest, so that it
        can go on at once, from the last step that was made; `info.latents` says how far it is. Other tasks that await steps of
        the rollout get `Cancelled`. `asyncio.shield` keeps a step out of all this.
        """
        return await _awaiting.result(self, ticket)

    async def step_async(self, controls: Controls = Controls()) -> tuple[StepInfo, Anchor]:  # noqa: B008 (it does not change)
        """Makes the next latent on the rollout's own thread, and awaits it; see `step` and `result_async`. Where the queue is full
        it awaits room first."""
        return await _awaiting.result(self, await _awaiting.submitted(lambda: self.submit(controls)))

    async def append_async(self, picture: npt.ArrayLike, *, order: Order = "rgba") -> tuple[StepInfo, Anchor]:
        """Appends a picture, as `step_async` makes a step; see `append`."""
        return await _awaiting.result(self, await _awaiting.submitted(lambda: self.submit_picture(picture, order=order)))

    def play_async(self, controls: Iterable[Controls]) -> AsyncIterator[Anchor]:
        """What `play` does, for `async for`: the event loop goes on while a step is made.

        When the iteration is given up, what is queued is cancelled: at once where it is closed, as by `contextlib.aclosing`, else when
        the loop comes to it.
        """
        return _awaiting.play(self, controls)

    def cancel(self) -> None:
        """Ends all that is going on: queued steps are not made, and the one in progress ends before its next pass. Each raises
        `Cancelled`, and the rollout is as before it. Does not wait."""
        call("rollout_cancel", self._handle)

    def pause(self) -> None:
        """Holds the queue: the step in progress ends as it would, and no other begins."""
        call("rollout_pause", self._handle)

    def resume(self) -> None:
        """Lets a held queue go on."""
        call("rollout_resume", self._handle)

    def single_step(self) -> bool:
        """Lets exactly one step of a held queue run; False when none is queued. Raises `InvalidArgument` when not paused."""
        return call("rollout_single_step", self._handle) == c.OK

    def save(self) -> bytes:
        """The whole state: memory, clocks, seed, operating point, last pictures. A rollout that takes it up goes on bit for bit.

        Raises `Busy` while a step is running; `OutOfMemory`, `DeviceError`.
        """
        size = c_size_t()
        call("rollout_save", self._handle, None, 0, byref(size))
        state = bytearray(size.value)
        memory = (c_char * size.value).from_buffer(state)
        call("rollout_save", self._handle, memory, size.value, byref(size))
        del memory
        return bytes(state[: size.value])

    def save_file(self, path: str | os.PathLike[str]) -> None:
        """Writes the whole state into a file, whole or not at all. Raises `FileError` and what `save` raises."""
        call("rollout_save_file", self._handle, encoded(path, "path"))

    def restore(self, state: bytes | bytearray | memoryview) -> None:
        """Takes up a state of the same bundle, precision and global window; seed and operating point become the state's.

        Raises `InvalidState`, `Unsupported` for a state of another version, `Busy`, `DeviceError`; the rollout is then as it was.
        """
        size = memoryview(state).nbytes
        if size == 0:
            raise refuse("state", "is empty", "Give what save() gave")
        memory = np.frombuffer(state, np.uint8)
        call("rollout_restore", self._handle, memory.ctypes.data, size)

    def restore_file(self, path: str | os.PathLike[str]) -> None:
        """Takes up a state from a file. Raises `FileError` and what `restore` raises."""
        call("rollout_restore_file", self._handle, encoded(path, "path"))
