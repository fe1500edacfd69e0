"""Awaited steps: the event loop continues, results equal those of direct steps, and a cancellation leaves the rollout consistent."""

import asyncio
import contextlib
import gc
from types import SimpleNamespace

import numpy as np
import pytest

import cairn
import runtime
from cairn import _awaiting

WALK = [cairn.Controls(keys=["W"], mouse=(8 * i, -2)) for i in range(6)]


@pytest.fixture(scope="module")
def world():
    runtime.need_library()
    with cairn.Device.cpu(threads=2) as device, device.load_world(runtime.need_worlds() / "tiny") as world:
        yield world


@pytest.fixture
def rollout(world):
    with world.rollout(seed=7) as rollout:
        rollout.append(runtime.pattern(72, 128))
        yield rollout


@pytest.fixture(scope="module")
def expected(world) -> list[np.ndarray]:
    """The walk's pictures, step by step."""
    with world.rollout(seed=7) as rollout:
        rollout.append(runtime.pattern(72, 128))
        pictures = []
        for controls in WALK:
            rollout.step(controls)
            pictures.append(rollout.anchor().picture())
        return pictures


def is_consistent(rollout, expected) -> None:
    """Whether a rollout is idle and its next steps equal those of an undisturbed walk."""
    assert rollout.statistics.queue_depth == 0
    for number in range(rollout.info.latents - 1, len(WALK)):
        rollout.step(WALK[number])
        assert np.array_equal(rollout.anchor().picture(), expected[number]), number


def test_awaited_steps_equal_direct_steps(world, expected):
    async def walk():
        with world.rollout(seed=7) as rollout:
            info, anchor = await rollout.append_async(runtime.pattern(72, 128))
            assert info.latent == 0 and anchor.info.pictures == 4
            pictures = []
            for number, controls in enumerate(WALK, start=1):
                info, anchor = await rollout.step_async(controls)
                assert info.latent == number
                pictures.append(anchor.picture())
            return pictures

    assert all(map(np.array_equal, asyncio.run(walk()), expected))


def test_the_loop_continues_while_a_step_is_paused(rollout):
    async def walk():
        rollout.pause()
        step = asyncio.create_task(rollout.step_async())
        for _ in range(50):
            await asyncio.sleep(0)
        # The step waits because another one blocks it, and the event loop still runs.
        assert not step.done() and rollout.info.latents == 1
        rollout.resume()
        info, _ = await step
        assert info.latent == 1

    asyncio.run(walk())


def test_two_rollouts_are_awaited_at_once(world, expected):
    async def one():
        with world.rollout(seed=7) as rollout:
            await rollout.append_async(runtime.pattern(72, 128))
            return [anchor.picture() async for anchor in rollout.play_async(WALK)]

    async def both():
        return await asyncio.gather(one(), one())

    for pictures in asyncio.run(both()):
        assert len(pictures) == len(WALK) and all(map(np.array_equal, pictures, expected))


def test_a_queued_step_can_be_awaited_by_its_ticket(rollout, expected):
    async def walk():
        tickets = [rollout.submit(controls) for controls in WALK[:2]]
        results = [await rollout.result_async(ticket) for ticket in tickets]
        assert [info.latent for info, _ in results] == [1, 2]
        assert all(np.array_equal(anchor.picture(), picture) for (_, anchor), picture in zip(results, expected, strict=False))
        with pytest.raises(cairn.InvalidArgument):
            await rollout.result_async(tickets[0])

    asyncio.run(walk())


def test_room_in_the_queue_is_awaited(world, expected):
    async def walk():
        with world.rollout(seed=7, queue_capacity=1) as rollout:
            rollout.append(runtime.pattern(72, 128))
            first = rollout.submit(WALK[0])
            second = asyncio.create_task(rollout.step_async(WALK[1]))
            await asyncio.sleep(0.01)
            assert not second.done()
            await rollout.result_async(first)
            _, anchor = await second
            assert np.array_equal(anchor.picture(), expected[1])

            # Cancelled while waiting for room: nothing was queued, and the earlier step is made.
            third = rollout.submit(WALK[2])
            waiting = asyncio.create_task(rollout.step_async(WALK[3]))
            await asyncio.sleep(0.01)
            waiting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await waiting
            _, anchor = await rollout.result_async(third)
            assert np.array_equal(anchor.picture(), expected[2])
            is_consistent(rollout, expected)

    asyncio.run(walk())


def test_a_cancelled_step_was_not_started(rollout, expected):
    async def walk():
        rollout.pause()
        step = asyncio.create_task(rollout.step_async(WALK[3]))
        await asyncio.sleep(0.01)
        step.cancel()
        with pytest.raises(asyncio.CancelledError):
            await step
        rollout.resume()
        assert rollout.info.latents == 1
        is_consistent(rollout, expected)

    asyncio.run(walk())


def test_the_rollout_is_consistent_after_a_cancellation_at_any_time(world, expected):
    async def walk(after: int) -> int:
        with world.rollout(seed=7) as rollout:
            rollout.append(runtime.pattern(72, 128))
            step = asyncio.create_task(rollout.step_async(WALK[0]))
            for _ in range(after):
                await asyncio.sleep(0.001)
            step.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await step
            made = rollout.info.latents
            assert made in (1, 2)
            is_consistent(rollout, expected)
            return made

    assert {asyncio.run(walk(after)) for after in (0, 1, 3, 10, 1000)} == {1, 2}


def test_a_timeout_leaves_the_rollout_idle(rollout, expected):
    async def walk():
        rollout.pause()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.02):
                await rollout.step_async(WALK[0])
        rollout.resume()
        # Immediately, without a wait in between.
        is_consistent(rollout, expected)

    asyncio.run(walk())


def test_steps_queued_after_a_cancelled_one_are_cancelled(rollout, expected):
    async def walk():
        rollout.pause()
        steps = [asyncio.create_task(rollout.step_async(controls)) for controls in WALK[:3]]
        await asyncio.sleep(0.01)
        steps[1].cancel()
        ends = await asyncio.gather(*steps, return_exceptions=True)
        assert [type(end) for end in ends] == [cairn.Cancelled, asyncio.CancelledError, cairn.Cancelled]
        rollout.resume()
        is_consistent(rollout, expected)

    asyncio.run(walk())


def test_a_cancellation_ends_when_all_steps_have_ended():
    """Also a step of others, which runs on while the cancelled step, which had not begun, ends at once."""

    class Running:
        closed = False
        _last_ticket = 1

        def __init__(self):
            self.depths = [1, 1, 0]

        def cancel(self):
            pass

        def poll(self, ticket):
            raise cairn.Cancelled("the step was cancelled")

        @property
        def statistics(self):
            return SimpleNamespace(queue_depth=self.depths.pop(0))

    rollout = Running()
    asyncio.run(_awaiting.cancel_steps(rollout, [1]))
    assert not rollout.depths

    class Busy(Running):
        """Others queue a step at the third question, so that the queue is never empty."""

        @property
        def statistics(self):
            self.depths.append(1)
            if len(self.depths) == 5:
                self._last_ticket = 2
            return SimpleNamespace(queue_depth=1)

    rollout = Busy()
    asyncio.run(asyncio.wait_for(_awaiting.cancel_steps(rollout, [1]), 30))
    assert len(rollout.depths) == 5


def test_a_second_cancellation_does_not_leave_a_step_behind(rollout, expected):
    async def walk():
        step = asyncio.create_task(rollout.step_async(WALK[0]))
        await asyncio.sleep(0.001)
        step.cancel()
        await asyncio.sleep(0)
        step.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await step
        is_consistent(rollout, expected)

    asyncio.run(walk())


@pytest.mark.parametrize("closing", [True, False])
def test_an_abandoned_play_leaves_the_queue_empty(rollout, expected, closing):
    async def walk():
        play = rollout.play_async(WALK)
        if closing:
            async with contextlib.aclosing(play):
                async for anchor in play:
                    assert anchor.info.latent == 1
                    break
        else:
            async for _ in play:
                break
            del play
            gc.collect()
            while rollout.statistics.queue_depth:
                await asyncio.sleep(0.001)
        is_consistent(rollout, expected)

    asyncio.run(walk())


def test_a_steps_error_is_raised_where_it_is_awaited(rollout):
    async def walk():
        with pytest.raises(cairn.InvalidArgument):
            await rollout.step_async(cairn.Controls(mouse=(float("nan"), 0)))
        rollout.pause()
        step = asyncio.create_task(rollout.step_async())
        await asyncio.sleep(0.01)
        rollout.cancel()
        with pytest.raises(cairn.Cancelled):
            await step
        rollout.resume()
        rollout.step()
        # Paused; otherwise the step would sometimes be made before the rollout is closed.
        rollout.pause()
        gone = asyncio.create_task(rollout.step_async())
        await asyncio.sleep(0)
        rollout.close()
        with pytest.raises((cairn.Cancelled, cairn.InvalidHandle)):
            await gone

    asyncio.run(walk())
