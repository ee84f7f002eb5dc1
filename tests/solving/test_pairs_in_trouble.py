"""Models with pairs that start where a side has no value, whose bounds contradict each other, or that are unbounded."""

from __future__ import annotations

import math

import pyomo.environ as pyo
import pytest
from pyomo.mpec import Complementarity, complements

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.solving.iterates import Quality, Standing, StopReason, Tolerances
from pyrobocop_pyomo.solving.violations import violations_of_pairs

pytestmark = pytest.mark.ipopt


def plane(start: tuple[float, float] = (1.0, 1.0), bounds: tuple[float | None, float | None] = (None, None)):
    m = pyo.ConcreteModel(name="plane")
    m.x, m.y = pyo.Var(bounds=bounds, initialize=start[0]), pyo.Var(bounds=bounds, initialize=start[1])
    return m


def test_a_start_at_which_a_side_has_no_value_is_moved():
    m = plane(start=(-1.0, 1.0))
    m.pair = Complementarity(expr=complements(pyo.sqrt(m.x) - 1 >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=(m.x - 4) ** 2 + (m.y - 2) ** 2)
    result = rcp.solve(m)
    assert result.solved
    guess = "The initial guess could not be evaluated: sqrt(...) of x = -1, in a side of complementarity 'pair'"
    assert guess in result.report()
    assert result.objective == pytest.approx(4.0, abs=1e-6)


def test_a_side_that_can_have_no_value_where_the_rows_hold_is_a_failed_result():
    m = plane(start=(-1.0, 1.0))
    m.negative = pyo.Constraint(expr=m.x + m.y / 10 <= -0.5)
    m.pair = Complementarity(expr=complements(pyo.sqrt(m.x) >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=(m.x - 4) ** 2 + (m.y - 2) ** 2)
    result = rcp.solve(m)
    assert result.quality is Quality.INFEASIBLE
    assert "sqrt(...) of x = -1" in result.report()
    assert result.table()
    assert result.report()


def test_pairs_without_a_value_are_reported_as_not_met():
    residual = PairResidual("pair", math.nan, 1.0)
    (violation,) = violations_of_pairs([residual], Tolerances())
    assert math.isinf(violation.amount)
    assert violation.name == "pair"


def two_variables(m):
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))


def expressions(m):
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x + 0.5 * m.y - 0.5 * m.y >= 0, m.y * (1 + m.x**2) >= 0))


def of_pyomo(m):
    m.pair = Complementarity(expr=complements(m.x >= 0, m.y >= 0))


def between_bounds(m):
    m.pair = rcp.Complementarity(expr=rcp.complements(pyo.inequality(0, m.x, 10), m.y))


def with_an_equation(m):
    m.z = pyo.Var(initialize=1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.z >= 0))
    m.row = pyo.Constraint(expr=m.z == m.y / 3 + 0.1 * m.x - 0.1)


@pytest.mark.parametrize("maximise", [False, True])
@pytest.mark.parametrize("state_pair", [two_variables, expressions, of_pyomo, between_bounds, with_an_equation])
def test_an_objective_that_falls_without_end_has_no_solution(state_pair, maximise: bool):
    m = plane()
    state_pair(m)
    cost = (m.x - 1) ** 2 - m.y
    m.cost = pyo.Objective(expr=-cost if maximise else cost, sense=pyo.maximize if maximise else pyo.minimize)
    result = rcp.solve(m)
    assert not result.solved
    assert result.stop_reason is StopReason.DIVERGED
    assert "What grows: " in result.report()
    assert "'y' (" in result.report()
    # What is left on the model is the optimum of the branch that is bounded, where any run has found it.
    if any(step.converged for step in result.steps):
        assert abs(m.y.value) < 1.0
        assert abs(result.objective) < 1.0
    assert not result.standing.bounded


def test_with_a_bound_on_what_grows_the_far_branch_is_the_solution():
    m = plane()
    two_variables(m)
    m.y.setub(1e4)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2 - m.y)
    result = rcp.solve(m)
    assert result.solved
    assert result.objective == pytest.approx(1 - 1e4, rel=1e-6)


def test_points_on_the_way_to_infinity_are_the_last_choice_among_feasible_ones():
    far, near = Standing(excess=1.0, cost=-1e19, bounded=False), Standing(excess=1.0, cost=1.0)
    assert near.is_better_than(far)
    assert not far.is_better_than(near)
    assert far.is_better_than(Standing(excess=2.0))
