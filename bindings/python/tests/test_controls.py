"""Keys, control scripts and recordings, as the library reads and writes them."""

import ctypes
from pathlib import Path

import numpy as np
import pytest

import cairn
import runtime
from cairn import _library

SCRIPTS = sorted((runtime.ROOT / "samples" / "scripts").glob("*.txt"))


@pytest.fixture(scope="module", autouse=True)
def library():
    runtime.need_library()


@pytest.mark.parametrize("name", sorted(cairn.KEYS))
def test_keys_have_the_names_of_scripts(name):
    with cairn.Script(f"cairn-controls 1\n0..1 hold {name}\n") as script:
        assert script.controls(1, 15).keys == (cairn.KEYS[name],) == (cairn.key_code(name.lower()),)


def test_every_code_has_a_name():
    for code in range(256):
        assert cairn.key_code(f"VK_0x{code:02x}") == code == cairn.key_code(code)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_equals_its_text(path: Path):
    with cairn.Script.read(path) as script, cairn.Script(script.text) as again:
        assert script.duration == again.duration > 0
        for latent in range(1, 31):
            assert script.controls(latent, 15) == again.controls(latent, 15)
        with pytest.raises(cairn.InvalidArgument):
            script.controls(1, 0)


def test_errors_in_a_script_are_reported():
    with pytest.raises(cairn.InvalidArgument, match="line 2"):
        cairn.Script("cairn-controls 1\n0..1 hold NO_SUCH_KEY\n")
    with pytest.raises(cairn.Unsupported):
        cairn.Script("cairn-controls 999\n")


def test_recorded_steps_are_reproduced_bit_for_bit():
    steps = [
        cairn.Controls(),
        cairn.Controls(["W", "MOUSE_LEFT"], (12.5, -3), 1),
        cairn.Controls(["W"], (-0.25, 0), -1),
        cairn.Controls([], (0, 1)),
    ]
    with cairn.Recorder() as recorder:
        for number, controls in enumerate(steps, 1):
            recorder.step(number, 15, controls)
        with recorder.script(len(steps) / 15) as script:
            assert [script.controls(number, 15) for number in range(1, len(steps) + 1)] == steps


def test_events_become_a_script():
    with cairn.Recorder() as recorder:
        recorder.key(0.1, "W", True)
        recorder.key(0.15, "W", True)
        recorder.mouse(0.2, 5, -1)
        recorder.scroll(0.25, 2)
        recorder.key(0.3, "W", False)
        with pytest.raises(cairn.InvalidArgument, match="seconds"):
            recorder.mouse(float("nan"), 1, 1)
        with recorder.script(1) as script:
            assert script.duration == 1
            assert script.controls(1, 1) == cairn.Controls(["W"], (5, -1), 1)


def test_numbers_that_the_library_cannot_hold_are_refused():
    with cairn.Recorder() as recorder, cairn.Script("cairn-controls 1\n") as script:
        for call in (
            lambda: recorder.scroll(0, 1 << 31),
            lambda: recorder.scroll(0, 0.5),
            lambda: recorder.step(1 << 64, 15, cairn.Controls()),
            lambda: recorder.step(1, (1 << 32) + 15, cairn.Controls()),
            lambda: script.controls((1 << 64) + 1, 15),
            lambda: script.controls(1, (1 << 32) + 15),
            lambda: recorder.mouse(86_401, 1, 1),
        ):
            with pytest.raises(cairn.InvalidArgument):
                call()
        recorder.mouse(86_400, 1, 1)


def test_an_interrupt_after_a_call_destroys_the_object(monkeypatch):
    functions, destroyed = _library.library().functions, []
    create, destroy = functions["recorder_create"], functions["recorder_destroy"]

    def create_and_interrupt(handle):
        create(handle)
        raise KeyboardInterrupt

    def note_and_destroy(handle):
        destroyed.append(handle.value)
        return destroy(handle)

    monkeypatch.setitem(functions, "recorder_create", create_and_interrupt)
    monkeypatch.setitem(functions, "recorder_destroy", note_and_destroy)
    with pytest.raises(KeyboardInterrupt):
        cairn.Recorder()
    assert len(destroyed) == 1 and destroy(ctypes.c_void_p(destroyed[0])) < 0, "it is destroyed"


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int64])
def test_keys_of_numpy_types_are_kept(kind):
    assert cairn.Controls([kind(0x57)])._struct().keys[1] == 1 << (0x57 - 64)
    with pytest.raises(cairn.InvalidArgument, match="keys: "):
        cairn.Controls([65.0])


def test_controls_know_their_keys():
    controls = cairn.Controls(["w", 0x41, "W"], (1, 2), 3)
    assert controls.keys == (0x41, 0x57)
    assert controls == cairn.Controls([0x57, "a"], (1, 2), 3)
    assert len({controls, cairn.Controls(["a", "w"], (1, 2), 3)}) == 1
