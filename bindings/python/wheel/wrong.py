"""The errors of an installed wheel with missing or wrong libraries, each in a process of its own, which this program starts.

    python wrong.py FOLDER STAND_INS     uses FOLDER, and libraries that are almost Cairn
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from cairn import _library, _library_file, _onnxruntime

WINDOWS = sys.platform == "win32"
LOAD = "import cairn\nfrom cairn import _library\n"
DEVICE = "try:\n    cairn.Device.cpu()\nexcept cairn.Error as error:\n    print(type(error).__name__, error)\nelse:\n    print('a device')\n"
VERSION = "try:\n    print('loaded', _library.library().version)\nexcept cairn.Error as error:\n    print(type(error).__name__, error)\n"


def said(program: str, **environment: str) -> str:
    """The output of a new Python that runs a program."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("CAIRN_")}
    variables |= {"PYTHONUTF8": "1", "PYTHONIOENCODING": "utf-8"} | environment
    command = [sys.executable, "-X", "utf8", "-W", "always", "-c", LOAD + program]
    ended = subprocess.run(command, env=variables, capture_output=True, check=False)
    return (ended.stdout + ended.stderr).decode("utf-8", "replace")


def test(name: str, text: str, *parts: str) -> None:
    """Prints one line for the test runner; on failure also the output."""
    right = all(part.lower() in text.lower() for part in parts)
    if not right:
        print(f"{name}: {parts} should be in {text!r}")
    print(f"test {name} ... {'ok' if right else 'FAILED'}", flush=True)


def other_processor(library: bytes) -> bytes:
    """The library with a header that names arm64."""
    at = int.from_bytes(library[60:64], "little") + 4 if WINDOWS else 18
    machine = 0xAA64 if WINDOWS else 183
    return library[:at] + machine.to_bytes(2, "little") + library[at + 2 :]


def later_glibc(library: bytes) -> bytes:
    """The library with a requirement of a future glibc."""
    needed = max((part.split(b"\0")[0] for part in library.split(b"\0GLIBC_")[1:]), key=lambda text: [int(n) for n in text.split(b".")])
    return library.replace(b"\0GLIBC_" + needed + b"\0", b"\0GLIBC_" + b"9.9999"[: len(needed)] + b"\0")


def main(folder: Path, stand_ins: Path) -> None:
    package = Path(_library_file.__file__).parent
    own = package / _library.FILE
    whole = own.read_bytes()
    here = str(_library_file.this_process())

    def library(name: str, content: bytes) -> str:
        place = folder / name / _library.FILE
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
        return str(place)

    def load(path: str) -> str:
        return said(VERSION, CAIRN_LIBRARY=path)

    copy = library("a folder Ж 状態", whole)
    test("a path with spaces and letters of all kinds", load(copy), "loaded ")
    test("no library", load(str(folder / "nowhere" / _library.FILE)), "LibraryMissing", "was not found", "nowhere", "Install the wheel")
    test("a file that is none", load(library("text", b"# " + b"no library " * 100)), "LibraryMissing", "is no shared library")
    test("an empty file", load(library("empty", b"")), "is no shared library")
    test("a library that was cut off", load(library("cut", whole[: len(whole) // 4])), "is cut off", "Install the wheel again")
    foreign = load(library("arm", other_processor(whole)))
    test("another processor", foreign, "is made for", "on arm64", f"this Python is {here}", f"Install the wheel for {here}")
    elf = whole if not WINDOWS else b"\x7fELF\x02\x01" + bytes(12) + (62).to_bytes(2, "little") + bytes(60)
    dos = b"MZ" + bytes(58) + (64).to_bytes(4, "little") + b"PE\0\0" + (0x8664).to_bytes(2, "little") + bytes(60)
    other = load(library("system", elf if WINDOWS else dos))
    test("another system", other, "is made for Linux" if WINDOWS else "is made for Windows", f"this Python is {here}")
    for name, parts in {
        "later": ("has the binary interface", "same release"),
        "older": ("is version", "older than", "same release"),
        "incomplete": ("has no cairn_", "whole"),
        "other": ("has no cairn_abi_version",),
    }.items():
        file = next(stand_ins.glob(f"{name}.*"))
        test(f"a library that is {name}", load(str(file)), "LibraryMissing", *parts)
    if not WINDOWS:
        text = load(library("glibc", later_glibc(whole)))
        test("an older glibc", text, "needs glibc 9.9", "this system has glibc 2.", "Use a newer Linux")
    builder = said("import cairn.build\n")
    test("the builder without its packages", builder, "ImportError: cairn.build needs onnx, safetensors, yaml", "pip install", "PyYAML>=6.0")
    two = said(f"import ctypes\nfirst = ctypes.CDLL({copy!r})\n" + VERSION)
    test("two in one process", two, "loaded ", "RuntimeWarning", "another Cairn", "a folder Ж")

    # Without the ONNX Runtime package, and with no other copy to be found.
    empty = {"CAIRN_CACHE_DIR": str(folder / "no cache")}
    hidden = "import importlib.util\n_spec = importlib.util.find_spec\nimportlib.util.find_spec = lambda name, *a: None if name == 'onnxruntime' else _spec(name, *a)\n"
    missing = said(hidden + DEVICE, **empty)
    test("no ONNX Runtime", missing, "RuntimeMissing", "was not found", f"python -m pip install {_onnxruntime.REQUIREMENT}")
    named = said(DEVICE, CAIRN_ONNXRUNTIME=str(folder / "nowhere.so"))
    test("a runtime that is named and not there", named, "RuntimeMissing", "nowhere.so", "pip install")
    stranger = said(DEVICE, CAIRN_ONNXRUNTIME=copy)
    test("a runtime that is another library", stranger, "RuntimeMissing", "OrtGetApiBase", "pip install")
    text = said(DEVICE, CAIRN_ONNXRUNTIME=library("no runtime", b"no library " * 100))
    test("a runtime that is no library", text, "RuntimeMissing", "cannot be loaded", "pip install")
    runtime = _onnxruntime.in_package()
    assert runtime is not None
    second = folder / "a second one" / runtime.name
    second.parent.mkdir()
    shutil.copy(runtime, second)
    for beside in runtime.parent.glob("DirectML.dll"):
        shutil.copy(beside, second.parent)
    both = said(f"cairn.Device.cpu()\ntry:\n    cairn.Device.cpu(onnxruntime={str(second)!r})\nexcept cairn.Error as error:\n    print(type(error).__name__, error)\n")
    test("two runtimes in one process", both, "Unsupported", "already uses", "Use one ONNX Runtime file in one process")
    test("a runtime in a folder with spaces", said(DEVICE, CAIRN_ONNXRUNTIME=str(second)), "a device")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
