"""Contact planned from zero: eight tasks of contact-implicit planning, by this package and by other ways.

    python benchmarks/contact_from_nothing.py [--quick] [--tasks WORD ...] [--methods WORD ...] [--cases N]
                                              [--time-limit SECONDS] [--results FILE]

Tasks are those of ``benchmarks/contact_tasks.py`` and ``benchmarks/manipulation_tasks.py``. The point that a method
leaves on the model is checked from the statement of the model by code that no method shares
(``tests/mpcc_catalogue/point_check.py``). Shown are

strict      cases whose rows hold to 1e-6 and whose pairs to 1e-6, by the smaller side
certified   cases whose certificate is PROVEN: no branch through the point has a direction of descent
claimed     cases that the method says it has solved
end         median distance from the goal at the end; a goal is a cost here, so that it is not zero
pairs       largest natural residual over the strict cases
cost        median objective over its lowest by any method in the same case, of strict cases
iterations  of Ipopt, median
CPU         seconds, median and worst

Results are added to ``--results``, one line of JSON each; what is there already is not computed again.
"""

from __future__ import annotations

import argparse
import json
import logging
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi
import pyomo.environ as pyo
from contact_tasks import TASKS, Task
from manipulation_tasks import MANIPULATION
from mpcc_ways import Effort, cold_continuation, ipopt, stock_solver, stock_transformation
from pyomo.repn.plugins.nl_writer import NLWriter
from table import Table, show_progress

import pyrobocop_pyomo as rcp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from mpcc_catalogue.point_check import check_point

DEFAULT = "rcp.solve"
ALL_TASKS = (*TASKS, *MANIPULATION)


def products(model: Any, backend: str, limit: float) -> Effort:
    """Ipopt on the direct form: each product bounded by 1e-8."""
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(model, delta=1e-8, lift=False)
    return ipopt(model, backend, limit)


def casadi_sqp(model: Any, backend: str, limit: float) -> Effort:
    """CasADi's own SQP method with OSQP, on products bounded by 1e-8; it knows no limit of time."""
    pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(model, delta=1e-8, lift=False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.nl"
        with path.open("w", encoding="utf-8") as file:
            written = NLWriter().write(
                model, file, linear_presolve=False, scale_model=False, export_defined_variables=False
            )
        builder = casadi.NlpBuilder()
        builder.import_nl(str(path), {})
    functions = casadi.Function("read", [casadi.veccat(*builder.x)], [casadi.MX(builder.f), casadi.veccat(*builder.g)])
    x = casadi.SX.sym("x", len(builder.x))
    f, g = functions.expand()(x)
    quiet = {"print_header": False, "print_iteration": False, "print_time": False, "print_status": False}
    loose = {"error_on_fail": False, "osqp": {"verbose": False, "eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 10_000}}
    options = {
        "qpsol": "osqp",
        "qpsol_options": loose,
        "max_iter": 100,
        "convexify_strategy": "regularize",
        "error_on_fail": False,
        **quiet,
    }
    solver = casadi.nlpsol("sqp", "sqpmethod", {"x": x, "f": f, "g": g}, options)
    found = solver(x0=builder.x_init, lbx=builder.x_lb, ubx=builder.x_ub, lbg=builder.g_lb, ubg=builder.g_ub)
    for variable, number in zip(written.variables, found["x"].full().ravel(), strict=True):
        variable.set_value(float(number), skip_validation=True)
    said = solver.stats()
    return Effort(bool(said["success"]), int(said["iter_count"]))


METHODS: dict[str, Callable[[Any, str, float], Effort] | None] = {
    DEFAULT: None,
    "Ipopt, products below 1e-8": products,
    "Pyomo mpec.simple_nonlinear": stock_transformation,
    "Pyomo mpec_nlp, 1 to 1e-7": stock_solver,
    "CasADi sqpmethod with OSQP": casadi_sqp,
    "cold continuation, 1 to 1e-8": cold_continuation,
}


def run(task: Task, case: int, method: str, limit: float) -> dict[str, Any]:
    """One case by one method; an exception is an answer without a point."""
    model = task.build(case)
    checked, way = model.clone(), METHODS[method]
    started = time.process_time()
    certified, effort = False, Effort(False, 0)
    try:
        if way is None:
            result = rcp.solve(model, time_limit=limit, progress=False)
            effort = Effort(result.solved, result.iterations)
            certified = result.certificate is rcp.Certificate.PROVEN
        else:
            effort = way(model, "vectorised", limit)
    except Exception as error:  # whatever a method raises counts against it, and the next case is tried
        logging.getLogger(__name__).info("%s, %s: %s", model.name, method, error)
    seconds = time.process_time() - started
    for variable in checked.component_data_objects(pyo.Var):
        variable.set_value(model.find_component(variable).value, skip_validation=True)
    point = check_point(checked)
    return {
        "task": task.name, "case": case, "method": method, "strict": point.violation <= 1e-6 >= point.natural,
        "certified": certified, "claimed": effort.claims, "error": task.error(checked), "natural": point.natural,
        "objective": point.objective, "iterations": effort.iterations, "cpu": seconds,
    }  # fmt: skip


def results_of(given: argparse.Namespace, tasks: list[Task], cases: int) -> list[dict[str, Any]]:
    """Of all runs, those of the file included."""
    path = given.results
    known = [json.loads(line) for line in path.read_text().splitlines()] if path and path.exists() else []
    done = {(r["task"], r["case"], r["method"]): r for r in known}
    methods = [method for method in METHODS if any(word in method for word in given.methods)]
    wanted = [(task, case, method) for task in tasks for case in range(cases) for method in methods]
    for number, (task, case, method) in enumerate(wanted, start=1):
        key = (task.name, case, method)
        if key not in done:
            show_progress(f"{number} of {len(wanted)}: {task.name} {case}, {method}")
            done[key] = run(task, case, method, given.time_limit)
            if path:
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(done[key]) + "\n")
    show_progress("")
    return [done[task.name, case, method] for task, case, method in wanted]


def row(task: str, method: str, runs: list[dict[str, Any]], best: dict[Any, float]) -> tuple[Any, ...]:
    """One line of the table."""
    strict = [r for r in runs if r["strict"]]
    ratios = [r["objective"] / best[r["task"], r["case"]] for r in strict]
    return (
        task,
        method,
        len(runs),
        len(strict),
        sum(r["certified"] for r in runs) if method == DEFAULT else None,
        sum(r["claimed"] for r in runs),
        statistics.median(r["error"] for r in strict) if strict else None,
        max((r["natural"] for r in strict), default=None),
        statistics.median(ratios) if ratios else None,
        int(statistics.median(r["iterations"] for r in runs)),
        statistics.median(r["cpu"] for r in runs),
        max(r["cpu"] for r in runs),
    )


def main() -> None:
    """Read the arguments, run, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one case of two tasks, by two methods")
    parser.add_argument("--tasks", nargs="+", default=[""], metavar="WORD")
    parser.add_argument("--methods", nargs="+", default=[""], metavar="WORD")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds per case and method")
    parser.add_argument("--results", type=Path)
    given = parser.parse_args()
    logging.getLogger("pyomo").setLevel(logging.CRITICAL)  # what a method says about a point is in the table
    tasks, cases = [task for task in ALL_TASKS if any(word in task.name for word in given.tasks)], given.cases
    if given.quick:
        tasks, cases, given.methods = (
            [task for task in ALL_TASKS if task.name in ("push box", "cart-pole")],
            1,
            [DEFAULT, "below"],
        )
    results = results_of(given, tasks, cases)
    best: dict[Any, float] = {}
    for r in results:
        if r["strict"]:
            key = r["task"], r["case"]
            best[key] = min(best.get(key, r["objective"]), r["objective"])
    table = Table(
        [
            ("task", "<9s"), ("method", "<29s"), ("cases", ">5d"), ("strict", ">6d"), ("certified", ">9d"),
            ("claimed", ">7d"), ("end", ">8.1e"), ("pairs", ">8.1e"), ("cost", ">6.3f"), ("iterations", ">10d"),
            ("CPU", ">6.1f"), ("worst", ">6.1f"),
        ]
    )  # fmt: skip
    table.header()
    for task in tasks:
        for method in METHODS:
            runs = [r for r in results if r["task"] == task.name and r["method"] == method]
            if runs:
                table.add(*row(task.name, method, runs, best))


if __name__ == "__main__":
    main()
