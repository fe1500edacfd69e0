"""The whole path at its smallest: clips, autoencoder, latents, transformer, checkpoint, bundle, and a latent out of it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cairn.build.archive import read_geometry
from miniature import store
from miniature.shapes import PRESETS, SMOKE
from rollout import Rollout
from safetensors.numpy import load_file

ROOT = Path(__file__).resolve().parents[4]


@pytest.fixture(scope="module")
def renderer() -> Path:
    """The scenes program: SCENES, or built here."""
    if given := os.environ.get("SCENES"):
        return Path(given)
    subprocess.run(["cargo", "build", "--quiet", "--package", "scenes"], cwd=ROOT, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target")
    return target / "debug" / ("scenes.exe" if sys.platform == "win32" else "scenes")


@pytest.mark.long
def test_one_command_trains_a_world_from_nothing_in_chunks(renderer, tmp_path):
    folders = f"{ROOT / 'samples/worlds/miniature'}{os.pathsep}{ROOT / 'bindings/python'}"
    variables = {**os.environ, "PYTHONPATH": folders, "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    # The commands run the same networks; each is compiled once.
    variables |= {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "compiled"), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    command = [sys.executable, "-m", "miniature", "--preset", "smoke", "--folder", tmp_path, "--renderer", renderer]

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        ended = subprocess.run([*command, *arguments], env=variables, capture_output=True, text=True, encoding="utf-8", check=False)
        assert ended.returncode in (0, 3), ended.stdout + ended.stderr
        return ended

    first = run("--minutes", "0", "all")
    assert first.returncode == 3 and "step 1/" in first.stdout
    assert run("all").returncode == 0

    plan = PRESETS["smoke"]
    log = (tmp_path / "training.log").read_text(encoding="utf-8")
    assert f"step {plan.autoencoder.steps}/{plan.autoencoder.steps}" in log and f"step {plan.world.steps}/{plan.world.steps}" in log
    assert "held-out seed 41" in log and log.count("walk ") == plan.world.count
    assert read_geometry(tmp_path / "bundle") == SMOKE
    world = Rollout(tmp_path / "bundle", SMOKE)
    latents = [world.step(world.noise(np.random.default_rng(1))) for _ in range(3)]
    assert np.isfinite(latents).all()
    assert all(np.isfinite(value).all() for value in store.mean_parameters(tmp_path / "world.npz").values())

    # What it made is begun with anew, in another folder: the numbers are the bundle's.
    ended = run("--folder", tmp_path / "again", "--bundle", tmp_path / "bundle", "begin")
    assert ended.returncode == 0
    for state in ("world.npz", "autoencoder.npz"):
        before, after = (store.mean_parameters(folder / state) for folder in (tmp_path, tmp_path / "again"))
        assert before.keys() == after.keys()
        assert all(np.array_equal(before[name].astype(np.float16), after[name].astype(np.float16)) for name in before)
    refused = subprocess.run([*command, "begin"], env=variables, capture_output=True, text=True, encoding="utf-8", check=False)
    assert refused.returncode == 1 and "there already" in refused.stderr

    # Half way between two worlds: a checkpoint of the mean of their weights.
    def checkpoint(*options: str | Path) -> dict[str, np.ndarray]:
        assert run("--folder", tmp_path, *options, "checkpoint").returncode == 0
        return load_file(tmp_path / "checkpoint" / "model.safetensors")

    zeros = tmp_path / "zeros"
    shutil.copytree(tmp_path / "bundle", zeros)
    (zeros / "transformer.bin").write_bytes(bytes((zeros / "transformer.bin").stat().st_size))
    whole, half, same = checkpoint(), checkpoint("--share", "0.5", "--bundle", zeros), checkpoint("--share", "0.5", "--bundle", tmp_path / "bundle")
    assert whole.keys() == half.keys()
    for name, value in whole.items():
        exact = np.asarray(value, np.float32)
        assert np.allclose(np.asarray(half[name], np.float32), exact / 2, rtol=1e-2, atol=1e-6), name
        assert np.allclose(np.asarray(same[name], np.float32), exact, rtol=1e-2, atol=1e-6), name
