"""What has no value on a trajectory is named with its expression, rule and time; nothing else is raised."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError


def falling(state: Callable[[Any, Any], Any]) -> Any:
    """A state that passes zero at t = 1, with a rule that is not defined there or from there on."""
    m = pyo.ConcreteModel("falling")
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=4)
    b.x, b.u = rcp.State(initial=1), rcp.Control()
    state(m, b)
    for variable in b.x.values():
        if not variable.fixed:
            variable.set_value(1.0 - variable.index())
    for variable in (*b.u.values(), *(b.z.values() if hasattr(b, "z") else ())):
        variable.set_value(-1.0)
    return b


def with_root(m: Any, b: Any) -> None:
    b.ode(lambda b, t: {b.x: pyo.sqrt(b.x[t]) + b.u[t]})


def with_limit(m: Any, b: Any) -> None:
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.constraint(lambda b, t: pyo.log(b.x[t] + 0.1) <= 1, name="limit")


def with_algebraic(m: Any, b: Any) -> None:
    b.ode(lambda b, t: {b.x: b.u[t]})
    b.z = rcp.Algebraic()
    b.residual(lambda b, t: b.z[t] == pyo.log(b.x[t] + 0.1), name="level")


@pytest.mark.parametrize(
    ("state", "words"), [(with_root, r"sqrt.*ode"), (with_limit, r"log.*'limit'"), (with_algebraic, r"log.*'level'")]
)
def test_verification_names_expression_rule_and_time(state: Any, words: str) -> None:
    b = falling(state)
    with pytest.raises(TrajectoryError, match=rf"phase 'p': {words}.* at time 1\.\d+ \(element 2\)"):
        b.trajectory().verify()


def with_algebraic_in_motion(m: Any, b: Any) -> None:
    b.z = rcp.Algebraic()
    b.ode(lambda b, t: {b.x: b.u[t] + 1e-9 * b.z[t]})
    b.residual(lambda b, t: b.z[t] == pyo.log(b.x[t] + 0.1), name="level")


@pytest.mark.parametrize(("state", "words"), [(with_root, "sqrt"), (with_algebraic_in_motion, "log")])
def test_reintegration_names_what_the_plan_itself_does_not_define(state: Any, words: str) -> None:
    b = falling(state)
    trajectory = b.trajectory()
    for ask in (b.reintegrate, b.element_errors):
        with pytest.raises(TrajectoryError, match=rf"{words}.*'x'.* at time 1\.\d+ \(element 2\)"):
            ask(trajectory)


@pytest.mark.parametrize(("state", "words"), [(with_root, "sqrt"), (with_limit, "log"), (with_algebraic, "log")])
def test_diagnose_names_the_expression(state: Any, words: str) -> None:
    b = falling(state)
    assert re.search(rf"{words}\(\.\.\.\) of (p\.)?x\[1\.", str(rcp.diagnose(b.model())))


def test_reintegration_does_not_ask_what_the_motion_does_not_read() -> None:
    b = falling(with_algebraic)
    assert b.element_errors(b.trajectory()) == pytest.approx(0.0, abs=1e-9)
