"""What every entry of the catalogue of complementarity problems has to satisfy, without solving anything."""

import math
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st
from known_mpccs import MpccProblem, mpcc_problems
from pyomo import mpec

from pyrobocop_pyomo.complementarity import Complementarity, complements, either_zero

from .point_check import Point, PointCheck, check_point, read_pairs

PROBLEMS = mpcc_problems()
BY_NAME = [
    pytest.param(problem, id=problem.name, marks=[pytest.mark.heavy] if "large" in problem.tags else [])
    for problem in PROBLEMS
]
every_problem = pytest.mark.parametrize("problem", BY_NAME)


@every_problem
def test_a_build_has_pairs_and_a_start(problem: MpccProblem) -> None:
    model = problem.build()
    assert read_pairs(model)
    decided = [v for v in model.component_data_objects(pyo.Var) if not v.name.startswith("kkt")]
    assert all(v.value is not None for v in decided)
    assert ("maximise" in problem.tags) == PointCheck(model).maximise


@pytest.mark.parametrize("problem", [problem for problem in BY_NAME if problem.values[0].solution])
def test_known_answers_are_variables_and_complete_ones_are_optimal(problem: MpccProblem) -> None:
    model = problem.build()
    check = PointCheck(model)
    for name, number in problem.solution.items():
        model.find_component(name).set_value(number)
    if all(v.name in problem.solution for v in model.component_data_objects(pyo.Var)):
        point = check.point()
        assert max(point.violation, point.natural) <= 1e-9
        assert point.objective == pytest.approx(problem.best, rel=1e-9, abs=1e-9)


# --------------------------------------------------------------------
# The check of points: its residual is zero exactly where one of the branches of a pair holds.


FORMS = {
    "one-sided": lambda x, y: (x >= 1, y >= 0),
    "two directions": lambda x, y: (x <= 1, y >= -1),
    "variables on both sides": lambda x, y: (x >= y, y >= 0),
    "range against free": lambda x, y: (pyo.inequality(-1, x, 1), y),
    "range against a sign": lambda x, y: (pyo.inequality(-1, x, 1), y >= 0),
    "range against the other sign": lambda x, y: (y <= 0, pyo.inequality(-1, x, 1)),
    "equation": lambda x, y: (x == 1, y),
}
# A grid, on which bounds are met exactly and often.
numbers = st.integers(-6, 6).map(lambda number: number / 2)


def holds(rows: list[Any]) -> bool:
    return all(low <= pyo.value(body) <= high for low, body, high in rows)


@pytest.mark.parametrize("package", ["own", "mpec"])
@pytest.mark.parametrize("form", FORMS)
@given(x=numbers, y=numbers)
def test_the_residual_is_zero_exactly_where_a_branch_holds(form: str, package: str, x: float, y: float) -> None:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=x), pyo.Var(initialize=y)
    sides = FORMS[form](m.x, m.y)
    if package == "own":
        m.pair = Complementarity(expr=complements(*sides))
    else:
        m.pair = mpec.Complementarity(expr=mpec.complements(*sides))
    (pair,) = read_pairs(m)
    met = holds(pair.hull()) and any(holds(branch) for branch in pair.branches())
    point = PointCheck(m).point()
    assert (max(point.natural, point.violation) == 0.0) == met
    if met:
        assert point.product == 0.0


def test_what_a_method_adds_does_not_count() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(0, 1), initialize=0.5)
    m.cost = pyo.Objective(expr=m.x)
    check = PointCheck(m)
    m.cost.deactivate()
    m.other = pyo.Objective(expr=-m.x)
    m.row = pyo.Constraint(expr=m.x >= 3)
    assert check.point() == Point(0.5, 0.0, 0.0, 0.0)


def test_a_point_without_finite_values_is_infinitely_bad() -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=0.0)
    m.cost = pyo.Objective(expr=1 / m.x)
    assert PointCheck(m).point().violation == math.inf
    m.x.set_value(math.nan, skip_validation=True)
    assert PointCheck(m).point().violation == math.inf


@pytest.mark.parametrize(
    ("first", "second", "violation", "natural"),
    [(0.0, -3.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (0.5, -0.2, 0.0, 0.2), (-0.1, 4.0, 0.1, 0.1), (3.5, 0.0, 0.5, 0.0)],
)
def test_a_second_side_of_any_sign_is_read(first: float, second: float, violation: float, natural: float) -> None:
    m = pyo.ConcreteModel()
    m.a, m.b = pyo.Var(bounds=(0, 3)), pyo.Var()
    m.pair = Complementarity(expr=either_zero(m.a >= 0, m.b))
    m.a.set_value(first, skip_validation=True)
    m.b.set_value(second)
    point = check_point(m)
    assert (point.violation, point.natural) == (pytest.approx(violation), pytest.approx(natural))
