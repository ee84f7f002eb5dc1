"""Small scenes with obstacles, to be stated in several ways."""

from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

# Neither symmetric nor centred: a footprint that is mirrored or turned the wrong way shows.
ARROW = rcp.Polytope.from_vertices([(-0.3, -0.2), (0.5, -0.1), (0.6, 0.1), (-0.3, 0.3)], name="arrow")
WALL = rcp.Polytope.from_vertices([(1.5, -1.5), (2.4, -1.5), (2.2, 0.4), (1.6, 0.5)], name="wall")


def placed(block: Any, t: Any) -> rcp.scenes.Pose:
    """Pose rule at the top level, so that a pickle can hold it."""
    return rcp.planar_pose(block.x[t], block.y[t], block.theta[t])


def turning_move(elements: int = 8, height: float = 1.6, stages: int = 2, turn: float = 0.6) -> pyo.ConcreteModel:
    """A body that moves from x = 0 to x = 4 while it turns, guessed on an arc of a given height."""
    m = pyo.ConcreteModel(name="turning move")
    m.move = b = rcp.PhaseBlock(duration=1.0, elements=elements, stages=stages)
    b.x = rcp.State(initial=0, final=4, initial_guess=lambda t: 4 * t)
    b.y = rcp.State(initial=0, final=0, initial_guess=lambda t: 4 * height * t * (1 - t))
    b.theta = rcp.State(initial=0, final=turn, initial_guess=lambda t: turn * t)
    b.u, b.v, b.w = rcp.Control(), rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.v[t], b.theta: b.w[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.v[t] ** 2 + b.w[t] ** 2))
    return m


def avoiding(m: pyo.ConcreteModel, **options: Any) -> Any:
    """The arrow keeps clear of the wall, unless options say otherwise."""
    options.setdefault("bodies", {"arrow": rcp.Body(ARROW, pose=placed)})
    options.setdefault("obstacles", {"wall": WALL})
    options.setdefault("clearance", 0.05)
    m.move.avoid = rcp.ObstacleAvoidanceBlock(options.pop("points", m.move.time), **options)
    return m.move.avoid


def set_poses(block: Any, poses: np.ndarray) -> None:
    """Values of x, y and theta over all times, (k, 3)."""
    for time, (x, y, theta) in zip(block.time, poses, strict=True):
        block.x[time].set_value(x)
        block.y[time].set_value(y)
        block.theta[time].set_value(theta)


def exact(block: Any, body: rcp.Polytope, obstacle: rcp.Polytope, times: Any) -> list[float]:
    """Exact signed distances at times."""
    return [rcp.scenes.signed_distance(body, obstacle, placed(block, t)).distance for t in times]


def solve_once(m: pyo.ConcreteModel) -> None:
    """One run of Ipopt on the rows as they stand, without the rounds that `rcp.solve` adds."""
    result = pyo.SolverFactory("ipopt").solve(m, options={"bound_relax_factor": 0})
    pyo.assert_optimal_termination(result)
