"""`python -m cairn` in a process of its own, as a user runs it, also with missing parts."""

import ctypes
import os

import pytest

import runtime


@pytest.fixture(scope="module", autouse=True)
def library():
    return runtime.need_library()


def doctor(*arguments: str, **environment: str | None):
    return runtime.python("-m", "cairn", "doctor", *arguments, **environment)


def test_all_is_well_with_a_world():
    result = doctor("--world", str(runtime.need_worlds() / "tiny"))
    assert result.returncode == 0, result.stdout + result.stderr
    for what in ("python", "library", "platform", "onnxruntime", "device", "world", "step"):
        assert any(line.split()[:2] == ["ok", what] for line in result.stdout.splitlines()), what
    assert "All is well." in result.stdout and "FAIL" not in result.stdout


def test_each_thing_is_explained_when_asked():
    result = doctor("--verbose")
    assert result.returncode == 0
    assert "ONNX Runtime runs the world's neural networks" in result.stdout


def test_without_a_path_it_is_the_embedded_world():
    result = doctor()
    assert result.returncode == 0, result.stdout + result.stderr
    assert any(line.split()[:3] == ["ok", "world", "Miniature,"] for line in result.stdout.splitlines()), result.stdout


@pytest.mark.parametrize(
    ("arguments", "environment", "says"),
    [
        ([], {"CAIRN_LIBRARY": "no/such/file"}, ["FAIL library", "cargo build --release", "no/such/file", "(not there)"]),
        ([], {"CAIRN_LIBRARY": __file__}, ["FAIL library", "is no shared library", "and whole"]),
        (["--onnxruntime", "no/such/file"], {}, ["FAIL onnxruntime", "CAIRN_ONNXRUNTIME", "cargo xtask setup"]),
        (["--world", "no/such/world"], {}, ["FAIL world", "no/such/world", "docs/bundle.md"]),
        (["--world", os.path.dirname(__file__)], {}, ["FAIL world", "cairn-world.json"]),
    ],
)
def test_problems_are_reported_with_a_remedy(arguments, environment, says):
    result = doctor(*arguments, **environment)
    shown = " ".join(result.stdout.split())
    assert result.returncode == 1 and not result.stderr
    for part in [*says, "What to do: "]:
        assert part in shown, result.stdout


def test_a_library_that_is_not_ours_is_refused():
    other = getattr(ctypes, "_ctypes", None) or __import__("_ctypes")
    result = doctor(CAIRN_LIBRARY=other.__file__)
    assert result.returncode == 1 and "has no cairn_abi_version" in " ".join(result.stdout.split())


def test_the_builder_needs_no_library():
    result = runtime.python("-m", "cairn.build", "describe", "--preset", "tiny", CAIRN_LIBRARY="no/such/file")
    assert result.returncode == 0, result.stderr


def test_the_end_of_a_program_is_quiet_with_everything_open():
    program = (
        "import sys, cairn, numpy\n"
        "device = cairn.Device.cpu(threads=1)\n"
        "world = device.load_world(sys.argv[1])\n"
        "rollout = world.rollout()\n"
        "rollout.append(numpy.zeros((8, 8, 3), numpy.uint8))\n"
        "anchor = rollout.anchor()\n"
        "tickets = [rollout.submit() for _ in range(4)]\n"
        "print(anchor.picture().shape)\n"
    )
    result = runtime.python("-X", "dev", "-c", program, str(runtime.need_worlds() / "tiny"))
    assert (result.returncode, result.stdout.strip(), result.stderr) == (0, "(72, 128, 4)", "")


def test_a_failure_is_not_called_well_if_the_library_has_no_world(monkeypatch, capsys):
    from cairn import doctor as program
    from cairn.errors import DeviceError, Unsupported
    from cairn.world import Device

    def refuse(*_arguments, **_options):
        raise Unsupported("no world is inside")

    def fail(*_arguments, **_options):
        raise DeviceError("the driver failed")

    monkeypatch.setattr(Device, "load_world", refuse)
    assert program.run()
    assert "All is well. This library has no world inside" in capsys.readouterr().out
    monkeypatch.setattr(program, "adapters", fail)
    assert not program.run()
    shown = capsys.readouterr().out
    assert "FAIL device" in " ".join(shown.split()) and "This library has no world inside" in shown and "All is well" not in shown


def test_amds_requirements_are_listed_if_direct3d_is_available(monkeypatch, capsys):
    from cairn import doctor as program
    from cairn.world import Adapter, Requirement, requirements

    def found(kind="cpu", *, onnxruntime=None):
        if kind == "cpu":
            return requirements(kind, onnxruntime=onnxruntime)
        return [
            Requirement("onnxruntime", False, "said of the CPU device already", "nothing"),
            Requirement("fsr", True, "AMD's libraries", "C:/fsr/amd_fidelityfx_loader_dx12.dll 1.0.2.44888"),
            Requirement("fsr-direct3d", None, "D3D12Core.dll of Windows 11, for ml", "C:/windows/system32/d3d12.dll"),
        ]

    monkeypatch.setattr(program, "adapters", lambda: [Adapter("d3d12", 0, "an adapter", 1 << 30, 7)])
    monkeypatch.setattr(program, "requirements", found)
    assert program.run(), "what is only optional is no failure"
    shown = " ".join(capsys.readouterr().out.split())
    for part in ("ok fsr C:/fsr/amd", "? fsr-direct3d C:/windows", "What to do, where it is wanted: Ship the Agility SDK"):
        assert part in shown
    assert "said of the CPU device already" not in shown
