"""Checks for the packages that only the builder needs."""

import importlib.util
import sys

# Import names; pip installs them through the package's extra `build`.
PACKAGES = {"onnx": "onnx>=1.16", "safetensors": "safetensors>=0.4.3", "yaml": "PyYAML>=6.0"}


def require() -> None:
    """Raises ImportError with a remedy if one of them is missing."""
    missing = {name: package for name, package in PACKAGES.items() if importlib.util.find_spec(name) is None}
    if not missing:
        return
    message = (
        f"cairn.build needs {', '.join(missing)}, which {'is' if len(missing) == 1 else 'are'} not installed: no other part of cairn does, "
        f"so that only its extra \"build\" brings them. Run: {sys.executable or 'python'} -m pip install "
        + " ".join(f'"{package}"' for package in missing.values())
    )
    # sys.argv[0] is "-m" while Python looks for the module of -m: a command-line user gets a message, not a stack trace.
    if sys.argv[:1] == ["-m"]:
        sys.exit(message)
    raise ImportError(message, name=next(iter(missing)))
