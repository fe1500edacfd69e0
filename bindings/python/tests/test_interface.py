"""`cairn._interface` against `abi.txt`."""

import ctypes
import sys
from pathlib import Path

import pytest

import cairn
from cairn import _interface as c
from cairn import _library, _library_file
from cairn.errors import _KINDS, Unsupported

RECORD = (Path(__file__).parents[3] / "abi.txt").read_text(encoding="utf-8").splitlines()

STRUCTS = {
    "cairn_" + "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_"): kind
    for name, kind in vars(c).items()
    if isinstance(kind, type) and issubclass(kind, c.Sized) and kind is not c.Sized
}

# ctypes by the C type's text, without const and the parameter's name. Handles are numbers: every pointer to one is void.
TYPES = {
    "uint8_t *": ctypes.POINTER(ctypes.c_uint8),
    "uint16_t *": ctypes.POINTER(ctypes.c_uint16),
    "uint32_t": ctypes.c_uint32,
    "int32_t": ctypes.c_int32,
    "uint64_t": ctypes.c_uint64,
    "size_t": ctypes.c_size_t,
    "float": ctypes.c_float,
    "cairn_result": ctypes.c_int32,
    "void *": ctypes.c_void_p,
    "char *": ctypes.c_char_p,
    "size_t *": ctypes.POINTER(ctypes.c_size_t),
    "uint32_t *": ctypes.POINTER(ctypes.c_uint32),
    "uint64_t *": ctypes.POINTER(ctypes.c_uint64),
    "float *": ctypes.POINTER(ctypes.c_float),
    "cairn_log_callback": c.log_callback,
    **{f"{name} *": ctypes.POINTER(kind) for name, kind in STRUCTS.items()},
}


def lines(kind: str) -> list[list[str]]:
    """The words of `abi.txt`'s lines of one kind."""
    found = [line.split(" ")[1:] for line in RECORD if line.startswith(f"{kind} ")]
    assert found, f"abi.txt has no {kind}"
    return found


def parsed(declaration: str) -> tuple[str, object]:
    """Name and ctypes type of a parameter or function, from its declaration in C."""
    text = declaration.replace("const ", "").replace("struct ", "").strip()
    at = max(text.rfind(" "), text.rfind("*")) + 1
    kind, name = text[:at].strip(), text[at:]
    if kind in TYPES:
        return name, TYPES[kind]
    stars = kind.count("*")
    assert kind.startswith("cairn_") and stars in (1, 2), f"an unknown type: {declaration}"
    return name, ctypes.c_void_p if stars == 1 else ctypes.POINTER(ctypes.c_void_p)


def test_constants_match_abi_txt():
    recorded = {name.removeprefix("CAIRN_"): int(value) for name, value in lines("constant")}
    assert recorded["FOREVER"] == -1
    recorded["FOREVER"] = 2**64 - 1
    assert {name: value for name, value in vars(c).items() if name.isupper() and isinstance(value, int)} == recorded


def test_struct_layouts_match_abi_txt():
    recorded = {name for name, _ in lines("struct")}
    assert STRUCTS.keys() == recorded
    newest = dict(lines("size"))
    for name, kind in STRUCTS.items():
        assert ctypes.sizeof(kind) == int(newest[name]), name
        assert kind().struct_size == ctypes.sizeof(kind)
        fields = [(path, int(at), int(size)) for path, at, size in lines("field") if path.split(".")[0] == name]
        own = [(f"{name}.{field}", getattr(kind, field).offset, getattr(kind, field).size) for field, _ in kind._fields_]
        assert own == fields


def test_function_signatures_match_abi_txt():
    own = {name: (types, c.RETURNS.get(name, ctypes.c_int32)) for name, types in c.FUNCTIONS.items()}
    # Of the experimental functions, the package has some.
    experimental = [line for line in RECORD if line.startswith("experimental ") and name_of(line) in own]
    recorded = {}
    for line in [line for line in RECORD if line.startswith("function ")] + experimental:
        head, _, rest = line.partition(" ")[2].partition("(")
        inside = rest.rstrip(")")
        parameters = () if inside == "void" else tuple(parsed(part)[1] for part in inside.split(","))
        recorded[name_of(line)] = (parameters, parsed(head)[1])
    assert own == recorded
    assert {name_of(line) for line in experimental} == c.EXPERIMENTAL


def test_experimental_functions_of_another_version_are_not_called(monkeypatch):
    monkeypatch.setattr(c, "VERSION", c.VERSION - 1)
    newer = _library.Library(_library.find())
    assert newer.function("device_create_cpu") is not None
    for name in c.EXPERIMENTAL:
        with pytest.raises(Unsupported, match=f"cairn_{name}: it is experimental"):
            newer.function(name)


def name_of(line: str) -> str:
    """The name of a recorded function, without its prefix."""
    return line.partition("(")[0].replace("*", " ").split()[-1].removeprefix("cairn_")


def test_every_error_has_an_exception_of_its_own():
    errors = {value for name, value in vars(c).items() if name.startswith("ERROR_")}
    assert _KINDS.keys() == errors
    assert len(set(_KINDS.values())) == len(errors)
    for result, kind in _KINDS.items():
        assert kind("x").result == result
        assert kind("x").name.startswith("CAIRN_ERROR_")
        assert str(kind("what it says", result)) == "what it says"


def test_all_exported_names_exist():
    for name in cairn.__all__:
        assert getattr(cairn, name) is not None, name


@pytest.mark.parametrize("name", sorted(STRUCTS))
def test_a_struct_starts_as_zeroes(name):
    struct = STRUCTS[name]()
    assert bytes(struct)[4:] == bytes(ctypes.sizeof(struct) - 4)


@pytest.mark.parametrize(
    ("why", "words"),
    [
        (FileNotFoundError("Could not find module 'cairn.dll' (or one of its dependencies)."), "this system does not have"),
        (OSError(22, "An Application Control policy has blocked this file"), "policy of this Windows"),
    ],
)
def test_reasons_of_windows_are_explained(monkeypatch, why, words):
    monkeypatch.setattr(sys, "platform", "win32")
    if not isinstance(why, FileNotFoundError):
        why.winerror = 4551
    cause, remedy = _library_file.explain_failure(why)
    assert words in cause and remedy != _library.REMEDY
    assert _library_file.explain_failure(OSError("another reason")) is None
