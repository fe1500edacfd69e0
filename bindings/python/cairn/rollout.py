"""Rollouts, which make anchors from controls, and anchors."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import AsyncIterator, Iterable, Iterator, Sequence
from ctypes import POINTER, Array, byref, c_char, c_float, c_size_t, c_uint64, c_void_p
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from . import _awaiting, _display
from . import _interface as c
from ._handles import Object, field_values
from ._library import call, call_for_handle, encoded, make, whole
from .controls import Controls
from .errors import Error, InvalidArgument, refuse
from .pictures import Bytes, Floats, Order, source, target

if TYPE_CHECKING:
    from .presenter import Presenter
    from .world import World

# Interval between two checks for Ctrl+C, because a call into the library cannot be interrupted.
_SIGNAL_CHECK_NS = 100_000_000

# How often a state is saved again after its size has grown.
_SAVE_TRIES = 9


@dataclass(frozen=True)
class AnchorInfo:
    """Properties of an anchor. `cut` is true if it does not continue the previous anchor. `latent` is the number of its latent in the rollout,
    from 0; `latents_per_second` is 0 for a picture of your own, and so are the sizes of its latent.
    """

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
    """An anchor: an immutable copy, independent of its rollout. May be used from any thread."""

    _kind = "anchor"

    @classmethod
    def of_picture(cls, picture: npt.ArrayLike, number: int, *, cut: bool = False, order: Order = "rgba") -> Self:
        """Makes an anchor of a picture of your own, `uint8` `[height, width, 4]` or `[height, width, 3]`, which is copied.

        `number` increases by one from anchor to anchor; `cut` is true if it does not continue the previous one. Raises `InvalidArgument`,
        `OutOfMemory`.
        """
        struct, owner = source(picture, order)
        number = whole("number", number, 0, (1 << 64) - 1)
        anchor = cls(make(cls._kind, "anchor_create", byref(struct), number, c.ANCHOR_CUT if cut else 0))
        del owner
        return anchor

    @property
    def info(self) -> AnchorInfo:
        """Its properties."""
        struct = self._fill("anchor_get_info", c.AnchorInfo)
        return AnchorInfo(cut=bool(struct.flags & c.ANCHOR_CUT), **field_values(struct, ("flags",)))

    def picture(self, index: int = -1, *, out: Bytes | None = None, order: Order = "rgba") -> Bytes:
        """A copy of one of its pictures, `uint8` `[height, width, 4]`.

        `index` is in order of time, and counts from the end if negative; the last is the anchor itself. With `out`, which may be a part of a
        larger array, the pixels are written there, and `out` is returned. Raises `InvalidArgument`.
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
        """A notebook's representation: all its pictures side by side, in order of time."""
        return _display.anchor(self)

    def _repr_png_(self) -> bytes | None:
        """The anchor itself, its last picture, as a PNG; None if it is closed."""
        return None if self.closed else _display.png(self.picture())

    def latent(self) -> Floats:
        """Its latent, `float32` `[channels, height, width]`: a copy. Raises `Unsupported` for a picture of your own."""
        info = self.info
        latent = np.empty((info.latent_channels, info.latent_height, info.latent_width), np.float32)
        call("anchor_read_latent", self._handle, latent.ctypes.data_as(POINTER(c_float)), latent.size)
        return latent


@dataclass(frozen=True)
class StepInfo:
    """Report on a step. `committed` is true if keys and values were copied into the ring, with joined passes those of the latent before; times are nanoseconds of wall time."""

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
        return cls(committed=bool(struct.flags & c.STEP_COMMITTED), **field_values(struct, ("flags",)))


@dataclass(frozen=True)
class RolloutInfo:
    """Properties and progress of a rollout: the number of `latents` made so far, its `seed`, its rates, and its full operating point, which is cut
    off after 191 bytes.
    """

    latents: int
    seed: int
    pictures_per_latent: int
    latents_per_second: int
    presented_rate: int
    operating_point: str


@dataclass(frozen=True)
class RolloutStatistics:
    """Statistics of a rollout since it was made, up to the end of its last step; `queue_depth` is current. Times are nanoseconds."""

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
    """Pictures as an array of the library's structs, and the objects that own their memory."""
    made = [source(picture, order) for picture in pictures]
    # At least one element: for an empty list the library gets a valid pointer and reports the count of 0.
    structs = (c.Picture * max(1, len(made)))(*(struct for struct, _ in made))
    return structs, [owner for _, owner in made]


def _joined(schedules: Sequence[str]) -> bytes:
    """Schedules as one text for the library."""
    if isinstance(schedules, str):
        raise refuse("schedules", f"is the text {schedules!r}", f"Give a list of schedules: [{schedules!r}]")
    return encoded(" ".join(schedules), "schedules") or b""


class Rollout(Object):
    """One running instance of a world: its memory of the past, its clocks and its noise.

    `append`, `append_pictures`, `step`, `reset`, `rest`, `restore`, `restore_file`, `keep_encoder_stream`, `set_budget`, `govern` and `ungovern`
    exclude each other: during another of them, and while steps are queued, they raise `Busy`. Everything else may be called from any thread at
    any time. `info`, `anchor`, `save` and `save_file` raise `Busy` while a step is running.
    """

    _kind = "rollout"
    _last_ticket = 0
    """Ticket of the step that was queued last; 0 if there is none."""

    @property
    def info(self) -> RolloutInfo:
        """Its properties and progress."""
        return RolloutInfo(**field_values(self._fill("rollout_get_info", c.RolloutInfo)))

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, object]:
        """A notebook's representation: its progress, and the pictures of its last anchor."""
        return _display.rollout(self)

    @property
    def statistics(self) -> RolloutStatistics:
        """Its statistics so far; does not wait for a running step."""
        return RolloutStatistics(**field_values(self._fill("rollout_get_statistics", c.RolloutStatistics)))

    def append(self, picture: npt.ArrayLike, *, order: Order = "rgba") -> StepInfo:
        """Appends a picture of any size: the seed, or later an edit of the scene. It is `uint8` `[height, width, 4]` or
        `[height, width, 3]`, and is copied. Raises `InvalidArgument`, `Busy`, `OutOfMemory`, `DeviceError`, `Cancelled`."""
        struct, owner = source(picture, order)
        info = c.StepInfo()
        call("rollout_append", self._handle, byref(struct), byref(info))
        del owner
        return StepInfo._of(info)

    def append_pictures(self, pictures: Sequence[npt.ArrayLike], *, order: Order = "rgba") -> StepInfo:
        """Appends consecutive pictures, the oldest first, as one latent: the 4 of a latent, so that a moving scene keeps moving, or 1, a still.
        See `append`.
        """
        structs, owners = _array(pictures, order)
        info = c.StepInfo()
        call("rollout_append_pictures", self._handle, structs, len(pictures), byref(info))
        del owners
        return StepInfo._of(info)

    def keep_encoder_stream(self, keep: bool) -> None:
        """Sets whether the encoder keeps its state from one appended picture to the next, as the released engine does, or starts anew with
        each, which is the default. The state is empty after this call and after `reset`; it is part of a saved state.

        Raises `Unsupported` if the bundle was built without `--streaming-encoder`, and `Busy` while steps are queued.
        """
        call("rollout_keep_encoder_stream", self._handle, int(keep))

    def rest(self) -> None:
        """Frees the device memory of a rollout that makes no latents for a while: evicts its rings, latents and pictures after the work in
        flight. The next call that needs them makes them resident again, or raises `OutOfMemory` and changes nothing. `pause` also rests a
        rollout whose queue was used. Has no effect on a processor. Raises `Busy` while steps are queued.
        """
        call("rollout_rest", self._handle)

    def step(self, controls: Controls = Controls()) -> StepInfo:  # noqa: B008 (it does not change)
        """Makes the next latent; the controls cover one latent's interval of world time. Raises `InvalidArgument`, `Busy`, `Unsupported` for a
        key that the world does not know, `OutOfMemory`, `DeviceError`, `Cancelled`.
        """
        info = c.StepInfo()
        call("rollout_step", self._handle, byref(controls._struct()), byref(info))
        return StepInfo._of(info)

    def anchor(self) -> Anchor:
        """A copy of the last anchor. Raises `InvalidArgument` before the first latent; `Busy` while a step is running."""
        return Anchor(make(Anchor._kind, "rollout_get_anchor", self._handle))

    def set_budget(self, latent_ns: int, schedules: Sequence[str]) -> None:
        """Limits the wall time per latent to `latent_ns` nanoseconds: latents are made with the first of `schedules`, such as `["stock",
        "explicit:1:0.5:0"]`, until that takes too long, and then with one of fewer passes. The choice depends on the times of previous
        latents, so the same controls may give other pictures the next time. An empty list removes the limit.

        Raises `InvalidArgument`, and `Busy` while steps are queued.
        """
        call("rollout_set_budget", self._handle, whole("latent_ns", latent_ns, 0, (1 << 64) - 1), _joined(schedules))

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
        """Keeps the rollout, and a presenter's frames, within a budget: `frame_ns` nanoseconds of device time per shown frame, and
        `memory_mib`; 0 for no limit. From measured times it chooses the passes per latent, the window, and the number of frames made per
        anchor. The window is one of `worlds`, which are of the same bundle, or the rollout's own; it loads no world itself. Passes are
        reduced first, then frames, the window last; each is raised again when there is time. `multiplier` is the number of frames shown per
        anchor: 0 for the presenter's own, and for 1 without a presenter. `statistics` reports its actions. It replaces `set_budget`, which
        ends it.

        Raises `InvalidArgument`; `OutOfMemory` if even the narrowest window needs too much; `Busy` while steps are queued.
        """
        handles = (c_void_p * len(worlds))(*(world._handle for world in worlds))
        budget = c.Budget(
            multiplier=whole("multiplier", multiplier, 0, 64),
            frame_ns=whole("frame_ns", frame_ns, 0, (1 << 64) - 1),
            memory_mib=whole("memory_mib", memory_mib, 0, (1 << 64) - 1),
            schedules=_joined(schedules) or None,
            worlds=handles,
            world_count=len(worlds),
            presenter=None if presenter is None else presenter._handle,
        )
        call("rollout_govern", self._handle, byref(budget))

    def ungovern(self) -> None:
        """Removes the budget of `govern`, and keeps the current settings. Raises `Busy` while steps are queued."""
        call("rollout_govern", self._handle, None)

    def reset(self) -> None:
        """Resets the rollout to its start with the same seed: no latents, empty memory."""
        call("rollout_reset", self._handle)

    def submit(self, controls: Controls = Controls()) -> int | None:  # noqa: B008 (it does not change)
        """Queues a step for the rollout's own thread, and returns at once: the ticket that identifies its result, or None if the queue is full.
        A step that fails cancels the steps queued after it.
        """
        return self._submit("rollout_submit", byref(controls._struct()))

    def submit_picture(self, picture: npt.ArrayLike, *, order: Order = "rgba") -> int | None:
        """Queues a picture, which is copied, to be appended; see `append` and `submit`."""
        struct, owner = source(picture, order)
        ticket = self._submit("rollout_submit_picture", byref(struct))
        del owner
        return ticket

    def submit_pictures(self, pictures: Sequence[npt.ArrayLike], *, order: Order = "rgba") -> int | None:
        """Queues pictures, which are copied, to be appended as one latent; see `append_pictures` and `submit`."""
        structs, owners = _array(pictures, order)
        ticket = self._submit("rollout_submit_pictures", structs, len(pictures))
        del owners
        return ticket

    def _submit(self, function: str, *arguments: Any) -> int | None:
        ticket = c_uint64()
        result = call(function, self._handle, *arguments, byref(ticket))
        if result == c.QUEUE_FULL:
            return None
        self._last_ticket = ticket.value
        return ticket.value

    def poll(self, ticket: int) -> tuple[StepInfo, Anchor] | None:
        """Fetches the result of a queued step, without waiting; None while the step waits or runs. Each result can be fetched once.

        Raises the step's error; `InvalidArgument` for a ticket whose result was fetched.
        """
        return self._result("rollout_poll", whole("ticket", ticket, 0, (1 << 64) - 1))

    def wait(self, ticket: int, timeout: float | None = None) -> tuple[StepInfo, Anchor] | None:
        """Waits for a queued step to end, for at most `timeout` seconds, None for no limit, and fetches its result as `poll` does.

        Returns None after the timeout. Closing the rollout ends the wait with `Cancelled`. Raises `InvalidArgument` for a negative timeout, and
        the errors of `poll`.
        """
        ticket = whole("ticket", ticket, 0, (1 << 64) - 1)
        if timeout is not None and not timeout >= 0:
            raise refuse("timeout", f"{timeout} is no time to wait", "Give seconds, or None for as long as it takes")
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            # Limited before it is rounded, because an infinite timeout cannot be.
            left = _SIGNAL_CHECK_NS if end is None else round(min(_SIGNAL_CHECK_NS, max(0.0, (end - time.monotonic()) * 1e9)))
            result = self._result("rollout_wait", ticket, left)
            if result is not None or left < _SIGNAL_CHECK_NS:
                return result

    def _result(self, function: str, *arguments: int) -> tuple[StepInfo, Anchor] | None:
        info, anchor = c.StepInfo(), c_void_p()
        result = call_for_handle(Anchor._kind, anchor, function, self._handle, *arguments, byref(info), byref(anchor))
        if result == c.NOT_READY or anchor.value is None:
            return None
        return StepInfo._of(info), Anchor(anchor.value)

    def play(self, controls: Iterable[Controls]) -> Iterator[Anchor]:
        """Makes a step for each of the controls and yields the anchors in order, keeping the queue full: the world works on the next steps
        while the caller uses an anchor.

        If the iteration is abandoned, queued steps are cancelled.
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
                self._cancel_steps(tickets)

    def _cancel_steps(self, tickets: Iterable[int]) -> None:
        """Cancels queued steps, and fetches their results so that the queue is empty."""
        self.cancel()
        for ticket in tickets:
            try:
                self.wait(ticket)
            except Error:
                # The step was cancelled, or discarded after a failed step that has reported its error.
                continue

    async def result_async(self, ticket: int) -> tuple[StepInfo, Anchor]:
        """Awaits a queued step, as `wait` waits for it; the event loop continues meanwhile, and no thread is used.

        If the awaiting task is cancelled, also by a timeout, this does what `cancel` does: this step and all others that are queued are not
        made, and the one in progress ends before its next pass. The task ends when the rollout is idle, so that it can continue at once from
        the last step that was made; `info.latents` is the number of latents so far. Other tasks that await steps of the rollout get
        `Cancelled`. `asyncio.shield` protects a step from this.
        """
        return await _awaiting.result(self, ticket)

    async def step_async(self, controls: Controls = Controls()) -> tuple[StepInfo, Anchor]:  # noqa: B008 (it does not change)
        """Makes the next latent on the rollout's own thread, and awaits it; see `step` and `result_async`. If the queue is full, it first
        awaits room.
        """
        return await _awaiting.result(self, await _awaiting.submit_when_ready(lambda: self.submit(controls)))

    async def append_async(self, picture: npt.ArrayLike, *, order: Order = "rgba") -> tuple[StepInfo, Anchor]:
        """Appends a picture on the rollout's own thread, and awaits it; see `append` and `result_async`."""
        return await _awaiting.result(self, await _awaiting.submit_when_ready(lambda: self.submit_picture(picture, order=order)))

    def play_async(self, controls: Iterable[Controls]) -> AsyncIterator[Anchor]:
        """Does what `play` does, for `async for`: the event loop continues while a step is made.

        If the iteration is abandoned, queued steps are cancelled: at once if it is closed, as by `contextlib.aclosing`, otherwise when the
        event loop finalises it.
        """
        return _awaiting.play(self, controls)

    def cancel(self) -> None:
        """Cancels all work: queued steps are not made, and the one in progress ends before its next pass. Each raises `Cancelled` and leaves
        the rollout unchanged. Does not wait.
        """
        call("rollout_cancel", self._handle)

    def pause(self) -> None:
        """Pauses the queue: the step in progress completes, and no other begins."""
        call("rollout_pause", self._handle)

    def resume(self) -> None:
        """Resumes a paused queue."""
        call("rollout_resume", self._handle)

    def single_step(self) -> bool:
        """Runs exactly one step of a paused queue; False if none is queued. Raises `InvalidArgument` if the queue is not paused."""
        return call("rollout_single_step", self._handle) == c.OK

    def save(self) -> bytes:
        """Saves the whole state: memory, clocks, seed, operating point, last pictures. A rollout that restores it continues bit for bit the
        same.

        Raises `Busy` while a step is running; `OutOfMemory`, `DeviceError`.
        """
        size = c_size_t()
        call("rollout_save", self._handle, None, 0, byref(size))
        for attempt in range(1, _SAVE_TRIES + 1):
            state = bytearray(size.value)
            memory = (c_char * len(state)).from_buffer(state)
            try:
                call("rollout_save", self._handle, memory, len(state), byref(size))
            except InvalidArgument:
                # A queued step that ended since the size was asked may have changed it, if the rollout has a budget.
                call("rollout_save", self._handle, None, 0, byref(size))
                if size.value <= len(state) or attempt == _SAVE_TRIES:
                    raise
            else:
                break
        del memory
        return bytes(state[: size.value])

    def save_file(self, path: str | os.PathLike[str]) -> None:
        """Writes the whole state to a file, completely or not at all. Raises `FileError` and the errors of `save`."""
        call("rollout_save_file", self._handle, encoded(path, "path"))

    def restore(self, state: bytes | bytearray | memoryview) -> None:
        """Restores a state of the same bundle, precision and global window; the rollout gets its seed and operating point.

        Raises `InvalidState`, `Unsupported` for a state of another version, `Busy`, `DeviceError`; the rollout is then unchanged.
        """
        size = memoryview(state).nbytes
        if size == 0:
            raise refuse("state", "is empty", "Give what save() gave")
        memory = np.frombuffer(state, np.uint8)
        call("rollout_restore", self._handle, memory.ctypes.data, size)

    def restore_file(self, path: str | os.PathLike[str]) -> None:
        """Restores a state from a file. Raises `FileError` and the errors of `restore`."""
        call("rollout_restore_file", self._handle, encoded(path, "path"))
