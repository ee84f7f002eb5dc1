"""`print(result)`: one line where all is well, two with pairs, and at most eight where it is not."""

import dataclasses
import functools
import itertools
import math
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

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis.least_violation import Least, LeastViolation, least_violation
from pyrobocop_pyomo.modeling import deadline as deadlines
from pyrobocop_pyomo.presentation import percent
from pyrobocop_pyomo.solving.result_text import CLEAR_START, MOST_CHARACTERS, MOST_LINES

pytestmark = pytest.mark.ipopt


def test_success_is_one_line_with_the_errors_of_equations_and_mesh() -> None:
    (line,) = str(rcp.solve(cart())).splitlines()
    assert line.startswith("cart: solved. objective 1.5, ")
    assert "equations to " in line
    assert "mesh error " in line
    assert "on 4 elements" in line


@pytest.mark.parametrize(("seconds", "said"), [(0.234, "0.23 s"), (9.96, "10 s"), (123.4, "123 s")])
def test_seconds_are_written_without_an_exponent(seconds: float, said: str) -> None:
    assert f", {said}" in str(dataclasses.replace(rcp.solve(cart()), seconds=seconds))


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


def winch() -> Any:
    m = cart(force=2.0)
    m.p.u.setlb(None)
    m.p.u.setub(None)
    m.effort.sense = pyo.maximize
    return m


def tank(final: float) -> Any:
    m, b = one_phase(model="tank", duration=1.0, elements=3)
    b.level, b.inflow = rcp.State(initial=1, final=final), rcp.Control(bounds=(0, 1))
    b.ode(lambda b, t: {b.level: b.inflow[t] - pyo.sqrt(b.level[t] - 0.5)})
    m.water = pyo.Objective(expr=b.integral(lambda b, t: b.inflow[t] ** 2))
    return m


def arm(fastest: float) -> Any:
    """A path constraint that no motion meets, and that a fast one passes between the points."""
    m, b = one_phase(model="arm", duration=2.0, elements=4, stages=2)
    b.q, b.w = rcp.State(initial=0, final=2.6), rcp.Control(bounds=(-fastest, fastest))
    b.ode(lambda b, t: {b.q: b.w[t]})
    b.constraint(lambda b, t: pyo.sin(b.q[t]) <= 0.9, name="ceiling")
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.w[t] ** 2))
    return m


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        (
            lambda: cart(force=0.5),
            {},
            [
                "NOT SOLVED, and proven to have no solution",
                "not met: ",
                "- 'p.u' ",
                "Try first to widen the bounds 'p.u' ",
            ],
        ),
        (cart, {"options": {"max_iter": 0}}, ["NOT SOLVED: Ipopt reached its iteration limit. ", "max_iter"]),
        (winch, {}, ["cart: NOT SOLVED: Variables grow without end", "'p.u'", "Bound what grows", "the objective."]),
        (lambda: tank(0.2), {}, ["expressions have no value", "which is fixed", "needs another value", "'gauss'"]),
        (
            lambda: arm(fastest=1.5),
            {},
            ["no point nearby violates less", "- constraint 'p.ceiling'", "start nearer to it"],
        ),
    ],
)
def test_a_failure_says_why_and_what_to_do_in_eight_lines(model: Any, options: Any, words: list[str]) -> None:
    result = rcp.solve(model(), **options)
    assert not result.solved
    assert not (result.quality is rcp.Quality.INFEASIBLE and "objective " in str(result).splitlines()[0])
    lines = str(result).splitlines()
    assert len(lines) <= MOST_LINES
    assert all(len(line) <= MOST_CHARACTERS for line in lines)
    assert all(word in str(result) for word in words)


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
    assert "a limit of states is passed between the points by " in doubt
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
