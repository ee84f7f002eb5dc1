"""Command line: ``python -m pyrobocop_pyomo [doctor | build-native | build-asl | solve]``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.ipopt.build_asl import build_asl
from pyrobocop_pyomo.ipopt.build_native import build_native
from pyrobocop_pyomo.ipopt.doctor import pyomo_warnings_off, report
from pyrobocop_pyomo.studies import solve_files


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
    native = commands.add_parser(
        "build-native", help="compile the C parts of this package now, with any C compiler, not when first used"
    )
    native.add_argument("--force", action="store_true", help="compile also what is there")
    native.add_argument("--beside", action="store_true", help="put them beside their sources, for a wheel")
    solve = commands.add_parser("solve", help="solve problems in .nl and .json files, and print a table")
    solve.add_argument("paths", nargs="+", metavar="PATH", help="files, and folders with such files")
    solve.add_argument("--workers", default="1", help="number of processes, or 'all' cores (%(default)s)")
    solve.add_argument("--time-limit", type=float, metavar="SECONDS", help="for each file")
    solve.add_argument(
        "--results", default="results.jsonl", metavar="FILE", help="where results are kept as they come (%(default)s)"
    )
    solve.add_argument("--again", action="store_true", help="solve also what has a result there")
    options = parser.parse_args(arguments)
    if options.command == "solve":
        return _solve(options)
    if options.command == "build-native":
        try:
            build_native(force=options.force, beside=options.beside, report=_say)
        except PyRobocopError as error:
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
    with pyomo_warnings_off():
        text, works = report()
    _say(text)
    return 0 if works else 1


def _solve(options: argparse.Namespace) -> int:
    workers = int(options.workers) if options.workers.isdecimal() else options.workers
    try:
        result = solve_files(
            options.paths, workers=workers, time_limit_per_file=options.time_limit, file=options.results,
            again=options.again,
        )  # fmt: skip
    except PyRobocopError as error:
        sys.stderr.write(f"solve: {error}\n")
        return 1
    _say(str(result))
    return 0 if result.reached else 1


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
