"""Exact ellipses and ellipsoids are planned around and proven; their surfaces, sampled, say the same."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from scipy.spatial.distance import cdist

import pyrobocop_pyomo as rcp

pytestmark = pytest.mark.casadi

CLEARANCE = 0.05
ellipsoid = rcp.Polytope.ellipsoid


def turning_body(names: str, **avoidance: Any) -> pyo.ConcreteModel:
    """A body that is pushed from the origin to x = 4 and may turn about one axis; what is given is to be kept clear."""
    m = pyo.ConcreteModel(name="ellipsoid")
    m.move = b = rcp.PhaseBlock(duration=4.0, elements=12)
    places = [*names, "theta"]
    for name in places:
        b.declare(name, rcp.State(initial=0, final=4.0 if name == "x" else 0.0))
        b.declare(f"{name}_rate", rcp.State(initial=0, final=0))
        b.declare(f"{name}_force", rcp.Control(bounds=(-3, 3)))

    @b.ode
    def motion(b: Any, t: float) -> dict[str, Any]:
        rates = {name: b.component(f"{name}_rate")[t] for name in places}
        return {**rates, **{f"{name}_rate": b.component(f"{name}_force")[t] for name in places}}

    def pose(b: Any, t: float) -> rcp.geometry.Pose:
        place = [b.component(name)[t] for name in names]
        return (
            rcp.planar_pose(*place, b.theta[t]) if names == "xy" else rcp.spatial_pose(place, euler=(0, 0, b.theta[t]))
        )

    region = avoidance.pop("region", None)
    b.avoid = rcp.ObstacleAvoidanceBlock(b.time, pose=pose, clearance=CLEARANCE, **avoidance)
    if region is not None:
        b.inside = rcp.Containment(b.time, body=avoidance["body"], pose=pose, region=region)
    b.initialize_straight_lines()
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: sum(b.component(f"{name}_force")[t] ** 2 for name in places)))
    return m


def surface(semi_axes: tuple[float, ...]) -> np.ndarray:
    unit = np.random.default_rng(0).normal(size=(400 if len(semi_axes) == 2 else 1500, len(semi_axes)))
    return np.asarray(unit / np.linalg.norm(unit, axis=1)[:, None] * semi_axes)


@pytest.mark.parametrize(
    ("body", "rock", "middle"),
    [
        ((0.6, 0.2), (0.5, 0.8), (2.0, 0.1)),
        ((0.6, 0.2, 0.3), (0.5, 0.8, 0.4), (2.0, 0.1, 0.05)),
    ],
    ids=["plane", "space"],
)
def test_an_ellipsoid_passes_another_one(body: Any, rock: Any, middle: Any) -> None:
    m = turning_body("xyz"[: len(body)], body=ellipsoid(body), obstacles={"rock": ellipsoid(rock, middle)})
    result = rcp.solve(m, progress=False)
    assert result.safe is True
    b, moving, resting = m.move, surface(body), surface(rock) + middle
    at = b.trajectory()(np.linspace(0.0, 4.0, 121))
    c, s = np.cos(at["theta"]), np.sin(at["theta"])
    closest = np.inf
    for k in range(121):
        turn = np.eye(len(body))
        turn[:2, :2] = [[c[k], -s[k]], [s[k], c[k]]]
        place = [at[name][k] for name in "xyz"[: len(body)]]
        closest = min(closest, cdist(moving @ turn.T + place, resting).min())
    assert closest >= 0.99 * CLEARANCE
    assert closest <= 3.0 * CLEARANCE  # the detour is no longer than it has to be


def test_an_ellipse_stays_inside_and_turns_to_pass() -> None:
    """The way between rock and wall is narrower than the ellipse is long."""
    body, region = (0.6, 0.2), rcp.Polytope.box(8.0, 1.6, center=(2.0, 0.4))
    m = turning_body("xy", body=ellipsoid(body), obstacles={"rock": ellipsoid((0.5, 0.4), (2.0, -0.1))}, region=region)
    result = rcp.solve(m, progress=False)
    assert result.safe is True
    at = m.move.trajectory()(np.linspace(0.0, 4.0, 121))
    high = at["y"] + np.hypot(0.6 * np.sin(at["theta"]), 0.2 * np.cos(at["theta"]))
    assert high.max() <= 1.2 + 1e-6
