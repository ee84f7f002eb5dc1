"""What the checks cost that `rcp.solve` makes of a model before it solves it.

    python benchmarks/check_costs.py [--quick] [--only NAME ...]

CPU seconds of this process: of the checks (`doubts_before_solve`, the least of five), of the whole of `rcp.solve`
with them, and their ratio in per cent. "simulation" is a cart-pole without an objective, where variables are counted
that nothing determines; "hopper" has linked phases.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pyomo.environ as pyo
from cart_pole_ways import stated_as_phase
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis.diagnose import doubts_before_solve

COLUMNS = [("model", "<22s"), ("variables", ">9d"), ("checks (s)", ">10.4f"), ("solve (s)", ">9.3f"), ("%", ">5.2f")]


def take_off() -> pyo.ConcreteModel:
    """The first example of the README."""
    m = pyo.ConcreteModel(name="take-off")
    m.lift = b = rcp.PhaseBlock(duration=2.0, elements=20, scheme="implicit_euler")
    b.height = rcp.State(initial=0, final=0.5, bounds=(0, None))
    b.speed = rcp.State(initial=0, final=0)
    b.floor_force = rcp.Algebraic(bounds=(0, None))
    b.thrust = rcp.Control(bounds=(0, 15))
    b.ode(lambda b, t: {b.height: b.speed[t], b.speed: b.thrust[t] + b.floor_force[t] - 9.81})
    b.complementarity(lambda b, t: rcp.complements(b.height[t] >= 0, b.floor_force[t] >= 0))
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.thrust[t] ** 2))
    return m


def simulation(elements: int) -> pyo.ConcreteModel:
    """The cart-pole without a force, a goal and an objective."""
    m = stated_as_phase(elements)
    b = next(iter(rcp.phases_of(m)))
    for name in b.record.names_of_states:
        b.component(name)[b.final_time].unfix()
    for force in b.force.values():
        force.fix(0.0)
    for objective in m.component_data_objects(pyo.Objective):
        objective.deactivate()
    return m


def example(name: str) -> Callable[[], pyo.ConcreteModel]:
    """What builds the model of an example."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
    return lambda: importlib.import_module(name).build()


def models(quick: bool) -> dict[str, Callable[[], pyo.ConcreteModel]]:
    """What is measured."""
    elements = 20 if quick else 1000
    found = {
        "take-off": take_off,
        f"cart-pole, {elements}": lambda: stated_as_phase(elements),
        f"simulation, {elements}": lambda: simulation(elements),
    }
    slow = {} if quick else {name: example(name) for name in ("planar_pushing", "parking", "hopper")}
    return found | slow


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two small models")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    arguments = parser.parse_args()
    rcp.solve(take_off(), progress=False)  # what is imported and loaded on first use
    table = Table(COLUMNS)
    table.header()
    for name, build in models(arguments.quick).items():
        if arguments.only and not any(word in name for word in arguments.only):
            continue
        show_progress(name)
        m, checks = build(), []
        for _ in range(5):
            started = time.process_time()
            doubts_before_solve(m)
            checks.append(time.process_time() - started)
        variables = sum(1 for _ in m.component_data_objects(pyo.Var))
        started = time.process_time()
        rcp.solve(m, progress=False)
        seconds = time.process_time() - started
        table.add(name, variables, min(checks), seconds, 100.0 * min(checks) / seconds)


if __name__ == "__main__":
    main()
