"""Measured rates: those in reports of `cairn-check` that users sent. Each is a `report.json` (docs/check.md).

The check `latents` steps the world inside the library in half floats at the preset `stock`, with passes run anew and with captured passes,
on a device that does nothing else. Software adapters, emulated ones and short runs say nothing about a GPU's rate and are not used.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from .errors import BuildError

# What the check runs: a test compares these with its source.
WORLD = "miniature"
PRESET = "stock"
SCHEMA = 1
# Figures with the milliseconds of a step, by what they measure.
STEPS = {"captured passes": "captured passes: a step, median", "passes run anew": "passes run anew: a step, median"}


@dataclass(frozen=True)
class Measured:
    """A measured rate."""

    file: str
    adapter: str  # as its driver names it
    driver: str
    memory: float  # GiB of the adapter's own
    rate: float  # latents per second, the faster of both ways to run passes
    passes: str  # which way that is


@dataclass(frozen=True)
class Reports:
    """A folder's measured rates, and why the other files have none."""

    measured: tuple[Measured, ...]
    unused: tuple[tuple[str, str], ...]  # file, reason


def read(folder: Path) -> Reports:
    """Reads the reports of a folder, by file name."""
    if not folder.is_dir():
        raise BuildError("it is no folder", field=str(folder), remedy="Name the folder of the reports: --reports hardware.")
    measured, unused = [], []
    for path in sorted(folder.glob("*.json")):
        try:
            found = _rate(path, json.loads(path.read_text(encoding="utf-8")))
        except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
            raise BuildError(
                f"it is no report of cairn-check: {type(error).__name__}: {error}",
                field=str(path),
                remedy="Remove it, or send report.json as cairn-check wrote it.",
            ) from error
        if isinstance(found, str):
            unused.append((path.name, found))
        else:
            measured.append(found)
    return Reports(tuple(measured), tuple(unused))


def _rate(path: Path, report: dict) -> Measured | str:
    """The rate in a report, or the reason why it has none."""
    if report["schema"] != SCHEMA:
        raise BuildError(
            f"its schema is {report['schema']}, and this program reads {SCHEMA}",
            field=str(path),
            remedy="Make it again with this repository's cairn-check.",
        )
    machine = report["machine"]
    if machine["judged"] is None:
        return "no adapter was judged"
    adapter = machine["adapters"][machine["judged"]]
    if machine["emulated"] or adapter["software"]:
        return "a processor may emulate the adapter"
    if report["quick"] or not report["optimised"]:
        return "a short run" if report["quick"] else "the program was compiled without optimisation"
    check = next((check for check in report["checks"] if check["name"] == "latents"), None)
    if check is None or check["verdict"] != "pass":
        return "its check `latents` did not pass"
    figures = {figure["name"]: figure["value"] for figure in check["figures"] if figure["unit"] == "ms"}
    passes, step = min(((how, figures[name]) for how, name in STEPS.items()), key=lambda pair: pair[1])
    if not step > 0:
        raise ValueError(f"a step takes {step} ms")
    return Measured(path.name, adapter["name"], adapter["driver"] or "-", adapter["memory"] / 2**30, 1e3 / step, passes)


def plain_name(name: str) -> str:
    """A GPU's name without its maker, marks and remarks: data sheets and drivers write them differently."""
    name = re.sub(r"\((R|TM|C)\)|[®™]", " ", name, flags=re.IGNORECASE)
    name = re.sub(r"\([^)]*\)", " ", name).lower()
    return " ".join(word for word in name.split() if word not in {"nvidia", "amd", "intel", "graphics", "gpu"})


def is_same(name: str, memory: float, shares_memory: bool, adapter: str, adapter_memory: float) -> bool:
    """Whether the `adapter` of a report, with `adapter_memory` in GiB, is the GPU of that name and memory.

    GPUs of one name with other memory are other GPUs: their bandwidth differs.
    """
    wanted = re.sub(r" \d+ gb$", "", plain_name(name))
    fits = shares_memory or abs(adapter_memory - memory) <= 0.2 * memory
    return plain_name(adapter) == wanted and fits
