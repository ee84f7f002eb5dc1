"""Where the time of one iteration goes: a cart-pole swing-up, by several ways of evaluating it.

    python benchmarks/iteration_costs.py [--quick] [--elements N ...] [--option NAME=VALUE ...] [--without WORD ...]

All ways make the same nonlinear program (``cart_pole_ways.py``) and are solved by the same Ipopt. Columns are CPU
milliseconds of one iteration, as Ipopt's own timing statistics have them: "linear algebra" is all of its linear
systems, "evaluation" the functions as Ipopt waits for them, callbacks included, "Ipopt" the rest of its algorithm.
"around" is what is left of the CPU seconds, from nothing to the checked answer, in all iterations together: stating,
building, handing over, checking. "ratio" is the total against the program written by hand. All take MUMPS but the last
one, which has the linear solver of this package. Options are Ipopt's, for every way: ``--option linear_solver=ma27``.
"""

from __future__ import annotations

import argparse
import gc
import os
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from cart_pole_ways import Measured, as_phase, by_hand_in_casadi
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.linear_solver import find_linear_solver
from pyrobocop_pyomo.native.shared_library import SWITCH_VARIABLE
from pyrobocop_pyomo.programs.summed_terms import evaluation_library

Options = dict[str, object]
BY_HAND = "CasADi by hand"
COLUMNS = [
    ("elements", ">8d"), ("way", "<27"), ("linear algebra", ">14.2f"), ("evaluation", ">10.2f"), ("Ipopt", ">6.2f"),
    ("around (s)", ">10.2f"), ("total (s)", ">9.2f"), ("ratio", ">5.2f"), ("iterations", ">10d"),
    ("objective", ">11.7f"),
]  # fmt: skip


def ways() -> dict[str, Callable[[int, Options], Measured]]:
    """What can be measured on this machine, what is written by hand first."""
    mumps: Options = {"linear_solver": "mumps"}
    chosen: dict[str, Callable[[int, Options], Measured]] = {BY_HAND: by_hand_in_casadi}
    if rcp.ipopt.Backend.IN_PROCESS_ASL in rcp.ipopt.available_backends():
        chosen["phase, ASL"] = lambda n, options: as_phase(n, "asl", options={**mumps, **options})
    chosen["phase, vectorised, CasADi"] = lambda n, options: _switched("off", n, {**mumps, **options})
    if evaluation_library() is not None:
        chosen["phase, vectorised, compiled"] = lambda n, options: _switched("on", n, {**mumps, **options})
        if find_linear_solver() is not None:
            own = {"linear_solver": "ldl"}
            chosen["the same, own linear solver"] = lambda n, options: _switched("on", n, {**options, **own})
    return chosen


def _switched(switch: str, elements: int, options: Options) -> Measured:
    before = os.environ.get(SWITCH_VARIABLE)
    os.environ[SWITCH_VARIABLE] = switch
    try:
        return as_phase(elements, "vectorised", options=options)
    finally:
        del os.environ[SWITCH_VARIABLE]
        if before is not None:
            os.environ[SWITCH_VARIABLE] = before


def cpu_seconds(log: str, name: str) -> float:
    """Of one line of Ipopt's timing statistics, over all runs in the log."""
    return sum(map(float, re.findall(rf"^ *{name}\.*: +([\d.]+)", log, re.MULTILINE)))


def measured(way: Callable[[int, Options], Measured], elements: int, options: Options) -> tuple[float, ...]:
    """Seconds of linear algebra, evaluation, the rest of Ipopt, all around; iterations and objective."""
    with tempfile.TemporaryDirectory() as folder:
        log_file = Path(folder) / "ipopt.log"
        statistics = {"output_file": str(log_file), "file_print_level": 5, "print_timing_statistics": "yes"}
        gc.collect()  # what the way before has left
        started = time.process_time()
        answer = way(elements, {**options, **statistics})
        total = time.process_time() - started
        log = log_file.read_text()
    inside = cpu_seconds(log, "OverallAlgorithm")
    evaluation = cpu_seconds(log, "Function Evaluations")
    algebra = cpu_seconds(log, "PDSystemSolverTotal")
    return algebra, evaluation, inside - algebra - evaluation, total - inside, answer.iterations, answer.objective


def main() -> None:
    """Print the table; exit with 1 when the objectives disagree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 elements")
    parser.add_argument("--elements", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--option", nargs="+", default=[], help="options of Ipopt, as NAME=VALUE")
    parser.add_argument("--without", nargs="+", default=[], help="words of ways to leave out, as ASL")
    arguments = parser.parse_args()
    options: Options = dict(option.split("=", 1) for option in arguments.option)
    table, objectives = Table(COLUMNS), []
    table.header()
    found = {name: way for name, way in ways().items() if not any(word in name for word in arguments.without)}
    for way in found.values():
        measured(way, 5, options)  # what is imported and loaded on first use
    for elements in [20] if arguments.quick else arguments.elements:
        by_hand = 0.0
        for name, way in found.items():
            show_progress(f"{name}, {elements} elements")
            *parts, iterations, objective = measured(way, elements, options)
            total = sum(parts)
            by_hand = total if name == BY_HAND else by_hand
            each = [1e3 * part / iterations for part in parts[:3]]
            table.add(elements, name, *each, parts[3], total, total / by_hand, int(iterations), objective)
            objectives.append((elements, objective))
    for elements in {elements for elements, _ in objectives}:
        values = [objective for n, objective in objectives if n == elements]
        if max(values) - min(values) > 1e-6 * abs(values[0]):
            raise SystemExit(f"{elements} elements: the objectives disagree: {values}")


if __name__ == "__main__":
    main()
