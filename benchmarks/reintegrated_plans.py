"""Whether plans that are called safe are safe for a robot that integrates their controls.

    python benchmarks/reintegrated_plans.py [--quick] [--plans N] [--first SEED] [--time-limit S] [--details]

Each seed is a plan: a unicycle, a car, an arm of two links, a planar quadrotor, a cart with drag, or a slider that a
finger pushes with friction, among random obstacles, on 3 to 40 elements of a random scheme. What `rcp.solve` calls
safe is integrated again by `scipy.integrate.solve_ivp` at tolerances of 1e-10, open loop, with independent
dynamics in NumPy. The contact of the slider slips or sticks element by element, so each of its elements is integrated
from the start that the plan gives it.

Distances are those of shapely at 60 instants per element. *false* counts the plans called safe whose motion
comes closer than the clearance less its tolerance of 1 %; *worst* is the largest of these shortfalls, as a share of
the clearance.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Any

import numpy as np
import pyomo.environ as pyo
import shapely
from scipy.integrate import solve_ivp
from table import Table, show_progress

import pyrobocop_pyomo as rcp

SCHEMES: list[tuple[str, int | None]] = [
    ("radau", 1), ("radau", 2), ("radau", 3), ("gauss", 1), ("gauss", 2), ("gauss", 3), ("lobatto", 3),
    ("implicit_euler", None), ("implicit_midpoint", None), ("trapezoid", None), ("explicit_euler", None),
]  # fmt: skip
CLEARANCE = 0.05
INSTANTS = 60


@dataclass
class Robot:
    """A kind of robot: its states from start to goal, its controls, its equations for Pyomo and for NumPy alike.

    Attributes
    ----------
    start, goal : dict of state name to number
    controls : dict of control name to bound
    rates : callable
        ``rates(states, controls, functions)`` with dicts of numbers or expressions; `functions` is pyo or np.
    shapes : callable
        ``shapes(states, functions)``: (x, y, angle) of each body.
    bodies : list of Polytope
    duration : float
    positive : set of str
        Controls that are not negative.
    pairs : callable, optional
        ``pairs(controls)``: both sides of each complementarity pair.
    """

    start: dict[str, float]
    goal: dict[str, float]
    controls: dict[str, float]
    rates: Any
    shapes: Any
    bodies: list[Any]
    duration: float
    positive: frozenset[str] = frozenset()
    pairs: Any = None


def unicycle(random: Any) -> Robot:
    """Speed and turning rate are controls."""
    return Robot(
        {"x": 0.0, "y": 0.0, "h": random.uniform(-1, 1)},
        {"x": 3.0, "y": random.uniform(-0.5, 0.5)},
        {"v": 2.0, "w": 3.0},
        lambda s, u, f: {"x": u["v"] * f.cos(s["h"]), "y": u["v"] * f.sin(s["h"]), "h": u["w"]},
        lambda s, f: [(s["x"], s["y"], s["h"])],
        [rcp.Polytope.box(0.4, 0.2)],
        3.0,
    )


def car(random: Any) -> Robot:
    """Acceleration and rate of steering are controls."""

    def rates(s: Any, u: Any, f: Any) -> dict[str, Any]:
        turning = s["v"] * f.tan(s["d"]) / 0.3
        return {"x": s["v"] * f.cos(s["h"]), "y": s["v"] * f.sin(s["h"]), "h": turning, "v": u["a"], "d": u["r"]}

    return Robot(
        {"x": 0.0, "y": 0.0, "h": random.uniform(-0.5, 0.5), "v": 0.0, "d": 0.0},
        {"x": 3.0, "y": random.uniform(-0.5, 0.5), "v": 0.0},
        {"a": 3.0, "r": 2.0},
        rates,
        lambda s, f: [(s["x"], s["y"], s["h"])],
        [rcp.Polytope.box(0.5, 0.2, center=(0.15, 0.0))],
        4.0,
    )


def arm(random: Any) -> Robot:
    """Two links; torques act on joints with damping and gravity."""

    def rates(s: Any, u: Any, f: Any) -> dict[str, Any]:
        return {
            "p": s["dp"],
            "q": s["dq"],
            "dp": u["k"] - 2.0 * f.cos(s["p"]) - 0.5 * s["dp"],
            "dq": u["l"] - 1.0 * f.cos(s["p"] + s["q"]) - 0.5 * s["dq"],
        }

    def shapes(s: Any, f: Any) -> list[Any]:
        return [(0.0, 0.0, s["p"]), (f.cos(s["p"]), f.sin(s["p"]), s["p"] + s["q"])]

    return Robot(
        {"p": 0.0, "q": 0.3, "dp": 0.0, "dq": 0.0},
        {"p": random.uniform(1.5, 2.5)},
        {"k": 12.0, "l": 8.0},
        rates,
        shapes,
        [rcp.Polytope.box(1.0, 0.06, center=(0.5, 0.0)), rcp.Polytope.box(0.8, 0.06, center=(0.4, 0.0))],
        1.5,
    )


def quadrotor(random: Any) -> Robot:
    """In a vertical plane; thrust and moment are controls."""

    def rates(s: Any, u: Any, f: Any) -> dict[str, Any]:
        return {
            "x": s["vx"], "y": s["vy"], "h": s["w"],
            "vx": -u["f"] * f.sin(s["h"]), "vy": u["f"] * f.cos(s["h"]) - 9.81, "w": u["m"],
        }  # fmt: skip

    return Robot(
        {"x": 0.0, "y": 0.0, "h": 0.0, "vx": 0.0, "vy": 0.0, "w": 0.0},
        {"x": 3.0, "y": random.uniform(-0.5, 0.5), "h": 0.0, "vx": 0.0, "vy": 0.0, "w": 0.0},
        {"f": 30.0, "m": 40.0},
        rates,
        lambda s, f: [(s["x"], s["y"], s["h"])],
        [rcp.Polytope.box(0.4, 0.1)],
        2.0,
    )


def cart(random: Any) -> Robot:
    """A disc with drag; forces are controls."""

    def rates(s: Any, u: Any, f: Any) -> dict[str, Any]:
        drag = 1.5 * f.sqrt(s["vx"] ** 2 + s["vy"] ** 2 + 0.01)
        return {"x": s["vx"], "y": s["vy"], "vx": u["fx"] - drag * s["vx"], "vy": u["fy"] - drag * s["vy"]}

    return Robot(
        {"x": 0.0, "y": 0.0, "vx": random.uniform(-1, 1), "vy": random.uniform(-1, 1)},
        {"x": 3.0, "y": random.uniform(-0.5, 0.5)},
        {"fx": 20.0, "fy": 20.0},
        rates,
        lambda s, f: [(s["x"], s["y"], 0.0)],
        [rcp.Polytope.box(0.2, 0.2)],
        2.0,
    )


def slider(random: Any) -> Robot:
    """Pushed on its rear face by a finger that slips at the edge of the friction cone."""

    def rates(s: Any, u: Any, f: Any) -> dict[str, Any]:
        return {
            "x": f.cos(s["h"]) * u["n"] - f.sin(s["h"]) * u["t"],
            "y": f.sin(s["h"]) * u["n"] + f.cos(s["h"]) * u["t"],
            "h": 10.0 * (-0.2 * u["t"] - s["p"] * u["n"]),
            "p": u["up"] - u["down"],
        }

    return Robot(
        {"x": 0.0, "y": 0.0, "h": random.uniform(-0.3, 0.3), "p": 0.0},
        {"x": 3.0, "y": random.uniform(-0.5, 0.5)},
        {"n": 3.0, "t": 1.0, "up": 0.5, "down": 0.5},
        rates,
        lambda s, f: [(s["x"], s["y"], s["h"])],
        [rcp.Polytope.box(0.4, 0.4)],
        3.0,
        frozenset({"n", "up", "down"}),
        lambda u: {"up": (0.3 * u["n"] - u["t"], u["up"]), "down": (0.3 * u["n"] + u["t"], u["down"])},
    )


ROBOTS = {robot.__name__: robot for robot in (unicycle, car, arm, quadrotor, cart, slider)}


def obstacles_of(robot: Robot, random: Any) -> list[Any]:
    """One to three boxes and discs in the way, clear of start and goal."""
    found: list[Any] = []
    over_arm = robot.duration == 1.5
    while len(found) < 1 + random.integers(3):
        if over_arm:
            angle, reach = random.uniform(0.7, 1.6), random.uniform(1.5, 1.9)
            center = (reach * np.cos(angle), reach * np.sin(angle))
        else:
            center = (random.uniform(0.8, 2.2), random.uniform(-0.7, 0.7))
        size = random.uniform(0.1, 0.5, size=2)
        if random.random() < 0.5:
            shape = rcp.Polytope.hull([center], radius=float(size[0]) / 2, allow_flat=True)
        else:
            shape = rcp.Polytope.box(*size, center=center)
        found.append(shape)
    return found


def build(seed: int) -> tuple[Any, Robot, list[Any]]:
    """The model of a seed, its robot and its obstacles."""
    random = np.random.default_rng(seed)
    robot = list(ROBOTS.values())[seed % len(ROBOTS)](random)
    scheme, stages = SCHEMES[random.integers(len(SCHEMES))]
    obstacles = obstacles_of(robot, random)
    m = pyo.ConcreteModel(name=f"{ROBOTS[list(ROBOTS)[seed % len(ROBOTS)]].__name__} {seed}")
    elements = int(random.integers(3, 41))
    m.move = b = rcp.PhaseBlock(duration=robot.duration, elements=elements, scheme=scheme, stages=stages)
    for name, initial in robot.start.items():
        b.declare(name, rcp.State(initial=initial, final=robot.goal.get(name)))
    share_points = scheme in ("lobatto", "trapezoid")  # between elements: no control can be constant on each
    constant = scheme == "explicit_euler" or (random.random() < 0.3 and not share_points)
    held = "piecewise_constant" if constant else "collocated"
    for name, bound in robot.controls.items():
        b.declare(name, rcp.Control(bounds=(0 if name in robot.positive else -bound, bound), parametrization=held))

    def read(b: Any, t: Any, names: Any) -> dict[str, Any]:
        return {name: getattr(b, name)[t] for name in names}

    def ode(b: Any, t: Any) -> dict[Any, Any]:
        rates = robot.rates(read(b, t, robot.start), read(b, t, robot.controls), pyo)
        return {getattr(b, name): rate for name, rate in rates.items()}

    b.ode(ode)
    if robot.pairs is not None:

        def friction(b: Any, t: Any) -> Any:
            return robot.pairs(read(b, t, robot.controls))

        b.complementarity(friction)
    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: sum((getattr(b, n)[t] / bound) ** 2 for n, bound in robot.controls.items()))
    )

    def pose(k: int) -> Any:
        return lambda b, t: rcp.planar_pose(*robot.shapes(read(b, t, robot.start), pyo)[k])

    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={f"body {k}": rcp.Body(shape, pose=pose(k)) for k, shape in enumerate(robot.bodies)},
        body_pairs=[(f"body {k}", f"obstacle {j}") for k in range(len(robot.bodies)) for j in range(len(obstacles))],
        obstacles={f"obstacle {j}": shape for j, shape in enumerate(obstacles)},
        clearance=CLEARANCE,
    )
    b.initialize_straight_lines()
    return m, robot, obstacles


def closest(m: Any, robot: Robot, obstacles: list[Any]) -> float:
    """Smallest distance of the motion that the plan's controls lead to, by SciPy, NumPy and shapely."""
    b = m.find_component("move")
    trajectory = b.trajectory()
    names, boundaries = list(robot.start), trajectory.grid.mesh.boundaries
    state = np.array([float(getattr(trajectory, name)[0]) for name in names])
    hulls = [shapely.MultiPoint(shape.vertices).convex_hull for shape in obstacles]
    least = np.inf
    for start, end in pairwise(boundaries):

        def rates(t: float, s: Any, start: float = start, end: float = end) -> Any:
            controls = trajectory(min(max(t, np.nextafter(start, end)), end))
            found = robot.rates(dict(zip(names, s, strict=True)), controls, np)
            return [found[name] for name in names]

        if robot.pairs is not None:
            first = trajectory(start) if start == boundaries[0] else trajectory(np.nextafter(start, end))
            state = np.array([first[name] for name in names])
        times = np.linspace(start, end, INSTANTS)
        found = solve_ivp(rates, (start, end), state, rtol=1e-10, atol=1e-10, method="DOP853", t_eval=times)
        state = found.y[:, -1]
        for column in found.y.T:
            placed = robot.shapes(dict(zip(names, column, strict=True)), np)
            for (x, y, angle), shape in zip(placed, robot.bodies, strict=True):
                turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                body = shapely.MultiPoint(shape.vertices @ turn.T + [x, y]).convex_hull
                for hull, obstacle in zip(hulls, obstacles, strict=True):
                    least = min(least, body.distance(hull) - obstacle.radius - shape.radius)
    return float(least)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one plan of each robot, for 2 seconds each")
    parser.add_argument("--plans", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--time-limit", type=float, default=20.0, help="seconds per plan")
    parser.add_argument("--details", action="store_true", help="a line per plan called safe that is not")
    arguments = parser.parse_args()
    count = len(ROBOTS) if arguments.quick else arguments.plans
    limit = min(arguments.time_limit, 2.0) if arguments.quick else arguments.time_limit
    rows: dict[str, list[tuple[str, float, float, int]]] = {name: [] for name in ROBOTS}
    told = []
    for seed in range(arguments.first, arguments.first + count):
        kind = list(ROBOTS)[seed % len(ROBOTS)]
        show_progress(f"{kind} {seed}")
        m, robot, obstacles = build(seed)
        result = rcp.solve(m, progress=False, time_limit=limit)
        verdict = "safe" if result.safe else ("not safe" if result.quality.value != "infeasible" else "infeasible")
        shortfall = 0.0
        if result.safe:
            shortfall = (0.99 * CLEARANCE - closest(m, robot, obstacles)) / CLEARANCE
            if shortfall > 0 and arguments.details:
                told.append(f"{m.name} on {m.move.grid.scheme.name} x {m.move.grid.mesh.elements}: {shortfall:.2%}")
        rows[kind].append((verdict, shortfall, result.seconds, len(result.rounds)))
    show_progress("")
    table = Table(
        [
            ("robot", "<10"), ("plans", ">5d"), ("safe", ">4d"), ("not safe", ">8d"), ("false", ">5d"),
            ("worst", ">7.2%"), ("rounds", ">6d"), ("median s", ">8.2f"),
        ]
    )  # fmt: skip
    table.header()
    for kind, found in rows.items():
        if found:
            shortfalls = [max(shortfall, 0.0) for verdict, shortfall, *_ in found if verdict == "safe"]
            table.add(
                kind, len(found), len(shortfalls), len(found) - len(shortfalls),
                sum(shortfall > 0 for shortfall in shortfalls), max(shortfalls, default=0.0),
                sum(rounds for *_, rounds in found), median(seconds for *_, seconds, _ in found),
            )  # fmt: skip
    print(*told, sep="\n")


if __name__ == "__main__":
    main()
