"""Queued steps for programs on asyncio: awaited without a thread of their own, and without holding the loop."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable
from typing import TYPE_CHECKING

from .controls import Controls
from .errors import Error, refuse

if TYPE_CHECKING:
    from .rollout import Anchor, Rollout, StepInfo

# Polling starts at once. Each next poll comes after a sixteenth of the time that has passed so far. In total this costs a few dozen calls that
# return at once, and a result is noticed late by at most that fraction.
_SHORTEST = 0.0005
_LONGEST = 0.02
_SHARE = 1 / 16


class _Looks:
    """Pauses between looks at something that takes a time nobody knows."""

    def __init__(self) -> None:
        self._began = asyncio.get_running_loop().time()

    async def pause(self) -> None:
        so_far = asyncio.get_running_loop().time() - self._began
        await asyncio.sleep(min(max(so_far * _SHARE, _SHORTEST), _LONGEST))


async def result(rollout: Rollout, ticket: int) -> tuple[StepInfo, Anchor]:
    """What `Rollout.result_async` does."""
    looks = _Looks()
    try:
        while (found := rollout.poll(ticket)) is None:
            await looks.pause()
        return found
    except asyncio.CancelledError:
        await give_up(rollout, [ticket])
        raise


async def submitted(submit: Callable[[], int | None]) -> int:
    """The ticket of a step that is queued as soon as there is room."""
    looks = _Looks()
    # Nothing is queued until there is room, so nothing has to be taken back either.
    while (ticket := submit()) is None:
        await looks.pause()
    return ticket


async def give_up(rollout: Rollout, tickets: Iterable[int]) -> None:
    """Ends queued steps, and returns when the rollout is at rest; a cancellation meanwhile is told afterwards."""
    if rollout.closed:
        return
    rollout.cancel()
    looks = _Looks()
    again: asyncio.CancelledError | None = None
    for ticket in tickets:
        while not _over(rollout, ticket):
            try:
                await looks.pause()
            except asyncio.CancelledError as error:
                again = error
    if again is not None:
        raise again


def _over(rollout: Rollout, ticket: int) -> bool:
    try:
        found = rollout.poll(ticket)
    except Error:
        # The step was cancelled, or discarded after a failed step that has reported its error; or the rollout was closed.
        return True
    if found is not None:
        # The step was made before it could be cancelled. Its result is not wanted.
        found[1].close()
    return found is not None


async def play(rollout: Rollout, controls: Iterable[Controls]) -> AsyncIterator[Anchor]:
    """What `Rollout.play_async` does."""
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
            looks = _Looks()
            while (found := rollout.poll(tickets[0])) is None:
                await looks.pause()
            tickets.popleft()
            yield found[1]
    finally:
        if tickets:
            await give_up(rollout, tickets)
