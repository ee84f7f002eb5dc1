"""A rule that gives a template of its rows is called once for all new points, and says there what it would say."""

import pickle
from collections.abc import Callable
from typing import Any

import pyomo.dae as dae
import pyomo.environ as pyo
import pytest

from pyrobocop_pyomo.modeling.expressions import same_expression
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule

TABLE = {0.0: 1.0, 1.0: 2.0}


def skipped_at_start(m: Any, t: float) -> Any:
    return pyo.Constraint.Skip if t == 0 else m.dx[t] == m.u[t] * m.p - pyo.sin(m.x[t])


def skipped_outside(m: Any, t: float) -> Any:
    return m.dx[t] == m.x[t] if 0.0 < t <= 1.0 else pyo.Constraint.Skip


def at_every_point(m: Any, t: float) -> Any:
    return m.u[t] - m.x[t] ** 2 == m.dx[t]


def since_start_of_element(m: Any, t: float) -> Any:
    return pyo.Constraint.Skip if t == 0 else m.x[t] - m.x[m.t.get_lower_element_boundary(t)] <= 1


def implicit(m: Any, t: float) -> Any:
    return m.dx[t] ** 3 + m.dx[t] == m.u[t]


def data_at(m: Any, t: float) -> float:
    return 1.0 + t


# What a rule returns, and whether it is a template.
WRITINGS: dict[str, tuple[Callable[[Any, float], Any], bool]] = {
    "at every point": (lambda m, t: m.dx[t] == m.x[t] * m.u[t], True),
    "the derivative on the right": (at_every_point, True),
    "implicit": (implicit, True),
    "an inequality": (lambda m, t: m.x[t] ** 2 <= 4.0 - m.u[t], True),
    "not at the start": (skipped_at_start, True),
    "between the ends": (skipped_outside, True),
    "a number": (lambda m, t: m.dx[t] == 1.0, True),
    "the time": (lambda m, t: m.dx[t] == m.x[t] * t, False),
    "one half": (lambda m, t: m.dx[t] == (m.x[t] if t < 0.5 else -m.x[t]), False),
    "a dictionary": (lambda m, t: m.dx[t] == m.x[t] * TABLE.get(t, 7.0), False),
    "its type": (lambda m, t: m.dx[t] == m.x[t] * (2.0 if isinstance(t, float) else 3.0), False),
    "the element": (since_start_of_element, False),
    "a parameter": (lambda m, t: m.dx[t] == m.x[t] * m.data[t], False),
}


def model(rule: Callable[[Any, float], Any], **derivative: Any) -> Any:
    m = pyo.ConcreteModel()
    m.t = dae.ContinuousSet(bounds=(0, 1))
    m.x, m.u = pyo.Var(m.t, initialize=0.7), pyo.Var(m.t, bounds=(0, 1), initialize=0.3)
    m.dx, m.p = dae.DerivativeVar(m.x, **derivative), pyo.Param(initialize=2.0, mutable=True)
    m.data = pyo.Param(m.t, initialize=data_at)
    m.row = pyo.Constraint(m.t, rule=rule)
    m.x[0].fix(1.0)
    return m


@pytest.mark.parametrize("scheme", ["LAGRANGE-RADAU", "LAGRANGE-LEGENDRE"])
@pytest.mark.parametrize("writing", WRITINGS)
def test_rows_are_what_the_rule_says_at_each_point(writing: str, scheme: str) -> None:
    rule, is_template = WRITINGS[writing]
    calls: list[Any] = []

    def counted(m: Any, t: Any) -> Any:
        calls.append(t)
        return rule(m, t)

    m = model(counted, bounds=(-9, 9))  # the derivative stays a variable
    stated = len(calls)
    pyo.TransformationFactory("pyrobocop.collocation").apply_to(m, nfe=4, ncp=2, scheme=scheme)
    assert (len(calls) - stated < 5) is is_template
    between = {t: m.row[t] for t in m.t if 0 < t < 1}
    assert all((row.__class__ is RowByRule) is is_template for row in between.values())
    for t, row in between.items():
        assert all(map(same_expression, row.expr.args, rule(m, t).args))


def solved(m: Any) -> tuple[float, list[float]]:
    assert pyo.check_optimal_termination(pyo.SolverFactory("pyrobocop.ipopt").solve(m))
    return pyo.value(m.cost), [m.x[t].value for t in m.t]


@pytest.mark.ipopt
@pytest.mark.parametrize("rule", [at_every_point, implicit, skipped_at_start])
def test_a_copy_a_pickle_and_rows_that_were_read_have_the_same_answer(rule: Callable[[Any, float], Any]) -> None:
    m, asked = model(rule), model(lambda m, t: rule(m, float(t)))
    for one in (m, asked):
        pyo.TransformationFactory("pyrobocop.collocation").apply_to(one, nfe=4, ncp=3)
        one.cost = pyo.Objective(expr=sum((one.x[t] - 0.5) ** 2 + one.u[t] ** 2 for t in one.t if t > 0))
    copied, read = m.clone(), m.clone()
    for row in read.component_data_objects(pyo.Constraint):
        assert row.expr is not None
    cost, states = solved(asked)
    for one in (m, copied, pickle.loads(pickle.dumps(copied)), read):
        assert solved(one) == (pytest.approx(cost, rel=1e-6), pytest.approx(states, abs=1e-6))
        shown = [pyo.value(one.dx[t]) for t in one.t if t > 0]
        assert shown == pytest.approx([pyo.value(asked.dx[t]) for t in asked.t if t > 0], abs=1e-5)
