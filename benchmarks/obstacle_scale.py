"""How planning grows with the number of obstacles: random scenes, from a straight line through the obstacles.

    python benchmarks/obstacle_scale.py [--quick] [--sizes OBSTACLESxELEMENTS ...] [--robots NAME ...]
        [--seeds SEED ...] [--all-pairs] [--time-limit S]

Every scene can be passed by a disc around the robot. CPU seconds, of one process: "build" of the model with all
separations, "start" of separations, "solve" by Ipopt with all that belongs to it, "verify" and "tighten", summed over
all rounds; "total" is from the model's first line to the result. "closest" is the smallest distance found; the
clearance is 0.05.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median
from typing import Any

from obstacle_problems import ROBOTS, scattered
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.planning import safe_planning

PARTS = ("start", "solve", "verify", "tighten")


def main() -> None:
    """Print a row per scene, and the medians of each size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one scene of 8 obstacles on 15 elements")
    parser.add_argument("--sizes", nargs="+", default=["8x50", "20x50", "50x50"], metavar="OBSTACLESxELEMENTS")
    parser.add_argument("--robots", nargs="+", choices=list(ROBOTS), default=list(ROBOTS), metavar="NAME")
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(7)))
    parser.add_argument("--all-pairs", action="store_true", help="without the broad phase")
    parser.add_argument("--time-limit", type=float, default=300.0)
    arguments = parser.parse_args()
    sizes = ["8x15"] if arguments.quick else arguments.sizes
    robots, seeds = (["cart"], [0]) if arguments.quick else (arguments.robots, arguments.seeds)
    options = {"broad_phase": None} if arguments.all_pairs else {}
    table = Table(
        [
            ("scene", "<8"), ("robot", "<9"), ("seed", ">4d"), ("planes", ">6d"), ("build", ">6.2f"),
            *((part, ">7.2f") for part in PARTS), ("total", ">7.2f"), ("rounds", ">6d"), ("iterations", ">10d"),
            ("objective", ">10.4f"), ("closest", ">8.4f"), ("safe", "<4"),
        ]
    )  # fmt: skip
    table.header()
    told = []
    for size in sizes:
        obstacles, elements = map(int, size.split("x"))
        rows = []
        for robot in robots:
            for seed in seeds:
                show_progress(f"{size} {robot} {seed}")
                rows.append(measured(robot, seed, obstacles, elements, arguments.time_limit, options))
                show_progress("")
                table.add(size, robot, seed, *rows[-1])
        totals = [row[6] for row in rows]
        safe = sum(row[-1] == "yes" for row in rows)
        told.append(f"{size}: {safe} of {len(rows)} safe; total median {median(totals):.2f}, largest {max(totals):.2f}")
    print("", *told, sep="\n")


def measured(
    robot: str, seed: int, obstacles: int, elements: int, time_limit: float, options: dict[str, Any]
) -> tuple[Any, ...]:
    """One row after the scene's name."""
    started = time.process_time()
    m = scattered(robot, seed, obstacles, elements, **options)
    build = time.process_time() - started
    with timed() as seconds:
        result = rcp.solve(m, progress=False, time_limit=time_limit)
    total = time.process_time() - started
    taken = (build, *(seconds[part] for part in PARTS), total, len(result.rounds), result.iterations)
    planes = len(m.move.avoid.separations)
    return (planes, *taken, result.objective, result.safety.worst.distance, "yes" if result.safe else "no")


@contextmanager
def timed() -> Iterator[dict[str, float]]:
    """CPU seconds of the parts of `solve`, while in the context."""
    seconds = dict.fromkeys(PARTS, 0.0)
    places = (
        (ObstacleAvoidanceBlockData, "initialize", "start"),
        (safe_planning, "solve_model", "solve"),
        (ObstacleAvoidanceBlockData, "verify", "verify"),
        (safe_planning, "tighten", "tighten"),
    )
    kept = [getattr(home, name) for home, name, _ in places]
    for (home, name, part), function in zip(places, kept, strict=True):
        setattr(home, name, _counting(function, seconds, part))
    try:
        yield seconds
    finally:
        for (home, name, _), function in zip(places, kept, strict=True):
            setattr(home, name, function)


def _counting(function: Callable[..., Any], seconds: dict[str, float], part: str) -> Callable[..., Any]:
    def counted(*arguments: Any, **options: Any) -> Any:
        started = time.process_time()
        try:
            return function(*arguments, **options)
        finally:
            seconds[part] += time.process_time() - started

    return counted


if __name__ == "__main__":
    main()
