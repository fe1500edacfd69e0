"""The runtime through the package: a whole rollout, lifetimes, errors, callbacks. Drives the shared library."""

import gc
import logging
import os
import signal
import sys
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

import cairn
import runtime
from cairn import _library, logs


@pytest.fixture(scope="module")
def device():
    runtime.need_library()
    with cairn.Device.cpu(threads=2) as device:
        yield device


@pytest.fixture(scope="module")
def world_path() -> Path:
    return runtime.need_worlds() / "tiny"


@pytest.fixture(scope="module")
def world(device, world_path):
    with device.load_world(world_path) as world:
        yield world


@pytest.fixture
def rollout(world):
    with world.rollout(seed=7) as rollout:
        rollout.append(runtime.pattern(72, 128))
        yield rollout


WALK = [cairn.Controls(keys=["W"], mouse=(8 * i, -2)) for i in range(5)]


def shown(world, walk, seed=7) -> np.ndarray:
    """The last pictures of a walk's anchors."""
    with world.rollout(seed=seed) as rollout:
        rollout.append(runtime.pattern(72, 128))
        pictures = []
        for controls in walk:
            rollout.step(controls)
            with rollout.anchor() as anchor:
                pictures.append(anchor.picture())
    return np.stack(pictures)


def test_slices_give_the_same_pictures(device, world, world_path):
    assert (world.info.slices, world.info.longest_slice_us) == (1, 0)
    layers, expected = world.info.layers, shown(world, WALK[:2])
    for slices in (2, layers):
        with device.load_world(world_path, slices=slices) as sliced:
            assert sliced.info.slices == slices
            assert np.array_equal(shown(sliced, WALK[:2]), expected)
    with pytest.raises(cairn.InvalidArgument, match=f"it can be split into 1 to {layers}") as raised:
        device.load_world(world_path, slices=layers + 1)
    assert raised.value.field == "slices"
    # No slice takes a microsecond, and none takes half an hour.
    for limit, slices in ((1, layers), (1_800_000_000, 1)):
        stages = []
        with device.load_world(
            world_path, longest_submission_us=limit, progress=lambda *at: stages.append(at)
        ) as chosen:
            assert chosen.info.slices == slices and chosen.info.longest_slice_us > 0
        assert stages[-1][1] == stages[-1][2] >= slices + 2


def test_a_whole_rollout(device, world_path):
    stages = []
    with device.load_world(world_path, progress=lambda *at: stages.append(at)) as world:
        assert {stage for stage, _, _ in stages} == {"reading", "preparing"}
        assert stages[-1][1] == stages[-1][2] > 0
        info = world.info
        assert (info.render_width, info.render_height, info.precision) == (128, 72, "f32")
        assert info.pictures_per_latent == 4 and len(info.digest) == 64 and info.licence == "CC0-1.0"
        assert world.memory.total > world.memory.ring > 0
        with world.rollout(seed=1) as rollout:
            assert rollout.info.latents == 0
            first = rollout.append(runtime.pattern(200, 300, channels=3))
            assert first.committed and first.latent == 0
            before = None
            for number in range(1, 16):
                step = rollout.step(cairn.Controls(keys=["W", 0x10], mouse=(3, -1), scroll=1))
                assert step.latent == number and step.denoise_passes > 0 and step.denoise_ns > 0
                with rollout.anchor() as anchor:
                    pictures = anchor.pictures()
                    latent = anchor.latent()
                    assert anchor.info.latent == number and not anchor.info.cut
                assert [picture.shape for picture in pictures] == [(72, 128, 4)] * 4
                assert latent.shape == (info.latent_channels, info.latent_height, info.latent_width)
                assert np.isfinite(latent).all() and np.ptp(latent) > 0
                assert before is None or not np.array_equal(before, pictures[-1])
                before = pictures[-1]
            assert rollout.info.latents == rollout.statistics.latents == 16


def test_equal_seeds_and_controls_give_equal_pictures(world):
    first = shown(world, WALK)
    assert np.array_equal(first, shown(world, WALK))
    assert not np.array_equal(first, shown(world, WALK, seed=8))
    assert not np.array_equal(first, shown(world, [cairn.Controls()] * len(WALK)))


def test_pictures_outlive_everything(device, world_path):
    world = device.load_world(world_path)
    rollout = world.rollout()
    rollout.append(runtime.pattern(72, 128))
    anchor = rollout.anchor()
    world.close()
    rollout.step()
    rollout.close()
    picture, latent = anchor.picture(), anchor.latent()
    anchor.close()
    copies = picture.copy(), latent.copy()
    gc.collect()
    assert np.array_equal(picture, copies[0]) and np.array_equal(latent, copies[1])
    assert picture.flags.writeable and picture.flags.owndata


def test_arrays_of_any_layout_are_read_right(rollout):
    picture = runtime.pattern(72, 128)
    wide = np.zeros((80, 140, 4), np.uint8)
    wide[3:75, 5:133] = picture
    expected = first_picture(picture)
    for same in (wide[3:75, 5:133], np.asfortranarray(picture), picture[::-1].copy()[::-1], picture[:, :, :3]):
        assert np.array_equal(first_picture(same), expected)
    assert np.array_equal(first_picture(picture[:, :, [2, 1, 0, 3]], order="bgra"), expected)
    assert not np.array_equal(first_picture(picture[::-1]), expected)


def first_picture(picture, order="rgba") -> np.ndarray:
    with cairn.Anchor.of_picture(picture, 0, order=order) as anchor:
        return anchor.picture()


def test_pictures_go_into_memory_of_the_caller(rollout):
    with rollout.anchor() as anchor:
        picture = anchor.picture()
        wall = np.full((100, 200, 4), 9, np.uint8)
        part = wall[10:82, 20:148]
        assert anchor.picture(out=part) is part
        assert np.array_equal(part, picture)
        part[:] = 9
        assert (wall == 9).all(), "nothing beside the part was written"
        blue = anchor.picture(order="bgra")
        assert np.array_equal(blue[:, :, [2, 1, 0, 3]], picture)
        assert np.array_equal(anchor.picture(3), picture) and np.array_equal(anchor.picture(-4), anchor.picture(0))
        read_only = np.empty((72, 128, 4), np.uint8)
        read_only.flags.writeable = False
        for wrong in (np.empty((72, 128, 3), np.uint8), np.empty((72, 128, 4), np.int8), wall[10:82, 20:148].T, read_only, [1]):
            with pytest.raises(cairn.InvalidArgument, match="out: "):
                anchor.picture(out=wrong)
        for index in (4, -5):
            with pytest.raises(cairn.InvalidArgument, match="0 to 3"):
                anchor.picture(index)


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((4, 4, 4), np.float32), "astype"),
        (np.zeros((4, 4), np.uint8), "height, width, 4"),
        (np.zeros((4, 4, 2), np.uint8), "height, width, 4"),
        (np.zeros((0, 4, 4), np.uint8), "at least one pixel"),
        (np.zeros((1, 16385, 4), np.uint8), "16384"),
        ("a text", "uint8"),
    ],
)
def test_invalid_pictures_are_refused_with_a_remedy(rollout, picture, message):
    with pytest.raises(cairn.InvalidArgument, match=message) as raised:
        rollout.append(picture)
    assert "picture" in raised.value.field
    assert rollout.info.latents == 1


def test_an_error_has_the_librarys_message_and_its_parts(device, tmp_path):
    with pytest.raises(cairn.Error) as raised:
        device.load_world(tmp_path / "nowhere")
    error = raised.value
    assert error.function == "cairn_world_load"
    assert error.name.startswith("CAIRN_ERROR_") and error.result < 0
    assert str(tmp_path / "nowhere") in error.field
    assert str(error).startswith("cairn_world_load: ")
    assert all(part in str(error) for part in (error.field, error.cause, error.remedy))
    with pytest.raises(ValueError, match="fastest") as raised:
        device.load_world(tmp_path, operating_point="fastest")
    assert isinstance(raised.value, cairn.InvalidArgument)


def test_invalid_texts_are_refused(device):
    for path in ("a\0b", "\udcff", b"bytes"):
        with pytest.raises(cairn.InvalidArgument, match="path: "):
            device.load_world(path)


@pytest.mark.parametrize(
    "make",
    [
        lambda device, world: cairn.Device.cpu(threads=1025),
        lambda device, world: cairn.Device.cpu(threads=-1),
        lambda device, world: world.rollout(seed=-1),
        lambda device, world: world.rollout(seed=1 << 64),
        lambda device, world: world.rollout(queue_capacity=65),
        lambda device, world: world.rollout(operating_point="nonsense"),
        lambda device, world: device.load_world(precision="f8"),
        lambda device, world: device.load_world(slices=-1),
        lambda device, world: device.load_world(slices=1 << 32),
        lambda device, world: device.load_world(longest_submission_us=-1),
        lambda device, world: cairn.Controls(keys="W"),
        lambda device, world: cairn.Controls(keys=["NO_SUCH_KEY"]),
        lambda device, world: cairn.Controls(keys=[256]),
        lambda device, world: cairn.Script("no script"),
        lambda device, world: cairn.requirements("gpu"),
    ],
)
def test_invalid_arguments_are_refused(device, world, make):
    with pytest.raises(cairn.InvalidArgument) as raised:
        make(device, world)
    assert raised.value.cause


def test_invalid_controls_leave_the_rollout_unchanged(rollout):
    for controls in (cairn.Controls(mouse=(float("nan"), 0)), cairn.Controls(mouse=(1e6, 0))):
        with pytest.raises(cairn.InvalidArgument):
            rollout.step(controls)
    assert rollout.info.latents == 1


def test_closed_objects_stay_closed(world):
    rollout = world.rollout()
    assert not rollout.closed
    rollout.close()
    rollout.close()
    assert rollout.closed
    with pytest.raises(cairn.InvalidHandle, match="this Rollout is closed"):
        rollout.step()


def test_the_garbage_collector_destroys_objects(world):
    rollout = world.rollout()
    rollout.append(runtime.pattern(8, 8))
    assert rollout.submit() is not None
    gone = weakref.ref(rollout)
    cycle = [rollout]
    cycle.append(cycle)
    del rollout, cycle
    gc.collect()
    assert gone() is None


def test_a_load_can_be_cancelled(device, world_path):
    with pytest.raises(cairn.Cancelled):
        device.load_world(world_path, progress=lambda *_: False)

    class Mine(Exception):
        pass

    def fail(stage, done, total):
        if stage == "preparing":
            raise Mine

    with pytest.raises(Mine):
        device.load_world(world_path, progress=fail)
    device.load_world(world_path).close()


def interrupt_in_the_library(main: int) -> None:
    """Sends SIGINT while the thread `main` is in a function of the library, not in a callback."""
    while sys._current_frames()[main].f_code is not _library.call.__code__:
        time.sleep(0)
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT would end the process")
@pytest.mark.parametrize("has_own_handler", [False, True])
def test_an_interrupt_cancels_a_load(device, world_path, monkeypatch, has_own_handler):
    handled, threads = [], []

    def interrupt_once(*_):
        if not threads:
            threads.append(threading.Thread(target=interrupt_in_the_library, args=(threading.get_ident(),)))
            threads[0].start()

    handler = (lambda number, frame: handled.append(number)) if has_own_handler else signal.default_int_handler
    former = signal.signal(signal.SIGINT, handler)
    try:
        with pytest.raises(cairn.Cancelled if has_own_handler else KeyboardInterrupt):
            device.load_world(world_path, progress=interrupt_once)
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, former)
        threads[0].join()
    assert handled == ([signal.SIGINT] if has_own_handler else [])
    device.load_world(world_path).close()


def test_another_thread_can_load_a_world(device, world_path):
    found = []
    thread = threading.Thread(target=lambda: found.append(device.load_world(world_path)))
    thread.start()
    thread.join()
    found[0].close()


def test_queued_steps_give_the_same_results(world):
    expected = shown(world, WALK)
    with world.rollout(seed=7, queue_capacity=3) as rollout:
        assert rollout.submit_picture(runtime.pattern(72, 128)) is not None
        # The seed's result was not taken yet, so there is room for two.
        tickets = [rollout.submit(WALK[0]), rollout.submit(WALK[1])]
        assert None not in tickets and rollout.submit(WALK[2]) is None
        assert rollout.wait(1) is not None
        for i, ticket in enumerate(tickets):
            info, anchor = rollout.wait(ticket)
            assert info.latent == i + 1 and np.array_equal(anchor.picture(), expected[i])
        with pytest.raises(cairn.InvalidArgument):
            rollout.poll(tickets[0])
        for i, anchor in enumerate(rollout.play(WALK[2:])):
            assert np.array_equal(anchor.picture(), expected[i + 2])
        assert rollout.info.latents == len(WALK) + 1


def test_tickets_and_timeouts_are_checked(rollout):
    ticket = rollout.submit()
    for wrong in (ticket + (1 << 64), -1, 1.0):
        for fetch in (rollout.poll, rollout.wait):
            with pytest.raises(cairn.InvalidArgument, match="ticket: "):
                fetch(wrong)
    for wrong in (-1, float("nan")):
        with pytest.raises(cairn.InvalidArgument, match="timeout: "):
            rollout.wait(ticket, wrong)
    assert rollout.wait(ticket, float("inf")) is not None
    assert rollout.wait(rollout.submit(), 1e300) is not None


def test_an_interrupt_after_a_fetch_destroys_the_anchor(rollout, monkeypatch):
    functions, destroyed = _library.library().functions, []
    wait, destroy = functions["rollout_wait"], functions["anchor_destroy"]

    def wait_and_interrupt(*arguments):
        if (result := wait(*arguments)) == 0:
            raise KeyboardInterrupt
        return result

    monkeypatch.setitem(functions, "rollout_wait", wait_and_interrupt)
    monkeypatch.setitem(functions, "anchor_destroy", lambda handle: destroyed.append(destroy(handle)))
    with pytest.raises(KeyboardInterrupt):
        rollout.wait(rollout.submit())
    assert destroyed == [0]


def test_an_abandoned_play_leaves_the_queue_empty(rollout):
    for anchor in rollout.play([cairn.Controls()] * 50):
        assert anchor.info.latent == 1
        break
    gc.collect()
    rollout.step()
    assert rollout.statistics.queue_depth == 0
    assert 2 < rollout.info.latents < 20


def test_pause_and_single_step(rollout):
    rollout.pause()
    with pytest.raises(cairn.InvalidArgument):
        rollout.resume()
        rollout.single_step()
    rollout.pause()
    assert not rollout.single_step()
    tickets = [rollout.submit(), rollout.submit()]
    assert rollout.wait(tickets[0], timeout=0.05) is None and rollout.poll(tickets[0]) is None
    assert rollout.single_step()
    assert rollout.wait(tickets[0]) is not None and rollout.poll(tickets[1]) is None
    rollout.cancel()
    with pytest.raises(cairn.Cancelled):
        rollout.wait(tickets[1])
    rollout.resume()
    rollout.step()


def test_a_budget_limits_latents(rollout):
    # No step finishes within a nanosecond.
    rollout.set_budget(1, ["stock", "explicit:1:0.5:0"])
    passes = [rollout.step(controls).denoise_passes for controls in WALK]
    assert passes[0] == passes[1] == passes[2] > 2 and passes[3:] == [2, 2]
    assert "explicit:1:0.5:0" in rollout.info.operating_point
    for latent_ns, schedules in ((0, ["stock"]), (1, ["explicit:1:0.5:0", "stock"]), (1, ["fast"]), (-1, ["stock"]), (1, "stock"), (1, ["stock\0x"])):
        with pytest.raises(cairn.InvalidArgument):
            rollout.set_budget(latent_ns, schedules)
    rollout.set_budget(0, [])


def test_one_budget_limits_latents_and_frames(world, rollout):
    with cairn.Presenter(4, interval_ns=66_666_667) as presenter:
        # No step finishes within a nanosecond.
        rollout.govern(1, schedules=["stock", "explicit:1:0.5:0"], worlds=[world], presenter=presenter)
        passes = [rollout.step(controls).denoise_passes for controls in WALK]
        assert passes[0] == passes[1] == passes[2] > 2 and passes[3:] == [2, 2]
        told = rollout.statistics
        assert (told.governed_less, told.governed_more, told.governed_made, told.governed_passes) == (1, 0, 1, 2)
        assert told.governed_latents == 5 and told.governed_frame_ns > 1 and told.governed_window > 0
        assert presenter.statistics.made_to_anchor == 1
        for wrong in (
            {},
            {"frame_ns": -1},
            {"frame_ns": 1, "multiplier": 3},
            {"frame_ns": 1, "worlds": [world, world]},
            {"frame_ns": 1, "schedules": "stock"},
        ):
            with pytest.raises(cairn.InvalidArgument):
                rollout.govern(**wrong, presenter=presenter)
        with pytest.raises(cairn.OutOfMemory):
            rollout.govern(memory_mib=1)
        rollout.ungovern()
    rollout.step()


def test_a_second_step_beside_a_queued_one_is_busy(rollout):
    rollout.pause()
    ticket = rollout.submit()
    with pytest.raises(cairn.Busy):
        rollout.step()
    rollout.resume()
    assert rollout.wait(ticket) is not None


def test_a_restored_state_continues_bit_for_bit(world, tmp_path):
    expected = shown(world, WALK)
    file = tmp_path / "ein Zustand – 状態.state"
    with world.rollout(seed=7) as rollout, world.rollout(seed=1) as other, world.rollout(seed=2) as third:
        rollout.append(runtime.pattern(72, 128))
        for controls in WALK[:2]:
            rollout.step(controls)
        state = rollout.save()
        rollout.save_file(file)
        other.restore(bytearray(state))
        third.restore_file(file)
        for heir in (other, third):
            assert heir.info.seed == 7
            heir.step(WALK[2])
            assert np.array_equal(heir.anchor().picture(), expected[2])
        for wrong in (b"", state[:-1], bytes(len(state))):
            with pytest.raises((cairn.InvalidState, cairn.InvalidArgument, cairn.Unsupported)):
                other.restore(wrong)
        with pytest.raises(OSError, match="nowhere"):
            other.restore_file(tmp_path / "nowhere")
        assert other.info.latents == 4


@pytest.mark.parametrize("sizes", [(100,), (100, 60), (100, 120), (100, 120, 120, 90), (100, 120, 120, 130)])
def test_a_state_whose_size_changes_is_saved_whole(rollout, monkeypatch, sizes):
    monkeypatch.setattr("cairn.rollout.call", _saving(iter(sizes), sizes[-1]))
    assert rollout.save() == bytes([sizes[-1]]) * sizes[-1]


@pytest.mark.parametrize("sizes", [(100, 120, 100), range(1, 100)])
def test_a_state_that_cannot_be_saved_is_an_error(rollout, monkeypatch, sizes):
    monkeypatch.setattr("cairn.rollout.call", _saving(iter(sizes), sizes[-1]))
    with pytest.raises(cairn.InvalidArgument):
        rollout.save()


def _saving(sizes, last):
    """A double of `call` whose state has the next size in each call."""

    def call(name, handle, memory, capacity, size):
        assert name == "rollout_save"
        length = next(sizes, last)
        if memory is not None and capacity < length:
            raise cairn.InvalidArgument("the capacity is too small", -1, function=name, field="capacity", cause="", remedy="")
        if memory is not None:
            memory[:length] = bytes([length]) * length
        size._obj.value = length

    return call


def test_four_pictures_are_one_latent(world):
    pictures = [np.roll(runtime.pattern(72, 128), 8 * i, axis=1) for i in range(4)]
    latents = []
    for given in (pictures[:1], [pictures[0]] * 4, pictures):
        with world.rollout(seed=7) as rollout:
            assert rollout.append_pictures(given).latent == 0
            with rollout.anchor() as anchor:
                latents.append(anchor.latent())
            ticket = rollout.submit_pictures(given)
            rollout.wait(ticket)[1].close()
            assert rollout.info.latents == 2
    assert np.array_equal(latents[0], latents[1]) and not np.array_equal(latents[0], latents[2])
    with world.rollout(seed=7) as rollout:
        for count in (0, 2, 3, 5):
            with pytest.raises(cairn.InvalidArgument):
                rollout.append_pictures((pictures * 2)[:count])
        with pytest.raises(cairn.InvalidArgument):
            rollout.append_pictures([pictures[0], pictures[1][:, :, 0]] * 2)
        assert rollout.info.latents == 0


def test_the_encoders_state_is_kept_on_request(device, world):
    picture, other = runtime.pattern(72, 128), runtime.pattern(72, 128)[::-1]

    def second_latent(world, keep):
        with world.rollout(seed=7) as rollout:
            rollout.keep_encoder_stream(keep)
            rollout.append(picture)
            rollout.append(other)
            with rollout.anchor() as anchor:
                return anchor.latent()

    with device.load_world(runtime.need_worlds() / "stream") as streaming:
        assert not np.array_equal(second_latent(streaming, True), second_latent(streaming, False))
    with pytest.raises(cairn.Unsupported, match="streaming-encoder"):
        second_latent(world, True)


def test_a_scene_edit_is_a_cut(rollout):
    rollout.step()
    rollout.append(np.full((36, 64, 3), 200, np.uint8))
    with rollout.anchor() as anchor:
        assert anchor.info.cut
    rollout.reset()
    assert rollout.info.latents == 0
    with pytest.raises(cairn.InvalidArgument):
        rollout.anchor()


def test_threads_run_at_the_same_time(world):
    expected = shown(world, WALK)
    found: list[np.ndarray] = []
    threads = [threading.Thread(target=lambda: found.append(shown(world, WALK))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 3 and all(np.array_equal(each, expected) for each in found)


def test_other_threads_run_while_a_step_does(rollout):
    went_on = threading.Event()
    stop = threading.Event()

    def count():
        while not stop.is_set():
            went_on.set()
            time.sleep(0)

    thread = threading.Thread(target=count)
    thread.start()
    went_on.wait()
    # No call is forced to wait, so the race occurs only where a call releases the GIL. A busy machine may need many attempts.
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1000)
    try:
        went_on.clear()
        for _ in range(200):
            rollout.step()
            if went_on.is_set():
                break
        ran = went_on.is_set()
    finally:
        sys.setswitchinterval(usual)
        stop.set()
        thread.join()
    assert ran


def test_the_log_goes_to_logging(device, caplog):
    logger = logging.getLogger("host")
    try:
        cairn.log_to(logger, logging.INFO)
        # The library logs nothing when all is well, so the callback is called directly.
        with caplog.at_level(logging.DEBUG, "host"):
            for level in range(1, 6):
                logs._callbacks[-1](level, b"cairn::part", "grün".encode(), None)
        assert [record.levelno for record in caplog.records] == [40, 30, 20, 10, 10]
        assert {record.getMessage() for record in caplog.records} == {"cairn::part: grün"}
        cairn.log_to(logger, logging.CRITICAL)
    finally:
        cairn.log_to(None)
    assert len(logs._callbacks) == 1 and not logs._callbacks[-1]


def test_a_handler_that_changes_the_log_is_busy(device, monkeypatch):
    """Also while another thread changes it, and waits in the library for the handler."""
    waits, handled, raised = threading.Event(), threading.Event(), []

    class Handler(logging.Handler):
        def emit(self, record):
            waits.wait()
            try:
                cairn.log_to(None)
            except cairn.Busy as busy:
                raised.append(busy)
            handled.set()

    logger = logging.getLogger("changes")
    logger.addHandler(Handler())
    cairn.log_to(logger)
    callback, set_callback = logs._callbacks[-1], _library.library().functions["set_log_callback"]

    def wait_for_the_handler(*arguments):
        waits.set()
        assert handled.wait(10), "the handler waits for the lock"
        return set_callback(*arguments)

    monkeypatch.setitem(_library.library().functions, "set_log_callback", wait_for_the_handler)
    thread = threading.Thread(target=callback, args=(1, b"part", b"message", None))
    thread.start()
    cairn.log_to(None)
    thread.join()
    assert len(raised) == 1 and raised[0].function == "log_to"


def test_an_interrupt_while_the_log_changes_frees_no_callback(device, monkeypatch):
    functions = _library.library().functions
    set_callback = functions["set_log_callback"]

    def set_and_interrupt(*arguments):
        set_callback(*arguments)
        raise KeyboardInterrupt

    cairn.log_to(logging.getLogger("former"))
    with monkeypatch.context() as patch:
        patch.setitem(functions, "set_log_callback", set_and_interrupt)
        with pytest.raises(KeyboardInterrupt):
            cairn.log_to(logging.getLogger("interrupted"))
    assert len(logs._callbacks) == 2 and all(logs._callbacks)
    cairn.log_to(None)
    assert len(logs._callbacks) == 1


def test_threads_are_set_while_there_is_no_object(device):
    with pytest.raises(cairn.Busy, match="objects live"):
        cairn.set_threads(2)
    for wrong in [{"threads": 0}, {"threads": 1025}, {"priority": "high"}]:
        with pytest.raises(cairn.InvalidArgument):
            cairn.set_threads(**wrong)


def test_adapters_and_requirements_are_listed(device):
    assert [adapter.kind for adapter in cairn.adapters()][0] == "cpu"
    needed = {requirement.what: requirement for requirement in cairn.requirements()}
    assert needed["onnxruntime"].met and "1.24" in needed["onnxruntime"].found
    missing = {requirement.what: requirement for requirement in cairn.requirements(onnxruntime="no/such/file")}
    assert missing["onnxruntime"].met is False
    assert device.kind == "cpu" and device.precision == "f32" and device.threads == 2
    assert "ONNX Runtime 1.24" in device.description


def test_a_device_is_chosen_by_itself_and_has_the_reason() -> None:
    """Without the provider's library beside ONNX Runtime the processor runs worlds."""
    with pytest.raises(cairn.RuntimeMissing, match="WebGPU provider"):
        cairn.Device.gpu(webgpu="/nowhere/libonnxruntime_providers_webgpu.so")
    with pytest.raises(cairn.InvalidArgument, match="adapter: "):
        cairn.Device.gpu("0\0x")
    with cairn.Device.auto(2, deterministic=True, webgpu="/nowhere/libonnxruntime_providers_webgpu.so") as device:
        assert (device.kind, device.threads, "deterministic" in device.description) == ("cpu", 2, True)
        assert device.refusals[-1].startswith("not WebGPU: /nowhere/libonnxruntime_providers_webgpu.so: ")
        assert "is not there" in device.refusals[-1]
    with cairn.Device.cpu() as device:
        assert device.refusals == ()
    with pytest.raises(cairn.InvalidArgument, match="1025"):
        cairn.Device.auto(1025)


def test_requirements_of_a_graphics_adapter_are_listed() -> None:
    found = {requirement.what: requirement for requirement in cairn.requirements("webgpu")}
    assert {"platform", "onnxruntime", "webgpu", "adapter", "memory"} == set(found)
    assert all(requirement.found for requirement in found.values())
    with pytest.raises(cairn.InvalidArgument, match="voodoo"):
        cairn.requirements("voodoo")
