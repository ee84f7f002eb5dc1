"""A slip in a rule is named with its remedy, and the phase stays as it was."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, PyRobocopError


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (lambda b, t: {b.x: b.gain[t] * b.u[t]}, r"ode 'rule': its rule reads 'gain' at \[t\].*Write b\.gain\."),
        (lambda b, t: {b.x: b.u[t] / (1.0 - t)}, r"divides numbers by zero at t = 1 .*scheme='gauss'"),
    ],
)
def test_a_slip_is_named_with_its_remedy(rule: Callable[..., Any], message: str) -> None:
    m = pyo.ConcreteModel()
    m.go = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.x, b.u, b.gain = rcp.State(initial=0), rcp.Control(), rcp.Parameter(bounds=(0, 1))
    before = list(b.component_map())
    with pytest.raises(ModelError, match=message):
        b.ode(rule, name="rule")
    assert list(b.component_map()) == before


SINGULAR = lambda t: 1 / (1 - t)  # noqa: E731


@pytest.mark.parametrize(
    ("state", "control", "rule"),
    [
        ({}, {}, lambda b, t: b.x[t] ** 2 / (1 - t)),  # where Pyomo's own error says nothing
        ({}, {}, lambda b, t: b.u[t] ** 2 * (1 - t) ** -0.5),
        ({}, {"bounds": lambda t: (0, SINGULAR(t))}, None),
        ({"initial_guess": SINGULAR}, {}, None),
        ({"history": lambda t: 1 / (t + 0.5)}, {}, lambda b, t: b.x.delayed(t, 1.5)),
    ],
)
def test_what_divides_by_zero_is_named_with_the_time(state: Any, control: Any, rule: Any) -> None:
    m = pyo.ConcreteModel()
    m.go = b = rcp.PhaseBlock(duration=1.0, elements=2)

    def state_all() -> None:
        b.x, b.u = rcp.State(**state), rcp.Control(**control)
        b.ode(lambda b, t: {b.x: b.u[t]})
        b.integral(rule)

    with pytest.raises(PyRobocopError, match=r"go': .*divides numbers by zero at t = (1|-0\.5) "):
        state_all()
