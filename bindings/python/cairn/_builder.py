"""The console command `cairn-build`, and a check for the packages that only the builder needs.

This is not a part of `cairn.build`, which cannot be imported without them.
"""

import importlib.util
import sys

# Import names; pip installs them through the package's extra `build`.
PACKAGES = {"onnx": "onnx>=1.16", "safetensors": "safetensors>=0.4.3", "yaml": "PyYAML>=6.0"}


def missing() -> dict[str, str]:
    """Those that are not installed."""
    return {name: package for name, package in PACKAGES.items() if importlib.util.find_spec(name) is None}


def message(packages: dict[str, str]) -> str:
    """Cause and remedy for a user who lacks `packages`."""
    return (
        f"cairn.build needs {', '.join(packages)}, which {'is' if len(packages) == 1 else 'are'} not installed: no other part of cairn does, "
        f"so that only its extra \"build\" brings them. Run: {sys.executable or 'python'} -m pip install "
        + " ".join(f'"{package}"' for package in packages.values())
    )


def require() -> None:
    """Raises ImportError with a remedy if one of them is missing."""
    if not (packages := missing()):
        return
    # sys.argv[0] is "-m" while Python looks for the module of -m: a command-line user gets a message, not a stack trace.
    if sys.argv[:1] == ["-m"]:
        sys.exit(message(packages))
    raise ImportError(message(packages), name=next(iter(packages)))


def main() -> int:
    """Runs the builder. Without its packages, ends with the message; the plain package installs the command, too."""
    if packages := missing():
        sys.exit(message(packages))
    from .build.cli import main as build

    return build()
