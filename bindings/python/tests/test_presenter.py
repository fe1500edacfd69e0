"""Guidance and presenters through the package."""

import numpy as np
import pytest

import cairn
import runtime
from cairn import _library

SECOND = 1_000_000_000


@pytest.fixture(scope="module", autouse=True)
def library():
    runtime.need_library()


def moved(by: int, height: int = 96, width: int = 160) -> np.ndarray:
    """A picture with texture, shifted to the right."""
    noise = np.random.default_rng(1).integers(0, 256, (height // 8, width // 8, 3), np.uint8)
    return np.roll(np.kron(noise, np.ones((8, 8, 1), np.uint8)), by, axis=1)


def anchors(count: int, step: int = 4) -> list[cairn.Anchor]:
    return [cairn.Anchor.of_picture(moved(step * i), i) for i in range(count)]


def test_motion_is_found_between_two_pictures():
    first, second = anchors(2)
    with cairn.Guidance.of_anchors(first, second) as guidance:
        motion, depth = guidance.motion(), guidance.depth()
        info = guidance.info
    assert (info.width, info.height) == (160, 96)
    assert motion.dtype == np.float16 and motion.shape == (96, 160, 2)
    assert depth.dtype == np.float32 and depth.shape == (96, 160)
    # The content moved to the right, so the motion to the previous picture points left.
    middle = motion[32:64, 40:120].astype(np.float32)
    assert abs(np.median(middle[..., 0]) + 4) < 0.5 and abs(np.median(middle[..., 1])) < 0.5


def test_guidance_returns_the_hosts_motion_and_depth():
    motion = np.random.default_rng(2).normal(0, 3, (24, 32, 2)).astype(np.float32)
    motion[0, 0] = np.nan, 1e9
    depth = np.linspace(0, 1, 24 * 32, dtype=np.float64).reshape(24, 32)
    with cairn.Guidance.of_arrays(motion, depth, near_plane=0.5, far_plane=50, vertical_fov=1) as guidance:
        expected = np.where(np.abs(motion) < 60000, motion, 0).astype(np.float16)
        assert np.array_equal(guidance.motion(), expected)
        assert np.allclose(guidance.depth(), depth, atol=1e-6)
        assert guidance.info == cairn.GuidanceInfo(32, 24, 0.5, 50, 1)
    with cairn.Guidance.of_arrays(motion, depth, depth_kind="inverted") as guidance:
        assert np.allclose(guidance.depth(), 1 - depth, atol=1e-6)
    with cairn.Guidance.of_arrays(np.transpose(motion, (1, 0, 2))) as guidance:
        assert (guidance.info.width, guidance.info.height) == (24, 32)


def test_frames_come_between_anchors():
    shown = []
    with cairn.Presenter(4, interval_ns=SECOND) as presenter:
        assert presenter.query(0) is None and presenter.draw(0) is None
        coming = anchors(4)
        for quarter in range(13):
            now = quarter * SECOND // 4
            if quarter % 4 == 0:
                with coming[quarter // 4] as anchor:
                    assert presenter.push(anchor, now)
            if quarter < 4:
                continue
            frame, pixels = presenter.draw(now)
            assert frame == presenter.query(now)
            assert pixels.shape == (96, 160, 4) and frame.position == quarter - 4
            shown.append((frame.source, pixels))
        statistics = presenter.statistics
    sources = [source for source, _ in shown]
    assert [sources[i] for i in (0, 4, 8)] == ["anchor"] * 3
    assert set(sources) == {"anchor", "generated"}
    assert np.array_equal(shown[0][1][..., :3], moved(0)) and np.array_equal(shown[4][1][..., :3], moved(4))
    # Halfway it has moved two pixels, and the frame is closer to that than either anchor is.
    half, truth = shown[2][1][16:80, 16:144, :3].astype(float), moved(2)[16:80, 16:144].astype(float)
    error = np.abs(half - truth).mean()
    assert error < 0.5 * min(np.abs(moved(at)[16:80, 16:144] - truth).mean() for at in (0, 4))
    assert statistics.anchors == 4 and statistics.shown_generated == 6 and statistics.generator == "cpu"


def test_a_frame_goes_into_memory_of_the_caller_as_bytes_or_halves():
    with cairn.Presenter(2, interval_ns=SECOND) as presenter:
        for i, anchor in enumerate(anchors(2)):
            presenter.push(anchor, i * SECOND)
        wall = np.zeros((100, 200, 4), np.uint8)
        part = wall[2:98, 20:180]
        frame, pixels = presenter.draw(SECOND, out=part)
        assert pixels is part and not wall[:2].any() and not wall[:, 180:].any()
        again, halves = presenter.draw(SECOND, out=np.empty((96, 160, 4), np.float16))
        assert again.position == frame.position
        assert np.abs(halves.astype(np.float32) * 255 - part).max() < 0.6
        _, blue = presenter.draw(SECOND, order="bgra")
        assert np.array_equal(blue[..., [2, 1, 0, 3]], part)
        for wrong in (np.empty((96, 160, 4), np.float32), np.empty((96, 161, 4), np.uint8)):
            with pytest.raises(cairn.InvalidArgument, match="out: "):
                presenter.draw(SECOND, out=wrong)


def test_frames_can_be_resized_with_letterbox():
    with cairn.Presenter(interval_ns=SECOND, letterbox=True) as presenter:
        first, second = anchors(2)
        presenter.push(first, 0)
        presenter.push(second, SECOND)
        assert presenter.draw(SECOND)[1].shape == (96, 160, 4)
        assert presenter.statistics.upscaler == ""
        presenter.resize((80, 80))
        _, framed = presenter.draw(SECOND)
        done = presenter.statistics
        assert (done.upscaler, done.upscaling) == ("spatial", "")
        assert framed.shape == (80, 80, 4)
        # 160 x 96 becomes 80 x 48: sixteen black rows above and below.
        assert (framed[:16, :, :3] == 0).all() and (framed[64:, :, :3] == 0).all() and (framed[..., 3] == 255).all()
        assert framed[16:64, :, :3].any(axis=(1, 2)).all()
        presenter.resize()
        assert presenter.draw(SECOND)[1].shape == (96, 160, 4)
        with pytest.raises(cairn.InvalidArgument):
            presenter.resize((0, 5))


@pytest.mark.parametrize("size", [[0, 0], np.zeros(2, np.int32)])
def test_a_size_may_be_a_list_or_an_array(size):
    with cairn.Presenter(interval_ns=SECOND) as presenter:
        presenter.push(anchors(1)[0], 0)
        presenter.resize((80, 48))
        presenter.resize(size)
        assert presenter.draw(SECOND)[1].shape == (96, 160, 4)


def test_a_frame_is_made_again_if_it_is_resized_meanwhile(monkeypatch):
    draw, times = _library.library().functions["presenter_draw"], []
    with cairn.Presenter(interval_ns=SECOND) as presenter:
        presenter.push(anchors(1)[0], 0)

        def resize_and_draw(*arguments):
            times.append(arguments[1])
            if len(times) == 1:
                presenter.resize((80, 48))
            return draw(*arguments)

        monkeypatch.setitem(_library.library().functions, "presenter_draw", resize_and_draw)
        assert presenter.draw(SECOND)[1].shape == (48, 80, 4)
        assert times == [SECOND, SECOND]
        # The caller's array is of one size.
        with pytest.raises(cairn.InvalidArgument):
            presenter.draw(SECOND, out=np.empty((96, 160, 4), np.uint8))


def test_a_new_array_of_linear_light_is_of_half_floats():
    with cairn.Presenter(interval_ns=SECOND, linear=True) as presenter:
        presenter.push(anchors(1)[0], 0)
        _, pixels = presenter.draw(SECOND)
        assert pixels.dtype == np.float16
        encoded = moved(0) / 255
        light = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
        assert np.abs(pixels[..., :3].astype(float) - light).max() < 1e-3


def test_overlays_and_budgets_can_be_set():
    with cairn.Presenter(4, interval_ns=SECOND) as presenter:
        presenter.push(anchors(1)[0], 0)
        presenter.set_overlay(np.ones((96, 160), bool))
        presenter.set_overlay(None)
        for wrong in (np.ones((95, 160)), np.ones((96, 160, 1))):
            with pytest.raises(cairn.InvalidArgument):
                presenter.set_overlay(wrong)
        assert presenter.statistics.made_to_anchor == 0
        with pytest.raises(cairn.InvalidArgument, match="frame_ns: "):
            presenter.set_budget(-1)
        presenter.set_budget(2_000_000)
        done = presenter.statistics
        assert (done.made_to_anchor, done.budget_changes, done.waiting, done.device_frames) == (4, 0, 0, 0)


def test_a_cut_and_a_full_queue_are_reported():
    with cairn.Presenter(2, interval_ns=SECOND, capacity=2) as presenter:
        first, second, third = anchors(3)
        assert presenter.push(first, 0)
        with cairn.Anchor.of_picture(moved(50), 1, cut=True) as cut:
            assert presenter.push(cut, SECOND)
        frame, _ = presenter.draw(3 * SECOND // 2)
        assert frame.source == "held" and frame.cut
    with cairn.Presenter(2, interval_ns=SECOND, capacity=1) as presenter:
        taken = [presenter.push(anchor, 0) for anchor in anchors(6)]
        assert taken[0] and not taken[-1]


def test_a_reset_takes_anchors_of_another_size():
    with cairn.Presenter(interval_ns=SECOND) as presenter:
        presenter.push(anchors(1)[0], 0)
        other = cairn.Anchor.of_picture(moved(0, 48, 80), 0)
        with pytest.raises(cairn.InvalidArgument):
            presenter.push(other, SECOND)
        presenter.reset()
        assert presenter.draw(SECOND) is None
        assert presenter.push(other, SECOND)
        assert presenter.draw(2 * SECOND)[1].shape == (48, 80, 4)


@pytest.mark.parametrize(
    "make",
    [
        lambda: cairn.Presenter(5),
        lambda: cairn.Presenter(-1),
        lambda: cairn.Presenter(interval_ns=61 * SECOND),
        lambda: cairn.Presenter(capacity=65),
        lambda: cairn.Presenter(motion="fast"),
        lambda: cairn.Presenter(cpu="maybe"),
        lambda: cairn.Presenter(size=(160, 0)),
        lambda: cairn.Presenter(size=(160.5, 90)),
        lambda: cairn.Anchor.of_picture(moved(0), 1 << 64),
        lambda: cairn.Anchor.of_picture(moved(0), -1),
        lambda: cairn.Guidance.of_arrays(np.zeros((4, 4))),
        lambda: cairn.Guidance.of_arrays(np.zeros((4, 4, 2)), np.zeros((4, 5))),
        lambda: cairn.Guidance.of_arrays(np.zeros((4, 4, 2)), near_plane=-1),
        lambda: cairn.Guidance.of_arrays(np.zeros((4, 4, 2)), depth_kind="deep"),
    ],
)
def test_invalid_arguments_are_refused(make):
    with pytest.raises(cairn.InvalidArgument):
        make()


def test_requiring_a_missing_generator_fails():
    with pytest.raises(cairn.Unsupported):
        cairn.Presenter(shader="require")
