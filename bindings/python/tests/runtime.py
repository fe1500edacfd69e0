"""Finds the library and the worlds for tests of the runtime."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cairn import _library

ROOT = Path(__file__).resolve().parents[3]


def need_library() -> Path:
    """Cairn's library: the one in CAIRN_LIBRARY, else the one that cargo builds for tests, which is built here if it is missing."""
    if not os.environ.get(_library.VARIABLE):
        target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target")
        path = target / "debug" / _library.FILE
        if not path.is_file():
            subprocess.run(["cargo", "build", "--quiet", "--package", "cairn"], cwd=ROOT, check=True)
        os.environ[_library.VARIABLE] = str(path)
    return Path(os.environ[_library.VARIABLE])


def need_worlds() -> Path:
    """The folder with the random-weight worlds that `cargo xtask setup --all` makes."""
    if given := os.environ.get("CAIRN_TEST_BUNDLE"):
        return Path(given)
    pytest.fail("CAIRN_TEST_BUNDLE is not set. Run `cargo xtask test pytest`, which sets it", pytrace=False)


def pattern(height: int, width: int, channels: int = 4) -> np.ndarray:
    """A picture with colour and edges."""
    y, x = np.mgrid[0:height, 0:width]
    picture = np.stack([x * 255 // width, y * 255 // height, (x // 8 + y // 8) % 2 * 200, np.full_like(x, 255)], axis=2)
    return np.ascontiguousarray(picture[:, :, :channels].astype(np.uint8))


def python(*arguments: str, **environment: str | None) -> subprocess.CompletedProcess[str]:
    """Runs this Python with changed environment variables; None removes a variable."""
    variables = {**os.environ, "PYTHONPATH": str(ROOT / "bindings" / "python"), "PYTHONUTF8": "1"}
    for name, value in environment.items():
        variables.pop(name, None)
        if value is not None:
            variables[name] = value
    return subprocess.run(
        [sys.executable, *arguments], env=variables, capture_output=True, text=True, encoding="utf-8", check=False
    )
