"""Random obstacles all over a square, and three kinds of robots that cross it from corner to corner."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.obstacles.rerouting import grid_distances, grid_lower_bounds

CLEARANCE = 0.05
CELL = 0.1
# Distances between neighbouring obstacles' middles, as a range from crowded to open; their radii are 0.3 to 0.8.
SPACINGS = (1.9, 2.6)
GRAVITY = 9.81


def scattered(
    robot: str, seed: int, obstacles: int = 20, elements: int = 50, stages: int = 2, **options: Any
) -> pyo.ConcreteModel:
    """The least effort from one corner to the other; the initial guess is the straight line through the obstacles.

    Parameters
    ----------
    robot : str
        One of `ROBOTS`.
    seed : int
        Of the scene. How crowded it is changes with it; a disc around the robot can pass every scene.
    obstacles, elements, stages : int
    **options
        Of the `ObstacleAvoidanceBlock`.
    """
    shape, moves = ROBOTS[robot]
    shapes, side = random_scene(obstacles, seed, shape.reach)
    m = pyo.ConcreteModel(name=f"{robot} {seed}")
    m.move = b = rcp.PhaseBlock(duration=max(1.2 * side, 6.0), elements=elements, stages=stages)
    cost = moves(b, side)
    b.initialize_straight_lines()
    m.effort = pyo.Objective(expr=b.integral(cost))
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={robot: rcp.Body(shape, pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.theta[t]))},
        obstacles=shapes,
        clearance=CLEARANCE,
        **options,
    )
    return m


def random_scene(count: int, seed: int, reach: float) -> tuple[dict[str, rcp.Polytope], float]:
    """Triangles to hexagons in a square, and its side; a disc of radius `reach` keeps its clearance on some path."""
    rng = np.random.default_rng([seed, count])
    side = float(rng.uniform(*SPACINGS) * np.sqrt(count))
    while True:
        shapes: list[rcp.Polytope] = []
        while len(shapes) < count:
            middle = rng.uniform(0, side, 2)
            size, turn, corners = rng.uniform(0.3, 0.8), rng.uniform(0, 2 * np.pi), int(rng.integers(3, 7))
            if min(np.linalg.norm(middle), np.linalg.norm(middle - side)) > size + reach + 0.5:
                angles = turn + 2 * np.pi * np.arange(corners) / corners
                spread = np.column_stack([np.cos(angles), np.sin(angles)])
                shapes.append(rcp.Polytope.from_vertices(middle + size * spread))
        if _is_passable(shapes, side, reach):
            return {f"rock {number}": shape for number, shape in enumerate(shapes, start=1)}, side


def _is_passable(shapes: list[rcp.Polytope], side: float, reach: float) -> bool:
    axis = np.linspace(-1.0, side + 1.0, int((side + 2.0) / CELL) + 1)
    room = grid_lower_bounds([axis, axis], shapes, reach + CLEARANCE + CELL)
    cost = np.where(room > reach + CLEARANCE, 1.0, np.inf)
    start, goal = (tuple([int(np.abs(axis - end).argmin())] * 2) for end in (0.0, side))
    return bool(np.isfinite(grid_distances(cost, np.diff(axis)[:1].repeat(2), start)[goal]))


def _holonomic(b: Any, side: float) -> Callable[..., Any]:
    for name, last in (("x", side), ("y", side), ("theta", 0.0)):
        b.declare(name, rcp.State(initial=0.0, final=last))
        b.declare(f"{name}_rate", rcp.State(initial=0, final=0))
        b.declare(f"{name}_push", rcp.Control(bounds=(-5, 5)))

    @b.ode
    def pushed(b: Any, t: Any) -> dict[Any, Any]:
        rates = {b.x: b.x_rate[t], b.y: b.y_rate[t], b.theta: b.theta_rate[t]}
        return {**rates, b.x_rate: b.x_push[t], b.y_rate: b.y_push[t], b.theta_rate: b.theta_push[t]}

    return lambda b, t: b.x_push[t] ** 2 + b.y_push[t] ** 2 + b.theta_push[t] ** 2


def _unicycle(b: Any, side: float) -> Callable[..., Any]:
    b.x, b.y = rcp.State(initial=0.0, final=side), rcp.State(initial=0.0, final=side)
    b.theta = rcp.State(initial=np.pi / 4, final=np.pi / 4)
    b.v, b.w = rcp.State(initial=0, final=0, bounds=(-1, 4)), rcp.State(initial=0, final=0, bounds=(-3, 3))
    b.a, b.turn = rcp.Control(bounds=(-3, 3)), rcp.Control(bounds=(-5, 5))

    @b.ode
    def rolling(b: Any, t: Any) -> dict[Any, Any]:
        ahead = {b.x: b.v[t] * pyo.cos(b.theta[t]), b.y: b.v[t] * pyo.sin(b.theta[t])}
        return {**ahead, b.theta: b.w[t], b.v: b.a[t], b.w: b.turn[t]}

    return lambda b, t: b.a[t] ** 2 + b.turn[t] ** 2


def _quadrotor(b: Any, side: float) -> Callable[..., Any]:
    for name, last in (("x", side), ("y", side), ("theta", 0.0)):
        b.declare(name, rcp.State(initial=0.0, final=last))
        b.declare(f"{name}_rate", rcp.State(initial=0, final=0))
    b.left, b.right = (rcp.Control(bounds=(0, GRAVITY), initial_guess=GRAVITY / 2) for _ in range(2))

    @b.ode
    def flying(b: Any, t: Any) -> dict[Any, Any]:
        lift = b.left[t] + b.right[t]
        rates = {b.x: b.x_rate[t], b.y: b.y_rate[t], b.theta: b.theta_rate[t]}
        pulled = {b.x_rate: -lift * pyo.sin(b.theta[t]), b.y_rate: lift * pyo.cos(b.theta[t]) - GRAVITY}
        return {**rates, **pulled, b.theta_rate: 2.0 * (b.right[t] - b.left[t])}

    return lambda b, t: (b.left[t] - GRAVITY / 2) ** 2 + (b.right[t] - GRAVITY / 2) ** 2


# Shape, and what declares the motion from (0, 0) to (side, side) and returns the cost.
ROBOTS: dict[str, tuple[rcp.Polytope, Callable[[Any, float], Callable[..., Any]]]] = {
    "cart": (rcp.Polytope.box(0.6, 0.3), _holonomic),
    "unicycle": (rcp.Polytope.box(0.6, 0.4), _unicycle),
    "quadrotor": (rcp.Polytope.box(0.6, 0.15), _quadrotor),
}
