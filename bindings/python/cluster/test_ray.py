"""A sweep with Ray, on an instance on this machine, compared with the same sweep by processes."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
import ray

from cairn import sweep

PLAN = """\
scenes = ["sword"]
seconds = 0.2
size = [128, 72]
lpips = false

[sweep]
window = [128, 384]
steps = [4]
"""


@pytest.fixture(scope="module")
def cluster():
    """Ray with two processors, in a folder with a short path, as its sockets need."""
    folder = tempfile.mkdtemp(prefix="ray-", dir="/tmp" if os.path.isdir("/tmp") else None)
    ray.init(num_cpus=2, include_dashboard=False, object_store_memory=80 << 20, log_to_driver=False, _temp_dir=folder)
    yield
    ray.shutdown()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(PLAN)
    return path


def numbers(out: Path) -> list[list[str]]:
    """Every rollout's line without the time that it took."""
    with open(out / "mine.csv", newline="") as lines:
        return [line[:-1] for line in csv.reader(lines)]


def written(out: Path) -> dict[str, int]:
    """The modification time of each file of the rollouts."""
    return {str(path): path.stat().st_mtime_ns for path in out.glob("sword-41/g*/**/*") if path.is_file()}


def kill_the_first_worker(plan: Path, out: Path) -> list[int]:
    """Kills, once and from another thread, the study that makes frames in `out`; appends its process to the list."""
    killed: list[int] = []

    def watch():
        until = time.monotonic() + 300
        while time.monotonic() < until:
            for frame in out.glob("sword-41/g*/frames/000001.png"):
                for process in Path("/proc").glob("[0-9]*"):
                    try:
                        words = (process / "cmdline").read_bytes().decode().split("\0")
                    except OSError:
                        continue
                    if str(plan) in words and "--only" in words and words[words.index("--only") + 1].endswith(frame.parents[1].name):
                        os.kill(int(process.name), signal.SIGKILL)
                        killed.append(int(process.name))
                        return
            time.sleep(0.002)

    threading.Thread(target=watch, daemon=True).start()
    return killed


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_a_cluster_makes_what_processes_make_even_where_one_is_killed(cluster, plan, tmp_path):
    through, here = tmp_path / "through", tmp_path / "here"
    killed, completed = kill_the_first_worker(plan, through), []
    text = sweep.run(plan, through, on_complete=lambda *so_far: completed.append(so_far))
    assert len(killed) == 1, "a study was killed while it made frames"
    assert text.startswith("# Sweep mine") and "2 of them kept" in " ".join(text.split()), text
    assert sorted(done for done, _, _ in completed) == [1, 2] and {of for _, of, _ in completed} == {2}

    subprocess.run([sweep.find_study(), "sweep", plan, "--out", here, "--quiet"], check=True, stdout=subprocess.DEVNULL)
    assert numbers(through) == numbers(here)

    # The same manifests: each run continues with the other's results, and nothing is made again.
    before, completed = written(here), []
    sweep.run(plan, here, on_complete=lambda *so_far: completed.append(so_far))
    assert written(here) == before and completed == []
    frame = next(iter(sorted(here.glob("sword-41/g384*/frames/000003.png"))))
    frame.unlink()
    sweep.run(plan, here, on_complete=lambda *so_far: completed.append(so_far))
    assert [name.split("/")[1][:4] for _, _, name in completed] == ["g384"]
    assert {path: time for path, time in written(here).items() if "g128" in path} == {
        path: time for path, time in before.items() if "g128" in path
    }
    assert numbers(through) == numbers(here)

    # A manifest of a newer version is rejected and kept.
    manifest = next(iter(here.glob("sword-41/g128*/manifest.json")))
    content = {**json.loads(manifest.read_text()), "manifest_version": 2}
    manifest.write_text(json.dumps(content))
    with pytest.raises(sweep.SweepError, match="version 2"):
        sweep.run(plan, here)
    assert json.loads(manifest.read_text()) == content


def test_what_fails_is_named_in_the_studys_words(cluster, plan, tmp_path):
    out = tmp_path / "out"
    own = sweep.Study(sweep.find_study(), plan, out)
    jobs, _ = own.jobs()
    # A file is where the rollout's folder should be.
    (out / jobs[0].name).write_text("in the way")
    with pytest.raises(sweep.SweepError, match=jobs[0].name):
        sweep.run(plan, out)
    (out / jobs[0].name).unlink()
    assert "# Sweep mine" in sweep.run(plan, out)
