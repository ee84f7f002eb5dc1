"""Bodies that move along tables and parameters: as the rows say, at every instant between them too."""

import math
import pickle
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
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, planar_pose
from pyrobocop_pyomo.motion import Body, motion_of
from pyrobocop_pyomo.motion.moving_shapes import template_of
from pyrobocop_pyomo.motion.table_paths import TableFunction
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial

BOX = Polytope.box(1, 1)
TIMES = [0.0, 0.4, 0.5, 1.3, 2.0]
XS, YS = [0.0, 1.0, 0.5, 3.0, 3.0], [0.0, 0.0, 1.0, -2.0, 0.0]


def ramp(low: np.ndarray, high: np.ndarray) -> TaylorForm:
    """The time itself on subintervals, over fractions of them."""
    ends, slope = np.stack([low, high], axis=1), (high - low)[:, None]
    return taylor_form_of_polynomial((ends, slope, np.zeros_like(slope)))


@given(
    st.lists(st.floats(-3, 3), min_size=3, max_size=7),
    st.sampled_from(["linear", "cubic"]),
    st.tuples(st.integers(-50, 250), st.integers(1, 200)).map(lambda pair: (pair[0] / 100, pair[1] / 100)),
)
def test_bounds_contain_values_slopes_and_curvatures(
    numbers: list[float], kind: str, part: tuple[float, float]
) -> None:
    knots = np.linspace(0.0, 2.0, len(numbers)) ** 1.5
    table = TableFunction("table", knots, np.array(numbers)[:, None], ["x"], kind=kind)
    low, high = part[0], part[0] + part[1]
    form = table.taylor_form(ramp(np.array([low]), np.array([high])), 0)
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


def test_values_and_derivatives_are_those_of_the_table() -> None:
    linear = TableFunction("table", np.array(TIMES), np.array([XS, YS]).T, ["x", "y"])
    at = np.linspace(0, 2, 77)
    np.testing.assert_allclose(linear.values(at[:, None])[:, 0], np.interp(at, TIMES, XS), atol=1e-12)
    for kind in ("linear", "cubic"):
        table = TableFunction("table", np.array(TIMES), np.array([XS, YS]).T, ["x", "y"], kind=kind)
        np.testing.assert_allclose(table.values(np.array(TIMES)[:, None])[:, 1], YS, atol=1e-12)
        table.check_derivatives(np.array([[0.1], [0.45], [0.9], [1.7]]))


def test_a_kink_inside_has_no_bound_of_its_curvature() -> None:
    table = TableFunction("table", np.array(TIMES), np.array([XS]).T, ["x"])
    form = table.taylor_form(ramp(np.array([0.0, 0.3]), np.array([0.4, 0.6])), 0)
    assert form.second.high[0] < 1e-9
    assert form.second.high[1] == np.inf


def crossing(truck: Any, clearance: float) -> Any:
    m = on_a_phase(lambda t: (0.5 * t, 3, 0), elements=3, duration=2.0)
    return check(
        m, BOX, [Body(BOX, truck)], clearance, points=m.move.time, pose=lambda m, t: planar_pose(m.move.x[t], 3.0)
    )


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_the_proof_follows_a_table_whose_rows_fall_inside_elements(kind: str) -> None:
    path = rcp.TablePath(TIMES, XS, YS, [0, 0.3, 0.2, 0.1, 0], kind=kind)
    truth = min(
        rcp.scenes.signed_distance(BOX, BOX, planar_pose(0.5 * t, 3), path(None, t)).distance
        for t in np.linspace(0, 2, 2001).tolist()
    )
    report = crossing(path, clearance=0.999 * truth)
    assert report.safe is not False
    assert report.body_pairs[0].distance == pytest.approx(truth, abs=2e-3)
    assert crossing(path, clearance=1.02 * truth).safe is False


def test_headings_turn_the_shorter_way() -> None:
    path = rcp.TablePath([0, 1], 0, 0, [3.1, -3.1])
    rotation, _ = path(None, 0.5).numbers()
    assert rotation[0, 0] == pytest.approx(math.cos(math.pi))


def test_tables_in_space() -> None:
    path = rcp.TablePath([0, 2], [0, 4], 1.0, z=[0, 2], pitch=[0, 1], theta=[0, 0.6])
    rotation, translation = path(None, 1.0).numbers()
    expected = rcp.spatial_pose((2, 1, 1), euler=(0, 0.5, 0.3)).numbers()
    np.testing.assert_allclose(translation, expected[1])
    np.testing.assert_allclose(rotation, expected[0])


def test_a_table_has_the_clock_of_its_phase_or_the_one_given() -> None:
    m = on_a_phase(lambda t: (t, 0, 0), elements=2, duration=rcp.Duration(bounds=(1, 3), initial_guess=2.0))
    late = rcp.TablePath([0, 4], [0, 8], 0, clock=lambda b, t: b.time_at(t) + 1.0)
    assert rcp.TablePath([0, 4], [0, 8], 0)(m.move, 0.5).numbers()[1][0] == pytest.approx(2.0)
    assert late(m.move, 0.5).numbers()[1][0] == pytest.approx(4.0)
    motion = motion_of(m.move.time, m.move)
    values = template_of(motion, late, "truck", 2).values(np.array([0, 1]), np.array([0.5, 1.0]))
    np.testing.assert_allclose(values[:, 4], [3.0, 6.0])


def test_beyond_its_ends_a_table_says_nothing_unless_the_body_rests_there() -> None:
    short = rcp.TablePath([0, 1.5], [0, 1], 0)
    with pytest.raises(ObstacleError, match=r"from 0 to 1.5.*says nothing about time 1.*hold_ends"):
        crossing(short, 0.1)
    resting = rcp.TablePath([0, 1.5], [0, 1], 0, hold_ends=True)
    assert resting(None, 9.0).translation == (1.0, 0)
    assert crossing(resting, 0.1).safe is not False
    m = on_a_phase(lambda t: (0, 9, 0), elements=2, duration=rcp.Duration(bounds=(1, 3), initial_guess=2.0))
    report = check(m.move, BOX, [Body(BOX, short)], 0.1, points=m.move.time)
    assert report.body_pairs[0].undecided == (1,)  # beyond 1.5 nothing is known, and nothing is proven
    assert check(m.move, BOX, [Body(BOX, resting)], 0.1, points=m.move.time).safe is not False


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (([0, 1], [0, 1, 2], 0), "x has the shape"),
        (([0, 0], 0, 0), "0 at 0 is followed by 0"),
        (([0], 0, 0), "at least 2"),
        (([0, 1], math.nan, 0), "finite"),
    ],
)
def test_tables_that_are_none(arguments: Any, match: str) -> None:
    with pytest.raises(ObstacleError, match=match):
        rcp.TablePath(*arguments)
    with pytest.raises(ObstacleError, match="linear"):
        rcp.TablePath([0, 1], 0, 0, kind="square")


def test_tables_survive_pickles_and_clones() -> None:
    path = pickle.loads(pickle.dumps(rcp.TablePath(TIMES, XS, YS, kind="cubic")))
    assert path(None, 0.7).translation == rcp.TablePath(TIMES, XS, YS, kind="cubic")(None, 0.7).translation


def test_a_parameter_over_the_times_of_a_phase_is_refused() -> None:
    m = on_a_phase(lambda t: (0.5 * t, 3, 0), elements=2, duration=2.0)
    m.move.place = pyo.Param(m.move.time, initialize=1.0, mutable=True)
    with pytest.raises(ObstacleError, match="'move.place.t.' is no state .* places over time are a TablePath"):
        template_of(motion_of(m.move.time, m.move), lambda b, t: planar_pose(b.place[t], 2), "truck", 2)


@pytest.mark.casadi
def test_a_plan_leads_past_a_table_in_a_free_duration() -> None:
    duration = rcp.Duration(bounds=(1, 3), initial_guess=2.0)
    m, b = integrator(x={"initial": 0, "final": 4}, duration=duration, elements=4, stages=2)
    b.initialize_straight_lines()
    m.hurry = pyo.Objective(expr=b.duration + 0.01 * b.integral(lambda b, t: b.u[t] ** 2))
    box = Polytope.box(0.5, 0.5)
    truck = Body(box, rcp.TablePath([0, 1.1, 3], 2, [-3, -2, 1]))
    keep_clear(b, box, {"truck": truck}, on_the_line, 0.1)
    assert rcp.solve(m).safe
