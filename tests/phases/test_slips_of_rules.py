"""A slip in a rule is named with its remedy, and the phase stays as it was."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TranscriptionError


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (lambda b, t: {b.x: b.gain[t] * b.u[t]}, r"ode 'rule': its rule reads 'gain' at \[t\].*Write b\.gain\."),
        (lambda b, t: {b.x: b.u[t] / (1.0 - t)}, r"divides numbers by zero.*scheme='gauss'"),
    ],
)
def test_a_slip_is_named_with_its_remedy(rule: Callable[..., Any], message: str) -> None:
    m = pyo.ConcreteModel()
    m.go = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.x, b.u, b.gain = rcp.State(initial=0), rcp.Control(), rcp.Parameter(bounds=(0, 1))
    before = list(b.component_map())
    with pytest.raises(TranscriptionError, match=message):
        b.ode(rule, name="rule")
    assert list(b.component_map()) == before


def test_an_integrand_that_is_singular_at_the_end_is_named_and_has_a_remedy() -> None:
    def build(scheme: str) -> Any:
        m = pyo.ConcreteModel()
        m.go = b = rcp.PhaseBlock(duration=1.0, elements=2, scheme=scheme)
        b.x, b.u = rcp.State(initial=0), rcp.Control()
        b.ode(lambda b, t: {b.x: b.u[t]})
        return b.integral(lambda b, t: b.u[t] ** 2 * (1 - t) ** -0.5)

    with pytest.raises(TranscriptionError, match=r"the integrand .*divides numbers by zero"):
        build("radau")
    assert build("gauss") is not None
