"""What notebooks show: PNG files, decoded here by an independent implementation."""

import struct
import zlib

import numpy as np
import pytest

import cairn
import runtime
from cairn import _display


def chunks(file: bytes) -> list[tuple[bytes, bytes]]:
    """A PNG file's chunks, each with its sum checked."""
    assert file[:8] == b"\x89PNG\r\n\x1a\n"
    found, at = [], 8
    while at < len(file):
        (size,) = struct.unpack_from(">I", file, at)
        kind, data = file[at + 4 : at + 8], file[at + 8 : at + 8 + size]
        assert zlib.crc32(kind + data) == struct.unpack_from(">I", file, at + 8 + size)[0], kind
        found.append((kind, data))
        at += 12 + size
    assert found[0][0] == b"IHDR" and found[-1] == (b"IEND", b"")
    return found


def pixels(data: bytes, width: int, height: int) -> np.ndarray:
    """Undoes the rows' filters as the PNG specification defines, byte by byte."""
    raw = zlib.decompress(data)
    assert len(raw) == height * (1 + 4 * width)
    out = np.zeros((height, 4 * width), np.uint8)
    for y in range(height):
        row = raw[y * (1 + 4 * width) : (y + 1) * (1 + 4 * width)]
        for x in range(4 * width):
            left = int(out[y, x - 4]) if x >= 4 else 0
            up = int(out[y - 1, x]) if y else 0
            out[y, x] = (row[1 + x] + {0: 0, 1: left, 2: up}[row[0]]) & 255
    return out.reshape(height, width, 4)


def frames(file: bytes) -> list[np.ndarray]:
    """All pictures of a still or moving PNG."""
    parts = chunks(file)
    width, height, *rest = struct.unpack(">IIBBBBB", parts[0][1])
    assert rest == [8, 6, 0, 0, 0]
    moving = [data[4:] for kind, data in parts if kind == b"fdAT"]
    return [pixels(data, width, height) for data in [b"".join(d for k, d in parts if k == b"IDAT"), *moving]]


@pytest.fixture(scope="module")
def world():
    runtime.need_library()
    with cairn.Device.cpu(threads=2) as device, device.load_world(runtime.need_worlds() / "tiny") as world:
        yield world


@pytest.mark.parametrize("picture", [runtime.pattern(9, 16), np.random.default_rng(1).integers(0, 256, (5, 3, 4), np.uint8), np.zeros((1, 1, 4), np.uint8)])
def test_a_png_holds_its_picture(picture):
    assert np.array_equal(frames(_display.png(picture))[0], picture)


def test_a_film_moves():
    pictures = [np.roll(runtime.pattern(9, 16), i, axis=1) for i in range(4)]
    film = cairn.Film(pictures, 30)
    file = film._repr_mimebundle_()["image/png"]
    assert all(map(np.array_equal, frames(file), pictures))
    parts = chunks(file)
    (head,) = [data for kind, data in parts if kind == b"acTL"]
    assert struct.unpack(">II", head) == (4, 0)
    # Numbered in one sequence with the pictures' data, as the standard requires.
    numbers = [struct.unpack_from(">I", data)[0] for kind, data in parts if kind in (b"fcTL", b"fdAT")]
    assert numbers == list(range(7))
    assert all(struct.unpack_from(">HH", data, 20) == (1, 30) for kind, data in parts if kind == b"fcTL")
    assert "4 pictures of 16x9 pixels, 30 a second" in film._repr_mimebundle_()["text/plain"]


def test_a_strip_has_pictures_in_rows(tmp_path):
    pictures = [np.full((4, 6, 4), 40 * i + 40, np.uint8) for i in range(5)]
    strip = cairn.Film(pictures, 15).strip(columns=2)
    (shown,) = frames(strip._repr_png_())
    assert np.array_equal(shown, strip.picture) and shown.shape == (3 * 4 + 2 * 4, 2 * 6 + 4, 4)
    assert [int(shown[8 * (i // 2), 10 * (i % 2), 0]) for i in range(5)] == [40, 80, 120, 160, 200]
    assert (shown[:, 6:10] == 0).all() and (shown[16:, 10:] == 0).all()
    assert cairn.Film(pictures, 15).strip(every=2).picture.shape == (4, 3 * 6 + 2 * 4, 4)
    strip.save(tmp_path / "ein Streifen – 状態.png")
    assert frames((tmp_path / "ein Streifen – 状態.png").read_bytes())[0].shape == shown.shape


def test_anchors_and_rollouts_show_themselves(world):
    with world.rollout(seed=7) as rollout:
        empty = rollout._repr_mimebundle_()
        assert "0 latents" in empty["text/plain"] and "image/png" not in empty
        rollout.append(runtime.pattern(72, 128))
        rollout.step()
        anchor = rollout.anchor()
        assert np.array_equal(frames(anchor._repr_png_())[0], anchor.picture())
        shown = anchor._repr_mimebundle_()
        (strip,) = frames(shown["image/png"])
        assert strip.shape == (72, 4 * 128 + 3 * 4, 4)
        for i, picture in enumerate(anchor.pictures()):
            assert np.array_equal(strip[:, 132 * i : 132 * i + 128], picture)
        assert shown["text/plain"] == "anchor 1: 4 of 128x72 pixels"
        told = rollout._repr_mimebundle_()
        assert told["image/png"] == shown["image/png"] and "2 latents, seed 7" in told["text/plain"]
        anchor.close()
        assert anchor._repr_mimebundle_() == {"text/plain": "an anchor that is closed"} and anchor._repr_png_() is None
    assert rollout._repr_mimebundle_() == {"text/plain": "a rollout that is closed"}


def test_a_film_is_made_of_a_play(world, tmp_path):
    with world.rollout(seed=7) as rollout:
        rollout.append(runtime.pattern(72, 128))
        anchors = []

        def kept():
            for anchor in rollout.play([cairn.Controls()] * 2):
                anchors.append(anchor)
                yield anchor

        film = cairn.Film.of_anchors(kept())
        assert len(film) == 8 and film.rate == 4 * rollout.info.latents_per_second
        assert all(anchor.closed for anchor in anchors)
    film.save(tmp_path / "walk.png")
    assert np.array_equal(frames((tmp_path / "walk.png").read_bytes())[7], film.pictures[7])


@pytest.mark.parametrize(
    ("pictures", "rate", "says"),
    [
        ([], 15, "none"),
        ([np.zeros((4, 4, 3), np.uint8)], 15, "height, width, 4"),
        ([np.zeros((4, 4, 4))], 15, "uint8"),
        (["a text"], 15, "uint8"),
        ([np.zeros((4, 4, 4), np.uint8), np.zeros((4, 5, 4), np.uint8)], 15, "different sizes"),
        ([np.zeros((4, 4, 4), np.uint8)], 0, "pictures a second"),
        ([np.zeros((4, 4, 4), np.uint8)], 1 << 16, "pictures a second"),
        ([np.zeros((4, 4, 4), np.uint8)], 29.97, "whole number"),
    ],
)
def test_invalid_films_are_refused(pictures, rate, says):
    with pytest.raises(cairn.InvalidArgument, match=says):
        cairn.Film(pictures, rate)
    good = cairn.Film([np.zeros((4, 4, 4), np.uint8)], 15)
    for columns, every in ((0, 1), (1, 0)):
        with pytest.raises(cairn.InvalidArgument, match="at least 1"):
            good.strip(columns, every=every)
