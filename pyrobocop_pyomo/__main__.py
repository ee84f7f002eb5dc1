"""Command line: ``python -m pyrobocop_pyomo [doctor]``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from pyrobocop_pyomo.ipopt.doctor import report


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m pyrobocop_pyomo", description="The solvers of pyrobocop_pyomo.")
    commands = parser.add_subparsers(dest="command", metavar="command")
    commands.add_parser("doctor", help="show which backends to Ipopt work here, and how to get the others (default)")
    parser.parse_args(arguments)
    text, works = report()
    sys.stdout.write(text + "\n")
    return 0 if works else 1


if __name__ == "__main__":
    sys.exit(main())
