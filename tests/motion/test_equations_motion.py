"""Safe is what the robot does that integrates the plan's controls, not the polynomial of the plan alone."""

from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import along_its_heading, keep_clear
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


DOT = rcp.Polytope.ball(0.05)


def posts(m: Any, radius: float, clearance: float) -> Any:
    keep_clear(m.drive, BODY, {"post": rcp.Polytope.ball(0.1, (0.0, radius))}, along_its_heading, clearance)
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


@pytest.mark.parametrize(("scheme", "stages"), [("radau", 2), ("implicit_euler", None)])
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
    # eq-deviation, by the states of the re-integration.
    motion = m.drive.reintegrate()
    led, stated = (
        [np.array([s["x"], s["y"]]) + turned(s["heading"], corner) for corner in BODY.vertices]
        for s in (motion.open_loop, motion.planned)
    )
    expected = 1.1 * np.linalg.norm(np.subtract(led, stated), axis=1).max(axis=(0, 2))
    np.testing.assert_allclose(pair.interval_deviation, expected, rtol=1e-9)


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
    keep_clear(m.drive, DOT, {"post": rcp.Polytope.ball(0.05, (float(x[at]), float(y[at])))}, clearance=0.01)
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


def test_a_periodic_motion_starts_at_the_plan() -> None:
    m = car(6)
    m.drive.initialize(m.drive.simulate())
    m.again = rcp.Link(m.drive, m.drive, states=["x"])
    assert posts(m, 3.0, 0.1).verify().safe


def test_a_wall_that_is_never_touched_hides_nothing_of_the_motion() -> None:
    """A force field through accelerations as Algebraic: the plan keeps clear of a post that the true motion hits."""
    m = pyo.ConcreteModel(name="field")
    m.drive = b = rcp.PhaseBlock(duration=2.0, elements=5, stages=2)
    b.x, b.y, b.v, b.w = (rcp.State(initial=start) for start in (0.0, 0.1, 0.0, 0.0))
    b.a, b.b, b.push = rcp.Algebraic(), rcp.Algebraic(), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.v[t], b.y: b.w[t], b.v: b.a[t], b.w: b.b[t]})
    b.complementarity(lambda b, t: rcp.complements(b.push[t] >= 0, b.push[t] / 50 + b.x[t] + 5.0 >= 0))

    @b.constraint
    def field(b: Any, t: Any) -> Any:
        return [b.a[t] == 1 + 8 * pyo.sin(3 * b.y[t]) + b.push[t], b.b[t] == 8 * pyo.sin(3 * b.x[t])]

    for variable in b.component_data_objects(pyo.Var):
        variable.set_value(0.0)
    b.y[0.0].set_value(0.1)
    motion = b.reintegrate()
    exact = solve_ivp(
        lambda t, s: [s[2], s[3], 1 + 8 * np.sin(3 * s[1]), 8 * np.sin(3 * s[0])], (0, 2), [0, 0.1, 0, 0],
        rtol=1e-10, atol=1e-11, dense_output=True,
    )  # fmt: skip
    times = (np.arange(5)[:, None] + motion.fractions) * 0.4
    x, y = exact.sol(times.ravel())[:2]
    np.testing.assert_allclose(motion.open_loop["x"].ravel(), x, atol=1e-4)
    np.testing.assert_allclose(motion.open_loop["y"].ravel(), y, atol=1e-4)
    keep_clear(b, DOT, {"post": rcp.Polytope.ball(0.05, (float(x[-1]), float(y[-1])))}, clearance=0.01)
    report = b.avoid.verify()
    assert report.body_pairs[0].distance > 0.01  # of the plan
    assert not report.safe
    assert "simulated with contact" in str(report)
