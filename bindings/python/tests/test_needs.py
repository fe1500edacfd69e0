"""The builder without the packages that only it needs."""

import os
import subprocess
import sys
import tomllib

from conftest import ROOT

from cairn import _builder

PACKAGE = ROOT / "bindings" / "python"


def without(tmp_path, missing, *arguments):
    """Python with arguments, as if packages were not installed."""
    hidden = "".join(f"sys.modules[{name!r}] = None\n" for name in missing)
    (tmp_path / "sitecustomize.py").write_text(f"import sys\n{hidden}")
    paths = os.pathsep.join([str(tmp_path), str(PACKAGE)])
    return subprocess.run([sys.executable, *arguments], env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=False)


def test_the_packages_match_the_extra():
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    assert list(_builder.PACKAGES.values()) == project["optional-dependencies"]["build"]
    assert not any(package in project["dependencies"] for package in _builder.PACKAGES.values())


def test_the_error_names_what_to_install(tmp_path):
    done = without(tmp_path, ["yaml"], "-c", "from cairn.build import build_bundle")
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 1 and last.startswith("ImportError: cairn.build needs yaml, which is not installed")
    assert last.endswith(f'Run: {sys.executable} -m pip install "PyYAML>=6.0"')


def test_a_command_prints_only_the_error(tmp_path):
    done = without(tmp_path, ["onnx", "safetensors"], "-m", "cairn.build", "--help")
    assert done.returncode == 1 and done.stdout == "" and "Traceback" not in done.stderr
    assert done.stderr.strip().endswith('-m pip install "onnx>=1.16" "safetensors>=0.4.3"')


def script(name):
    """The program that pip writes for a console command of the package."""
    module, function = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]["scripts"][name].split(":")
    return f"import sys; sys.argv = [{name!r}, '--help']; from {module} import {function}; sys.exit({function}())"


def test_the_console_command_prints_only_the_error(tmp_path):
    done = without(tmp_path, ["yaml"], "-c", script("cairn-build"))
    assert done.returncode == 1 and done.stdout == "" and "Traceback" not in done.stderr
    assert done.stderr.startswith("cairn.build needs yaml, which is not installed") and done.stderr.strip().endswith('"PyYAML>=6.0"')


def test_the_console_command_runs_the_builder(tmp_path):
    done = without(tmp_path, [], "-c", script("cairn-build"))
    assert (done.returncode, done.stderr) == (0, "") and "Makes world bundles for Cairn" in done.stdout


def test_nothing_else_needs_them(tmp_path):
    done = without(tmp_path, _builder.PACKAGES, "-c", "import cairn, cairn.doctor, cairn.sweep, cairn.film; print('fine')")
    assert (done.returncode, done.stdout) == (0, "fine\n"), done.stderr
