"""What polish, certificate and exploration cost beside the solve that they follow, in CPU seconds of one process.

    python benchmarks/certificate_costs.py [--quick] [--problems WORD ...] [--nonsmooth] [--elements N]

On the catalogue of problems with known answers; with ``--nonsmooth`` on the nonsmooth collection too, N elements each.

solve    runs of Ipopt in the strategies: what the rest follows
polish   runs of Ipopt in branches, exploration left out
linear   linear programs of the certificate and of the multipliers
explore  everything of the exploration
ratio    (polish + linear) / solve
all      (polish + linear + explore) / solve
"""

from __future__ import annotations

import argparse
import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from known_mpccs import mpcc_problems
from nonsmooth_problems import PROBLEMS
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.mpcc import active_set
from pyrobocop_pyomo.solving import in_process_session, polish

PARTS = ("solve", "polish", "linear", "explore")
QUICK = ("ralph1", "kth1", "planted qpec 2x4")


@contextlib.contextmanager
def metered() -> Iterator[Counter[str]]:
    """Context in which CPU seconds are counted by part; what the exploration calls counts as exploration."""
    seconds: Counter[str] = Counter()
    exploring = [False]

    def watched(function: Callable[..., Any], part: str) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            if exploring[0]:
                return function(*arguments, **options)
            started, exploring[0] = time.process_time(), part == "explore"
            try:
                return function(*arguments, **options)
            finally:
                exploring[0] = False
                seconds[part] += time.process_time() - started

        return call

    parts = [
        (in_process_session, "run_ipopt", "solve"),
        (polish, "run_ipopt", "polish"),
        (active_set, "steepest_branch", "linear"),
        (polish, "classify", "linear"),
        (polish.Polish, "explore", "explore"),
    ]
    with contextlib.ExitStack() as stack:
        for owner, name, part in parts:
            function = getattr(owner, name)
            setattr(owner, name, watched(function, part))
            stack.callback(setattr, owner, name, function)
        yield seconds


def problems(arguments: argparse.Namespace) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Names, and functions that build."""
    words = QUICK if arguments.quick else arguments.problems
    for problem in mpcc_problems():
        if words is None or any(problem.name == word if arguments.quick else word in problem.name for word in words):
            yield problem.name, problem.build
    if arguments.nonsmooth:
        for name, collected in PROBLEMS.items():
            yield name, partial(collected.build, arguments.elements)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three problems")
    parser.add_argument("--problems", nargs="+", metavar="WORD", help="those of the catalogue with it in their name")
    parser.add_argument("--nonsmooth", action="store_true")
    parser.add_argument("--elements", type=int, default=20)
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds per solve")
    arguments = parser.parse_args()
    seconds = ">8.3f"
    table = Table(
        [
            ("problem", "<32s"),
            *((part, seconds) for part in PARTS),
            ("ratio", ">7.2f"),
            ("all", ">7.2f"),
            ("certificate", "<11s"),
        ]
    )
    rcp.solve(next(iter(mpcc_problems())).build(), progress=False)  # imports and libraries are nobody's
    table.header()
    totals: Counter[str] = Counter()
    for name, build in problems(arguments):
        show_progress(name)
        model = build()
        with metered() as spent:
            result = rcp.solve(model, progress=False, time_limit=arguments.time_limit)
        show_progress("")
        totals.update(spent)
        table.add(name[:32], *numbers(spent), result.certificate.name.lower())
    table.add("all together", *numbers(totals), "")
    dearer = sum(float(row[5]) > 1.0 for row in table.rows[:-1])
    print(f"\npolish and certificate cost more than the solve in {dearer} of {len(table.rows) - 1} problems")


def numbers(spent: Counter[str]) -> tuple[float, ...]:
    """The cells of a row."""
    after = spent["polish"] + spent["linear"]
    solve = max(spent["solve"], 1e-6)
    return (*(spent[part] for part in PARTS), after / solve, (after + spent["explore"]) / solve)


if __name__ == "__main__":
    main()
