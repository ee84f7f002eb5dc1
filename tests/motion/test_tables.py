"""Bodies that move along tables and parameters: as the rows say, at every instant between them too."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import check, on_a_phase
from harness.phases import integrator
from harness.scenes import keep_clear, on_the_line
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError, ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.motion import Body, motion_of
from pyrobocop_pyomo.motion.moving_shapes import template_of
from pyrobocop_pyomo.numerics.interval_arithmetic import TaylorForm, taylor_form_of_polynomial

BOX = Polytope.box(1, 1)
TIMES = [0.0, 0.4, 0.5, 1.3, 2.0]
XS, YS = [0.0, 1.0, 0.5, 3.0, 3.0], [0.0, 0.0, 1.0, -2.0, 0.0]


def ramp(low: np.ndarray, high: np.ndarray) -> TaylorForm:
    """The time itself on subintervals, over fractions of them."""
    ends, slope = np.stack([low, high], axis=1), (high - low)[:, None]
    return taylor_form_of_polynomial((ends, slope, np.zeros_like(slope)))


@given(
    st.lists(st.integers(-300, 300).map(lambda hundredths: hundredths / 100), min_size=6, max_size=9),
    st.sampled_from(["linear", "cubic", "natural", "quintic", "monotone"]),
    st.sampled_from(["constant", "linear"]),
    st.tuples(st.integers(-50, 250), st.integers(1, 200)).map(lambda pair: (pair[0] / 100, pair[1] / 100)),
)
def test_bounds_contain_values_slopes_and_curvatures(
    numbers: list[float], kind: Any, outside: Any, part: tuple[float, float]
) -> None:
    table = rcp.Table(np.linspace(0.0, 2.0, len(numbers)) ** 1.5, numbers, kind=kind, outside=outside)
    low, high = part[0], part[0] + part[1]
    form = table.taylor_form(ramp(np.array([low]), np.array([high])))
    at = np.linspace(low, high, 201)[:, None]
    for bound, found, scale in (
        (form.value, table.values(at), 1.0),
        (form.first, table.jacobians(at)[..., 0], part[1]),
        (form.second, table.hessians(at)[..., 0, 0], part[1] ** 2),
    ):
        slack = 1e-9 * (1 + np.abs(found * scale).max())
        assert bound.low[0] <= (found * scale).min() + slack
        assert bound.high[0] >= (found * scale).max() - slack
        assert bound.low[0] >= -np.inf


@pytest.mark.parametrize("kind", ["linear", "cubic", "natural", "monotone"])
def test_bounds_of_short_parts_are_close(kind: Any) -> None:
    table, edges = rcp.Table(TIMES, XS, kind=kind), np.linspace(0.0, 2.0, 2001)
    form = table.taylor_form(ramp(edges[:-1], edges[1:]))
    assert np.max(form.value.high - form.value.low) < 0.03
    assert np.isnan(table.taylor_form(ramp(np.array([-0.5]), np.array([0.5]))).value.low).all()  # it is not to be read


def test_a_line_from_row_to_row_has_no_bound_of_its_curvature_at_a_row() -> None:
    table = rcp.Table(TIMES, XS, kind="linear")
    np.testing.assert_allclose(table(np.linspace(0, 2, 77)), np.interp(np.linspace(0, 2, 77), TIMES, XS), atol=1e-12)
    form = table.taylor_form(ramp(np.array([0.0, 0.3]), np.array([0.4, 0.6])))
    assert form.second.high[0] < 1e-9
    assert form.second.high[1] == np.inf


def along(kind: Any = "linear", **options: Any) -> Any:
    """The pose rule of a body that moves along the rows."""
    x, y = (rcp.Table(TIMES, of, kind=kind, **options) for of in (XS, YS))
    heading = rcp.Table(TIMES, [0, 0.3, 0.2, 0.1, 0], kind=kind, **options)
    return lambda b, t: planar_pose(x(t), y(t), heading(t))


def crossing(truck: Any, clearance: float) -> Any:
    m = on_a_phase(lambda t: (0.5 * t, 3, 0), elements=3, duration=2.0)
    return check(
        m, BOX, [Body(BOX, truck)], clearance, points=m.move.time, pose=lambda m, t: planar_pose(m.move.x[t], 3.0)
    )


@pytest.mark.parametrize("kind", ["linear", "natural"])
def test_the_proof_follows_a_table_whose_rows_fall_inside_elements(kind: str) -> None:
    rule = along(kind)
    truth = min(
        rcp.scenes.signed_distance(BOX, BOX, planar_pose(0.5 * t, 3), rule(None, t)).distance
        for t in np.linspace(0, 2, 2001).tolist()
    )
    report = crossing(rule, clearance=0.999 * truth)
    assert report.safe is not False
    assert report.body_pairs[0].distance == pytest.approx(truth, abs=2e-3)
    assert crossing(rule, clearance=1.02 * truth).safe is False


def test_beyond_its_ends_a_table_says_nothing_unless_the_body_rests_there() -> None:
    short, resting = (rcp.Table([0, 1.5], [0, 1], kind="linear", outside=of) for of in ("error", "constant"))
    assert crossing(lambda b, t: planar_pose(short(t), short(t)), 0.1).body_pairs[0].undecided == (2,)
    assert crossing(lambda b, t: planar_pose(resting(t), 0), 0.1).safe is not False
    m = on_a_phase(lambda t: (0, 9, 0), elements=2, duration=rcp.Duration(bounds=(1, 3), initial_guess=2.0))
    places = [lambda b, t, x=x: planar_pose(x(b.time_at(t)), x(b.time_at(t))) for x in (short, resting)]
    report = check(m.move, BOX, [Body(BOX, places[0])], 0.1, points=m.move.time)
    assert report.body_pairs[0].undecided == (1,)  # beyond 1.5 nothing is known, and nothing is proven
    assert check(m.move, BOX, [Body(BOX, places[1])], 0.1, points=m.move.time).safe is not False
    _, b = integrator(x={"initial": 0, "final": 4}, duration=2.0, elements=4, stages=2)
    with pytest.raises(EvaluationError, match=r"'table': input 0 = .* is outside of the table, from 0 to 1.5"):
        keep_clear(b, BOX, {"truck": Body(BOX, lambda b, t: planar_pose(short(t), short(t)))}, on_the_line, 0.1)


def test_a_parameter_over_the_times_of_a_phase_is_refused() -> None:
    m = on_a_phase(lambda t: (0.5 * t, 3, 0), elements=2, duration=2.0)
    m.move.place = pyo.Param(m.move.time, initialize=1.0, mutable=True)
    with pytest.raises(ObstacleError, match="'move.place.t.' is no state .* places over time are an rcp.Table"):
        template_of(motion_of(m.move.time, m.move), lambda b, t: planar_pose(b.place[t], 2), "truck", 2)


@pytest.mark.casadi
def test_a_plan_leads_past_a_table_in_a_free_duration() -> None:
    duration = rcp.Duration(bounds=(1, 3), initial_guess=2.0)
    m, b = integrator(x={"initial": 0, "final": 4}, duration=duration, elements=4, stages=2)
    b.initialize_straight_lines()
    m.hurry = pyo.Objective(expr=b.duration + 0.01 * b.integral(lambda b, t: b.u[t] ** 2))
    box = Polytope.box(0.5, 0.5)
    y = rcp.Table([0, 1.1, 3], [-3, -2, 1], kind="linear")
    truck = Body(box, lambda b, t: planar_pose(2, y(b.time_at(t))))
    keep_clear(b, box, {"truck": truck}, on_the_line, 0.1)
    assert rcp.solve(m).safe
