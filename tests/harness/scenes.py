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


def at_place(b: Any, t: Any) -> rcp.scenes.Pose:
    """The pose made of two states."""
    return rcp.planar_pose(b.x[t], b.y[t])


def on_the_line(b: Any, t: Any) -> rcp.scenes.Pose:
    """The pose made of one state."""
    return rcp.planar_pose(b.x[t], 0.0)


def along_its_heading(b: Any, t: Any) -> rcp.scenes.Pose:
    """The pose of what drives where it looks."""
    return rcp.planar_pose(b.x[t], b.y[t], b.heading[t])


def post(x: float, y: float) -> dict[str, rcp.Polytope]:
    """An obstacle of a tenth of a metre."""
    return {"post": rcp.Polytope.box(0.1, 0.1, center=(x, y))}


def keep_clear(
    b: Any, body: Any, obstacles: Any, pose: Any = at_place, clearance: Any = 0.05, **options: Any
) -> rcp.ObstacleAvoidanceBlock:
    """One body of a phase keeps clear of obstacles, as its block ``avoid`` says."""
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, body=body, pose=pose, obstacles=obstacles, clearance=clearance, **options
    )
    return b.avoid


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


def state_point(b: Any, start: Any = (0, 0), end: Any = (4, 0)) -> None:
    """A point with the states ``x`` and ``y``, whose rates are the controls ``u`` and ``v``."""
    b.x, b.y = (rcp.State(initial=first, final=last) for first, last in zip(start, end, strict=True))
    b.u, b.v = rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.v[t]})


def rigid_body(b: Any, start: Any, end: Any, within: Any = (None, None), **rates: Any) -> None:
    """A body with the states ``x``, ``y`` and ``theta``, guessed on lines; controls, with options, are their rates."""
    for name, first, last in zip(("x", "y", "theta"), start, end, strict=True):
        b.declare(name, rcp.State(initial=first, final=last, bounds=within))
        b.declare(f"{name}_rate", rcp.Control(**rates))
    b.ode(lambda b, t: {b.x: b.x_rate[t], b.y: b.y_rate[t], b.theta: b.theta_rate[t]})
    b.initialize_straight_lines()


def effort_of(b: Any) -> Any:
    """Of a rigid body."""
    return b.integral(lambda b, t: b.x_rate[t] ** 2 + b.y_rate[t] ** 2 + b.theta_rate[t] ** 2)


def wall_with_opening(at: float, width: float, thickness: float) -> list[rcp.Polytope]:
    """Two boxes of ten metres across the x axis, with an opening between them."""
    boxes = ((side, at + side * (width / 2 + 5.0)) for side in (-1, 1))
    return [rcp.Polytope.box(thickness, 10.0, center=(0, y), name=f"{side}") for side, y in boxes]


def through_a_wall(
    pose: Any = placed, at: float = 1.2, bounds: Any = (-5, 5), end: Any = (2, 0.3, 0.5)
) -> pyo.ConcreteModel:
    """A box, and a straight guess from (-2, 0, 0) through a wall beside its opening."""
    m = pyo.ConcreteModel(name="through a wall")
    m.move = b = rcp.PhaseBlock(duration=5.0, elements=12, stages=2)
    rigid_body(b, (-2, 0, 0), end, within=bounds, bounds=(-9, 9))
    keep_clear(b, rcp.Polytope.box(0.4, 0.2), wall_with_opening(at, 0.8, 0.1), pose)
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


def sampled_distance(trajectory: Any, body: rcp.Polytope, obstacles: Any, times: np.ndarray) -> float:
    """The smallest one on the trajectory itself, looked at independently of any proof."""
    found = trajectory(times)
    poses = [rcp.planar_pose(*each) for each in zip(found["x"], found["y"], found["theta"], strict=True)]
    return min(rcp.scenes.signed_distance(body, each, pose).distance for pose in poses for each in obstacles)


def solve_once(m: pyo.ConcreteModel) -> None:
    """One run of Ipopt on the rows as they stand, without the rounds that `rcp.solve` adds."""
    result = pyo.SolverFactory("ipopt").solve(m, options={"bound_relax_factor": 0})
    pyo.assert_optimal_termination(result)
