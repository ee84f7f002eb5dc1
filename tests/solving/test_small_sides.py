"""Units of sides and of the objective change neither the answer nor what is called a solution."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyomo.mpec import Complementarity, complements

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.solving.iterates import Iterate, Quality, Tolerances
from pyrobocop_pyomo.solving.model_check import SideSizes

pytestmark = pytest.mark.ipopt

powers = st.integers(-8, 8)


def corner(x_unit: float, y_unit: float, cost_unit: float = 1.0, *, start: float = 1.0, lifted: bool = False):
    """The nearest point to (1, 2) on the axes, which is (0, 2) at a squared distance of 1."""
    m = pyo.ConcreteModel(name="corner")
    m.x, m.y = pyo.Var(initialize=start * x_unit), pyo.Var(initialize=start * y_unit)
    first = m.x + m.y * 1e-3 * x_unit / y_unit if lifted else m.x
    m.pair = Complementarity(expr=complements(first >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=cost_unit * ((m.x / x_unit - 1) ** 2 + (m.y / y_unit - 2) ** 2))
    return m


@settings(max_examples=25)
@given(x_power=powers, y_power=powers, start=st.sampled_from([0.0, 1.0, 3.0]))
@example(x_power=-8, y_power=-8, start=1.0)  # its polish ends by a step that is too small
def test_sides_in_other_units_have_the_same_answer_or_none(x_power: int, y_power: int, start: float):
    m = corner(10.0**x_power, 10.0**y_power, start=start)
    result = rcp.solve(m)
    if result.solved:
        assert result.objective == pytest.approx(1.0, abs=1e-4) or result.objective == pytest.approx(4.0, abs=1e-4)
        assert min(m.x.value / 10.0**x_power, m.y.value / 10.0**y_power) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("lifted", [False, True])
@pytest.mark.parametrize(("x_unit", "y_unit"), [(1e-2, 1e-2), (1e-4, 1e-4), (1e-5, 1e-6), (1e-5, 100.0), (1e-4, 1e6)])
def test_the_answer_is_found_in_small_units(x_unit: float, y_unit: float, lifted: bool):
    m = corner(x_unit, y_unit, lifted=lifted)
    result = solution(m)
    assert result.objective == pytest.approx(1.0, abs=1e-2)  # the side is slightly turned where it is lifted
    assert abs(m.x.value / x_unit + (1e-3 * m.y.value / y_unit if lifted else 0.0)) < 1e-6


@pytest.mark.parametrize("power", [0, -3, -5])
def test_effort_that_need_not_be_made_costs_nothing_in_any_unit(power: int):
    """Its derivative vanishes at its bound: what the barrier leaves of it has the size of its parameter."""
    m = corner(1.0, 1.0, 10.0**power)
    m.effort = pyo.Var(range(8), bounds=(0, None), initialize=1.0)
    m.cost.set_value(m.cost.expr + 10.0**power * sum(m.effort[i] ** 2 for i in m.effort))
    assert rcp.solve(m).objective == pytest.approx(10.0**power, rel=2e-5)


@pytest.mark.parametrize("power", [0, -6, -12])
def test_a_certificate_and_multipliers_know_the_unit_of_the_objective(power: int):
    """Both sides of the pair are zero at the start, and both descend from there, however small the objective is."""
    m = corner(1.0, 1.0, 10.0**power, start=0.0)
    result = rcp.solve(m)
    assert result.certificate is Certificate.PROVEN
    at_first = m.x.value == pytest.approx(0.0, abs=1e-6)  # or at the other local solution
    assert m.y.value == pytest.approx(2.0 if at_first else 0.0, abs=1e-4)
    (pair,) = result.pairs
    held = pair.first_multiplier if at_first else pair.second_multiplier
    assert held == pytest.approx((-2.0 if at_first else -4.0) * 10.0**power, rel=1e-3)


@pytest.mark.parametrize("power", [-9, -11, -14])
def test_a_side_that_bounds_keep_below_the_tolerance_is_small_and_not_zero(power: int):
    """As the force of friction is in units of large masses and long times: all of it is less than what is left of 0."""
    limit = 10.0**power
    m = pyo.ConcreteModel()
    m.friction, m.speed, m.free = pyo.Var(bounds=(-limit, limit)), pyo.Var(), pyo.Var()
    m.sliding = Complementarity(expr=complements(limit - m.friction >= 0, m.speed >= 0))
    m.open = Complementarity(expr=complements(m.free >= 0, m.speed >= 0))
    sizes = SideSizes(rcp.active_pairs(m), np.zeros((2, 2)))
    sticking, sliding = np.array([[limit, 100.0], [0.0, 100.0]]), np.array([[1e-9 * limit, 100.0], [limit, 100.0]])
    assert sizes.are_too_small(sticking, 1e-6).tolist() == [True, False]
    assert not sizes.are_too_small(sliding, 1e-6).any()


def test_without_a_polish_a_loose_point_of_small_sides_is_no_solution():
    m = corner(1e-4, 1e-4)
    result = rcp.solve(m, strategies=rcp.Strategy(polish=False))
    assert not result.solved
    assert result.quality is Quality.INFEASIBLE
    assert "pair 'pair': its sides are " in result.report()
    assert rcp.solve(corner(1.0, 1.0), strategies=rcp.Strategy(polish=False)).solved


def test_sides_that_are_both_zero_at_the_answer():
    for unit in (1.0, 1e-4):
        m = corner(unit, unit)
        m.cost.set_value((m.x / unit + 1) ** 2 + (m.y / unit + 1) ** 2)
        result = solution(m)
        assert result.objective == pytest.approx(2.0, abs=1e-6)


def test_tolerances_are_never_larger_than_for_sides_of_one():
    at = {"largest_product": 1e-8, "largest_natural_residual": 1e-5, "constraint_violation": 0.0}
    absolute = Iterate("run", None, None, None, 1, 0.0, **at)
    relative = Iterate("run", None, None, None, 1, 0.0, relative_product=1.0, relative_natural_residual=0.1, **at)
    assert absolute.excess(Tolerances()) == 1.0
    assert relative.excess(Tolerances()) > 1.0
