"""Units: where they are given, the transcribed rows are consistent, and a wrong one shows."""

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from pyomo.core.base.units_container import UnitsError
from pyomo.util.check_units import assert_units_consistent, assert_units_equivalent

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

U = pyo.units

HORIZONS = {
    "fixed": {"duration": 2},
    "free": {"duration": rcp.Duration(bounds=(1, 3))},
    "later": {"duration": 2, "start": rcp.Start(bounds=(0, 1))},
    "moving": {"duration": 2, "free_element_widths": (0.5, 2)},
}


def cart(**options: Any) -> pyo.ConcreteModel:
    m, b = one_phase(model="cart", **{"elements": 4, "time_units": U.s, **options})
    b.x = rcp.State(initial=0, final=1, units=U.m)
    b.v = rcp.State(initial=0, units=U.m / U.s, derivative_bounds=(-3, 3))
    b.f = rcp.Control(units=U.N, parametrization="piecewise_linear", rate_bounds=(-50, 50))
    b.drag = rcp.Algebraic(units=U.N)
    b.mass = rcp.Parameter(units=U.kg, bounds=(1, 2), initial_guess=1)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: (b.f[t] - b.drag[t]) / b.mass})
    b.residual(air)
    m.work = pyo.Objective(expr=b.integral(power))
    return m


def air(b: Any, t: float) -> Any:
    return b.drag[t] == 0.1 * U.N * U.s**2 / U.m**2 * b.v[t] ** 2 * (1 + b.time_at(t) / U.s)


def power(b: Any, t: float) -> Any:
    return b.f[t] * b.v[t]


@pytest.mark.parametrize("horizon", HORIZONS)
@pytest.mark.parametrize("scheme", ["radau", "gauss", "lobatto"])
def test_transcribed_rows_and_integrals_are_consistent(horizon: str, scheme: str) -> None:
    m = cart(scheme=scheme, **HORIZONS[horizon])
    assert_units_consistent(m)
    assert_units_equivalent(m.work.expr, U.J)
    assert_units_equivalent(m.p.time_at(0.5), U.s)
    assert rcp.diagnose(m).errors == []


@pytest.mark.ipopt
def test_units_that_differ_are_refused_before_the_solve() -> None:
    m, b = one_phase(duration=2.0, elements=4, time_units=U.s, x=rcp.State(initial=0, final=1, units=U.m))
    b.v = rcp.State(initial=0, units=U.m / U.s)
    b.u = rcp.Control(bounds=(-2, 2), units=U.N)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    with pytest.raises(ModelError, match="'p.v_collocation'.*not compatible.*correct the units"):
        rcp.solve(m)


def press(sides: str) -> pyo.ConcreteModel:
    """A pair in newtons and metres, stated in one of several ways."""
    m, b = one_phase(model="press", elements=2, time_units=U.s)
    b.x, b.v = rcp.State(initial=1, units=U.m), rcp.State(initial=0, units=U.m / U.s)
    b.f = rcp.Algebraic(bounds=(0, None), units=U.N)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.f[t] / (2 * U.kg)})

    def touch(b: Any, t: float) -> Any:
        return {
            "variable": lambda: rcp.complements(b.f[t], b.x[t] >= 0),
            "relations": lambda: rcp.complements(b.f[t] >= 0 * U.N, 2 * b.x[t] >= 1 * U.m),
            "range": lambda: rcp.complements(pyo.inequality(-1 * U.N, b.f[t], 1 * U.N), b.v[t]),
            "any sign": lambda: rcp.either_zero(b.x[t] >= 0, b.f[t]),
            "wrong": lambda: rcp.complements(b.f[t] >= 0, b.x[t] + b.v[t] >= 0),
        }[sides]()

    b.complementarity(touch)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.f[t] ** 2))
    return m


@pytest.mark.parametrize("sides", ["variable", "relations", "range", "any sign"])
def test_pairs_are_consistent(sides: str) -> None:
    assert_units_consistent(press(sides))


def test_a_side_of_terms_that_do_not_fit_shows() -> None:
    with pytest.raises(UnitsError, match="meter not compatible with meter / second"):
        assert_units_consistent(press("wrong"))
