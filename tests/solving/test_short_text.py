"""`print(result)`: one line where all is well, two with pairs, and at most eight where it is not."""

import dataclasses
import functools
import itertools
import logging
import math
import pickle
import re
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import cart, one_phase
from harness.scenes import keep_clear
from harness.small_problems import corner
from hypothesis import given
from hypothesis import strategies as st
from pyomo.mpec import Complementarity, complements

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.diagnosis.least_violation import Least, LeastViolation, least_violation
from pyrobocop_pyomo.errors import SolveFailed
from pyrobocop_pyomo.modeling import deadline as deadlines
from pyrobocop_pyomo.presentation import percent
from pyrobocop_pyomo.solving.iterates import Quality, Standing, StopReason, Tolerances
from pyrobocop_pyomo.solving.result_text import CLEAR_START, KEPT_MESH, MOST_LINES
from pyrobocop_pyomo.solving.violations import violations_of_pairs, worst_of_each_component

pytestmark = pytest.mark.ipopt


def test_success_is_one_line_with_the_errors_of_equations_and_mesh() -> None:
    result = rcp.solve(cart())
    (line,) = str(result).splitlines()
    assert line.startswith("cart: solved. objective 1.5, ")
    assert "equations to " in line
    assert "mesh error " in line
    assert "on 4 elements" in line
    for seconds, said in ((0.234, "0.23 s"), (9.96, "10 s"), (123.4, "123 s")):
        assert f", {said}" in str(dataclasses.replace(result, seconds=seconds))


def test_where_no_error_of_the_mesh_is_known_the_report_says_what_to_write() -> None:
    m, b = one_phase(model="rub", duration=1.0, elements=4, scheme="implicit_euler")
    b.x, b.v, b.u = rcp.State(initial=0, final=0.1), rcp.State(initial=0), rcp.Control(bounds=(-5, 5))
    b.floor = rcp.mechanics.CoulombFriction(b.v, normal=1.0, coefficient=0.3)
    b.ode(lambda b, t: {b.x: b.v[t]})
    b.residual(lambda b, t: 2 * b.derivative(b.v)[t] == b.u[t] + b.floor[t])
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = rcp.solve(m)
    assert "mesh error not known: phase 'p': error of the " in str(result).splitlines()[0]
    assert "error of the objective not estimated. It has pairs" in result.report()
    assert b.trajectory().verify().motion_error is not None  # the residual and the pairs are followed step by step


def test_pairs_are_counted_and_certified_in_a_second_line() -> None:
    _, line = str(rcp.solve(corner((1, 2)))).splitlines()
    assert line == "1 complementarity pair exact, no better choice of zero sides nearby"


def arm(fastest: float) -> Any:
    """A path constraint that no motion meets, and that a fast one passes between the points."""
    m, b = one_phase(model="arm", duration=2.0, elements=4, stages=2)
    b.q, b.w = rcp.State(initial=0, final=2.6), rcp.Control(bounds=(-fastest, fastest))
    b.ode(lambda b, t: {b.q: b.w[t]})
    b.constraint(lambda b, t: pyo.sin(b.q[t]) <= 0.9, name="ceiling")
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.w[t] ** 2))
    return m


def test_where_no_point_nearby_violates_less_the_constraint_is_named() -> None:
    words = ("no point nearby violates less", "- constraint 'p.ceiling'", "start nearer to it")
    text = str(rcp.solve(arm(fastest=1.5)))
    assert [word for word in words if word not in text] == []


def out_of_reach() -> Any:
    """A value that no control has, squared so that linear programs prove nothing."""
    m = cart(force=20.0)
    m.reach = pyo.Constraint(expr=m.p.u[2.0] ** 2 == 900)
    return m


def test_an_iteration_limit_gives_way_to_the_row_that_stands_against_a_solution() -> None:
    result = failed()
    assert result.stop_reason is rcp.StopReason.ITERATION_LIMIT
    assert str(result).splitlines()[-1].startswith("Try first to ")
    assert any("'reach'" in finding.message for finding in result.diagnose().errors)
    texts = [str(result), result.report(), str(result.diagnose())]
    assert not any("max_iter" in text for text in texts)


@pytest.mark.parametrize("kind", Least)
@pytest.mark.parametrize("reason", rcp.StopReason)
def test_no_text_says_both_that_points_nearby_violate_less_and_that_none_does(reason: Any, kind: Least) -> None:
    least = LeastViolation(kind, False, 1.0)
    found = dataclasses.replace(failed(), stop_reason=reason, least_violation=least)
    with pytest.raises(rcp.errors.SolveFailed) as raised:
        found.raise_for_status()
    for text in (str(found), found.report(), str(found.diagnose()), str(raised.value)):
        none = re.search(r"no point near(by| it) violates less", text, re.IGNORECASE)
        some = re.search(r"points nearby violate less|rows can be met", text, re.IGNORECASE)
        assert not (none and some)
        assert not (none and kind in (Least.UNKNOWN, Least.NONE))


@functools.cache
def failed() -> Any:
    return rcp.solve(out_of_reach(), options={"max_iter": 5})


def test_of_many_lines_the_first_and_the_last_are_shown() -> None:
    told = dataclasses.replace(failed(), remarks=tuple(f"{KEPT_MESH} {number}" for number in range(9)))
    lines = str(told).splitlines()
    assert len(lines) == MOST_LINES
    assert lines[-1] == str(failed()).splitlines()[-1]


def too_far() -> Any:
    """An end in other units, and a wall beside the way that has nothing to do with it."""
    m, b = one_phase(model="too far", duration=2.0, elements=8, stages=2)
    b.x, b.y = rcp.State(initial=0, final=600), rcp.State(initial=0, final=0)
    b.v, b.w = rcp.State(initial=0, final=0, bounds=(-3, 3)), rcp.Control(bounds=(-3, 3))
    b.u = rcp.Control(bounds=(-9, 9))
    b.ode(lambda b, t: {b.x: b.v[t], b.y: b.w[t], b.v: b.u[t]})
    b.initialize_straight_lines()
    keep_clear(b, rcp.Polytope.box(0.4, 0.4), {"wall": rcp.Polytope.box(1, 2, center=(2, 0.8))}, clearance=0.1)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.w[t] ** 2))
    return m


def test_an_end_out_of_reach_is_named_and_not_the_obstacles_on_the_way() -> None:
    result = rcp.solve(too_far(), time_limit=20)
    assert not result.solved
    assert "proven to have no solution" in str(result)
    assert "'p.x' fixed at 600" in str(result)
    assert "No motion was found" not in str(result)
    assert len(str(result).splitlines()) <= MOST_LINES


def test_what_a_motion_lacks_is_not_cut_off() -> None:
    m = too_far()
    m.p.x[2.0].fix(4)
    m.p.y.setlb(-0.1)
    m.p.y.setub(0.1)
    lines = str(rcp.solve(m, time_limit=20)).splitlines()
    (motion,) = [line for line in lines if line.startswith("No motion was found")]
    assert re.search(r"'body' and 'wall' overlap by [\d.]+ at t = [\d.]+, required clearance 0\.1 \(in", motion)
    assert lines.index(motion) < lines.index(CLEAR_START) == len(lines) - 1
    assert not any("first_shape" in line or "second_shape" in line for line in lines)


def test_neither_side_of_a_pair_can_be_zero_is_proven_and_says_which_bounds_keep_it_from_zero() -> None:
    m = corner((1, 2))
    m.x.setlb(1)
    m.y.setlb(4)
    result = rcp.solve(m, progress=False)
    first, unmet, _, *against, remedy = str(result).splitlines()
    assert "proven to have no solution" in first
    assert unmet.startswith("not met: pair 'pair': its sides are ")
    assert unmet.endswith("at the best point found, and one of them has to be 0")
    assert sorted(against) == ["- 'x' >= 1", "- 'y' >= 4"]
    assert remedy == "Try first to widen the bound 'x' >= 1 by 1 or more."
    m.x.setlb(0)
    assert rcp.solve(m, progress=False).solved


def test_the_time_limit_says_what_helps_beside_more_time() -> None:
    ended = rcp.solve(cart(), progress=False, options={"max_iter": 0})
    result = dataclasses.replace(ended, stop_reason=rcp.StopReason.TIME_LIMIT)
    *_, remedy = str(result).splitlines()
    assert remedy == result.stop_reason.remedy
    assert all(word in remedy for word in ("time_limit", "fewer elements", "initial guess"))


@pytest.mark.parametrize("busy", [False, True])
def test_what_stands_against_a_solution_does_not_depend_on_how_busy_the_machine_is(
    busy: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    m = arm(fastest=1.5)
    m.p.initialize_straight_lines()
    if busy:  # every reading of the clock is half a second after the one before
        ticks = itertools.count()
        monkeypatch.setattr(deadlines.time, "perf_counter", lambda: 0.5 * next(ticks))
    found = least_violation(m)
    assert found is not None
    assert any("'p.ceiling" in str(one) for one in found.obstructions)


def test_a_path_constraint_that_is_passed_between_the_points_is_doubtful() -> None:
    m = arm(fastest=30)
    result = solution(m, mesh_tolerance=None, strategies=rcp.Strategy(exploration=0))
    assert max(math.sin(angle) for angle in m.p.trajectory()(np.linspace(0, 2, 200))["q"]) > 0.95
    (doubt,) = [line for line in str(result).splitlines() if line.startswith("COARSE MESH: ")]
    assert "limits of states passed between the points by " in doubt
    assert doubt.endswith("take more elements")


@given(st.floats(0.0, 1.0))
def test_a_share_is_written_as_people_do(share: float) -> None:
    text = percent(share)
    assert text.endswith(" %")
    if share > 1e-9:
        assert "e" not in text
        assert float(text[:-2]) == pytest.approx(100 * share, rel=0.5)
    else:
        assert text.startswith("below")


# --------------------------------------------------------------------
# A solve that fails names what is not met, where and by how much; its remedy works when it is followed.


def test_what_cannot_be_met_is_named_with_its_size():
    result = rcp.solve(cart(duration=0.5))
    assert (result.quality, result.stop_reason) == (Quality.INFEASIBLE, StopReason.INFEASIBLE)
    assert result.violations[0].amount == pytest.approx(result.constraint_violation, rel=1e-6)
    assert str(result.violations[0]) in result.report()
    # It has no pairs, no solution to refine, and no guess would help.
    for word in ("COARSE MESH", "complementarity", "max a*b", "delta", "another initial guess"):
        assert word not in result.report()
    assert any("of which at least one must give way" in finding.message for finding in result.diagnose().findings)
    with pytest.raises(SolveFailed, match=r"(?s)not met: equation of 'x' of phase 'p' at t = .*'p.u' <= 2 at "):
        result.raise_for_status()


@pytest.mark.asl
def test_an_expression_without_a_value_is_named_once(caplog):
    m = cart()

    m.p.constraint(lambda b, t: pyo.log(b.x[t] - 2.0) <= 5.0, name="far")

    with caplog.at_level(logging.WARNING):
        result = rcp.solve(m)
    assert not result.solved
    assert "log" in result.report()
    assert not [record for record in caplog.records if "Exception encountered" in record.getMessage()]


def test_pairs_are_named_by_component_the_worst_first():
    residual = rcp.complementarity.PairResidual
    pairs = [residual("p.touch[1]", 0.1, 0.2), residual("p.touch[2]", 0.0, 3.0), residual("p.touch[3]", 0.4, 0.5)]
    (worst,) = worst_of_each_component(violations_of_pairs(pairs, Tolerances()))
    assert (worst.name, worst.others) == ("p.touch[3]", 1)
    assert str(worst) == (
        "pair 'p.touch[3]': its sides are 0.4 and 0.5 at the best point found, and one of them has to be 0 "
        "(and at 1 other index)"
    )


def test_what_a_result_finds_and_what_the_model_shows_are_one_diagnosis():
    m = cart(duration=0.5)
    m.del_component(m.effort)
    m.size = pyo.Objective(expr=m.p.integral(lambda b, t: abs(b.u[t])))
    result = rcp.solve(m, strategies="solve")
    found, of_model = result.diagnose(), rcp.diagnose(m)
    assert set(of_model.findings) <= set(found.findings)
    assert any(str(result.violations[0]) in finding.message for finding in found.findings)
    assert "no derivative at zero" in result.report()
    assert str(found).count("no derivative at zero") == 1
    alone = pickle.loads(pickle.dumps(result.diagnose()))
    assert alone.findings == found.findings


@pytest.mark.parametrize("elements", [10, 20])
def test_a_free_gain_times_a_control_that_costs_grows_without_end(elements):
    """The larger the gain, the smaller the control: no number of iterations gets there."""
    m, b = one_phase(duration=2, elements=elements)
    m.k = pyo.Var(initialize=1)
    b.x, b.v, b.u = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0), rcp.Control()
    b.ode(lambda b, t: {b.x: b.v[t], b.v: m.k * b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = rcp.solve(m)
    assert not result.solved
    assert result.stop_reason is StopReason.DIVERGED
    assert "max_iter" not in result.report()
    assert any("What grows: 'k'" in remark for remark in result.remarks)


def test_a_variable_that_is_as_large_as_its_guess_or_bounds_has_not_grown():
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1e12), pyo.Var(bounds=(0, 1e13))
    m.cost = pyo.Objective(expr=(m.x * 1e-12 - 2) ** 4 + (m.y * 1e-12 - 3) ** 4)
    result = rcp.solve(m, options={"max_iter": 3, "nlp_scaling_method": "gradient-based"})
    assert result.stop_reason is not StopReason.DIVERGED


def test_a_point_where_the_iterations_ended_is_not_called_a_local_minimum():
    m = cart(duration=0.5)
    result = rcp.solve(m, options={"max_iter": 2})
    assert result.stop_reason is StopReason.ITERATION_LIMIT
    assert result.least_violation.is_proof  # the equations are linear: what linear programs say is no less true
    m.p.x[0.5].unfix()
    ended = rcp.solve(m, options={"max_iter": 0})
    assert ended.stop_reason is StopReason.ITERATION_LIMIT
    assert ended.least_violation.kind is Least.NONE
    assert "can be met" in ended.report()


@pytest.mark.parametrize("zero", ["int", "float", "param", "mutable", "expression"])
def test_an_objective_of_zero_is_no_mistake(zero):
    m = pyo.ConcreteModel()
    m.param, m.mutable = pyo.Param(initialize=0.0), pyo.Param(initialize=0.0, mutable=True)
    m.expression = pyo.Expression(expr=0)
    m.x = pyo.Var(initialize=1)
    m.row = pyo.Constraint(expr=m.x**2 == 4)
    m.nothing = pyo.Objective(expr={"int": 0, "float": 0.0}.get(zero, m.component(zero)))
    result = solution(m)
    assert result.remarks == ()
    assert result.doubts == ()
    m.mutable.set_value(3.0)
    expected = zero == "mutable"
    assert any("holds no variable" in doubt.message for doubt in rcp.solve(m).doubts) is expected


# --------------------------------------------------------------------
# Models with pairs that start where a side has no value, whose bounds contradict each other, or that are unbounded.


def in_the_plane(start: tuple[float, float] = (1.0, 1.0), bounds: tuple[float | None, float | None] = (None, None)):
    m = pyo.ConcreteModel(name="in_the_plane")
    m.x, m.y = pyo.Var(bounds=bounds, initialize=start[0]), pyo.Var(bounds=bounds, initialize=start[1])
    return m


def test_a_start_at_which_a_side_has_no_value_is_moved():
    m = in_the_plane(start=(-0.1, 1.0))
    m.pair = Complementarity(expr=complements(pyo.sqrt(m.x) - 1 >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=(m.x - 4) ** 2 + (m.y - 2) ** 2)
    result = solution(m)
    guess = "The initial guess could not be evaluated: sqrt(...) of x = -0.1, in a side of complementarity 'pair'"
    assert guess in result.report()
    assert result.objective == pytest.approx(4.0, abs=1e-6)


def test_pairs_without_a_value_are_reported_as_not_met():
    residual = PairResidual("pair", math.nan, 1.0)
    (violation,) = violations_of_pairs([residual], Tolerances())
    assert math.isinf(violation.amount)
    assert violation.name == "pair"


SIDES = {
    "two variables": lambda m: (m.x >= 0, m.y >= 0),
    "expressions": lambda m: (m.x + 0.5 * m.y - 0.5 * m.y >= 0, m.y * (1 + m.x**2) >= 0),
    "between bounds": lambda m: (pyo.inequality(0, m.x, 10), m.y),
}


@pytest.mark.parametrize("maximise", [False, True])
@pytest.mark.parametrize("sides", SIDES)
def test_an_objective_that_falls_without_end_has_no_solution(sides: str, maximise: bool):
    m = in_the_plane()
    m.pair = rcp.Complementarity(expr=complements(*SIDES[sides](m)))
    cost = (m.x - 1) ** 2 - m.y
    m.cost = pyo.Objective(expr=-cost if maximise else cost, sense=pyo.maximize if maximise else pyo.minimize)
    result = rcp.solve(m)
    assert not result.solved
    assert result.stop_reason is StopReason.DIVERGED
    assert "What grows: " in result.report()
    assert "'y' (" in result.report()
    # What is left on the model is the optimum of the branch that is bounded, where any run has found it.
    if any(step.converged for step in result.steps):
        assert abs(m.y.value) < 1.0
        assert abs(result.objective) < 1.0
    assert not result.standing.bounded


def test_points_on_the_way_to_infinity_are_the_last_choice_among_feasible_ones():
    far, near = Standing(excess=1.0, cost=-1e19, bounded=False), Standing(excess=1.0, cost=1.0)
    assert near.is_better_than(far)
    assert not far.is_better_than(near)
    assert far.is_better_than(Standing(excess=2.0))
