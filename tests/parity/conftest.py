"""Fixtures: the test bundles, the trace program, and rollouts that several tests share."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from cases import DEVICE
from comparison import Runner, Trace

ROOT = Path(__file__).resolve().parents[2]


def set_up_bundles() -> Path:
    """The newest complete folder of bundles that `cargo xtask setup` made; it makes one for each version of the builder."""
    if own := os.environ.get("CAIRN_CACHE_DIR"):
        cache = Path(own)
    elif sys.platform == "win32":
        cache = Path(os.environ["LOCALAPPDATA"])
    else:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "cairn" / "bundles"
    complete = [made for made in folder.glob("*") if not lacking(made)]
    return max(complete, key=lambda made: made.stat().st_mtime, default=folder)


def lacking(folder: Path) -> list[str]:
    """The required bundles that `folder` lacks."""
    return [name for name in ("tiny", "tiny-residual", "window") if not (folder / name / "cairn-world.json").is_file()]


@pytest.fixture(scope="session")
def bundles() -> Path:
    """The folder with the bundles `tiny`, `tiny-residual` and `window`."""
    folder = Path(os.environ.get("CAIRN_TEST_BUNDLE") or set_up_bundles())
    if missing := lacking(folder):
        cause = f"{folder} lacks the test bundles {missing}"
        pytest.fail(f"{cause}. Run `cargo xtask setup`, or set CAIRN_TEST_BUNDLE.", pytrace=False)
    return folder


@pytest.fixture(scope="session")
def program() -> Path:
    """The trace program: PARITY_TRACE, or built here."""
    if given := os.environ.get("PARITY_TRACE"):
        return Path(given)
    subprocess.run(["cargo", "build", "--quiet", "--package", "parity-trace"], cwd=ROOT, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target")
    return target / "debug" / ("parity-trace.exe" if sys.platform == "win32" else "parity-trace")


@pytest.fixture(scope="session")
def run(bundles: Path, program: Path, tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """`run(**options)` gives the trace of one rollout; equal options run once.

    `oracle_bundle` is the bundle that the oracle reads, if the bundle that runs is a faulty copy.
    """
    done: dict[tuple, Trace] = {}
    # Command that starts the trace program, such as one that runs Windows programs on Linux.
    runner = shlex.split(os.environ.get("PARITY_RUNNER", ""))

    def run(bundle: str | Path = "tiny", oracle_bundle: Path | None = None, **options: str | int) -> Trace:
        key = (bundle, *sorted(options.items()))
        if key not in done:
            path, folder = bundles / bundle, tmp_path_factory.mktemp("trace")
            arguments = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
            arguments.append(f"--device={DEVICE}")
            result = subprocess.run(
                [*runner, program, path, folder, *arguments],
                capture_output=True,
                text=True,
                encoding="utf-8",
                check=False,
            )
            command = f"{program.name} {path} {' '.join(arguments)}"
            assert result.returncode == 0, f"{command}\n{result.stdout}{result.stderr}"
            done[key] = Trace(oracle_bundle or path, folder)
        return done[key]

    return run
