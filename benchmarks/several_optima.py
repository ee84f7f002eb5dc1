"""What the look for better optima by default finds and costs, where problems have several.

    python benchmarks/several_optima.py [--quick] [--only NAME ...]

Twenty-one problems of optimal control (``several_optima_problems.py``) from guesses most of which lead to the worse
optima, each solved without exploration and with defaults. The best value is published, or the best that many random
starts have found on the same mesh. Shown are both objectives, iterations of all runs of Ipopt together, and CPU
seconds.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from several_optima_problems import PROBLEMS, SeveralOptima
from table import Table, show_progress

import pyrobocop_pyomo as rcp

COLUMNS = [
    ("problem", "<22s"), ("best", ">11.6g"), ("first", ">11.6g"), ("iterations", ">10d"), ("CPU s", ">6.2f"),
    ("default", ">11.6g"), ("iterations", ">10d"), ("CPU s", ">6.2f"), ("strategy", "<20s"), ("verdict", "<10s"),
]  # fmt: skip
QUICK = ("wrong_side", "mountain_car")
CLOSE = 2e-3  # relative


def solved(problem: SeveralOptima, **options: Any) -> tuple[rcp.SolveResult, float]:
    """The result and its CPU seconds."""
    m = problem.build()
    started = time.process_time()
    result = rcp.solve(m, progress=False, **options)
    return result, time.process_time() - started


def is_best(problem: SeveralOptima, result: rcp.SolveResult) -> bool:
    """Whether a result is optimal and no worse than the best value."""
    return result.solved and abs(result.objective - problem.best) <= CLOSE * abs(problem.best)


def main() -> None:
    """Print the table."""
    names = [problem.name for problem in PROBLEMS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two problems")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME")
    arguments = parser.parse_args()
    chosen = arguments.only or (QUICK if arguments.quick else names)
    # What is loaded at the first use.
    rcp.solve(PROBLEMS[0].build(), progress=False, strategies=rcp.Strategy(exploration=0))
    table, before, after, seconds = Table(COLUMNS), 0, 0, [0.0, 0.0]
    table.header()
    for problem in PROBLEMS:
        if problem.name not in chosen:
            continue
        show_progress(problem.name)
        first, spent_first = solved(problem, strategies=rcp.Strategy(exploration=0))
        default, spent = solved(problem)
        show_progress("")
        before, after = before + is_best(problem, first), after + is_best(problem, default)
        seconds = [seconds[0] + spent_first, seconds[1] + spent]
        verdict = "best" if is_best(problem, default) else "worse" if default.solved else "not solved"
        table.add(
            problem.name, problem.best, first.objective, first.iterations, spent_first, default.objective,
            default.iterations, spent, default.strategy, verdict,
        )  # fmt: skip
    print(f"\nbest: {before} without, {after} with, of {len(chosen)}; CPU s {seconds[0]:.1f}, {seconds[1]:.1f}")


if __name__ == "__main__":
    main()
