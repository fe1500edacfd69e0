"""The command line of the package: `python -m cairn`."""

from __future__ import annotations

import argparse
import sys

from . import doctor

HELP = """\
Cairn from the command line.

  python -m cairn doctor                 whether Cairn works here, and what to do where it does not
  python -m cairn doctor --world PATH    the same, with a world of your own; --half: is float16 enough for it?
  python -m cairn.build --help           makes world bundles
"""


def parser() -> argparse.ArgumentParser:
    """The parser of all commands and their options."""
    top = argparse.ArgumentParser(
        prog="python -m cairn", description=HELP, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    check = commands.add_parser(
        "doctor",
        help="whether Cairn works here",
        description="Checks Python, the library, ONNX Runtime, the device and a world, and makes one step. "
        "Prints each finding and, for a failure, the reason and the remedy. Exits with 1 if anything failed.",
    )
    check.add_argument("--world", metavar="PATH", help="load this bundle instead of the world inside the library")
    check.add_argument("--onnxruntime", metavar="FILE", help="the library file of ONNX Runtime; else it is looked for")
    check.add_argument("--half", action="store_true", help="check as well that float16 is enough for the world")
    check.add_argument("--verbose", action="store_true", help="explain every line")
    return top


def main(arguments: list[str] | None = None) -> int:
    """Runs a command and returns its exit status."""
    given = parser().parse_args(arguments)
    return 0 if doctor.run(given.world, given.onnxruntime, verbose=given.verbose, half=given.half) else 1


if __name__ == "__main__":
    sys.exit(main())
