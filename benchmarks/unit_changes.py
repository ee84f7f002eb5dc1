"""What a change of units changes: iterations and answers in metres, seconds, radians and in feet, hours, degrees.

    python benchmarks/unit_changes.py [--quick] [--only NAME ...] [--scaling on | off]

Each problem of ``benchmarks/restated_problems.py`` is solved with defaults in five systems of units. Shown are the
iterations, their largest change relative to those in base units, and the largest relative change of the objective. A
problem counts where iterations change by at most 30 % and the answer by less than 1e-6. The exit code is 0 if at least
ten do.
"""

from __future__ import annotations

import argparse
import sys

import restated_problems
from table import Table, show_progress

import pyrobocop_pyomo as rcp

MOST_ITERATIONS, MOST_OF_ANSWER, ENOUGH = 0.3, 1e-6, 10
QUICK = ("moon_landing", "zermelo")
COLUMNS = [
    ("problem", "<20"),
    *((name, ">10d") for name in restated_problems.UNITS),
    ("iterations", ">10.0%"),
    ("answer", ">8.0e"),
    ("within", "<6"),
]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [build.__name__ for build in restated_problems.PROBLEMS]
    parser.add_argument("--quick", action="store_true", help="two problems")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help="some of the problems")
    parser.add_argument("--unscaled", action="store_true", help="with Ipopt's own scaling instead")
    arguments = parser.parse_args()
    options = {"nlp_scaling_method": "gradient-based"} if arguments.unscaled else {}
    table, good = Table(COLUMNS), 0
    table.header()
    for build in restated_problems.PROBLEMS:
        if build.__name__ not in (arguments.only or (QUICK if arguments.quick else names)):
            continue
        iterations: list[int | None] = []
        values: list[float] = []
        for label, units in restated_problems.UNITS.items():
            show_progress(f"{build.__name__} in {label}")
            model, dimension = build(units)
            result = rcp.solve(model, options=options)
            iterations.append(result.iterations if result.solved else None)
            values.append(restated_problems.value_of(model, units, dimension))
        show_progress("")
        counts = [count for count in iterations if count is not None]
        if len(counts) < len(iterations):
            table.add(build.__name__, *iterations, None, None, "failed")
            continue
        change = max(abs(count / counts[0] - 1) for count in counts)
        moved = max(abs(value / values[0] - 1) for value in values)
        within = change <= MOST_ITERATIONS and moved < MOST_OF_ANSWER
        good += within
        table.add(build.__name__, *counts, change, moved, "yes" if within else "no")
    print(f"\n{good} of {len(table.rows)} change little")
    sys.exit(0 if good >= min(ENOUGH, len(table.rows)) else 1)


if __name__ == "__main__":
    main()
