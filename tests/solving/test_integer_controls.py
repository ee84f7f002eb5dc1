"""Integer controls come out of `solve` with values that they may take, near what the relaxed problem says."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution, unchanged
from harness.phases import contents, one_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError


def fishing(elements: int, **options: Any) -> Any:
    """Lotka-Volterra fishing: Sager (2005); the relaxed optimum is 1.34408."""
    m, b = one_phase("go", model="fishing", duration=12.0, elements=elements)
    b.x = rcp.State(initial=0.5, initial_guess=1.0, bounds=(0, 5))
    b.y = rcp.State(initial=0.7, initial_guess=1.0, bounds=(0, 5))
    b.w = rcp.Control(initial_guess=0.5, **{"integer": (0, 1), **options})

    def hunt(b: Any, t: float) -> Any:
        x, y, w = b.x[t], b.y[t], b.w[t]
        return {b.x: x - x * y - 0.4 * x * w, b.y: -y + x * y - 0.2 * y * w}

    b.ode(hunt)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 1) ** 2 + (b.y[t] - 1) ** 2))
    return m


@pytest.mark.ipopt
def test_fishing_is_rounded_within_the_bound_and_comes_near_its_relaxation() -> None:
    objectives = []
    for elements in (20, 60):
        m = fishing(elements)
        result = solution(m)
        values = m.go.trajectory().w
        assert set(np.unique(values)) <= {0.0, 1.0}
        assert not any(variable.fixed for variable in m.component_data_objects(pyo.Var) if "w" in variable.name)
        rounding = result.rounding
        (control,) = rounding.controls
        assert control.gap <= control.bound == pytest.approx(6.0 / elements)
        assert rounding.objective == pytest.approx(pyo.value(m.cost))
        assert rounding.relaxed_objective <= rounding.objective
        assert "integral gap" in result.report()
        assert m.go.trajectory().verify().largest_violation < 1e-6
        objectives.append(rounding)
    assert objectives[1].relaxed_objective == pytest.approx(1.34408, rel=1e-3)
    assert objectives[1].objective < objectives[0].objective


def near_a_line(elements: int, width: float) -> Any:
    """A position that follows the time to a width, by a speed of 0 or 2: elements may be no longer than the width."""
    m, b = one_phase("go", model="near a line", duration=1.0, elements=elements, stages=1)
    b.x = rcp.State(initial=0.0, bounds=lambda t: (t - width, t + width))
    b.w = rcp.Control(integer=(0, 1), initial_guess=0.5)
    b.ode(lambda b, t: {b.x: 2 * b.w[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - b.time_at(t)) ** 2))
    return m


@pytest.mark.ipopt
def test_what_helps_is_told_where_rounded_controls_cannot_meet_the_constraints() -> None:
    m = near_a_line(4, width=0.15)
    result = rcp.solve(m)
    assert not result.solved
    assert m.go.grid.mesh.elements == 4
    assert "more elements or more switches" in result.report()
    assert result.rounding is not None
    assert result.least_violation is None  # that of the relaxation explains nothing
    m = near_a_line(8, width=0.15)
    m.limit = pyo.Constraint(expr=m.go.integral(lambda b, t: b.w[t]) <= 0.49)  # half of the time, rounded
    result = rcp.solve(m)
    assert not result.solved
    assert "'limit'" in result.report()
    assert "more elements or more switches" in result.report()
    assert pyo.value(m.go.integral(lambda b, t: b.w[t])) <= 0.49 + 1e-6  # the relaxed plan is kept
    del m.limit
    assert rcp.solve(m).solved
    assert m.go.trajectory().verify().largest_violation < 1e-6
    assert set(np.unique(m.go.trajectory().w)) <= {0.0, 1.0}


@pytest.mark.ipopt
def test_switches_and_dwelling_are_limited() -> None:
    m = fishing(24, max_switches=2, min_dwell=1.2)
    result = solution(m)
    values = m.go.trajectory().w[::3]
    ends = np.flatnonzero(np.diff(values)) + 1
    assert len(ends) == result.rounding.controls[0].switches <= 2
    assert (np.diff(ends) * 0.5 >= 1.2 - 1e-9).all()


@pytest.mark.ipopt
def test_one_mode_of_several_is_chosen_at_a_time() -> None:
    # x' = one of -1, 0.3, 2 (chosen by a vector): follow a straight line of slope 0.3, then one of slope 1.
    slopes = np.array([-1.0, 0.3, 2.0])
    m, b = one_phase("go", duration=2.0, elements=20, x=rcp.State(initial=0.0))
    b.mode = rcp.Control(index=3, integer=(0, 1), one_of=True, initial_guess=0.3)
    b.ode(lambda b, t: {b.x: slopes @ b.mode[t]})

    def wanted(t: Any) -> Any:
        return pyo.Expr_if(t < 1, 0.3 * t, 0.3 + (t - 1))

    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - wanted(t)) ** 2))
    b.remesh(16)
    result = solution(m)
    modes = m.go.trajectory().mode
    assert modes.sum(axis=0) == pytest.approx(np.ones(48))
    assert set(np.unique(modes)) <= {0.0, 1.0}
    (control,) = result.rounding.controls
    assert control.name == "go.mode"
    assert control.gap <= control.bound
    found = m.go.trajectory()
    assert max(abs(found.x - [pyo.value(wanted(t)) for t in found.time])) < 0.4


@pytest.mark.ipopt
def test_fixed_integers_stay_and_a_free_duration_is_rounded_on_its_own_intervals() -> None:
    m, b = one_phase("go", duration=rcp.Duration(bounds=(0.5, 9), initial_guess=3), elements=9)
    b.x = rcp.State(initial=0.0, final=(2.9, 3.1))
    b.gear = rcp.Control(integer=True, bounds=(0, 2))
    b.ode(lambda b, t: {b.x: b.gear[t]})
    b.gear_per_element[0].fix(1.0)
    m.cost = pyo.Objective(expr=b.duration)
    result = solution(m)
    assert b.gear_per_element[0].fixed
    values = m.go.trajectory().gear[::3]
    assert values[0] == 1.0
    assert set(values) <= {0.0, 1.0, 2.0}
    assert result.rounding.objective == pytest.approx(b.duration.value)


def declare(**options: Any) -> Callable[[Any], None]:
    def act(b: Any) -> None:
        b.w = rcp.Control(**options)

    return act


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (declare(integer=True), r"it has no range. Say integer=\(0, 1, 2\)"),
        (declare(integer=True, bounds=(0.2, 0.8)), "hold 0 whole numbers"),
        (declare(integer=()), r"integer = \(\)"),
        (declare(integer="01x"), "expected the values"),
        (declare(integer=(0, 1), parametrization="piecewise_linear"), "constant over intervals"),
        (declare(integer=(0, 1), max_switches=-1), "max_switches = -1"),
        (declare(integer=(0, 1), min_dwell=-1.0), "min_dwell = -1"),
        (declare(max_switches=3), "belong to an integer control"),
        (declare(integer=(0, 1), one_of=True), "is one_of, but no vector"),
        (declare(index=2, integer=(0, 2), one_of=True), r"integer=\(0, 1\)"),
    ],
)
def test_integer_controls_without_sense_are_refused_and_leave_nothing(act: Callable[[Any], None], message: str) -> None:
    _, b = one_phase("go", duration=1.0, elements=2)
    with unchanged(contents, b), pytest.raises(ModelError, match=message):
        act(b)


def test_relaxed_values_of_integer_controls_are_a_violation() -> None:
    m = fishing(4)
    found = m.go.simulate(controls={"w": [0.0, 1.0, 0.25, 0.0]})
    assert found.verify().bounds == pytest.approx(0.25)
