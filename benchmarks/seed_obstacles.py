"""Two plans around obstacles by the optimality conditions of the distance, as PyRoboCOP does it, and by planes.

    python benchmarks/seed_obstacles.py [--quick] [--time-limit SECONDS]

A small car past one obstacle, and a slider pushed into a slot, both with 0.02 to keep: the distance that PyRoboCOP
has built in. "optimality" states the nearest points of each pair as complementarity at the nodes, cold (all
unknowns at zero, as there) or started at the nearest points; "planes" is the default, one plane per interval, with
all rounds until the motion of the plan is proven clear between the nodes as well (no mesh is refined). Both start
from the same initial guess: a quarter of a circle for the car, a straight line for the slider.

"work" is iterations times variables, in millions, summed over all rounds; "ratio" is to that of the planes. "closest"
is the smallest distance among 20 instants per interval, "a*b" the largest product of a complementary pair.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation and
Collision Avoidance, arXiv:2106.03220
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
from obstacle_problems import model_size, restate, sampled_distance, start_on_quarter_circle
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles import Optimality

import car_between_obstacles  # isort: skip
import pushing_among_obstacles  # isort: skip

WAYS: dict[str, dict[str, Any]] = {
    "planes": {},
    "optimality": {"formulation": Optimality()},
    "cold optimality": {"formulation": Optimality(cold=True)},
}


def car(elements: int) -> tuple[pyo.ConcreteModel, Any]:
    """Past one obstacle."""
    m = start_on_quarter_circle(car_between_obstacles.build("one", elements))
    return m, m.drive


def slider(elements: int) -> tuple[pyo.ConcreteModel, Any]:
    """Into a slot."""
    m = pushing_among_obstacles.build("slot", elements)
    return m, m.push


PROBLEMS: dict[str, tuple[Callable[[int], tuple[pyo.ConcreteModel, Any]], int, int]] = {
    "car": (car, 50, 15),
    "pushing": (slider, 100, 20),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the car alone, 15 elements")
    parser.add_argument("--problems", nargs="+", choices=list(PROBLEMS), default=list(PROBLEMS), metavar="NAME")
    parser.add_argument("--time-limit", type=float, default=300.0, help="seconds per run")
    arguments = parser.parse_args()
    table = Table(
        [
            ("problem", "<8"), ("way", "<16"), ("variables", ">9d"), ("rows", ">6d"), ("rounds", ">6d"),
            ("iterations", ">10d"), ("work", ">7.3f"), ("ratio", ">6.1f"), ("seconds", ">7.2f"), ("J", ">9.5f"),
            ("a*b", ">8.1e"), ("closest", ">8.4f"), ("verdict", "<9"), ("quality", "<10"),
        ]
    )  # fmt: skip
    table.header()
    for name in ["car"] if arguments.quick else arguments.problems:
        build, full, coarse = PROBLEMS[name]
        work_of_planes = None
        for way, options in WAYS.items():
            show_progress(f"{name}: {way}")
            row = measured(build, coarse if arguments.quick else full, options, arguments.time_limit)
            show_progress("")
            work_of_planes = work_of_planes or row[4]
            table.add(name, way, *row[:5], row[4] / work_of_planes, *row[5:])


def measured(build: Callable[..., Any], elements: int, options: dict[str, Any], time_limit: float) -> tuple:
    """One row."""
    m, phase = build(elements)
    if options:
        restate(phase, **options)
    phase.avoid.initialize()
    variables, rows = model_size(m)
    result = rcp.solve(m, progress=False, time_limit=time_limit, equations=False)
    most, _ = model_size(m)  # splitting planes adds variables: the work is counted with the larger size
    verdict = phase.avoid.verify(equations=False).worst.verdict
    return (
        variables, rows, len(result.rounds), result.iterations, result.iterations * max(variables, most) / 1e6,
        result.seconds, result.objective, result.largest_product, sampled_distance(phase.avoid), verdict,
        result.quality.name,
    )  # fmt: skip


if __name__ == "__main__":
    main()
