"""The files and the metadata of the wheels. CAIRN_WHEELS is their folder, CAIRN_BUILT the wheel that setuptools makes of the package."""

import base64
import csv
import hashlib
import json
import os
import re
import zipfile
from email import message_from_string
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "bindings" / "python" / "cairn"
WHEELS = sorted(Path(os.environ["CAIRN_WHEELS"]).glob("*.whl"))
LIBRARIES = {"manylinux_2_28_x86_64": ("libcairn.so", b"\x7fELF"), "win_amd64": ("cairn.dll", b"MZ")}


def platform(wheel: Path) -> str:
    return wheel.stem.split("-")[-1]


@pytest.fixture(params=WHEELS, ids=platform)
def wheel(request):
    with zipfile.ZipFile(request.param) as archive:
        yield request.param, {name: archive.read(name) for name in archive.namelist()}


def one(files: dict[str, bytes], end: str) -> bytes:
    """The only file with that ending."""
    (found,) = [content for name, content in files.items() if name.endswith(end)]
    return found


def test_there_is_one_for_each_system():
    assert {platform(wheel) for wheel in WHEELS} == LIBRARIES.keys()
    for wheel in WHEELS:
        assert re.fullmatch(r"cairn-[0-9.]+-py3-none-\w+\.whl", wheel.name)


def test_the_package_is_complete_and_has_the_library(wheel):
    path, files = wheel
    own = {f"cairn/{file.relative_to(PACKAGE).as_posix()}": file for file in PACKAGE.rglob("*") if file.suffix in (".py", ".typed")}
    library, magic = LIBRARIES[platform(path)]
    assert {name for name in files if name.startswith("cairn/")} == own.keys() | {f"cairn/{library}"}
    for name, file in own.items():
        assert files[name] == file.read_bytes(), name
    assert files[f"cairn/{library}"].startswith(magic) and b"cairn_rollout_step" in files[f"cairn/{library}"]
    # No path of the build machine.
    assert str(ROOT).encode() not in b"".join(content for name, content in files.items() if not name.endswith((".so", ".dll")))


def test_nothing_else_is_in_it(wheel):
    _, files = wheel
    info = next(name for name in files if name.endswith("/RECORD")).removesuffix("/RECORD")
    beside = {name.removeprefix(f"{info}/") for name in files if not name.startswith("cairn/")}
    texts = {f"licenses/{name}" for name in ("LICENSE-APACHE", "LICENSE-MIT", "THIRD-PARTY.md", "THIRD-PARTY-RUST.html")}
    assert beside == {"METADATA", "WHEEL", "RECORD", "entry_points.txt", "sboms/cairn.cdx.json"} | texts


def test_the_record_is_right(wheel):
    _, files = wheel
    rows = {name: (sum, size) for name, sum, size in csv.reader(one(files, "/RECORD").decode().splitlines())}
    assert rows.keys() == files.keys()
    for name, content in files.items():
        if name.endswith("/RECORD"):
            assert rows[name] == ("", "")
        else:
            sum = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            assert rows[name] == (f"sha256={sum}", str(len(content))), name


def test_it_names_its_platform(wheel):
    path, files = wheel
    said = message_from_string(one(files, "/WHEEL").decode())
    assert said["Tag"] == f"py3-none-{platform(path)}" and said["Root-Is-Purelib"] == "false" and said["Wheel-Version"] == "1.0"


def test_its_metadata_equals_setuptools(wheel):
    _, files = wheel
    with zipfile.ZipFile(os.environ["CAIRN_BUILT"]) as archive:
        built = {name: archive.read(name) for name in archive.namelist()}
    own, theirs = (message_from_string(one(all_files, "/METADATA").decode()) for all_files in (files, built))
    for field in ("Name", "Version", "Summary", "Requires-Python", "License-Expression", "Description-Content-Type"):
        assert own[field] == theirs[field], field

    def words(texts: list[str] | None) -> set[str]:
        """Regardless of spaces, and of the quotes around a system's name."""
        return {re.sub(r"\s", "", text).replace("'", '"') for text in texts or []}

    for field in ("Requires-Dist", "Provides-Extra"):
        assert words(own.get_all(field)) == words(theirs.get_all(field)), field
    assert {"onnxruntime==1.24.4;sys_platform!=\"win32\"", "onnxruntime-directml==1.24.4;sys_platform==\"win32\""} <= words(own.get_all("Requires-Dist"))
    assert own.get_payload().lstrip().startswith("# Cairn from Python")
    lines = [one(all_files, "/entry_points.txt").decode().split() for all_files in (files, built)]
    assert lines[0] == lines[1]


# Linkers embed parts of their own libraries.
LINKED = {"manylinux_2_28_x86_64": ("llvm-libunwind", "glibc-nonshared"), "win_amd64": ("mingw-w64", "libgcc")}


def test_it_names_all_that_is_linked_into_the_library(wheel):
    path, files = wheel
    page, bill = one(files, "/licenses/THIRD-PARTY.md").decode(), json.loads(one(files, "/sboms/cairn.cdx.json"))
    components = {component["name"]: component for component in bill["components"]}
    for part in ("rust-std", "ort", *LINKED[platform(path)]):
        licence = components[part]["licenses"][0]["expression"]
        assert f"| {part} {components[part]['version']} | {licence} |" in page
    own = next(entry for entry in bill["dependencies"] if entry["ref"] == bill["metadata"]["component"]["bom-ref"])
    assert {components[part]["purl"] for part in ("rust-std", *LINKED[platform(path)])} <= set(own["dependsOn"])
    assert b"Copyright notices for The Rust Standard Library" in one(files, "/licenses/THIRD-PARTY-RUST.html")
