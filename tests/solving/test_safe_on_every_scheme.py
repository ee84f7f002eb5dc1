"""A plan is proven safe whatever the scheme, with free durations, moving elements and continuous sets alike."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.scenes import effort_of, keep_clear, placed, rigid_body, sampled_distance
from scipy.spatial.distance import cdist

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs import function_rows
from pyrobocop_pyomo.programs.vectorised_program import VectorisedProgram

pytestmark = pytest.mark.casadi

BODY = rcp.Polytope.from_vertices([(-0.3, -0.2), (0.5, -0.2), (0.2, 0.3)], name="body")
WALL = rcp.Polytope.box(0.6, 1.0, center=(0.0, -0.3), name="wall")
CLEARANCE = 0.05

SCHEMES: list[tuple[str, int | None]] = [
    ("implicit_euler", None), ("radau", 2), ("gauss", 2), ("lobatto", 3), ("trapezoid", None), ("explicit_euler", None),
]  # fmt: skip


def build(**options: Any) -> pyo.ConcreteModel:
    """Over the wall, turning once on the way."""
    m, b = one_phase("move", model="over the wall", **{"duration": 4.0, "elements": 12, **options})
    kind = "piecewise_linear" if b.grid.elements_share_points else "piecewise_constant"
    rigid_body(b, (-1.5, 0, 0), (1.5, 0, 2.0), bounds=(-3, 3), parametrization=kind)
    m.effort = pyo.Objective(expr=effort_of(b) + b.duration)
    keep_clear(b, BODY, [WALL], placed, CLEARANCE)
    return m


def closest(m: pyo.ConcreteModel) -> float:
    """By the judge, 400 times per element."""
    trajectory = m.move.trajectory()
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    times = np.unique(boundaries[:-1, None] + np.diff(boundaries)[:, None] * np.linspace(0, 1, 401))
    return sampled_distance(trajectory, BODY, [WALL], times)


@pytest.mark.parametrize(("scheme", "stages"), SCHEMES)
def test_every_scheme(scheme: str, stages: int | None) -> None:
    m = build(scheme=scheme, **({} if stages is None else {"stages": stages}))
    result = rcp.solve(m, progress=False)
    result.raise_for_status()
    assert result.safe
    assert closest(m) >= 0.99 * CLEARANCE - 1e-9


def test_a_free_duration_and_moving_elements() -> None:
    m = build(duration=rcp.Duration(bounds=(1, 10), initial_guess=4), stages=2, free_element_widths=(0.4, 2.5))
    rcp.solve(m, progress=False).raise_for_status()
    assert closest(m) >= 0.99 * CLEARANCE - 1e-9


@pytest.mark.asl
def test_what_vectorised_expressions_do_not_know_is_left_to_asl(monkeypatch: pytest.MonkeyPatch) -> None:
    m = build(elements=6, stages=2)
    assert "vectorised" in rcp.solve(m, progress=False).derivatives

    # What vectorised expressions do not know are external functions, which need a library of their own.
    class Refusing(VectorisedProgram):
        def __init__(self, *_: Any) -> None:
            raise ModelError("an expression holds an external function")

    monkeypatch.setattr(function_rows, "VectorisedProgram", Refusing)
    result = rcp.solve(build(elements=6, stages=2), progress=False)
    assert "ASL" in result.derivatives
    assert result.safe
    with pytest.raises(ModelError, match="external function"):
        rcp.solve(build(elements=6, stages=2), backend="vectorised", progress=False)


# --------------------------------------------------------------------
# Exact ellipses and ellipsoids are planned around and proven; their surfaces, sampled, say the same.


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
