"""Moving bodies for tests: scenes on plain points and on phases, and distances by another library."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pyomo.environ as pyo
import shapely

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.motion import Body, SafetyReport, motion_of, verify_clearance


def on_points(poses: Sequence[Sequence[float]], times: Sequence[float] | None = None) -> pyo.ConcreteModel:
    """A model with ``x``, ``y`` and ``theta`` at points, between which they change linearly."""
    m = pyo.ConcreteModel()
    m.t = pyo.Set(initialize=list(range(len(poses)) if times is None else times), ordered=True)
    m.x, m.y, m.theta = pyo.Var(m.t), pyo.Var(m.t), pyo.Var(m.t)
    for time, pose in zip(m.t, poses, strict=True):
        m.x[time], m.y[time], m.theta[time] = map(float, pose)
    return m


def on_a_phase(
    path: Callable[[float], Sequence[float]], scheme: str = "radau", stages: int | None = 3, **options: Any
) -> pyo.ConcreteModel:
    """A model with a phase ``move`` whose states ``x``, ``y``, ``theta`` have the values of a path in indices.

    Their rates are variables, set to the path's slopes by central differences. Where the end of an element is no node
    of its own, the polynomials decide its value: a motion does not jump.
    """
    m = pyo.ConcreteModel()
    m.move = b = rcp.PhaseBlock(scheme=scheme, stages=stages, **options)
    for name in ("x", "y", "theta"):
        setattr(b, name, rcp.State())
        setattr(b, f"v_{name}", rcp.Algebraic())
    b.ode(lambda b, t: {b.x: b.v_x[t], b.y: b.v_y[t], b.theta: b.v_theta[t]})
    for k, name in enumerate(("x", "y", "theta")):
        for time in b.time:
            b.component(name)[time] = path(time)[k]
        _join_elements(b, b.component(name))
        for time in b.points:
            slope = (path(time + 1e-5)[k] - path(time - 1e-5)[k]) / 2e-5
            b.component(f"v_{name}")[time] = slope / (pyo.value(b.duration) if b.has_normalised_time else 1.0)
    return m


def _join_elements(b: Any, state: Any) -> None:
    scheme = b.grid.scheme
    if not scheme.end_is_a_node:
        for nodes, end in zip(b.grid.node_times, b.grid.mesh.boundaries[1:], strict=True):
            state[end] = float(scheme.end_weights @ [state[node].value for node in nodes])


def by_states(b: Any, t: Any) -> Any:
    """The pose made of the three states."""
    return planar_pose(b.x[t], b.y[t], b.theta[t])


def check(
    m: Any,
    shape: Polytope,
    obstacles: Sequence[Any],
    clearance: float,
    *,
    points: Any = None,
    pose: Callable[[Any, Any], Any] = by_states,
    **options: Any,
) -> SafetyReport:
    """The report on one body and several obstacles."""
    bodies = {"body": Body(shape, pose)}
    bodies |= {
        f"obstacle {i}": given if isinstance(given, Body) else Body(given) for i, given in enumerate(obstacles, 1)
    }
    clearances = {("body", name): clearance for name in bodies if name != "body"}
    return verify_clearance(
        motion_of(m.t if points is None else points, m), bodies, clearances, **{"equations": False, **options}
    )


def placed(vertices: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Corners at many planar poses (m, 3), shape ``(m, v, 2)``."""
    x, y, theta = poses.T
    rotation = np.stack([np.cos(theta), -np.sin(theta), np.sin(theta), np.cos(theta)], axis=1).reshape(-1, 2, 2)
    return np.einsum("mrc,ic->mir", rotation, vertices) + np.stack([x, y], axis=1)[:, None, :]


def distances_by_shapely(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances of polygons (m, v, 2), zero where they overlap."""
    return np.asarray(shapely.distance(shapely.polygons(first), shapely.polygons(second)))


def sampled(poses: Sequence[Sequence[float]], count: int) -> np.ndarray:
    """Poses on the lines between given ones, ``count`` in each interval, shape ``((n - 1) * count + 1, 3)``."""
    given = np.asarray(poses, dtype=float)
    at = np.linspace(0, len(given) - 1, (len(given) - 1) * count + 1)
    return np.stack([np.interp(at, np.arange(len(given)), column) for column in given.T], axis=1)
