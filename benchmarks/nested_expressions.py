"""Named Expressions that use each other, in an AMPL Solver Library: are derivatives right, and what do they cost?

    python benchmarks/nested_expressions.py [--quick] [--library FILE] [--models N]

The first table: of random models with nested Expressions, as Pyomo writes them (defined variables) and with the
Expressions written out, how many have a derivative that differs from finite differences. The second: what reading and
evaluating costs, in CPU milliseconds, the least of seven runs. FILE is a library of PyNumero; by default the one
that is found. What build-asl installs writes defined variables out itself.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
from pyomo.contrib.pynumero.asl import AmplInterface
from table import Table, show_progress

from pyrobocop_pyomo.ipopt.asl_derivatives import differ_from_differences
from pyrobocop_pyomo.ipopt.nested_models import nested_model
from pyrobocop_pyomo.programs.asl_program import AslProgram, find_asl_library

RUNS = 7


def chains(times: int, joints: int) -> pyo.ConcreteModel:
    """Planar chains of joints: angles and positions are Expressions, each made of the one before."""
    model = pyo.ConcreteModel()
    points, links = range(times), range(joints)
    model.q = pyo.Var(points, links, initialize=lambda _, t, j: 0.1 * j + 0.01 * t / times)
    model.w = pyo.Var(points, links, initialize=0.3)
    model.angle, model.x, model.y = (pyo.Expression(points, links) for _ in range(3))
    model.rows = pyo.ConstraintList()
    for t in points:
        for j in links:
            before = (model.angle[t, j - 1], model.x[t, j - 1], model.y[t, j - 1]) if j else (0.0, 0.0, 0.0)
            model.angle[t, j] = before[0] + model.q[t, j]
            model.x[t, j] = before[1] + pyo.cos(model.angle[t, j])
            model.y[t, j] = before[2] + pyo.sin(model.angle[t, j])
            model.rows.add(model.x[t, j] ** 2 + model.y[t, j] ** 2 + model.w[t, j] ** 2 <= 100)
            model.rows.add(model.x[t, j] * model.w[t, j] - model.y[t, j] * model.w[t, 0] <= 10)
    model.cost = pyo.Objective(expr=sum(model.x[t, joints - 1] ** 2 + model.y[t, joints - 1] ** 2 for t in points))
    return model


def doubling(times: int, depth: int) -> pyo.ConcreteModel:
    """Expressions of which each uses the one before twice."""
    model = pyo.ConcreteModel()
    points = range(times)
    model.x, model.y = pyo.Var(points, initialize=0.5), pyo.Var(points, initialize=0.4)
    model.e = pyo.Expression(points, range(depth))
    model.rows = pyo.Constraint(points)
    for t in points:
        model.e[t, 0] = pyo.sin(model.x[t]) * model.y[t]
        for k in range(1, depth):
            model.e[t, k] = model.e[t, k - 1] * pyo.cos(model.e[t, k - 1])
        model.rows[t] = model.e[t, depth - 1] + model.e[t, depth - 2] <= 1
    model.cost = pyo.Objective(expr=sum(model.x[t] ** 2 for t in points))
    return model


def program(model: pyo.ConcreteModel, *, defined: bool) -> tuple[AslProgram, float]:
    """A model as the library reads it, and the seconds that reading takes."""
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "model.nl")
        model.write(file, format="nl", io_options={"export_defined_variables": defined})
        started = time.process_time()
        made = AslProgram(file)
        return made, time.process_time() - started


def count_wrong(models: int) -> None:
    """Print the first table."""
    table = Table([("Expressions", "<22"), ("models", ">7d"), ("wrong", ">6d")])
    table.header()
    for title, defined in (("defined variables", True), ("written out", False)):
        wrong = 0
        for seed in range(models):
            show_progress(f"{title}: {seed}")
            made, _ = program(nested_model(seed), defined=defined)
            wrong += bool(differ_from_differences(made, made.x_start))
        table.add(title, models, wrong)


def costs(*, quick: bool) -> None:
    """Print the second table."""
    table = Table([
        ("model", "<26"), ("Expressions", "<18"), ("read", ">8.1f"), ("f, g", ">8.2f"), ("first", ">8.2f"),
        ("Hessian", ">8.2f"),
    ])  # fmt: skip
    table.header()
    cases: dict[str, Callable[[], pyo.ConcreteModel]] = {
        "1000 chains of 3 joints": lambda: chains(1000, 3),
        "500 chains of 7 joints": lambda: chains(500, 7),
        "20 Expressions, 14 deep": lambda: doubling(20, 14),
    }
    if quick:
        cases = {"10 chains of 3 joints": lambda: chains(10, 3)}
    for title, build in cases.items():
        for kind, defined in (("defined variables", True), ("written out", False)):
            show_progress(title)
            made, seconds = program(build(), defined=defined)
            table.add(title, kind, *(1e3 * value for value in (seconds, *evaluation_seconds(made))))


def evaluation_seconds(made: AslProgram) -> tuple[float, float, float]:
    """Functions, first derivatives and Hessian."""
    least = np.full(3, np.inf)
    for run in range(RUNS):
        x = made.x_start * (1 + 1e-6 * run)
        marks = [time.process_time()]
        made.objective(x), made.constraints(x)
        marks.append(time.process_time())
        made.gradient(x), made.jacobian(x)
        marks.append(time.process_time())
        made.hessian(x, 1.0, np.ones(made.m))
        marks.append(time.process_time())
        least = np.minimum(least, np.diff(marks))
    return float(least[0]), float(least[1]), float(least[2])


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few small models")
    parser.add_argument("--library", help="a library of PyNumero")
    parser.add_argument("--models", type=int, default=3000)
    arguments = parser.parse_args()
    AmplInterface.libname = arguments.library or find_asl_library()
    count_wrong(10 if arguments.quick else arguments.models)
    print()
    costs(quick=arguments.quick)


if __name__ == "__main__":
    main()
