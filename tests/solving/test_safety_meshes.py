"""Plans on meshes that are too coarse for their equations: refined in place, or kept away by margins."""

import time
from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from harness.scenes import along_its_heading, keep_clear
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.motion.equations_motion import needed_reductions
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.planning import mesh_loop
from pyrobocop_pyomo.planning.recovery import PlanningPoint

pytestmark = pytest.mark.ipopt


CLEARANCE = 0.05
POST = (1.0, 0.0)
BODY, ROUND = rcp.Polytope.box(0.2, 0.1), {"post": rcp.Polytope.ball(0.2, POST)}


def unicycle(elements: int, scheme: str = "radau", stages: int | None = 1) -> Any:
    """Around a post, on few elements of low order."""
    m, b = one_phase("move", model="unicycle", duration=2.0, elements=elements, scheme=scheme, stages=stages)
    b.x, b.y = rcp.State(initial=0, final=2), rcp.State(initial=0, final=0.2)
    b.heading = rcp.State(initial=0.8)
    b.speed, b.turn = rcp.Control(bounds=(0, 3)), rcp.Control(bounds=(-4, 4))
    b.ode(
        lambda b, t: {
            b.x: b.speed[t] * pyo.cos(b.heading[t]), b.y: b.speed[t] * pyo.sin(b.heading[t]), b.heading: b.turn[t]
        }
    )  # fmt: skip
    keep_clear(b, BODY, ROUND, along_its_heading, CLEARANCE)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.speed[t] ** 2 + 0.1 * b.turn[t] ** 2))
    b.initialize(x=lambda t: t, y=lambda t: 0.4 * np.sin(np.pi * t / 2), speed=1.0)
    return m


def closest(m: Any) -> float:
    """Distance of the motion that SciPy makes of the controls from the post, over the corners of the body."""
    trajectory = m.move.trajectory()
    state, least = [0.0, 0.0, 0.8], np.inf
    corners = [(s * 0.1, r) for s in (-1, 1) for r in np.linspace(-0.05, 0.05, 21)]
    corners += [(s, r * 0.05) for r in (-1, 1) for s in np.linspace(-0.1, 0.1, 41)]
    for start, end in pairwise(trajectory.grid.mesh.boundaries):

        def rates(t: float, s: Any, start: float = start, end: float = end) -> Any:
            u = trajectory(max(t, np.nextafter(start, end)))
            return [u["speed"] * np.cos(s[2]), u["speed"] * np.sin(s[2]), u["turn"]]

        found = solve_ivp(rates, (start, end), state, rtol=1e-10, atol=1e-10, t_eval=np.linspace(start, end, 40))
        state = found.y[:, -1]
        for x, y, heading in found.y.T:
            for a, b in corners:
                place = (x + np.cos(heading) * a - np.sin(heading) * b, y + np.sin(heading) * a + np.cos(heading) * b)
                least = min(least, np.hypot(place[0] - POST[0], place[1] - POST[1]) - 0.2)
    return float(least)


def test_a_mesh_that_is_too_coarse_is_refined_and_the_rounds_say_so() -> None:
    m = unicycle(6)
    final = m.move.x[m.move.final_time]
    result = rcp.solve(m)
    assert result.safe
    assert m.move.grid.mesh.elements > 6
    assert any("elements of 'move' from 6 to" in made.purpose for made in result.rounds)
    assert m.move.x[m.move.final_time] is final
    assert closest(m) >= 0.99 * CLEARANCE
    assert m.move.trajectory().verify().largest_violation < 1e-6


def in_a_field(elements: int) -> Any:
    """Past a post in a field of forces that drives the motion away from a plan on few elements."""
    m, b = one_phase("move", model="field", duration=4.0, elements=elements)
    b.p, b.v = rcp.State(index=2, initial=0, final=[2, 0.2]), rcp.State(index=2, initial=0)
    b.a = rcp.Control(index=2, bounds=(-20, 20))
    b.ode(lambda b, t: {b.p: b.v[t], b.v: b.a[t] + 8 * np.array([pyo.sin(3 * b.p[1, t]), pyo.sin(3 * b.p[0, t])])})
    keep_clear(b, BODY, ROUND, lambda b, t: rcp.planar_pose(b.p[0, t], b.p[1, t], 0.0), CLEARANCE)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.a[t] @ b.a[t]))
    b.initialize(p=lambda t: [t / 2, 0.4 * np.sin(np.pi * t / 4)])
    return m


def test_few_elements_to_start_with_are_no_limit_to_how_many_there_may_be() -> None:
    m = in_a_field(4)
    result = rcp.solve(m)
    assert result.safe
    assert len(result.rounds) <= 10
    assert m.move.grid.mesh.elements > 32


def in_two_phases() -> Any:
    """A turn on six elements of order one, then straight past a post on more of a higher order."""
    m = pyo.ConcreteModel(name="two phases")
    m.turn = rcp.PhaseBlock(duration=1.0, elements=6, stages=1)
    m.along = rcp.PhaseBlock(duration=1.0, elements=8, stages=2)
    for b, start in ((m.turn, 0), (m.along, None)):
        b.x, b.y = rcp.State(initial=start), rcp.State(initial=start)
        b.heading = rcp.State(initial=start if start is None else 1.2)
        b.turning = rcp.Control(bounds=(-4, 4))
        b.ode(lambda b, t: {b.x: pyo.cos(b.heading[t]), b.y: pyo.sin(b.heading[t]), b.heading: b.turning[t]})
    m.link = rcp.Link(m.turn, m.along)
    square = {"post": rcp.Polytope.box(0.3, 0.3, center=(1.2, 0.35))}
    keep_clear(m.along, BODY, square, along_its_heading, CLEARANCE)
    m.end = pyo.Constraint(expr=m.along.y[m.along.final_time] == 0.6)
    cost = sum(b.integral(lambda b, t: b.turning[t] ** 2) for b in (m.turn, m.along))
    m.cost = pyo.Objective(expr=cost)
    m.turn.initialize(x=lambda t: 0.8 * t, y=lambda t: 0.6 * t, heading=lambda t: 1.2 - t)
    m.along.initialize(x=lambda t: 0.8 + t, y=0.6, heading=0.0)
    return m


def test_of_linked_phases_the_one_that_errs_is_refined() -> None:
    m = in_two_phases()
    result = rcp.solve(m)
    assert result.safe
    assert m.turn.grid.mesh.elements > 6
    assert m.along.grid.mesh.elements <= 16


def test_errors_are_traced_back_to_the_phase_that_makes_them() -> None:
    m = in_two_phases()
    rates = {"turning": lambda t: -1.0}
    m.turn.initialize(m.turn.simulate(controls=rates, method="scheme"))
    ends = {name: m.turn.component(name)[1.0].value for name in ("x", "y", "heading")}
    m.along.initialize(m.along.simulate(controls={"turning": lambda t: 0.0}, initial=ends, method="scheme"))
    (first,) = needed_reductions(m.along, 0.1)
    assert first == (m.turn, pytest.approx(0.1, rel=0.2))
    # On its own the later phase is exact; the earlier one is its own cause.
    assert needed_reductions(m.turn, 0.1) == [(m.turn, 0.1)]


def test_small_deviations_are_covered_by_margins_on_the_users_mesh() -> None:
    m = unicycle(10, stages=2)
    result = rcp.solve(m)
    assert result.safe
    assert m.move.grid.mesh.elements == 10
    assert closest(m) >= 0.99 * CLEARANCE


def test_what_cannot_be_refined_keeps_its_mesh_and_is_not_called_safe_falsely() -> None:
    """A row that the user states on a point in the middle of an element, by its number, cannot follow."""
    m = unicycle(4, stages=2)
    inner = sorted(m.move.time)[1]
    m.own = pyo.Constraint(expr=m.move.y[inner] >= -5)
    result = rcp.solve(m)
    assert m.move.grid.mesh.elements == 4
    assert not result.safe or closest(m) >= 0.99 * CLEARANCE


def test_a_planning_point_goes_back_to_its_mesh() -> None:
    m = unicycle(5)
    before = {index: variable.value for index, variable in m.move.x.items()}
    point = PlanningPoint(m)
    m.move.remesh(12)
    for variable in m.move.x.values():
        variable.value = variable.value if variable.fixed else 7.0
    point.restore()
    assert {index: variable.value for index, variable in m.move.x.items()} == before
    assert m.move.grid.mesh.elements == 5
    point.restore()


@pytest.mark.parametrize("limit", [40.0, 60.0, 100.0, 130.0, 160.0, 220.0])
def test_a_round_that_could_not_be_verified_in_time_is_not_begun(limit: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Here only verifying takes time, and integrating again for a finer mesh as well: one second for each element."""
    clock, m = [0.0], unicycle(6)
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])

    def slow(old: Any) -> Any:
        def slowly(*arguments: Any, **options: Any) -> Any:
            clock[0] += m.move.grid.mesh.elements
            return old(*arguments, **options)

        return slowly

    monkeypatch.setattr(ObstacleAvoidanceBlockData, "verify", slow(ObstacleAvoidanceBlockData.verify))
    monkeypatch.setattr(mesh_loop, "reintegrate", slow(mesh_loop.reintegrate))
    result = rcp.solve(m, time_limit=limit)
    assert clock[0] <= limit
    assert result.safe or result.stop_reason is rcp.StopReason.TIME_LIMIT
    assert result.quality is not rcp.Quality.INFEASIBLE
