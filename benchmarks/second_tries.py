"""How often one run is enough without a good start, and which strategies solve what it leaves.

    python benchmarks/second_tries.py [--quick] [--only NAME ...]

Published problems of optimal control with one phase (``textbook_problems``), on 16 elements, each from zeros and from
two random starts, moved into the bounds: one run of at most 1000 iterations. Where it gives no solution, each strategy
is tried alone, with at most 500 iterations. What counts as solved is optimal by the residuals of `solve`.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np
import pyomo.environ as pyo
from table import Table, show_progress
from textbook_problems import PROBLEMS

import pyrobocop_pyomo as rcp

STRATEGIES = ("own units", "simulated", "elastic rows", "straight lines")
STARTS = ("zeros", "random 1", "random 2")
ELEMENTS = 16
FIRST, LATER = 1000, 500  # iterations at most
QUICK = ("bryson_denham", "stirred_tank")


def put_start(m: pyo.ConcreteModel, start: str) -> None:
    """Zeros, or numbers around the values of the guess, as large as these; within the bounds."""
    random = np.random.default_rng(int(start[-1])) if start != "zeros" else None
    for variable in m.component_data_objects(pyo.Var):
        if variable.fixed:
            continue
        guess = variable.value or 0.0
        value = 0.0 if random is None else guess + max(1.0, abs(guess)) * random.uniform(-1.0, 1.0)
        lower, upper = variable.bounds
        value = value if lower is None else max(value, lower)
        variable.set_value(value if upper is None else min(value, upper))


def solved(m: pyo.ConcreteModel, strategy: str, iterations: int) -> bool:
    """Whether a strategy alone leads to an optimal point."""
    try:
        result = rcp.solve(m, strategies=strategy, options={"max_iter": iterations}, progress=False)
    except rcp.errors.PyRobocopError:
        return False
    return result.solved


def main() -> None:
    """Print the table."""
    names = [problem.name for problem in PROBLEMS if not problem.phases]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two problems on 8 elements")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME")
    arguments = parser.parse_args()
    chosen = arguments.only or (QUICK if arguments.quick else names)
    counts, at_once, tried = Counter[str](), 0, 0
    table = Table([("left by one run", "<34s"), *((name, f">{len(name)}s") for name in STRATEGIES)])
    table.header()
    for problem in PROBLEMS:
        if problem.name not in chosen:
            continue
        for start in STARTS:
            show_progress(f"{problem.name}, {start}")

            def started(problem=problem, start=start) -> pyo.ConcreteModel:
                m = problem.build(elements=8 if arguments.quick else ELEMENTS)
                put_start(m, start)
                return m

            tried += 1
            if solved(started(), "solve", FIRST):
                at_once += 1
                continue
            found = [name for name in STRATEGIES if solved(started(), name, LATER)]
            counts.update(found)
            table.add(f"{problem.name}, {start}", *("yes" if name in found else "-" for name in STRATEGIES))
    table.add("solved", *(str(counts[name]) for name in STRATEGIES))
    print(f"\n{at_once} of {tried} starts are solved by one run")


if __name__ == "__main__":
    main()
