"""The module that runs sweeps on a cluster, without a cluster: its calls of the study, and how it uses the results."""

import json
import stat
import sys
import types

import pytest

from cairn import sweep

STAND_IN = """#!{python}
import json, os, sys
arguments = sys.argv[1:]
with open({log!r}, "a") as log:
    log.write(json.dumps(arguments) + "\\n")
{act}
"""


@pytest.fixture
def study(tmp_path):
    """A study of which only `act` exists."""

    def make(act: str) -> sweep.Study:
        program = tmp_path / "study"
        program.write_text(STAND_IN.format(python=sys.executable, log=str(tmp_path / "log"), act=act))
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        return sweep.Study(program, tmp_path / "mine.toml", tmp_path / "out")

    return make


def listed(version=sweep.LIST_VERSION):
    job = {"name": "sword-41/g128", "scene": "sword", "place": 41, "operating_point": "g128", "frames": 7, "whole": True}
    return {"list_version": version, "out": "out", "threads": 2, "jobs": [job]}


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as end:
        sweep.main(["--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    for word in ("examples:", "--address auto", "--study", "complete jobs are not repeated", "CAIRN_STUDY"):
        assert word in text


def test_jobs_are_what_the_study_lists(study, tmp_path):
    own = study(f"print({json.dumps(listed())!r})")
    jobs, threads = own.jobs()
    assert threads == 2 and jobs == [sweep.Job("sword-41/g128", "sword", 41, "g128", 7, True)]
    own.make("sword-41/g128")
    common = ["sweep", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "out"), "--quiet"]
    calls = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    assert calls == [[*common, "--list-jobs"], [*common, "--only", "sword-41/g128"]]


def test_a_list_of_another_version_is_refused(study):
    with pytest.raises(sweep.SweepError, match="version 2"):
        study(f"print({json.dumps(listed(2))!r})").jobs()


def test_the_studys_message_is_raised(study, capsys, tmp_path, monkeypatch):
    own = study("sys.exit('error: mine.toml: scenes: there is no scene')")
    with pytest.raises(sweep.SweepError, match="there is no scene") as failed:
        own.make("sword-41/g128")
    assert not isinstance(failed.value, sweep.Killed)
    # It fails before Ray is used.
    monkeypatch.setitem(sys.modules, "ray", types.ModuleType("ray"))
    assert sweep.main([str(tmp_path / "mine.toml"), "--study", str(own.program)]) == 1
    assert capsys.readouterr().err == "error: mine.toml: scenes: there is no scene\n"


def test_a_killed_study_differs_from_a_failed_one(study):
    with pytest.raises(sweep.Killed, match="signal 9"):
        study("os.kill(os.getpid(), 9)").make("sword-41/g128")
    # A shell or a container in between.
    with pytest.raises(sweep.Killed, match="signal 9"):
        study("sys.exit(137)").make("sword-41/g128")
    for status in (1, 2, 128, 193):
        with pytest.raises(sweep.SweepError) as failed:
            study(f"sys.exit({status})").make("sword-41/g128")
        assert not isinstance(failed.value, sweep.Killed)


def test_nothing_else_needs_ray(monkeypatch, capsys, study, tmp_path):
    monkeypatch.setitem(sys.modules, "ray", None)
    own = study("")
    assert sweep.main([str(tmp_path / "mine.toml"), "--study", str(own.program)]) == 1
    assert 'pip install "cairn[cluster]"' in capsys.readouterr().err
    assert not (tmp_path / "log").exists(), "the study was not called"


def test_a_missing_study_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("CAIRN_STUDY", str(tmp_path / "nowhere"))
    with pytest.raises(sweep.SweepError, match="nowhere.*cargo build"):
        sweep.find_study()
    monkeypatch.delenv("CAIRN_STUDY")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(sweep.SweepError, match="--study"):
        sweep.find_study()
