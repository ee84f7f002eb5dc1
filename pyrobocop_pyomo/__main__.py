"""Command line: ``python -m pyrobocop_pyomo [doctor | build-native | build-asl]``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.ipopt.build_asl import build_asl
from pyrobocop_pyomo.ipopt.doctor import report
from pyrobocop_pyomo.native.shared_library import LIBRARIES, compile_library


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m pyrobocop_pyomo", description="The solvers of pyrobocop_pyomo.")
    commands = parser.add_subparsers(dest="command", metavar="command")
    commands.add_parser("doctor", help="show which backends to Ipopt work here, and how to get the others (default)")
    build = commands.add_parser(
        "build-asl", help="build the ipopt executable and PyNumero's ASL library (Debian, Ubuntu)"
    )
    build.add_argument("--prefix", default=sys.prefix, help="install into PREFIX/bin and PREFIX/lib (%(default)s)")
    build.add_argument("--force", action="store_true", help="build also what is there and works")
    commands.add_parser("build-native", help="compile the C parts of this package, as its installation does")
    options = parser.parse_args(arguments)
    if options.command == "build-native":
        try:
            for name in LIBRARIES:
                _say(str(compile_library(name)))
        except OSError as error:
            sys.stderr.write(f"build-native: {error}\n")
            return 1
        return 0
    if options.command == "build-asl":
        try:
            build_asl(options.prefix, force=options.force, report=_say)
        except PyRobocopError as error:
            sys.stderr.write(f"build-asl: {error}\n")
            return 1
        return 0
    text, works = report()
    _say(text)
    return 0 if works else 1


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
