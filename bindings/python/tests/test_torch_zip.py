"""The reader of torch's zip files: it returns tensors and nothing else, and runs nothing in the file."""

import os
import pickle
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from released import torch_entries, write_zip

from cairn.build import BuildError
from cairn.build.torch_zip import TorchFile

TENSORS = {
    "a.weight": np.arange(6, dtype=np.float32).reshape(2, 3),
    "b": np.array(2.5, np.float32),
    "c": np.zeros((0, 3), np.float32),
}


def with_pickle(path, data):
    return write_zip(path, torch_entries(TENSORS) | {"archive/data.pkl": data})


@pytest.mark.parametrize("kind, numpy_kind", [("F32", "<f4"), ("F16", "<f2")])
def test_tensors_come_out(tmp_path, kind, numpy_kind):
    found = TorchFile(write_zip(tmp_path / "t.pth", torch_entries(TENSORS, kind)))
    assert {n: (t.kind, t.shape) for n, t in found.tensors.items()} == {n: (kind, v.shape) for n, v in TENSORS.items()}
    for name, value in TENSORS.items():
        assert np.array_equal(np.frombuffer(found.read(name), numpy_kind).reshape(value.shape), value)


def test_strided_tensors_come_out_in_order(tmp_path):
    turned = {"t": np.arange(12, dtype=np.float32).reshape(3, 4).T}
    entries = torch_entries(turned, "F32")
    entries["archive/data/0"] = np.arange(12, dtype="<f4").tobytes()
    found = TorchFile(write_zip(tmp_path / "t.pth", entries))
    assert np.array_equal(np.frombuffer(found.read("t"), "<f4").reshape(4, 3), turned["t"])


class Hostile:
    """Pickles as a call of any function."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


def hostile_pickles(canary):
    import builtins
    import os

    touch = f"touch {canary}"
    yield "os.system", pickle.dumps({"w": Hostile(os.system, touch)}, 2)
    yield "os.system, protocol 4", pickle.dumps({"w": Hostile(os.system, touch)}, 4)
    yield "eval", pickle.dumps({"w": Hostile(builtins.eval, f"open({str(canary)!r}, 'w')")}, 2)
    yield "getattr", pickle.dumps({"w": Hostile(builtins.getattr, "x", "join")}, 2)
    yield "torch.load", b"\x80\x02ctorch\nload\n)R."
    yield "dotted name", b"\x80\x04\x8c\x0ccollections.\x8c\x0bOrderedDict\x93)R."
    yield "INST", b"(S'" + touch.encode() + b"'\nios\nsystem\n."
    yield "OBJ", b"(cos\nsystem\nS'" + touch.encode() + b"'\no."
    yield "NEWOBJ", b"\x80\x02ccollections\nOrderedDict\n)\x81."
    yield "EXT1", b"\x80\x02\x82\x01."
    yield "PERSID", b"P0\n."
    yield "call of a dictionary", b"\x80\x02})R."
    yield "arguments to OrderedDict", b"\x80\x02ccollections\nOrderedDict\n]]\x85\x85R."
    yield "BUILD on a name", b"\x80\x02ccollections\nOrderedDict\n}b."
    yield "call of a storage", b"\x80\x02ctorch\nFloatStorage\n)R."
    yield "empty", b""
    yield "no end", b"\x80\x02}"
    yield "underflow", b"\x80\x02R."
    yield "left over", b"\x80\x02}}."
    yield "pop past a mark", b"\x80\x02}(\x85."
    yield "unknown memo", b"\x80\x02h\x07."
    yield "not a dictionary", b"\x80\x02]."
    yield "number for a tensor", b"\x80\x02}X\x01\x00\x00\x00aK\x01s."
    yield "unhashable key", b"\x80\x02}]K\x01s."
    doubled = b")q\x00" + b"h\x00h\x00\x86q\x00" * 64
    yield "a key of 2^64 parts", b"\x80\x02}" + doubled + b"K\x01s."
    yield "a name of 2^64 parts", b"\x80\x04" + doubled + b"\x8c\x01a\x93."
    yield "deep nesting", b"\x80\x02" + b"]" * 10000 + b"\x85" * 20000 + b"."
    yield "long string that is not there", b"\x80\x02X\xff\xff\xff\x7fabc."


def test_nothing_in_the_file_is_run(tmp_path):
    canary = tmp_path / "canary"
    for name, data in hostile_pickles(canary):
        with pytest.raises(BuildError) as refused:
            TorchFile(with_pickle(tmp_path / "t.pth", data))
        assert refused.value.remedy and refused.value.field.endswith("t.pth"), name
        assert not canary.exists(), name


def test_every_flipped_byte_of_the_pickle_is_an_error_or_tensors(tmp_path):
    good = torch_entries(TENSORS)["archive/data.pkl"]
    for at in range(len(good)):
        for bit in (0x01, 0x80):
            data = bytearray(good)
            data[at] ^= bit
            try:
                found = TorchFile(with_pickle(tmp_path / "t.pth", bytes(data)))
                for name in found.tensors:
                    found.read(name)
            except BuildError:
                continue
            assert all(isinstance(n, str) for n in found.tensors)


def storage(count, key="0", kind="FloatStorage"):
    parts = (b"X\x07\x00\x00\x00storage", f"ctorch\n{kind}\n".encode(), whole(key), b"X\x03\x00\x00\x00cpu", whole(count))
    return b"(" + b"".join(parts) + b"tQ"


def whole(value):
    return pickle.dumps(value, 2)[2:-1]


def tensor(offset, shape, strides, **facts):
    return (
        b"\x80\x02}X\x01\x00\x00\x00wctorch._utils\n_rebuild_tensor_v2\n("
        + storage(facts.pop("count", 6), **facts) + whole(offset) + whole(shape) + whole(strides) + b"\x89}tRs."
    )


@pytest.mark.parametrize(
    "offset, shape, strides, facts",
    [
        (1, (2, 3), (3, 1), {}),
        (0, (2, 3), (4, 1), {}),
        (0, (2, 3), (-3, 1), {}),
        (-1, (2, 3), (3, 1), {}),
        (0, (7,), (0,), {}),
        (0, (1 << 50,), (1,), {}),
        (0, (2, 3), (3,), {}),
        (0, (1,) * 9, (1,) * 9, {}),
        (0, (2.0, 3), (3, 1), {}),
        (7, (0,), (1,), {}),
        (0, (2, 3), (3, 1), {"count": 7}),
        (0, (2, 3), (3, 1), {"key": "9"}),
        (0, (2, 3), (3, 1), {"key": "../0"}),
        (0, (2, 3), (3, 1), {"kind": "LongStorage"}),
        (0, (2, 3), (3, 1), {"count": -6}),
    ],
)
def test_a_tensor_outside_its_storage_is_refused(tmp_path, offset, shape, strides, facts):
    entries = {"x/data.pkl": tensor(offset, shape, strides, **facts), "x/data/0": np.arange(6, dtype="<f4").tobytes()}
    with pytest.raises(BuildError):
        TorchFile(write_zip(tmp_path / "t.pth", entries)).read("w")
    entries["x/data.pkl"] = tensor(0, (2, 3), (3, 1))
    assert len(TorchFile(write_zip(tmp_path / "t.pth", entries)).read("w")) == 24


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "t.pth"
    good = torch_entries(TENSORS)
    cases = [
        (b"", "no zip"),
        (pickle.dumps({"a": 1}), "no zip"),
        (b"PK\x05\x06" + bytes(18), "data.pkl"),
    ]
    for data, cause in cases:
        path.write_bytes(data)
        with pytest.raises(BuildError, match=cause):
            TorchFile(path)
    write_zip(path, good | {"other/data.pkl": good["archive/data.pkl"]})
    with pytest.raises(BuildError, match="2 entries"):
        TorchFile(path)
    write_zip(path, good | {"archive/byteorder": b"big"})
    with pytest.raises(BuildError, match="little-endian"):
        TorchFile(path)
    write_zip(path, good, zipfile.ZIP_DEFLATED)
    with pytest.raises(BuildError, match="compressed"):
        TorchFile(path)
    write_zip(path, {"archive/data.pkl": b"\x80\x02}." + bytes(2 << 20)})
    with pytest.raises(BuildError, match="longer than"):
        TorchFile(path)


def test_every_damaged_file_has_a_message(tmp_path):
    entries = torch_entries({"a": np.arange(8, dtype=np.float32)}, "F32")
    whole, bad, count = write_zip(tmp_path / "t.pth", entries).read_bytes(), tmp_path / "bad.pth", 0
    rng = np.random.default_rng(1)
    for at in range(len(whole)):
        data = bytearray(whole)
        data[at] ^= 1 << int(rng.integers(8))
        bad.write_bytes(data)
        try:
            TorchFile(bad).read("a")
        except BuildError:
            count += 1
    assert count > len(whole) // 3


def test_an_entry_before_the_start_is_refused(tmp_path):
    path = write_zip(tmp_path / "t.pth", torch_entries(TENSORS))
    # A central directory that is said to begin later than it does moves all entries back.
    data = bytearray(path.read_bytes())
    data[-6:-2] = (int.from_bytes(data[-6:-2], "little") + len(data)).to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(BuildError, match="before the archive"):
        TorchFile(path)


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_the_file_is_closed(tmp_path):
    path = write_zip(tmp_path / "t.pth", torch_entries(TENSORS))
    found = TorchFile(path)
    found.read("b")
    assert str(path) not in {os.readlink(link) for link in Path("/proc/self/fd").iterdir() if os.path.lexists(link)}


def test_damaged_numbers_are_refused(tmp_path):
    path = write_zip(tmp_path / "t.pth", torch_entries({"a": np.arange(64, dtype=np.float32)}, "F32"))
    data = bytearray(path.read_bytes())
    at = bytes(data).index(np.float32(7).tobytes())
    data[at] ^= 1
    path.write_bytes(data)
    with pytest.raises(BuildError, match="damaged"):
        TorchFile(path).read("a")
