"""Nonsmooth problems of optimal control with known answers, by the writing of their switches and the way down.

    python benchmarks/nonsmooth_control.py [--quick] [--problems NAME ...] [--writings WRITING ...] [--ways WAY ...]
        [--elements N] [--stages S]

"pair" writes each pair at each collocation point of a uniform mesh; "crossed" lets the boundaries of the elements move
and multiplies the sides of all points of an element with each other, its left end included, by the grouping
``Crossed(left_end="first")``; "detected" says the same by pairs of sums per element.

"default" is ``rcp.solve`` as it is, "barrier" its first strategy alone, "x 0.1" a continuation with
delta = 1, 0.1, ..., 1e-8, "superlinear" one with fewer and fewer steps, "1e-8" a single delta; all are polished.

"error" is the objective's, relative to the optimum in continuous time; "residual" the largest min(a, b), recomputed;
"motion" the largest difference from the true motion under the plan's own controls, every switch located. "solved"
checks all of them. "CPU" is in seconds.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import Any

import pyomo.environ as pyo
from nonsmooth_problems import PROBLEMS
from table import Table, show_progress

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity.schedules import Superlinear

# Name: what `rcp.solve` is told.
WAYS = {
    "default": rcp.Strategy(),
    "barrier": rcp.Strategy("barrier"),
    "x 0.1": rcp.Strategy(schedule=rcp.relaxations.Geometric(first=1.0, factor=0.1, last=1e-8)),
    "superlinear": rcp.Strategy(schedule=Superlinear(first=1.0, last=1e-8)),
    "1e-8": rcp.Strategy(schedule=rcp.relaxations.Fixed(1e-8)),
}
# Name: how the model is built, grouping.
WRITINGS: dict[str, tuple[dict[str, bool], Any]] = {
    "pair": ({}, "pair"),
    "crossed": ({"moving": True}, rcp.relaxations.Crossed(left_end="first")),
    "detected": ({"detect": True}, "pair"),
}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two problems, two ways, 10 elements")
    parser.add_argument("--problems", nargs="+", choices=list(PROBLEMS), default=list(PROBLEMS), metavar="NAME")
    parser.add_argument("--writings", nargs="+", choices=list(WRITINGS), default=list(WRITINGS), metavar="WRITING")
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS), metavar="WAY")
    parser.add_argument("--elements", type=int, default=20)
    parser.add_argument("--stages", type=int, default=None, help="default: that of each problem")
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds per run")
    arguments = parser.parse_args()
    ways = {word: WAYS[word] for word in arguments.ways}
    writings = {word: WRITINGS[word] for word in arguments.writings}
    if arguments.quick:
        ways = {word: WAYS[word] for word in ("default", "x 0.1")}
    names = ["sliding by step", "pushed blocks"] if arguments.quick else arguments.problems
    elements = 10 if arguments.quick else arguments.elements

    print(f"{elements} elements of Radau with two stages, one where bodies collide and pairs are not crossed\n")
    table = Table(
        [
            ("problem", "<26"), ("writing", "<8"), ("way", "<11"), ("solved", "<6"), ("iterations", ">10d"),
            ("objective", ">10.5f"), ("error", ">8.1e"), ("residual", ">8.1e"), ("motion", ">8.1e"),
            ("strategy", "<12"), ("CPU", ">7.2f"),
        ]
    )  # fmt: skip
    table.header()
    counts: dict[tuple[str, str], int] = {}
    for name in names:
        problem = PROBLEMS[name]
        for writing, (built, grouping) in writings.items():
            # A single stage has nothing to be crossed with.
            stages = {} if writing == "pair" else {"stages": 2}
            stages |= {} if arguments.stages is None else {"stages": arguments.stages}
            for word, way in ways.items():
                show_progress(f"{name}, {writing}, {word}")
                model: pyo.ConcreteModel = problem.build(elements, **built, **stages)
                started = time.process_time()
                strategy = replace(way, grouping=grouping)
                result = rcp.solve(model, strategies=strategy, progress=False, time_limit=arguments.time_limit)
                seconds = time.process_time() - started
                assessment = problem.assess(model)
                counts[writing, word] = counts.get((writing, word), 0) + assessment.solved
                show_progress("")
                table.add(
                    name, writing, word, "yes" if assessment.solved else "no", result.iterations, assessment.objective,
                    assessment.objective_error, assessment.natural_residual, assessment.deviation, result.strategy,
                    seconds,
                )  # fmt: skip

    print(f"\nsolved, of {len(names)}\n")
    summary = Table([("writing", "<10"), *((word, ">12d") for word in ways)])
    summary.header()
    for writing in writings:
        summary.add(writing, *(counts[writing, word] for word in ways))


if __name__ == "__main__":
    main()
