"""Awaits queued steps in programs on asyncio, by polling: without an extra thread, and without blocking the event loop."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING

from .controls import Controls
from .errors import Error, refuse

if TYPE_CHECKING:
    from .rollout import Anchor, Rollout, StepInfo

# The first poll comes at once. Each next poll comes after a sixteenth of the time that has passed so far. In total this costs a few dozen calls
# that return at once, and delays a result by at most that fraction.
_SHORTEST = 0.0005
_LONGEST = 0.02
_SHARE = 1 / 16


class _Poller:
    """Pauses between polls for a result of unknown duration."""

    def __init__(self) -> None:
        self._began = asyncio.get_running_loop().time()

    async def pause(self) -> None:
        so_far = asyncio.get_running_loop().time() - self._began
        await asyncio.sleep(min(max(so_far * _SHARE, _SHORTEST), _LONGEST))


async def result(rollout: Rollout, ticket: int) -> tuple[StepInfo, Anchor]:
    """Implements `Rollout.result_async`."""
    poller = _Poller()
    try:
        while (found := rollout.poll(ticket)) is None:
            await poller.pause()
        return found
    except asyncio.CancelledError:
        await cancel_steps(rollout, [ticket])
        raise


async def submit_when_ready(submit: Callable[[], int | None]) -> int:
    """Queues a step as soon as there is room, and returns its ticket."""
    poller = _Poller()
    # Nothing is queued until there is room, so a cancellation meanwhile has nothing to undo.
    while (ticket := submit()) is None:
        await poller.pause()
    return ticket


async def cancel_steps(rollout: Rollout, tickets: Iterable[int]) -> None:
    """Cancels queued steps, and returns when the rollout is idle: also the step in progress, which may be another one, has ended. It does not
    wait for steps that are queued later. A cancellation meanwhile is raised afterwards.
    """
    if rollout.closed:
        return
    rollout.cancel()
    newest = rollout._last_ticket
    poller = _Poller()
    again: asyncio.CancelledError | None = None
    for is_over in (*(partial(_has_ended, rollout, ticket) for ticket in tickets), partial(_is_idle, rollout, newest)):
        while not is_over():
            try:
                await poller.pause()
            except asyncio.CancelledError as error:
                again = error
    if again is not None:
        raise again


def _has_ended(rollout: Rollout, ticket: int) -> bool:
    try:
        found = rollout.poll(ticket)
    except Error:
        # The step was cancelled, or discarded after a failed step that has reported its error; or the rollout was closed.
        return True
    if found is not None:
        # The step was made before it could be cancelled. Its result is not wanted.
        found[1].close()
    return found is not None


def _is_idle(rollout: Rollout, newest: int) -> bool:
    if rollout._last_ticket != newest:
        return True
    try:
        return rollout.statistics.queue_depth == 0
    except Error:
        # The rollout was closed.
        return True


async def play(rollout: Rollout, controls: Iterable[Controls]) -> AsyncIterator[Anchor]:
    """Implements `Rollout.play_async`."""
    tickets: deque[int] = deque()
    steps = iter(controls)
    following = next(steps, None)
    try:
        while tickets or following is not None:
            while following is not None and (ticket := rollout.submit(following)) is not None:
                tickets.append(ticket)
                following = next(steps, None)
            if not tickets:
                raise refuse("queue", "is full of steps that others submitted", "Take their results first")
            poller = _Poller()
            while (found := rollout.poll(tickets[0])) is None:
                await poller.pause()
            tickets.popleft()
            yield found[1]
    finally:
        if tickets:
            await cancel_steps(rollout, tickets)
