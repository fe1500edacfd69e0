"""Bundles that are hostile or damaged: nothing is written outside the output, and no damage gets a valid checksum."""

import hashlib
import json
import os
import shutil

import numpy as np
import onnx
import pytest
from conftest import TINY, change_manifest, copied, zipped

from cairn.build import archive, build_bundle, cli
from cairn.build.errors import BuildError
from cairn.build.manifest import MANIFEST_FILE, Licence
from cairn.build.random_weights import RandomWeights
from cairn.build.reader import name_violation
from cairn.build.stored import StoredWeights
from cairn.build.weights import Weight

# Commands that read all of a bundle; those that write have an output.
WRITERS = (["rebuild"], ["quantise", "--weights", "8"], ["pack"])
READERS = (["sensitivity", "--walks", "1", "--threads", "1"],)


def refused(command, bundle, out, capsys) -> str:
    """The message of a command that must refuse a bundle, and write nothing."""
    out.parent.mkdir(exist_ok=True)
    before = sorted(out.parent.iterdir())
    options = ["--out", str(out)] if command in WRITERS else []
    quiet = [] if command == ["pack"] else ["--quiet"]
    assert cli.main([command[0], str(bundle), *command[1:], *options, *quiet]) == 2, command
    assert sorted(out.parent.iterdir()) == before, command
    message = capsys.readouterr().err
    assert message.startswith("error: ") and message.count("\n") == 1, message
    return message


def refused_by_all(folder, tmp_path, capsys) -> set[str]:
    """The messages of all commands, for the folder and for an archive with the same files."""
    out = tmp_path / "out"
    packed = zipped(folder, tmp_path / "hostile.cairn")
    messages = {refused(command, folder, out / name, capsys) for command in (*WRITERS, *READERS) for name in ("new", "new.cairn")}
    return messages | {refused(command, packed, out / "new", capsys) for command in (*WRITERS, *READERS)}


@pytest.mark.parametrize("name", ["a", "weights.bin", "a/b/c.onnx", "-", "..a", "a..b", "COM", "COM10", "console.bin", "a" * 200])
def test_plain_names_are_valid(name):
    assert name_violation(name) is None


# The list of src/bundle/names.rs.
@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../a", "a/..", "a/../b", "./a", "a/./b", "/a", "//a", "a/", "a//b", "\\a", "a\\b", "..\\a", "C:a", "C:/a", "c:\\a"]
    + ["\\\\host\\share", "//?/C:/a", "file:///a", "a\0b", "a b", "ä", "a:stream", "NUL", "nul.bin", "b/CoM1", "lpt9.onnx", "a.", "b./c"]
    + ["~/a\n", "%2e%2e/a", "a" * 201, "a\n", "a ", None, 3],
)
def test_names_that_lead_out_of_the_bundle_are_refused(name):
    assert name_violation(name) is not None


def test_a_licence_outside_the_bundle_is_neither_read_nor_written(tiny, tmp_path, capsys):
    folder = copied(tiny, tmp_path / "a" / "world")
    (tmp_path / "a" / ".secret").write_text("theirs")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".secret").write_text("mine")

    def name_it(manifest):
        manifest["licence"]["file"] = "../.secret"

    change_manifest(folder, name_it)
    assert all("licence.file: '../.secret' is no name" in message for message in refused_by_all(folder, tmp_path, capsys))
    assert (tmp_path / "out" / ".secret").read_text() == "mine"


@pytest.mark.parametrize("member", ["licence.file", "graphs.f32.transformer", "graphs.f32.encoder", "graphs.f16.decoder"])
@pytest.mark.parametrize("name, cause", [("../outside", "is no name"), ("unlisted.txt", "not listed"), (3, "is no name")])
def test_every_named_file_is_a_listed_one(tiny, tmp_path, capsys, member, name, cause):
    folder = copied(tiny, tmp_path / "world")
    (folder / "unlisted.txt").write_text("it exists")

    def name_it(manifest):
        *above, last = member.split(".")
        for part in above:
            manifest = manifest[part]
        manifest[last] = name

    change_manifest(folder, name_it)
    with pytest.raises(BuildError, match=cause) as refusal:
        archive.read_geometry(folder)
    assert refusal.value.field == member
    assert refused(["rebuild"], folder, tmp_path / "new", capsys) == f"error: {refusal.value}\n"
    assert refused(["pack"], zipped(folder, tmp_path / "bad.cairn"), tmp_path / "new", capsys) == f"error: {refusal.value}\n"


@pytest.mark.parametrize(
    "key, value, cause",
    [
        ("location", "../secret.bin", "is no name"),
        ("location", "unlisted.bin", "not listed"),
        ("location", "", "is no name"),
        ("offset", "-2", "no whole number"),
        ("offset", "9" * 5000, "no whole number"),
        ("offset", "9" * 17, "ends before"),
    ],
)
def test_weights_are_in_listed_files(tiny, tmp_path, key, value, cause):
    folder = copied(tiny, tmp_path / "a" / "world")
    for secret in (tmp_path / "a" / "secret.bin", folder / "unlisted.bin"):
        shutil.copyfile(folder / "transformer.bin", secret)
    model = onnx.load(folder / "transformer.f32.onnx", load_external_data=False)
    for tensor in model.graph.initializer:
        for entry in tensor.external_data:
            entry.value = value if entry.key == key else entry.value
    (folder / "transformer.f32.onnx").write_bytes(model.SerializeToString())
    change_manifest(folder, lambda manifest: None)
    assert cli.main(["rebuild", str(folder), "--out", str(tmp_path / "new"), "--quiet"]) == 2
    with pytest.raises(BuildError, match=cause):
        source = StoredWeights(TINY, folder)
        source.get(Weight("patchify.weight", (64, 4, 2, 2), 16))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    "change, cause",
    [
        (lambda files: files.append(dict(files[0])), "listed twice"),
        (lambda files: files.append({**files[0], "path": files[0]["path"].upper()}), "listed twice"),
        (lambda files: files.append({**files[0], "path": "Cairn-World.json"}), "is the manifest"),
        (lambda files: files[0].update(size=True), "no size"),
        (lambda files: files[0].update(size=-1), "no size"),
        (lambda files: files[0].update(sha256="A" * 64), "hex digits"),
        (lambda files: files.clear(), "0 entries"),
        (lambda files: files.__setitem__(0, None), "no name"),
    ],
)
def test_the_list_of_files_is_checked(tiny, tmp_path, capsys, change, cause):
    folder = change_manifest(copied(tiny, tmp_path / "world"), lambda manifest: change(manifest["files"]))
    assert all(cause in message for message in refused_by_all(folder, tmp_path, capsys))


def test_names_may_have_folders(tmp_path):
    licence, facts = Licence("MIT", b"Permission is hereby granted.\n", "licences/MIT.txt"), {"name": "w", "provenance": {}}
    made = build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "made", licence=licence, **facts)
    assert (made / "licences" / "MIT.txt").read_bytes() == licence.text
    assert cli.main(["pack", str(made), "--out", str(tmp_path / "packed.cairn")]) == 0
    assert cli.main(["rebuild", str(tmp_path / "packed.cairn"), "--out", str(tmp_path / "again"), "--quiet"]) == 0
    assert (tmp_path / "again" / "licences" / "MIT.txt").read_bytes() == licence.text
    assert (tmp_path / "again" / MANIFEST_FILE).read_bytes() == (made / MANIFEST_FILE).read_bytes()


@pytest.mark.parametrize("name", ["transformer.bin", "Decoder.F16.onnx", "cairn-world.json", "encoder.f32.onnx/LICENSE", "../LICENSE", "NUL"])
def test_a_licence_never_takes_the_place_of_another_file(tmp_path, name):
    licence, facts = Licence("MIT", b"", name), {"name": "w", "provenance": {}}
    with pytest.raises(BuildError) as refusal:
        build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "w", licence=licence, **facts)
    assert refusal.value.field == "licence.file" and not list(tmp_path.iterdir())


def flip(path, at=1000):
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("name", ["transformer.bin", "autoencoder.bin", "decoder.f16.onnx", "LICENSE.txt"])
def test_a_changed_bit_never_gets_a_valid_checksum(tiny, tmp_path, capsys, name):
    folder = copied(tiny, tmp_path / "world")
    flip(folder / name, 10)
    assert refused_by_all(folder, tmp_path, capsys) == {f"error: {name}: size or checksum differs from the manifest. Fetch it again.\n"}


def test_describe_checks_the_graphs_that_it_reads(tiny, tmp_path, capsys):
    folder = copied(tiny, tmp_path / "world")
    flip(folder / "encoder.f32.onnx")
    assert cli.main(["describe", str(folder)]) == cli.main(["describe", str(zipped(folder, tmp_path / "w.cairn"))]) == 2
    assert capsys.readouterr().err.count("encoder.f32.onnx: size or checksum differs") == 2


def test_short_long_and_missing_files_are_refused(tiny, tmp_path, capsys):
    folder = copied(tiny, tmp_path / "world")
    whole = (folder / "transformer.bin").read_bytes()
    for data in (whole[:-100], b"", whole + b"\0"):
        (folder / "transformer.bin").write_bytes(data)
        assert all("transformer.bin: size or checksum differs" in message for message in refused_by_all(folder, tmp_path, capsys))
    (folder / "transformer.bin").unlink()
    for command in (*WRITERS, *READERS):
        assert "is missing or no file" in refused(command, folder, tmp_path / "out" / "new", capsys)
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / "transformer.bin")
        assert "is missing or no file" in refused(["rebuild"], folder, tmp_path / "out" / "new", capsys)


def test_weights_that_do_not_fit_the_geometry_are_refused(tiny, tmp_path):
    folder = copied(tiny, tmp_path / "world")
    (folder / "transformer.bin").write_bytes((folder / "transformer.bin").read_bytes()[:100])
    with pytest.raises(BuildError, match="transformer.bin ends before its"):
        StoredWeights(TINY, folder).get(Weight("blocks.7.mlp.fc1.weight", (64, 256), 64))
    with pytest.raises(BuildError, match=r"the shape \[64, 256\], the geometry needs FLOAT16 \[64, 128\]"):
        StoredWeights(TINY, tiny).get(Weight("blocks.7.mlp.fc1.weight", (64, 128), 64))
    model = onnx.load(folder / "transformer.f32.onnx", load_external_data=False)
    for tensor in model.graph.initializer:
        tensor.data_type = onnx.TensorProto.BFLOAT16
    (folder / "transformer.f32.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(BuildError, match="the type BFLOAT16"):
        StoredWeights(TINY, folder).get(Weight("blocks.7.mlp.fc1.weight", (64, 256), 64))


def test_a_graph_that_is_none_is_refused(tiny, tmp_path, capsys):
    folder = copied(tiny, tmp_path / "world")
    (folder / "transformer.f32.onnx").write_bytes(b"\xff" * 100)
    change_manifest(folder, lambda manifest: None)
    assert "transformer.f32.onnx: it is no ONNX model" in refused(["rebuild"], folder, tmp_path / "new", capsys)


@pytest.mark.parametrize(
    "data, cause",
    [
        (b"no JSON", "it is no JSON"),
        (b'{"name": "\xff"}', "it is no JSON"),
        (b"\xff\xfe{\0}\0", "it is no JSON"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a":' * 100_000, "nested too deeply"),
        (b'{"files":' + b"[" * 500 + b"]" * 500 + b"}", "nested too deeply"),
        (b"[]", "it is no JSON object"),
        (b"{}", "its member name is missing"),
        (b" " * ((1 << 20) + 1), "longer than 1 MiB"),
        (b'{"name": ' + b"9" * 5000 + b"}", "it is no JSON"),
    ],
)
def test_a_manifest_that_is_none_is_refused(tmp_path, capsys, data, cause):
    (tmp_path / "world").mkdir()
    (tmp_path / "world" / MANIFEST_FILE).write_bytes(data)
    messages = refused_by_all(tmp_path / "world", tmp_path, capsys)
    assert all(cause in message for message in messages)
    assert cli.main(["describe", str(tmp_path / "world")]) == cli.main(["describe", str(tmp_path / "hostile.cairn")]) == 2


@pytest.mark.parametrize("member", ["name", "geometry", "sampler", "graphs", "files", "licence", "provenance"])
@pytest.mark.parametrize("value", [None, 3, [1]])
def test_members_of_another_kind_are_refused(tiny, tmp_path, capsys, member, value):
    folder = change_manifest(copied(tiny, tmp_path / "world"), lambda manifest: manifest.update({member: value}))
    refused(["rebuild"], folder, tmp_path / "out" / "new", capsys)


@pytest.mark.parametrize(
    "change, field",
    [
        (lambda m: m["provenance"].update(seed=1), "provenance.seed"),
        (lambda m: m["sampler"].update(sigma_rounding="f8"), "sampler.sigma_rounding"),
        (lambda m: m["geometry"]["rope"].update(rounding=[]), "geometry.rope.rounding"),
        (lambda m: m["geometry"]["rope"].update(nyquist_fraction="1"), "nyquist_fraction"),
        (lambda m: m["geometry"].update(layers=10**9), "layers"),
        (lambda m: m["geometry"].update(patch=[2, "2"]), "patch"),
        (lambda m: m["sampler"].update(schedule=["a", 0]), MANIFEST_FILE),
        (lambda m: m.update(name="\ud800"), "name"),
        (lambda m: m["licence"].update(spdx=None), "licence"),
        (lambda m: m["graphs"].pop("f32"), "graphs"),
        (lambda m: m["graphs"].update(f8=m["graphs"]["f16"]), "graphs"),
        (lambda m: m["graphs"]["f16"].pop("encoder"), "graphs.f16"),
    ],
)
def test_values_of_another_kind_are_refused(tiny, tmp_path, capsys, change, field):
    folder = change_manifest(copied(tiny, tmp_path / "world"), change)
    assert refused(["rebuild"], folder, tmp_path / "out" / "new", capsys).startswith(f"error: {field}: ")


def test_a_licence_keeps_its_bytes(tmp_path, tiny):
    # Latin-1, and line ends of Windows.
    text = "© Léa\r\nAll rights reserved.\r\n".encode("latin-1")
    (tmp_path / "terms").write_bytes(text)
    licence, facts = Licence.read("LicenseRef-terms", tmp_path / "terms"), {"name": "w", "provenance": {}}
    made = build_bundle(TINY, RandomWeights(TINY, 1), tmp_path / "made", licence=licence, **facts)
    assert cli.main(["rebuild", str(made), "--out", str(tmp_path / "again.cairn"), "--quiet"]) == 0
    again = archive.unpack(tmp_path / "again.cairn", tmp_path / "again")
    assert (made / "LICENSE.txt").read_bytes() == (again / "LICENSE.txt").read_bytes() == text


@pytest.fixture
def small(tiny, tmp_path):
    """An archive of a manifest and files of a few bytes, for `unpack` alone."""
    folder = tmp_path / "small"
    folder.mkdir()
    manifest = json.loads((tiny / MANIFEST_FILE).read_bytes())
    manifest["graphs"].pop("f16")
    manifest["licence"]["file"] = None
    manifest["files"] = [entry for entry in manifest["files"] if entry["path"].endswith("f32.onnx")]
    for i, entry in enumerate(manifest["files"]):
        data = bytes([i] * (10 + i))
        (folder / entry["path"]).write_bytes(data)
        entry.update(size=len(data), sha256=hashlib.sha256(data).hexdigest())
    manifest |= {member: {} for member in ("geometry", "sampler", "provenance")}
    (folder / MANIFEST_FILE).write_bytes(json.dumps(manifest).encode())
    return folder, archive.pack(folder, tmp_path / "small.cairn")


def test_every_damaged_archive_has_a_message(small, tmp_path):
    folder, packed = small
    whole, bad, out = packed.read_bytes(), tmp_path / "bad.cairn", tmp_path / "out"
    wanted = {path.name: path.read_bytes() for path in folder.iterdir()}
    kinds = set()

    def read(data):
        bad.write_bytes(data)
        try:
            archive.unpack(bad, out)
        except BuildError as error:
            kinds.add(error.cause.split(":")[0])
            assert not out.exists()
        else:
            # A date or an attribute may change.
            assert {path.name: path.read_bytes() for path in out.iterdir()} == wanted
            shutil.rmtree(out)

    rng = np.random.default_rng(1)
    # Few bits of the manifest itself, and one of each other byte.
    start = whole.index((folder / MANIFEST_FILE).read_bytes())
    end = start + (folder / MANIFEST_FILE).stat().st_size
    for at in [*range(start), *range(start, end, 50), *range(end, len(whole))]:
        data = bytearray(whole)
        data[at] ^= 1 << int(rng.integers(8))
        read(data)
    for length in range(0, len(whole), 37):
        read(whole[:length])
    assert {"it is no archive", "the archive is damaged", "it is compressed or encrypted"} <= kinds, kinds


def test_a_changed_bit_in_an_archive_has_a_message(tiny, tmp_path, capsys):
    packed = archive.pack(tiny, tmp_path / "world.cairn")
    data = packed.read_bytes()
    for name, part in (("weights", (tiny / "transformer.bin").read_bytes()), ("manifest", (tiny / MANIFEST_FILE).read_bytes())):
        at = data.index(part[:200]) + 100
        packed.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        for command in (*WRITERS, *READERS):
            message = refused(command, packed, tmp_path / "out" / "new", capsys)
            assert "the archive is damaged: Bad CRC-32" in message and "Fetch it again." in message, name
    assert cli.main(["describe", str(packed)]) == 2
