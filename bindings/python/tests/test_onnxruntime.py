"""ONNX Runtime's library is found in its installed package, in every version that Cairn works with."""

import importlib.metadata
import importlib.util
import sys
from importlib.machinery import ModuleSpec

from cairn import _onnxruntime


def test_the_highest_usable_version_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    spec = ModuleSpec("onnxruntime", None)
    spec.submodule_search_locations = [str(tmp_path)]
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: spec)
    folder = tmp_path / "capi"
    assert _onnxruntime.in_package() is None
    folder.mkdir()
    names = ["providers_shared.so", "so", "so.1", "so.1.9.0", "so.1.23.2", "so.1.24.4", "so.1.100.0", "so.1.32.0", "so.1.200.x"]
    for number, name in enumerate(names):
        (folder / f"libonnxruntime.{name}").touch()
        found = _onnxruntime.in_package()
        expected = None if number < 5 else folder / f"libonnxruntime.{names[5] if number == 5 else 'so.1.100.0'}"
        assert found == expected, name


def test_an_old_package_is_reported(monkeypatch):
    def hints(version: str) -> list[str]:
        def installed(name: str) -> str:
            if name == "onnxruntime":
                return version
            raise importlib.metadata.PackageNotFoundError

        monkeypatch.setattr(importlib.metadata, "version", installed)
        return [hint for hint in _onnxruntime.hints("") if "needs 1.24 or newer" in hint]

    assert len(hints("1.9.0")) == len(hints("1.23.2")) == 1
    assert not hints("1.24.4") and not hints("1.32.0")
