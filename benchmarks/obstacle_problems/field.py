"""A field of twenty obstacles, of which a body on its way from one corner to the other comes near few."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

BODY = rcp.Polytope.box(0.6, 0.3)
START, GOAL = (0.0, 0.0, 0.0), (10.0, 10.0, 0.0)
CLEARANCE = 0.05


def field(obstacles: int = 20, elements: int = 100, seed: int = 0, **options: Any) -> pyo.ConcreteModel:
    """The least effort from one corner of a field to the other.

    Parameters
    ----------
    obstacles, elements : int
    seed : int
        Of the obstacles' places, shapes and turns.
    **options
        Of the `ObstacleAvoidanceBlock`.
    """
    m = pyo.ConcreteModel(name="field")
    m.move = b = rcp.PhaseBlock(duration=10.0, elements=elements, stages=1)
    for name, first, last in zip(("x", "y", "theta"), START, GOAL, strict=True):
        b.declare(name, rcp.State(initial=first, final=last))
        b.declare(f"{name}_rate", rcp.State(initial=0, final=0))
        b.declare(f"{name}_push", rcp.Control(bounds=(-5, 5)))

    @b.ode
    def pushed(b, t):
        rates = {b.x: b.x_rate[t], b.y: b.y_rate[t], b.theta: b.theta_rate[t]}
        return {**rates, b.x_rate: b.x_push[t], b.y_rate: b.y_push[t], b.theta_rate: b.theta_push[t]}

    b.initialize_straight_lines()
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.x_push[t] ** 2 + b.y_push[t] ** 2 + b.theta_push[t] ** 2))
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time,
        bodies={"body": rcp.Body(BODY, pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.theta[t]))},
        obstacles=_shapes(obstacles, seed),
        clearance=CLEARANCE,
        **options,
    )
    return m


def near_pairs(obstacles: int = 20, seed: int = 0, length: float = 1.0) -> list[tuple[str, str]]:
    """Pairs that a person would state who knows the way: obstacles within a length of the straight line."""
    line = rcp.Polytope.from_vertices([START[:2], GOAL[:2]], allow_flat=True).padded(BODY.reach)
    shapes = _shapes(obstacles, seed)
    return [
        ("body", name) for name, shape in shapes.items() if rcp.scenes.signed_distance(line, shape).distance < length
    ]


def _shapes(obstacles: int, seed: int) -> dict[str, rcp.Polytope]:
    """Triangles to hexagons, all over the field except at its two ends, and apart from each other."""
    rng = np.random.default_rng(seed)
    found: dict[str, rcp.Polytope] = {}
    ends = [rcp.Polytope.ball(1.2, np.array(end[:2])) for end in (START, GOAL)]
    while len(found) < obstacles:
        size, turn = rng.uniform(0.3, 0.8), rng.uniform(0, 2 * np.pi)
        shape = rcp.Polytope.regular_polygon(int(rng.integers(3, 7)), size, center=rng.uniform(0, 10, 2))
        spun = shape.placed(_turned_about(shape.center, turn))
        if all(rcp.scenes.signed_distance(spun, other).distance > 1.0 for other in [*found.values(), *ends]):
            found[f"obstacle {len(found) + 1}"] = spun
    return found


def _turned_about(center: np.ndarray, angle: float) -> rcp.scenes.Pose:
    to, back = rcp.planar_pose(*center.tolist()), rcp.planar_pose(*(-center).tolist())
    return to @ rcp.planar_pose(0, 0, angle) @ back
