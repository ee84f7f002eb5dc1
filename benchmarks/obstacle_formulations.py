"""The same motion kept clear by a plane per interval and by a plane per node, from the same good initial guess.

    python benchmarks/obstacle_formulations.py [--quick] [--scenes WORD ...]

The scene is solved as by default, and then with a plane per node from there. That motion, bent by seeded waves of a
thousandth of each state's range, is the initial guess of both; Ipopt starts with a barrier parameter of 1e-6, so that
it stays near. A plane per node looks at the nodes only. "closest" is the smallest distance among 20 instants per
interval, and may be less than what was asked for; the verdict is that of `verify`.

"gap" is the objective, relative to that of a plane per node.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pyomo.environ as pyo
from obstacle_problems import model_size, restate, sampled_distance, start_on_quarter_circle
from table import Table, show_progress

import pyrobocop_pyomo as rcp

import car_between_obstacles  # isort: skip
import parking  # isort: skip
import quadrotor_window  # isort: skip


FORMULATIONS: dict[str, dict[str, Any]] = {
    "plane per interval": {"between": "plane"},
    "plane per node": {"between": None},
}
NEAR = {"mu_init": 1e-6, "bound_push": 1e-6, "bound_frac": 1e-6}


def scenes(quick: bool) -> dict[str, Callable[[], tuple[pyo.ConcreteModel, Any]]]:
    """Name: how to build the model, and the phase of it that avoids obstacles."""

    def car(elements: int) -> tuple[Any, Any]:
        m = start_on_quarter_circle(car_between_obstacles.build("one", elements))
        return m, m.drive

    def quadrotor() -> tuple[Any, Any]:
        m = quadrotor_window.build("low", 20)
        return m, m.flight

    def reverse() -> tuple[Any, Any]:
        m = parking.build("reverse", 40)
        return m, m.drive

    return {"car": partial(car, 15)} if quick else {"car": partial(car, 50), "quadrotor": quadrotor, "parking": reverse}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a car past a square, 15 elements")
    parser.add_argument("--scenes", nargs="+", metavar="WORD", default=["car", "quadrotor", "parking"])
    parser.add_argument("--time-limit", type=float, default=120.0, help="seconds per run")
    arguments = parser.parse_args()
    chosen = {name: made for name, made in scenes(arguments.quick).items() if name in arguments.scenes}

    table = Table(
        [
            ("scene", "<9"), ("formulation", "<22"), ("variables", ">9d"), ("rows", ">6d"), ("rounds", ">6d"),
            ("iterations", ">10d"), ("seconds", ">7.2f"), ("objective", ">12.8f"), ("gap", ">8.1e"),
            ("closest", ">8.4f"), ("asked", ">6.3f"), ("verdict", "<9"),
        ]
    )  # fmt: skip
    table.header()
    for name, made in chosen.items():
        start = good_trajectory(made)
        shown = []
        for formulation, options in FORMULATIONS.items():
            show_progress(f"{name}: {formulation}")
            shown.append((name, formulation, *measured(made, start, options, arguments.time_limit)))
        show_progress("")
        per_node = next(row[7] for row in shown if row[1] == "plane per node")
        for row in shown:
            gap = None if row[7] is None or per_node is None else row[7] / per_node - 1
            table.add(*row[:8], gap, *row[8:])


def good_trajectory(made: Callable[[], tuple[pyo.ConcreteModel, Any]]) -> rcp.Trajectory:
    """Motion that a plane per interval leads to, and a plane per node from there."""
    m, phase = made()
    rcp.solve(m, progress=False)
    restate(phase, between=None)
    rcp.solve(m, progress=False, options=NEAR)
    return phase.trajectory()


def perturb(phase: Any, start: rcp.Trajectory, seed: int = 0) -> None:
    """Start from a motion to which waves are added, a thousandth of the range of each state high."""
    phase.initialize(start)
    generator = np.random.default_rng(seed)
    first, last = phase.time.first(), phase.time.last()
    for name in phase.record.names_of_states:
        state = getattr(phase, name)
        height = 0.001 * float(np.ptp([pyo.value(state[t]) for t in phase.time]))
        shift = generator.uniform(0, 2 * np.pi)
        for t in phase.time:
            if not state[t].fixed:
                wave = height * np.sin(shift + 6 * np.pi * (t - first) / (last - first))
                state[t].set_value(pyo.value(state[t]) + wave, skip_validation=True)


def measured(made: Callable[..., Any], start: rcp.Trajectory, options: dict[str, Any], time_limit: float) -> tuple:
    """One row: size, rounds, iterations, seconds, objective, distance found, asked, verdict."""
    m, phase = made()
    perturb(phase, start)
    avoid = restate(phase, **options)
    avoid.initialize()
    size = model_size(m)
    result = rcp.solve(m, progress=False, time_limit=time_limit, options=NEAR)
    worst = avoid.verify().worst
    objective = result.objective if result.quality is rcp.Quality.OPTIMAL else None
    verdict = worst.verdict if objective is not None else "unsolved"
    rounds = len(result.rounds)
    found = (rounds, result.iterations, result.seconds, objective)
    return (*size, *found, sampled_distance(avoid), worst.clearance, verdict)


if __name__ == "__main__":
    main()
