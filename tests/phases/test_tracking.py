"""Following a reference."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError


def phase(duration: Any = 2.0, **options: Any) -> Any:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=duration, elements=4, **options)
    b.x, b.u, b.k = rcp.State(initial_guess=lambda t: t), rcp.Control(initial_guess=1), rcp.Parameter()
    return b


def test_every_kind_of_reference_means_the_same() -> None:
    b = phase()
    line = phase()
    line.initialize(x=lambda t: 3 * t)
    for reference in (lambda t: 3 * t, ([0, 2], [0, 6]), np.array([[-1, 5.0], [-3, 15]]), line.trajectory()):
        assert pyo.value(b.tracking(b.x, reference)) == pytest.approx(4 * 2**3 / 3)  # integral of (2 t)^2
    assert pyo.value(b.tracking("u", 3, weight=0.5)) == pytest.approx(0.5 * 4 * 2)
    assert pyo.value(b.tracking(b.u, 3, weight=lambda t: t)) == pytest.approx(4 * 2)


def test_expressions_and_rules_are_followed_as_they_are() -> None:
    b = phase()
    m = b.model()
    m.goal, m.speed = pyo.Param(initialize=1.0, mutable=True), pyo.Var(initialize=3.0)
    b.double = pyo.Expression(b.points, rule=lambda b, t: 2 * b.x[t])
    costs = [b.tracking(b.u, m.goal), b.tracking("u", 2 * m.goal - 1), b.tracking(b.u, m.speed - 2)]
    assert [pyo.value(cost) for cost in costs] == pytest.approx([0, 0, 0])
    m.goal.set_value(3.0)
    m.speed.set_value(6.0)
    assert [pyo.value(cost) for cost in costs] == pytest.approx([8, 32, 18])
    for reference in (b.double, lambda b, t: 2 * b.x[t]):
        assert pyo.value(b.tracking(b.x, reference)) == pytest.approx(8 / 3)  # integral of t^2
        assert pyo.value(b.tracking(b.u, 3, weight=reference)) == pytest.approx(4 * 4)
    assert pyo.value(b.tracking(b.x, b.u, weight=m.goal)) == pytest.approx(3 * 2 / 3)  # integral of 3 (t - 1)^2
    assert pyo.value(b.tracking(b.u, 3, weight=([0, 2], [0, 2]))) == pytest.approx(4 * 2)
    b.first = pyo.Expression([0.0], rule=lambda b, t: b.x[t])
    with pytest.raises(ModelError, match=r"the reference 'p.first' has no value at t = .* Index it by the time"):
        b.tracking(b.x, b.first)


def test_a_vector_follows_another_and_a_free_duration_a_rule() -> None:
    b = phase(rcp.Duration(bounds=(1, 3), initial_guess=2.0))
    b.y, b.z = rcp.State(index=2, initial_guess=3), rcp.State(index=2, initial_guess=[1, 2])
    assert pyo.value(b.tracking(b.y, b.z)) == pytest.approx(2 * (4 + 1))
    assert pyo.value(b.tracking(b.x, lambda b, t: b.x[t] + t)) == pytest.approx(8 / 3)  # t is the time in a formula


def test_samples_are_joined_by_lines() -> None:
    b = phase()
    b.initialize(x=0)
    cost = b.tracking(b.x, ([0, 0.5, 2], [0, 1, 1]))
    assert pyo.value(cost) == pytest.approx(0.5 / 3 + 1.5)


def test_a_free_duration_takes_functions_of_pyomo() -> None:
    b = phase(rcp.Duration(bounds=(1, 3), initial_guess=2.0))
    b.initialize(x=0)
    assert pyo.value(b.tracking(b.x, lambda t: pyo.sin(t))) == pytest.approx(1 - math.sin(4) / 4, abs=1e-4)
    with pytest.raises(
        ModelError, match="data need times that are numbers, but something of the horizon is to be found"
    ):
        b.tracking(b.x, ([0, 3], [0, 1]))


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        (([0, 1], [0, 1]), r"tracking 'x': the reference runs from 0 to 1, the phase from 0 to 2\. Give"),
        (([0, 1, 2], [0, 1]), r"times of shape \(3,\) and values of shape \(2,\)"),
        (([0, 2, 1], [0, 1, 2]), "must be finite, and times increase"),
        (([0, 2], [0, math.nan]), "must be finite"),
        ("fast", "is no number, expression, function, trajectory or pair"),
        ((["a", "b"], [1, 2]), "is no number, expression, function, trajectory or pair"),
    ],
)
def test_what_is_no_reference_is_refused(reference: Any, message: str) -> None:
    b = phase()
    with pytest.raises(ModelError, match=message):
        b.tracking(b.x, reference)


def test_only_what_changes_in_time_on_this_phase_is_tracked() -> None:
    b, other = phase(), phase()
    for variable in (b.k, other.x, "z", b.points):
        with pytest.raises(ModelError, match="it is no state, algebraic or control of this phase"):
            b.tracking(variable, 0)
    m = pyo.ConcreteModel()
    m.p = rcp.PhaseBlock(duration=2.0)
    m.p.y = rcp.State()
    with pytest.raises(ModelError, match="trajectory 'p' has no 'x'"):
        b.tracking(b.x, m.p.trajectory())
