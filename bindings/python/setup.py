"""Copies the shared library in CAIRN_LIBRARY into the build, beside the package's modules; a wheel is then for this platform. Without
the variable the package has no library, and searches for one when it is used."""

import os
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

LIBRARY = os.environ.get("CAIRN_LIBRARY")
# The name that cairn/_library.py looks for.
FILE = {"win32": "cairn.dll", "darwin": "libcairn.dylib"}.get(sys.platform, "libcairn.so")


class BuildWithLibrary(build_py):
    def run(self) -> None:
        super().run()
        beside = Path(self.build_lib) / "cairn" / FILE
        beside.unlink(missing_ok=True)  # of an earlier build
        if LIBRARY and not self.editable_mode:
            self.copy_file(LIBRARY, str(beside))


class PlatformWheel(bdist_wheel):
    def get_tag(self) -> tuple[str, str, str]:
        tag = super().get_tag()
        return ("py3", "none", tag[2]) if LIBRARY else tag  # any Python takes the library


class WithLibrary(Distribution):
    def has_ext_modules(self) -> bool:
        return bool(LIBRARY)


setup(distclass=WithLibrary, cmdclass={"build_py": BuildWithLibrary, "bdist_wheel": PlatformWheel})
