"""What it costs to evaluate a model, and to prepare it for evaluation.

    python benchmarks/evaluation_costs.py [--quick] [--only EXAMPLE ...] [--rows N]

The first table: CPU milliseconds for the constraints, their Jacobian and the Hessian of the Lagrangian together, near
one point of the examples' models, by ASL, and by vectorised expressions that CasADi or compiled code evaluates. Each is
the least of seven runs of several evaluations. Pairs are relaxed by one product each.

The second: CPU seconds until a model can be evaluated. "alike" are rows of one shape, "different" are as many rows of
which no two have the same shape: what the vectorised backend is made for, and what it is not made for.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.native.shared_library import SWITCH_VARIABLE
from pyrobocop_pyomo.programs.asl_program import asl_available
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.summed_terms import evaluation_library

EXAMPLES = (
    "quadrotor_window", "crossing", "two_link_arm", "cart_pole", "acrobot", "planar_pushing", "stick_slip"
)  # fmt: skip
WAYS = {"ASL": "asl", "vectorised, CasADi": "vectorised", "vectorised, compiled": "vectorised"}
OPERATIONS = (pyo.sin, pyo.cos, pyo.exp, pyo.tanh, pyo.sinh, pyo.atan)
LEAST_SECONDS = 0.02  # of one run: the clock's steps are a hundredth of it


@contextmanager
def native_code(allowed: bool) -> Iterator[None]:
    """Compiled code switched on or off, and back afterwards."""
    before = os.environ.get(SWITCH_VARIABLE)
    os.environ[SWITCH_VARIABLE] = "on" if allowed else "off"
    try:
        yield
    finally:
        del os.environ[SWITCH_VARIABLE]
        if before is not None:
            os.environ[SWITCH_VARIABLE] = before


def ways() -> dict[str, str]:
    """Those that this machine has."""
    missing = set()
    if not asl_available():
        missing.add("ASL")
    with native_code(allowed=True):
        if evaluation_library() is None:
            missing.add("vectorised, compiled")
    return {name: derivatives for name, derivatives in WAYS.items() if name not in missing}


def compiled(m: pyo.ConcreteModel, way: str) -> CompiledModel:
    """The model as a program by one of the ways."""
    with native_code(allowed=way != "vectorised, CasADi"):
        return CompiledModel(m, WAYS[way])


def milliseconds(program: CompiledModel) -> float:
    """CPU time of one evaluation of all second-order information."""
    nlp = program.nlp
    x, multipliers = program.current_point(), np.ones(nlp.m)

    def evaluate() -> None:
        x[0] = np.nextafter(x[0], np.inf)  # another point, since programs remember the last one
        nlp.constraints(x)
        nlp.jacobian(x)
        nlp.hessian(x, 1.0, multipliers)

    return 1e3 * least(evaluate)


def least(run: Callable[[], object]) -> float:
    """CPU seconds of a call, the least of several means."""
    run()
    repetitions, found = 1, []
    while len(found) < 7:
        started = time.process_time()
        for _ in range(repetitions):
            run()
        seconds = time.process_time() - started
        if seconds < LEAST_SECONDS:
            repetitions *= 2
        else:
            found.append(seconds / repetitions)
    return min(found)


def example(name: str, quick: bool) -> pyo.ConcreteModel:
    """The model of an example, with rows in place of its pairs."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
    m = importlib.import_module(name).build(**({"elements": 10} if quick else {}))
    if any(m.component_data_objects(rcp.Complementarity, active=True)):
        pyo.TransformationFactory("pyrobocop.relax_complementarity").apply_to(m, delta=1e-4)
    return m


def rows_of(count: int, different: bool) -> pyo.ConcreteModel:
    """Nonlinear rows of one shape, or of as many shapes: the places of the functions in a row spell its number."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(count + 8), initialize=0.5)

    def row(m: pyo.ConcreteModel, i: int) -> object:
        total, digits = 0.0, i if different else 0
        for place in range(8):
            digits, digit = divmod(digits, len(OPERATIONS))
            total += (place + 1) * m.x[i + place] * OPERATIONS[digit](m.x[i + (place + 3) % 8])
        return total <= 100.0

    m.rows = pyo.Constraint(range(count), rule=row)
    m.cost = pyo.Objective(expr=sum(m.x[i] ** 2 for i in m.x))
    return m


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two examples on few elements, 40 rows")
    parser.add_argument("--only", nargs="+", choices=EXAMPLES, metavar="EXAMPLE")
    parser.add_argument("--rows", type=int, default=2000)
    arguments = parser.parse_args()
    found = ways()
    rcp.solve(rows_of(2, different=False), progress=False)  # what is imported and loaded on first use
    table = Table([("model", "<18s"), *((name, f">{max(8, len(name))}.2f") for name in found)])
    table.header()
    for name in arguments.only or (EXAMPLES[3:6:2] if arguments.quick else EXAMPLES):
        show_progress(name)
        m = example(name, arguments.quick)
        table.add(name, *(milliseconds(compiled(m, way)) for way in found))
    print()
    table = Table([("rows", "<18s"), *((name, f">{max(8, len(name))}.2f") for name in found)])
    table.header()
    count = 40 if arguments.quick else arguments.rows
    for kind in ("alike", "different"):
        seconds = []
        for way in found:
            show_progress(f"{count} rows, {kind}, {way}")
            m = rows_of(count, kind == "different")
            started = time.process_time()
            compiled(m, way)
            seconds.append(time.process_time() - started)
        table.add(f"{count} {kind}", *seconds)


if __name__ == "__main__":
    main()
