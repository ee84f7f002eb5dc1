"""Every option of a declaration has a judge: `verify` tells, from values alone, where what was declared is not kept."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp

Break = Callable[[Any], None]


def phase(**declared: Any) -> Any:
    """A cart whose speed is its control, at rest for two seconds; what is declared takes the place of something."""
    m = pyo.ConcreteModel()
    m.b = b = rcp.PhaseBlock(duration=declared.pop("duration", 2.0), elements=8, scheme="implicit_euler")
    b.x = declared.pop("x", rcp.State(initial_guess=0.0))
    b.u = declared.pop("u", rcp.Control(initial_guess=0.0))
    for name, declaration in declared.items():
        b.declare(name, declaration)
    b.ode(lambda b, t: {b.x: b.u[t] if b.component("u").dim() == 1 else 0.0})
    for variable in m.component_data_objects(pyo.Var):
        if variable.value is None:
            variable.set_value(0.0, skip_validation=True)
    return b


def put(**values: Any) -> Break:
    """Put numbers on components, over their index, whatever is fixed or bounded."""

    def on(b: Any) -> None:
        for name, numbers in values.items():
            data = list(b.component(name).values())
            for variable, number in zip(data, np.broadcast_to(numbers, len(data)).tolist(), strict=True):
                variable.set_value(number, skip_validation=True)

    return on


def delayed(declaration: Any, history: float) -> Any:
    """What was before the start moves the cart in its first half second."""
    name = "x" if isinstance(declaration, rcp.State) else "w"
    m = pyo.ConcreteModel()
    m.b = b = rcp.PhaseBlock(duration=2.0, elements=8, scheme="implicit_euler")
    b.x = declaration if name == "x" else rcp.State(initial_guess=0.0)
    if name == "w":
        b.w = declaration
    b.ode(lambda b, t: {b.x: b.component(name).delayed(t, 0.5)})
    for variable in m.component_data_objects(pyo.Var):
        variable.set_value(0.0, skip_validation=True)
    return b


SLOPE = 2.0 * np.linspace(0.0, 2.0, 9)
SWITCHING = [0, 1, 0, 1, 0, 1, 0, 1]
ON_OFF = {"parametrization": "piecewise_constant", "integer": (0, 1)}
# By declaration and option: a phase in which the fact holds, how it is broken, and where the judge says so.
FACTS: dict[tuple[type, str], tuple[Callable[[], Any], Break, str]] = {
    (rcp.State, "bounds"): (lambda: phase(x=rcp.State(bounds=(-1, 1))), put(x=1.5), "bounds"),
    (rcp.State, "initial"): (lambda: phase(x=rcp.State(initial=0.0)), put(x=0.5), "bounds"),
    (rcp.State, "final"): (lambda: phase(x=rcp.State(final=0.0)), put(x=0.5), "bounds"),
    (rcp.State, "derivative_bounds"): (
        lambda: phase(x=rcp.State(derivative_bounds=(-1, 1))), put(x=SLOPE, u=2.0), "bounds",
    ),
    (rcp.State, "history"): (lambda: delayed(rcp.State(history=0.0), 0.0), put(x=1.0), "defect"),
    (rcp.Control, "bounds"): (lambda: phase(w=rcp.Control(bounds=(-1, 1))), put(w=1.5), "bounds"),
    (rcp.Control, "rate_bounds"): (lambda: phase(w=rcp.Control(rate_bounds=(-1, 1))), put(w=SWITCHING), "bounds"),
    (rcp.Control, "history"): (lambda: delayed(rcp.Control(history=0.0), 0.0), put(w=1.0), "defect"),
    (rcp.Control, "integer"): (lambda: phase(w=rcp.Control(**ON_OFF)), put(w=0.5), "bounds"),
    (rcp.Control, "max_switches"): (lambda: phase(w=rcp.Control(max_switches=2, **ON_OFF)), put(w=SWITCHING), "bounds"),
    (rcp.Control, "min_dwell"): (lambda: phase(w=rcp.Control(min_dwell=0.5, **ON_OFF)), put(w=SWITCHING), "bounds"),
    (rcp.Control, "one_of"): (
        lambda: with_one_chosen(phase(w=rcp.Control(index=2, one_of=True, **ON_OFF))), put(w_0=1.0, w_1=1.0),
        "equations",
    ),
    (rcp.Algebraic, "bounds"): (lambda: phase(w=rcp.Algebraic(bounds=(-1, 1))), put(w=1.5), "bounds"),
    (rcp.Algebraic, "history"): (lambda: delayed(rcp.Algebraic(history=0.0), 0.0), put(w=1.0), "defect"),
    (rcp.Parameter, "bounds"): (lambda: phase(w=rcp.Parameter(bounds=(-1, 1))), put(w=1.5), "bounds"),
    (rcp.Duration, "bounds"): (
        lambda: phase(duration=rcp.Duration(bounds=(1, 3), initial_guess=2.0)), put(duration=4.0), "bounds",
    ),
}  # fmt: skip
# What promises nothing of a plan: where a solve starts, the names and units of a declaration, and how many variables
# there are, which no values can change.
NO_PROMISES = {"initial_guess", "declared_at", "index", "units", "parametrization", "knots", "levels"}


def with_one_chosen(b: Any) -> Any:
    put(w_0=1.0, w_1=0.0)(b)
    return b


def test_every_option_has_a_judge() -> None:
    """Who adds an option adds its fact here, and to what `verify` recomputes."""
    for declaration in (rcp.State, rcp.Control, rcp.Algebraic, rcp.Parameter, rcp.Duration):
        options = {field.name for field in fields(declaration)} - NO_PROMISES
        assert options == {option for of, option in FACTS if of is declaration}, declaration.__name__


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: f"{fact[0].__name__}.{fact[1]}")
def test_a_fact_that_does_not_hold_is_told(fact: tuple[type, str]) -> None:
    make, spoil, where = FACTS[fact]
    b = make()
    assert b.trajectory().verify().largest_violation < 1e-9
    spoil(b)
    found = b.trajectory().verify()
    assert getattr(found, where) > 0.1
    assert "does NOT hold" in found.verdict
