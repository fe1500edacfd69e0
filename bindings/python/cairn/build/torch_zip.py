"""Reads tensors from torch's zip file without torch, and without running code from the file.

Such a file contains a pickle, which names functions to call. A usual unpickler calls them. This interpreter knows only the few opcodes that a
dictionary of tensors needs, and four names, none of which it calls; it refuses everything else. Storages are looked up by key and checked
against the file before a number is read.
"""

from __future__ import annotations

import math
import pickletools
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import BuildError
from .zip_damage import DAMAGE, check_position

# The pickle of a state dictionary has a few kilobytes; this bounds the work that hostile bytes can cause.
PICKLE_LIMIT = 1 << 20
STORAGE_LIMIT = 4 << 30
_REMEDY = "Save the state dictionary again with torch.save, or as safetensors."
_STORAGES = {"FloatStorage": "F32", "HalfStorage": "F16", "BFloat16Storage": "BF16"}
_NAMES = {
    ("collections", "OrderedDict"),
    ("torch._utils", "_rebuild_tensor_v2"),
    ("torch._utils", "_rebuild_parameter"),
    *(("torch", storage) for storage in _STORAGES),
}


@dataclass(frozen=True)
class _Name:
    module: str
    name: str


@dataclass(frozen=True)
class _Storage:
    kind: str
    key: str
    count: int


@dataclass(frozen=True)
class TorchTensor:
    """Position of a tensor's numbers: kind "F32", "F16" or "BF16", shape, and strides within its storage."""

    storage: _Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    @property
    def kind(self) -> str:
        """Type of its numbers."""
        return self.storage.kind


class TorchFile:
    """A file of `torch.save` with one dictionary of tensors: `tensors` by name, and `read` for their bytes. The file is open only while it is
    read.
    """

    def __init__(self, path: Path):
        self.path = path
        with self._opened() as archive:
            names = archive.namelist()
            pickles = [n for n in names if n == "data.pkl" or n.endswith("/data.pkl")]
            if len(pickles) != 1:
                raise self._error(f"it holds {len(pickles)} entries called data.pkl, one is expected", _REMEDY)
            self._prefix = pickles[0].removesuffix("data.pkl")
            if f"{self._prefix}byteorder" in names and self._entry(archive, "byteorder", 16).strip() != b"little":
                raise self._error("its numbers are not little-endian", _REMEDY)
            pickled = self._entry(archive, "data.pkl", PICKLE_LIMIT)
        self.tensors = self._state(_Interpreter(pickled, self._error).run())

    def read(self, name: str) -> bytes:
        """The numbers of one tensor in C order, little-endian."""
        tensor = self.tensors[name]
        size = 4 if tensor.kind == "F32" else 2
        with self._opened() as archive:
            data = self._entry(archive, f"data/{tensor.storage.key}", STORAGE_LIMIT)
        if len(data) != size * tensor.storage.count:
            wanted = size * tensor.storage.count
            raise self._error(f"storage {tensor.storage.key} of {name} is {len(data)} bytes, {wanted} were named", _REMEDY)
        numbers = np.frombuffer(data, f"<u{size}")
        strides = tuple(size * s for s in tensor.strides)
        view = np.lib.stride_tricks.as_strided(numbers[tensor.offset :], tensor.shape, strides, writeable=False)
        return view.tobytes()

    @contextmanager
    def _opened(self) -> Iterator[zipfile.ZipFile]:
        try:
            archive = zipfile.ZipFile(self.path)
        except DAMAGE as error:
            raise self._error(f"it is no zip file ({error})", _REMEDY) from error
        with archive:
            yield archive

    def _entry(self, archive: zipfile.ZipFile, name: str, limit: int) -> bytes:
        full = f"{self._prefix}{name}"
        try:
            info = archive.getinfo(full)
        except KeyError:
            raise self._error(f"entry {full} is missing", _REMEDY) from None
        if info.compress_type != zipfile.ZIP_STORED or info.flag_bits & 1 or info.file_size > limit:
            raise self._error(f"entry {full} is compressed, encrypted or longer than {limit} bytes", _REMEDY)
        try:
            check_position(info)
            return archive.read(info)
        except DAMAGE as error:
            raise self._error(f"entry {full} is damaged ({error})", "Fetch the file again.") from error

    def _state(self, found: object) -> dict[str, TorchTensor]:
        if not isinstance(found, dict) or not all(isinstance(k, str) for k in found):
            raise self._error("it is not a dictionary of names", _REMEDY)
        for name, value in found.items():
            if not isinstance(value, TorchTensor):
                raise self._error(f"{name} is no tensor", _REMEDY)
        return found

    def _error(self, cause: str, remedy: str) -> BuildError:
        return BuildError(cause, field=str(self.path), remedy=remedy)


class _Interpreter:
    """Interprets a pickle with plain values only: dictionaries, lists, tuples, numbers, strings, tensors. Calls nothing."""

    def __init__(self, data: bytes, error):
        self.data = data
        self.error = error
        self.stack: list = []
        self.marks: list[int] = []
        self.memo: dict[int, object] = {}

    def run(self) -> object:
        """The value that the pickle describes."""
        try:
            for opcode, argument, _ in pickletools.genops(self.data):
                if opcode.name == "STOP":
                    if len(self.stack) != 1 or self.marks:
                        raise ValueError("values are left over")
                    return self.stack.pop()
                self.step(opcode.name, argument)
        except BuildError:
            raise
        except (ValueError, IndexError, KeyError, TypeError, RecursionError, OverflowError, MemoryError) as problem:
            raise self.error(f"its pickle is damaged ({problem!r})", _REMEDY) from problem
        raise self.error("its pickle has no end", _REMEDY)

    def step(self, name: str, argument) -> None:
        """Interprets one opcode."""
        stack = self.stack
        match name:
            case "PROTO" | "FRAME":
                pass
            case "EMPTY_DICT":
                stack.append({})
            case "EMPTY_LIST":
                stack.append([])
            case "EMPTY_TUPLE":
                stack.append(())
            case "NONE":
                stack.append(None)
            case "NEWTRUE" | "NEWFALSE":
                stack.append(name == "NEWTRUE")
            case "BININT" | "BININT1" | "BININT2" | "LONG1" | "BINUNICODE" | "SHORT_BINUNICODE":
                stack.append(argument)
            case "MARK":
                self.marks.append(len(stack))
            case "TUPLE":
                stack.append(tuple(self.since_mark()))
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                stack.append(tuple(self.pop_many(int(name[-1]))))
            case "BINPUT" | "LONG_BINPUT":
                self.memo[argument] = stack[-1]
            case "MEMOIZE":
                self.memo[len(self.memo)] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(self.memo[argument])
            case "APPEND" | "APPENDS":
                items = self.since_mark() if name == "APPENDS" else [stack.pop()]
                self.top(list).extend(items)
            case "SETITEM" | "SETITEMS":
                items = self.since_mark() if name == "SETITEMS" else self.pop_many(2)
                if len(items) % 2:
                    raise ValueError("a key without a value")
                # Only strings: hashing nested tuples could take exponential time.
                if not all(isinstance(key, str) for key in items[::2]):
                    raise TypeError("a key that is no string")
                self.top(dict).update(zip(items[::2], items[1::2]))
            case "GLOBAL":
                stack.append(self.named(*argument.split(" ", 1)))
            case "STACK_GLOBAL":
                stack.append(self.named(*self.pop_many(2)))
            case "BINPERSID":
                stack.append(self.storage(stack.pop()))
            case "REDUCE":
                function, arguments = self.pop_many(2)
                stack.append(self.rebuilt(function, arguments))
            case "BUILD":
                # torch attaches `_metadata` to its dictionaries. It does not affect the weights.
                stack.pop()
                self.top(dict)
            case _:
                raise self.error(f"its pickle uses {name}, which tensors do not need", _REMEDY)

    def since_mark(self) -> list:
        """Pops the values that were pushed since the last mark."""
        return self.pop_many(len(self.stack) - self.marks.pop())

    def pop_many(self, count: int) -> list:
        """Pops the last values, and returns them oldest first."""
        floor = self.marks[-1] if self.marks else 0
        if count < 0 or len(self.stack) - count < floor:
            raise IndexError("the stack is too short")
        items = self.stack[len(self.stack) - count :]
        del self.stack[len(self.stack) - count :]
        return items

    def top(self, kind: type):
        """The top of the stack, which must be of this type."""
        if not isinstance(self.stack[-1], kind):
            raise TypeError(f"a {kind.__name__} was expected")
        return self.stack[-1]

    def named(self, module: str, name: str) -> _Name:
        """One of the few allowed names."""
        if not isinstance(module, str) or not isinstance(name, str):
            raise TypeError("a name that is no string")
        if (module, name) not in _NAMES:
            cause = f"its pickle asks for {module[:80]}.{name[:80]}, which is not a tensor's"
            raise self.error(cause, "Do not trust this file. " + _REMEDY)
        return _Name(module, name)

    def storage(self, identity) -> _Storage:
        """The persistent identity ("storage", kind, key, device, count)."""
        label, kind, key, device, count = identity
        known = isinstance(kind, _Name) and kind.name in _STORAGES
        if not isinstance(label, str) or label != "storage" or not known or not _whole(count):
            raise ValueError("a storage of an unknown kind")
        if not isinstance(key, str) or not key.isdecimal() or not isinstance(device, str):
            raise ValueError("a storage with a strange key")
        return _Storage(_STORAGES[kind.name], key, count)

    def rebuilt(self, function, arguments):
        """The value that stands for a call of one of the allowed names."""
        if not isinstance(function, _Name) or not isinstance(arguments, tuple):
            raise TypeError("a call of something else than a name")
        if function.name == "OrderedDict":
            if arguments:
                raise ValueError("a dictionary with arguments")
            return {}
        if function.name == "_rebuild_parameter":
            if not arguments or not isinstance(arguments[0], TorchTensor):
                raise TypeError("a parameter without a tensor")
            return arguments[0]
        if function.name == "_rebuild_tensor_v2":
            storage, offset, shape, strides = arguments[:4]
            return self.tensor(storage, offset, shape, strides)
        raise TypeError(f"{function.name} cannot be called")

    def tensor(self, storage, offset, shape, strides) -> TorchTensor:
        """A tensor, all of whose numbers lie inside its storage."""
        if not isinstance(storage, _Storage) or not isinstance(shape, tuple) or not isinstance(strides, tuple):
            raise TypeError("a tensor without a storage or a shape")
        if len(shape) != len(strides) or len(shape) > 8 or not all(map(_whole, (offset, *shape, *strides))):
            raise ValueError("a tensor of a strange shape")
        count = math.prod(shape)
        last = offset + sum((n - 1) * s for n, s in zip(shape, strides)) if count else offset
        if last >= storage.count + (count == 0) or count > storage.count:
            raise ValueError("a tensor that reaches outside its storage")
        return TorchTensor(storage, offset, shape, strides)


def _whole(value) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << 40
