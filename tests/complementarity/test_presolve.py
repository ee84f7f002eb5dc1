"""The presolve: what bounds decide is decided, contradictions are named, and every bound is as it was afterwards."""

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.small_problems import corner

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import lifted_pairs_of
from pyrobocop_pyomo.complementarity.relaxed_model import fixed_at_zero, presolve
from pyrobocop_pyomo.errors import ComplementarityError

RELAX = pyo.TransformationFactory("pyrobocop.relax_complementarity")


def plane(x_bounds=(0, None), y_bounds=(0, None)) -> pyo.ConcreteModel:
    m = corner()
    m.x.bounds, m.y.bounds = x_bounds, y_bounds
    return m


def decisions(m: pyo.ConcreteModel) -> list[Any]:
    """What bounds decide of the lifted pairs."""
    RELAX.apply_to(m, lift=True)
    return presolve(lifted_pairs_of(m))


def fixed(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    m.x.fix(3.0)
    return m


def of_domain(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    m.y.domain = pyo.PercentFraction
    m.y.setlb(None)
    m.y.setub(None)
    return m


def limited_by_parameter(m: pyo.ConcreteModel) -> pyo.ConcreteModel:
    m.most = pyo.Param(initialize=4.0, mutable=True)
    m.y.setub(2 * m.most)
    return m


def stored_bounds(m: pyo.ConcreteModel) -> list[tuple]:
    """As stored, since a bound of the domain and one of the variable's own read the same."""
    return [(v.name, str(v._lb), str(v._ub), v.domain, v.fixed, v.bounds) for v in m.component_data_objects(pyo.Var)]


CASES = {
    "a positive lower bound": lambda: plane((0.5, None)),
    "a positive fixed side": lambda: fixed(plane()),
    "an own upper bound": lambda: plane((0.5, None), (0, 7.0)),
    "bounds of the domain": lambda: of_domain(plane((0.5, None))),
    "a parameter as a bound": lambda: limited_by_parameter(plane((0.5, None))),
}


@pytest.mark.casadi
@pytest.mark.parametrize("case", CASES)
def test_solve_uses_the_decision_and_gives_all_bounds_back(case: str) -> None:
    """eq-presolve, for a pair that it decides."""
    m = CASES[case]()
    before = stored_bounds(m)
    result = rcp.solve(m)
    assert result.solved
    assert result.decided_pairs == 1
    assert m.y.value == pytest.approx(0.0, abs=1e-8)
    assert m.x.value == pytest.approx(3.0 if m.x.fixed else 2.0, abs=1e-6)
    assert stored_bounds(m) == before


def test_bounds_come_back_after_an_exception() -> None:
    m = plane((0.5, None))
    RELAX.apply_to(m, lift=True)
    before = stored_bounds(m)
    with pytest.raises(ZeroDivisionError), fixed_at_zero(presolve(lifted_pairs_of(m))):
        1 / 0  # noqa: B018
    assert stored_bounds(m) == before


def test_a_bound_that_excludes_zero_is_not_overwritten() -> None:
    m = plane((0.5, None))
    decided = decisions(m)
    m.y.setub(-1.0)
    with fixed_at_zero(decided):
        assert m.y.ub == -1.0


def test_a_side_at_its_upper_bound_is_held_from_below() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(1, None), initialize=1)
    m.y = pyo.Var(bounds=(None, 2), initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y <= 2))
    (side,) = decisions(m)
    assert side.variable is m.y
    with fixed_at_zero([side]):
        assert (m.y.lb, m.y.ub) == (2.0, 2.0)
    assert (m.y.lb, m.y.ub) == (None, 2.0)


def test_an_expression_decides_by_the_intervals_of_its_variables() -> None:
    m = plane()
    m.pair.deactivate()
    m.x.setub(1.0)
    m.bent = rcp.Complementarity(expr=rcp.complements(2 - m.x**2 >= 0, m.y >= 0))
    (side,) = decisions(m)
    assert side.variable is m.y


def both_positive() -> pyo.ConcreteModel:
    m = plane((0, None), (2, None))
    m.x.fix(1.0)
    return m


def never_positive() -> pyo.ConcreteModel:
    m = plane()
    m.pair.deactivate()
    m.x.setub(1.0)
    m.short = rcp.Complementarity(expr=rcp.complements(m.x**2 - 4 >= 0, m.y >= 0))
    return m


@pytest.mark.casadi
@pytest.mark.parametrize(
    ("build", "message"),
    [
        (both_positive, r"'pair': both sides are positive .*\(at least 1 and 2\).*Check the bounds"),
        (never_positive, r"'short': its first side is at most -3 .*must be >= 0\. Check the bounds"),
    ],
)
def test_a_contradiction_is_told_by_name_before_any_run(build, message: str) -> None:
    m = build()
    before = stored_bounds(m), list(m.component_map()), m.y.value
    with pytest.raises(ComplementarityError, match=message):
        rcp.solve(m)
    assert (stored_bounds(m), list(m.component_map()), m.y.value) == before
    assert all(pair.active for pair in m.component_data_objects(rcp.Complementarity) if pair.name != "pair")


@pytest.mark.parametrize("name", ["tanh", "sinh", "asinh", "atanh", "acosh", "cosh", "floor", "ceil"])
def test_a_side_may_hold_any_function(name):
    function = getattr(pyo, name)
    m = plane((-0.5, 0.5), (0, 5))
    m.pair.deactivate()
    m.side = rcp.Complementarity(expr=rcp.complements(function(m.x) >= 0, m.y >= 0))
    assert decisions(m) == []
