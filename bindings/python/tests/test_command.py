"""The command line, archives, and failures while writing."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import ROOT, TINY, copied

from cairn.build import PRESETS, BuildError, archive, build_bundle, table
from cairn.build.cli import main
from cairn.build.files import fresh_folder
from cairn.build.geometry import Geometry, square_pixels
from cairn.build.manifest import Licence
from cairn.build.random_weights import RandomWeights


def test_help_teaches(capsys):
    for arguments in (["--help"], ["random", "--help"], ["checkpoint", "--help"], ["describe", "--help"], ["pack", "--help"]):
        with pytest.raises(SystemExit) as end:
            main(arguments)
        assert end.value.code == 0
    text = capsys.readouterr().out
    for word in ("examples:", "taehv1_5.pth", "config.yaml", "docs/bundle.md", "--seed", *PRESETS):
        assert word in text


def test_it_runs_as_a_module(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "cairn.build", "random", "--preset", "tiny", "--layers", "4", "--out", str(tmp_path / "w")],
        cwd=ROOT / "bindings" / "python",
        capture_output=True,
        text=True,
        check=True,
    )
    assert "parameters" in done.stdout and "g16" in done.stdout and f"wrote {tmp_path / 'w'}" in done.stdout
    assert "100.0 %" in done.stderr
    assert json.loads((tmp_path / "w" / "cairn-world.json").read_text())["geometry"]["layers"] == 4


def test_archive_and_folder_are_the_same_bundle(tiny, tmp_path):
    packed = tmp_path / "w.cairn"
    assert main(["pack", str(tiny), "--out", str(packed)]) == 0
    with zipfile.ZipFile(packed) as entries:
        assert {i.compress_type for i in entries.infolist()} == {zipfile.ZIP_STORED}
        assert entries.namelist()[0] == "cairn-world.json"
        assert set(entries.namelist()) == {p.name for p in tiny.iterdir()}
    assert main(["pack", str(packed), "--out", str(tmp_path / "w")]) == 0
    for path in tiny.iterdir():
        assert path.read_bytes() == (tmp_path / "w" / path.name).read_bytes()
    again = archive.pack(tmp_path / "w", tmp_path / "again.cairn")
    assert again.read_bytes() == packed.read_bytes()


def test_random_can_write_an_archive_at_once(tmp_path):
    out = tmp_path / "w.cairn"
    assert main(["random", "--out", str(out), "--quiet", "--precision", "f32"]) == 0
    assert zipfile.is_zipfile(out) and [p.name for p in tmp_path.iterdir()] == ["w.cairn"]
    assert main(["describe", str(out)]) == 0
    with zipfile.ZipFile(out) as entries:
        assert json.loads(entries.read("cairn-world.json"))["graphs"].keys() == {"f32"}


def test_describing_a_bundle_is_describing_its_shapes(tiny, tmp_path, capsys):
    assert archive.read_geometry(tiny) == TINY
    assert main(["describe", str(tiny)]) == 0 and main(["describe", "--preset", "tiny"]) == 0
    half = capsys.readouterr().out.splitlines()
    assert half[: len(half) // 2] == half[len(half) // 2 :]
    (tmp_path / "cairn-world.json").write_text('{"geometry": 3}')
    assert main(["describe", str(tmp_path)]) == 2
    assert main(["describe", str(tmp_path / "nothing")]) == 2


def test_a_tampered_archive_is_refused(tiny, tmp_path):
    content = json.loads((tiny / "cairn-world.json").read_text())
    for path, cause in (("../evil", "no name"), ("a/../b", "no name"), ("missing", "not in the archive")):
        bad = {**content, "files": [{**content["files"][0], "path": path}, *content["files"]]}
        with zipfile.ZipFile(tmp_path / "bad.cairn", "w") as entries:
            entries.writestr("cairn-world.json", json.dumps(bad))
            entries.writestr("../evil", b"")
        with pytest.raises(BuildError, match=cause):
            archive.unpack(tmp_path / "bad.cairn", tmp_path / "out")
        assert {p.name for p in tmp_path.iterdir()} == {"bad.cairn"}
    with zipfile.ZipFile(tmp_path / "bad.cairn", "w") as entries:
        entries.writestr("cairn-world.json", json.dumps(content))
        entries.writestr(content["files"][0]["path"], b"x" * content["files"][0]["size"])
    with pytest.raises(BuildError, match="checksum"):
        archive.unpack(tmp_path / "bad.cairn", tmp_path / "out")
    with zipfile.ZipFile(tmp_path / "bad.cairn", "w", zipfile.ZIP_DEFLATED) as entries:
        entries.writestr("cairn-world.json", json.dumps(content))
    with pytest.raises(BuildError, match="compressed"):
        archive.unpack(tmp_path / "bad.cairn", tmp_path / "out")


class Failing(RandomWeights):
    """A source of weights that fails half way."""

    left = 40

    def get(self, weight):
        self.left -= 1
        if self.left == 0:
            raise OSError(28, "No space left on device")
        return super().get(weight)


@pytest.mark.parametrize("name", ["w", "w.cairn"])
def test_a_failed_build_leaves_the_old_bundle(tmp_path, name):
    facts = {"name": "w", "provenance": {}, "licence": Licence("CC0-1.0"), "precisions": ("f32",)}
    out = build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / name, **facts)
    before = out.read_bytes() if out.is_file() else (out / "transformer.bin").read_bytes()
    with pytest.raises(OSError):
        build_bundle(TINY, Failing(TINY, 2), out, replace=True, **facts)
    assert before == (out.read_bytes() if out.is_file() else (out / "transformer.bin").read_bytes())
    assert [p.name for p in tmp_path.iterdir()] == [name]
    with pytest.raises(BuildError, match="exists already"):
        build_bundle(TINY, RandomWeights(TINY, 2), out, **facts)


def test_other_peoples_folders_are_never_replaced(tmp_path, capsys):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("keep me")
    assert main(["random", "--out", str(tmp_path / "mine"), "--replace", "--quiet"]) == 2
    assert "no bundle" in capsys.readouterr().err
    assert (tmp_path / "mine" / "letter.txt").read_text() == "keep me"


@pytest.mark.parametrize("name", ["letter.txt", "world.cairn"])
def test_other_peoples_files_are_never_replaced(tiny, tmp_path, capsys, name):
    out = tmp_path / name
    out.write_text("keep me")
    for command in (["random", "--quiet"], ["pack", str(tiny)], ["rebuild", str(tiny), "--quiet"]):
        assert main([*command, "--out", str(out), "--replace"]) == 2
        assert "no bundle" in capsys.readouterr().err
    with zipfile.ZipFile(out, "w") as entries:
        entries.writestr("letter.txt", "keep me")
    assert main(["pack", str(tiny), "--out", str(out), "--replace"]) == 2
    assert out.is_file() and [p.name for p in tmp_path.iterdir()] == [name]
    out.unlink()
    for _ in range(2):
        assert main(["pack", str(tiny), "--out", str(out), "--replace"]) == 0
    assert archive.read_geometry(out) == TINY


def test_an_archive_does_not_replace_a_folder(tiny, tmp_path, capsys):
    """It is refused before the source is read, so a damaged one is not noticed."""
    out, source = copied(tiny, tmp_path / "world.cairn"), copied(tiny, tmp_path / "source")
    (source / "transformer.bin").write_bytes(b"damaged")
    commands = (["random"], ["rebuild", str(source)], ["quantise", str(source), "--weights", "8"])
    for command in (*([*command, "--quiet"] for command in commands), ["pack", str(source)]):
        assert main([*command, "--out", str(out), "--replace"]) == 2
        assert "it is a folder, and a file is to be written" in capsys.readouterr().err
    # Without --replace, too.
    assert main(["rebuild", str(source), "--out", str(out)]) == 2
    assert "it exists already" in capsys.readouterr().err


@pytest.mark.parametrize("fails_at", [1, 2])
def test_a_bundle_that_cannot_be_replaced_stays(tiny, tmp_path, monkeypatch, fails_at):
    out = copied(tiny, tmp_path / "world")
    rename, times = Path.rename, []

    def fail_once(path, target):
        times.append(target)
        if len(times) == fails_at:
            raise PermissionError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", fail_once)
    with pytest.raises(PermissionError), fresh_folder(out, replace=True) as work:
        (work / "cairn-world.json").write_text("{}")
    assert [p.name for p in tmp_path.iterdir()] == ["world"]
    assert archive.read_geometry(out) == TINY


def test_shapes_beside_a_bundle_are_refused(tiny, capsys):
    for option, values in (("--layers", ["2"]), ("--preset", ["demo"]), ("--decoder-widths", ["8"] * 4)):
        assert main(["describe", str(tiny), option, *values]) == 2
        assert capsys.readouterr().err.startswith(f"error: {option}: a bundle has its own shapes")


@pytest.mark.parametrize(
    "arguments, field",
    [
        (["--width", "63"], "width"),
        (["--heads", "0"], "heads"),
        (["--kv-heads", "3"], "heads"),
        (["--heads", "16"], "width / heads"),
        (["--latent-height", "3"], "latent_height"),
        (["--global-window", "18"], "global_window"),
        (["--global-max-window", "8"], "global_max_window"),
        (["--layers", "2000000"], "layers"),
        (["--seed", "-1"], "--seed"),
        (["--name", "a" * 101], "name"),
        (["--name", "two\nlines"], "name"),
    ],
)
def test_wrong_shapes_are_refused_by_name(tmp_path, capsys, arguments, field):
    assert main(["random", "--out", str(tmp_path / "w"), "--quiet", *arguments]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"error: {field}:") and message.count(".") >= 2
    assert not list(tmp_path.iterdir())


# The limits of docs/bundle.md, section 3: the member, the largest value, and what else must change with it.
@pytest.mark.parametrize(
    "field, largest, others",
    [
        ("layers", 512, {}),
        ("width", 65536, {"heads": 64, "kv_heads": 64}),
        ("heads", 4096, {"width": 32768, "kv_heads": 1}),
        ("kv_heads", 4096, {"width": 32768, "heads": 4096}),
        ("mlp_ratio", 64, {}),
        ("latent_channels", 4096, {}),
        ("latent_height", 1024, {}),
        ("latent_width", 1024, {"latent_height": 2, "render": (64, 32)}),
        ("local_window", 65536, {}),
        ("global_window", 65536, {"global_max_window": 65536, "global_dilation": 1}),
        ("global_max_window", 65536, {}),
        ("global_dilation", 4096, {"global_window": 4096, "global_max_window": 4096}),
        ("global_period", 4096, {}),
        ("global_offset", 4096, {}),
        ("control_period", 4096, {}),
        ("latents_per_second", 1000, {}),
        ("time_multiplier", 1000, {}),
        ("encoder_width", 16384, {}),
        ("nyquist_fraction", 1, {}),
        ("time_base", 10**9, {}),
    ],
)
def test_every_number_has_the_limit_of_the_library(field, largest, others):
    assert getattr(TINY.with_(**others, **{field: largest}), field) == largest
    with pytest.raises(BuildError) as refusal:
        TINY.with_(**others, **{field: largest + 1})
    assert refusal.value.field == field and f"{largest + 1} is not" in refusal.value.cause and str(largest) in refusal.value.cause


@pytest.mark.parametrize(
    "changes, field, limit",
    [
        ({"global_offset": -4097}, "global_offset", "-4096"),
        ({"nyquist_fraction": 0.0}, "nyquist_fraction", "above 0"),
        ({"nyquist_fraction": float("nan")}, "nyquist_fraction", "at most 1"),
        ({"time_base": 1.0}, "time_base", "above 1"),
        ({"time_base": True}, "time_base", "above 1"),
        ({"buttons": 255}, "buttons", "256"),
        ({"patch": (65, 1), "latent_height": 65}, "patch", "from 1 to 64"),
        ({"patch": (0, 1)}, "patch", "from 1 to 64"),
        ({"decoder_widths": (32, 16, 16, 16385)}, "decoder_widths", "16384"),
        ({"width": 2048, "heads": 1, "kv_heads": 1}, "width / heads", "1024"),
        ({"latent_height": 512, "latent_width": 512, "patch": (1, 1)}, "tokens", "262144 is not a whole number from 1 to 65536"),
        ({"render": (1025, 64)}, "render", "from 1 to 1024"),
        ({"latent_width": 1024, "latent_height": 512, "patch": (8, 8), "render": (0, 0)}, "render", "20480 is not a whole number from 1 to 16384"),
    ],
)
def test_other_limits_of_the_library(changes, field, limit):
    with pytest.raises(BuildError) as refusal:
        TINY.with_(**changes)
    assert refusal.value.field == field and limit in refusal.value.cause


@pytest.mark.parametrize(
    "changes, value",
    [
        # [4, 129, 256, 512] is 258 MiB in float32.
        ({"encoder_width": 129}, "value encoder.0 of the encoder"),
        # A matrix [8192, 32768] in float32.
        ({"width": 8192, "heads": 128, "kv_heads": 64}, "of the transformer"),
    ],
)
def test_values_beyond_the_limit_of_the_library_are_refused(tmp_path, changes, value):
    facts = {"name": "w", "provenance": {}, "licence": Licence("CC0-1.0")}
    with pytest.raises(BuildError, match="at most 256 are allowed") as refusal:
        build_bundle(PRESETS["720p"][1].with_(**changes), None, tmp_path / "w", **facts)
    assert value in refusal.value.field and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "facts, field",
    [
        ({"name": ""}, "name"),
        ({"name": "a\x85b"}, "name"),
        ({"name": "\udc80"}, "name"),
        ({"licence": Licence("")}, "licence"),
        ({"licence": Licence("M" * 201)}, "licence"),
        ({"licence": Licence("MIT\n")}, "licence"),
        ({"licence": Licence("Licença")}, "licence"),
        ({"provenance": {"seed": 1}}, "provenance.seed"),
        ({"rounding": "f8"}, "rounding"),
    ],
)
def test_texts_that_the_library_refuses_are_refused_at_once(tmp_path, facts, field):
    facts = {"name": "w", "provenance": {}, "licence": Licence("CC0-1.0")} | facts
    with pytest.raises(BuildError) as refusal:
        build_bundle(TINY, None, tmp_path / "w", **facts)
    assert refusal.value.field == field and not list(tmp_path.iterdir())


def test_a_manifest_beyond_the_limit_is_refused(tmp_path):
    facts = {"name": "é" * 100, "provenance": {"a": "é" * (1 << 18)}, "licence": Licence("M" * 200)}
    with pytest.raises(BuildError, match="at most 1048576 are allowed"):
        build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "w", **facts)
    assert not list(tmp_path.iterdir())
    facts["provenance"] = {}
    assert build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "w", **facts).is_dir()


def test_windows_gives_the_same_bytes(tiny, tmp_path, monkeypatch):
    archive.pack(tiny, tmp_path / "here.cairn")
    # What differs there: line ends of text, and the system that `zipfile` writes down.
    monkeypatch.setattr(Path, "write_text", lambda path, text, **_: path.write_bytes(text.replace("\n", "\r\n").encode()))
    monkeypatch.setattr(zipfile, "sys", SimpleNamespace(platform="win32"))
    assert zipfile.ZipInfo("name").create_system == 0
    facts = {"name": "tiny", "provenance": {"seed": "1"}, "licence": Licence("CC0-1.0", b"No rights reserved.\n")}
    made = build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "there", **facts)
    assert {path.name: path.read_bytes() for path in made.iterdir()} == {path.name: path.read_bytes() for path in tiny.iterdir()}
    packed = build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "there.cairn", **facts)
    assert packed.read_bytes() == (tmp_path / "here.cairn").read_bytes()
    with zipfile.ZipFile(packed) as entries:
        assert {info.create_system for info in entries.infolist()} == {3}


def test_the_table_of_the_released_shapes():
    g = PRESETS["720p"][1]
    text = table.describe(g)
    assert "1,281,958,039" in text and "11,372,012" in text
    for precision in ("f32", "f16"):
        for window in (112, 128, 384, 512):
            assert f"{precision} g{window}" in text
    # 24 layers of 16 buckets at g128: 768 MiB in float16; one latent is 48 MiB.
    assert table.ring_bytes(g, 128, "f16") == 768 << 20
    assert table.slab_bytes(g, "f16") == 48 << 20
    assert table.windows(TINY) == [16, 64]


def test_square_pixels_of_the_released_sizes():
    assert square_pixels((1024, 512)) == (1280, 720) and square_pixels((512, 256)) == (640, 360)
    assert square_pixels((640, 480)) == (640, 480)
    small = Geometry(layers=1, width=8, heads=1, kv_heads=1, latent_channels=1, latent_height=2, latent_width=4)
    assert small.decoded == (64, 32) and small.render == (80, 44)
