"""How often random scenes end in a motion that is proven clear, and what plans are worth that look at nodes only.

    python benchmarks/obstacle_success.py [--quick] [--scenes N] [--problems WORD ...] [--time-limit S] [--details]

"flight": a quadrotor through a window of random place and size in a thin wall, between random ends, from a straight
line that mostly runs into the wall. "parking": a car from a random place in the street into a slot, backwards or along
the street, from the path of Hybrid A*. "warehouse": a car with a trailer, from a straight line, into a bay in reverse,
into the next aisle, or among pallets. Scenes are numbered; the same number is the same scene.

"nodes" asks for the clearance at the points of the mesh only; "planes" is what `rcp.solve` does by default. *feasible*
counts plans that meet every row that was asked for; *safe* those that are proven to keep their clearance at all times;
*too close* and *overlap* those among the feasible ones for which an instant was found at which they do not. Seconds are
those of `rcp.solve`, all rounds included.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from statistics import median
from typing import Any

import pyomo.environ as pyo
from obstacle_problems import random_flight, random_parking, random_shelf, random_warehouse
from table import Table, show_progress

import pyrobocop_pyomo as rcp

PROBLEMS: dict[str, Callable[..., pyo.ConcreteModel]] = {
    "flight": random_flight, "parking": random_parking, "shelf": random_shelf, "warehouse": random_warehouse,
}  # fmt: skip
WAYS: dict[str, dict[str, Any]] = {"nodes": {"between": None}, "planes": {}}


def main() -> None:
    """Print the table, and what was tried where no safe plan was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two parkings on 20 elements")
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--problems", nargs="+", choices=list(PROBLEMS), default=list(PROBLEMS), metavar="WORD")
    parser.add_argument("--time-limit", type=float, default=300.0, help="seconds per scene")
    parser.add_argument("--details", action="store_true", help="a line per scene")
    arguments = parser.parse_args()
    problems = ["parking"] if arguments.quick else arguments.problems
    scenes = 2 if arguments.quick else arguments.scenes
    size = {"elements": 20} if arguments.quick else {}

    table = Table(
        [
            ("problem", "<8"), ("way", "<7"), ("scenes", ">6d"), ("feasible", ">8d"), ("safe", ">4d"),
            ("too close", ">9d"), ("overlap", ">7d"), ("rounds", ">6d"), ("iterations", ">10d"),
            ("median s", ">8.1f"), ("longest s", ">9.1f"),
        ]
    )  # fmt: skip
    told: list[str] = []
    table.header()
    for problem in problems:
        for way, options in WAYS.items():
            results = []
            for seed in range(scenes):
                show_progress(f"{problem} {seed}: {way}")
                model = PROBLEMS[problem](seed, **size, **options)
                result = rcp.solve(model, progress=False, time_limit=arguments.time_limit)
                results.append(result)
                if arguments.details or (way == "planes" and not result.safe):
                    told.append(f"{problem} {seed}, {way}:\n{result.rounds_table()}")
            show_progress("")
            table.add(problem, way, scenes, *summary(results))
    if told:
        print("", *told, sep="\n")


def summary(results: list[rcp.SolveResult]) -> tuple:
    """Counts and times of one row."""
    feasible = [result for result in results if result.quality is not rcp.Quality.INFEASIBLE]
    verdicts = [result.safety.worst.verdict for result in feasible]
    return (
        len(feasible), sum(bool(result.safe) for result in results), verdicts.count("too close"),
        verdicts.count("overlap"),
        sum(len(result.rounds) for result in results), sum(result.iterations for result in results),
        median(result.seconds for result in results), max(result.seconds for result in results),
    )  # fmt: skip


if __name__ == "__main__":
    main()
