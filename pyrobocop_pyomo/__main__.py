"""Command line: ``python -m pyrobocop_pyomo [doctor | build-native]``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from pyrobocop_pyomo.ipopt.doctor import report
from pyrobocop_pyomo.native.shared_library import LIBRARIES, compile_library


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m pyrobocop_pyomo", description="The solvers of pyrobocop_pyomo.")
    commands = parser.add_subparsers(dest="command", metavar="command")
    commands.add_parser("doctor", help="show which backends to Ipopt work here, and how to get the others (default)")
    commands.add_parser("build-native", help="compile the C parts of this package, as its installation does")
    if parser.parse_args(arguments).command == "build-native":
        try:
            text, works = "\n".join(str(compile_library(name)) for name in LIBRARIES), True
        except OSError as error:
            sys.stderr.write(f"build-native: {error}\n")
            return 1
    else:
        text, works = report()
    sys.stdout.write(text + "\n")
    return 0 if works else 1


if __name__ == "__main__":
    sys.exit(main())
