"""Safe is what the robot does that integrates the plan's controls, not the polynomial of the plan alone."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from pyomo.dae import ContinuousSet, DerivativeVar
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp

BODY = rcp.Polytope.box(0.4, 0.2)


def car(elements: int, scheme: str = "radau", stages: int | None = None) -> Any:
    """A car on a circle between two posts."""
    m = pyo.ConcreteModel(name="car")
    m.drive = b = rcp.PhaseBlock(duration=3.0, elements=elements, scheme=scheme, stages=stages)
    b.x, b.y, b.heading = rcp.State(initial=1), rcp.State(initial=0), rcp.State(initial=np.pi / 2)
    b.turn = rcp.Control(initial_guess=1.0)
    b.ode(lambda b, t: {b.x: pyo.cos(b.heading[t]), b.y: pyo.sin(b.heading[t]), b.heading: b.turn[t]})
    return m


def posts(m: Any, radius: float, clearance: float) -> Any:
    m.drive.avoid = rcp.ObstacleAvoidanceBlock(
        m.drive.time,
        body=BODY,
        pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.heading[t]),
        obstacles={"post": rcp.Polytope.hull([(0.0, radius)], radius=0.1, allow_flat=True)},
        clearance=clearance,
    )
    return m.drive.avoid


def exact(m: Any) -> Any:
    """The motion of the equations, by SciPy."""
    trajectory = m.drive.trajectory()

    def rates(t: float, s: Any) -> Any:
        return [np.cos(s[2]), np.sin(s[2]), trajectory(t)["turn"]]

    boundaries = trajectory.grid.mesh.boundaries
    state, pieces = [1.0, 0.0, np.pi / 2], []
    for start, end in pairwise(boundaries):
        found = solve_ivp(rates, (np.nextafter(start, end), end), state, rtol=1e-11, atol=1e-12, dense_output=True)
        pieces.append(found.sol(np.linspace(start, end, 40)))
        state = found.y[:, -1]
    return np.concatenate(pieces, axis=1)


@pytest.mark.parametrize(("scheme", "stages"), [("radau", 1), ("radau", 2), ("gauss", 2), ("implicit_euler", None)])
def test_the_deviation_bounds_how_far_every_corner_leaves_the_plan(scheme: str, stages: int | None) -> None:
    m = car(6, scheme, stages)
    m.drive.initialize(m.drive.simulate(method="scheme"))
    report = posts(m, 3.0, 0.1).verify()
    trajectory = m.drive.trajectory()
    x, y, heading = exact(m)
    boundaries = np.array(trajectory.grid.mesh.boundaries)
    planned = trajectory.element_polynomials(np.linspace(0, 1, 40))
    worst = np.zeros(x.shape)
    for corner in BODY.vertices:
        real = np.array([x, y]) + turned(heading, corner)
        plan = np.array([planned["x"].ravel(), planned["y"].ravel()]) + turned(planned["heading"].ravel(), corner)
        worst = np.maximum(worst, np.hypot(*(real - plan)))
    per_element = worst.reshape(len(boundaries) - 1, -1).max(axis=1)
    (pair,) = report.body_pairs
    assert (pair.interval_deviation >= per_element * (1 - 1e-6) - 1e-9).all()
    assert (pair.interval_deviation <= 1.3 * per_element + 1e-8).all()


def turned(angle: Any, corner: Any) -> Any:
    return np.array(
        [np.cos(angle) * corner[0] - np.sin(angle) * corner[1], np.sin(angle) * corner[0] + np.cos(angle) * corner[1]]
    )


def test_a_plan_on_a_coarse_mesh_is_not_called_safe_where_its_equations_lead_closer() -> None:
    m = car(5, "implicit_euler")
    m.drive.initialize(m.drive.simulate(method="scheme"))
    trajectory = m.drive.trajectory()
    # The polynomial stays away from a post that the motion of the equations hits.
    x, y, _ = exact(m)
    at = int(np.argmax(np.hypot(x - trajectory(3.0)["x"], y - trajectory(3.0)["y"])[-40:])) + len(x) - 40
    m.drive.avoid = rcp.ObstacleAvoidanceBlock(
        m.drive.time,
        body=rcp.Polytope.hull([(0.0, 0.0)], radius=0.05, allow_flat=True),
        pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
        obstacles={"post": rcp.Polytope.hull([(float(x[at]), float(y[at]))], radius=0.05, allow_flat=True)},
        clearance=0.01,
    )
    report = m.drive.avoid.verify()
    (pair,) = report.body_pairs
    assert pair.distance > 0.01  # of the plan
    assert pair.verdict == "plan only"
    assert not report.safe
    assert "NOT SAFE" in str(report)
    assert "equations" in str(report)


def test_on_a_fine_mesh_both_motions_are_proven() -> None:
    m = car(40)
    m.drive.initialize(m.drive.simulate())
    report = posts(m, 3.0, 0.1).verify()
    (pair,) = report.body_pairs
    assert report.safe
    assert pair.deviation < 1e-6
    assert pair.proven_of_equations == pytest.approx(pair.proven, abs=1e-6)
    assert "at most" in str(report).splitlines()[1]


def test_points_without_equations_are_about_the_plan_alone_and_say_so() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var([0.0, 1.0, 2.0], initialize=lambda m, t: t)
    m.avoid = rcp.ObstacleAvoidanceBlock(
        [0.0, 1.0, 2.0],
        body=BODY,
        pose=lambda m, t: rcp.planar_pose(m.x[t], 0.0),
        obstacles={"post": rcp.Polytope.box(0.1, 0.1, center=(0.0, 2.0))},
        clearance=0.1,
    )
    report = m.avoid.verify()
    assert report.safe
    assert report.body_pairs[0].deviation == 0.0
    assert report.equations == ""


def test_what_one_phase_leaves_behind_the_next_starts_with() -> None:
    """Two linked phases on a coarse mesh drift as one phase with the same elements does."""

    def states(b: Any, start: Any) -> None:
        b.x, b.y = rcp.State(initial=start[0]), rcp.State(initial=start[1])
        b.ode(lambda b, t: {b.x: 0.3 * b.y[t], b.y: pyo.cos(2 * b.time_at(t)) - 0.2 * b.y[t]})

    whole = pyo.ConcreteModel()
    whole.move = rcp.PhaseBlock(duration=2.0, elements=8, scheme="implicit_euler")
    states(whole.move, (0.0, 1.0))
    whole.move.initialize(whole.move.simulate(method="scheme"))
    halves = pyo.ConcreteModel()
    halves.one = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    halves.two = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler", start=halves.one)
    states(halves.one, (0.0, 1.0))
    states(halves.two, (None, None))
    halves.link = rcp.Link(halves.one, halves.two)
    halves.one.initialize(halves.one.simulate(method="scheme"))
    halves.two.initialize(
        halves.two.simulate(method="scheme", initial=halves.link.start_after(halves.one.trajectory()))
    )

    def deviation(m: Any, phase: Any) -> Any:
        phase.avoid = rcp.ObstacleAvoidanceBlock(
            phase.time,
            body=BODY,
            pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
            obstacles={"post": rcp.Polytope.box(0.1, 0.1, center=(9.0, 9.0))},
            clearance=0.1,
        )
        return phase.avoid.verify().body_pairs[0].interval_deviation

    expected = deviation(whole, whole.move)
    found = np.concatenate([deviation(halves, halves.one), deviation(halves, halves.two)])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert expected[4] > 1.2 * expected[0]


def test_a_periodic_motion_starts_at_the_plan() -> None:
    m = car(6)
    m.drive.initialize(m.drive.simulate())
    m.again = rcp.Link(m.drive, m.drive, states=["x"])
    assert posts(m, 3.0, 0.1).verify().safe


def test_what_pyomo_dae_holds_is_about_the_plan_alone_and_says_so() -> None:
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0, 1))
    m.x = pyo.Var(m.t, initialize=0.0)
    m.rate = DerivativeVar(m.x, wrt=m.t)
    m.move = pyo.Constraint(m.t, rule=lambda m, t: m.rate[t] == 1)
    pyo.TransformationFactory("dae.collocation").apply_to(m, nfe=3, ncp=2)
    m.avoid = rcp.ObstacleAvoidanceBlock(
        m.t,
        body=BODY,
        pose=lambda m, t: rcp.planar_pose(m.x[t], 0.0),
        obstacles={"post": rcp.Polytope.box(0.1, 0.1, center=(0.0, 2.0))},
        clearance=0.1,
    )
    assert "the motion of the equations is not known" in str(m.avoid.verify())
