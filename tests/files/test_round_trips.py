"""A model, its file, and the model made of the file say the same of a point: by either writer, and in JSON."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from known_mpccs import MpccProblem, mpcc_problems
from mpcc_catalogue.point_check import read_pairs
from pyomo import mpec

from pyrobocop_pyomo.complementarity import Complementarity, complements, either_zero
from pyrobocop_pyomo.files import read_file, write_file

from .points import COLLECTION, OPTIMA, check_same, scatter, written_and_read

WRITERS = ("nl_v2", "nl_v1")
SMALL = [problem for problem in mpcc_problems() if "large" not in problem.tags]

# A side of any sign beside the forms of pyomo.mpec; where the bound of a variable is its own, it is left out.
SIDES = {
    "one-sided": lambda x, y: complements(x >= 1, y >= 0),
    "other direction": lambda x, y: complements(x <= 1, 2 - y >= 0),
    "with constants": lambda x, y: complements(2 * x + 3 >= 0, y - 1 >= 0),
    "nonlinear": lambda x, y: complements(x**2 - y + 2 >= 0, pyo.exp(x) - 1 >= 0),
    "range": lambda x, y: complements(pyo.inequality(-1, x, 1), y - 2),
    "range against a variable": lambda x, y: complements(pyo.inequality(-1, x, 1), y, second_bound="free"),
    "range of an expression": lambda x, y: complements(pyo.inequality(-1, x + y, 1), x * y),
    "equation": lambda x, y: complements(x + y == 1, x * y),
    "any sign": lambda x, y: either_zero(x >= 0, y - x),
    "any sign below": lambda x, y: either_zero(x <= 1, y),
}
values = st.integers(-6, 6).map(lambda number: number / 2)
bounds = st.sampled_from([(None, None), (0, None), (1, None), (None, 1), (-1, 1)])


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("problem", SMALL, ids=lambda problem: problem.name)
def test_problems_of_the_catalogue_come_back(problem: MpccProblem, writer: str, tmp_path: Path) -> None:
    for seed in range(2):
        model = problem.build()
        scatter(model, seed)
        check_same(model, written_and_read(model, tmp_path / "problem.nl", writer=writer))


@pytest.mark.casadi
@pytest.mark.parametrize("problem", SMALL, ids=lambda problem: problem.name)
def test_problems_of_the_catalogue_come_back_from_json(problem: MpccProblem, tmp_path: Path) -> None:
    model = problem.build()
    scatter(model, 0)
    sign = -1.0 if "maximise" in problem.tags else 1.0  # such files minimise
    check_same(model, written_and_read(model, tmp_path / "problem.json"), sign)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    pairs=st.lists(st.tuples(st.sampled_from(sorted(SIDES)), st.integers(0, 5)), min_size=1, max_size=4),
    ends=st.lists(bounds, min_size=3, max_size=3),
    point=st.lists(values, min_size=3, max_size=3),
    fixed=st.sampled_from([None, 0, 1, 2]),
    writer=st.sampled_from(WRITERS),
)
def test_any_pairs_over_any_variables_come_back(
    pairs: Any, ends: Any, point: Any, fixed: int | None, writer: str, tmp_path: Path
) -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(3), bounds=lambda m, i: ends[i])
    orders = list(itertools.permutations(range(3), 2))
    m.pairs = Complementarity(
        range(len(pairs)), rule=lambda m, k: SIDES[pairs[k][0]](*(m.x[i] for i in orders[pairs[k][1]]))
    )
    m.row = pyo.Constraint(expr=m.x[0] + m.x[1] ** 2 - m.x[2] <= 4)
    m.cost = pyo.Objective(expr=m.x[0] * m.x[1] + 3 * m.x[2] + 2, sense=pyo.maximize)
    for variable, number in zip(m.x.values(), point, strict=True):
        variable.set_value(number, skip_validation=True)
    if fixed is not None:
        m.x[fixed].fix()
        m.x[fixed].bounds = (None, None)  # of what is fixed they are in no file
    check_same(m, written_and_read(m, tmp_path / "model.nl", writer=writer))


@pytest.mark.parametrize("writer", WRITERS)
def test_writing_changes_nothing_in_the_model(writer: str, tmp_path: Path) -> None:
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=2.0)
    m.pair = Complementarity(expr=complements(m.x >= 1, m.y * m.x >= 2))
    m.other = mpec.Complementarity(expr=mpec.complements(m.y >= 0, m.x + 1 >= 0))
    m.cost = pyo.Objective(expr=m.x)
    before = [*map(id, m.component_objects()), m.x.bounds, m.y.bounds, m.x.value]
    write_file(m, tmp_path / "m.nl", writer=writer)
    assert [*map(id, m.component_objects()), m.x.bounds, m.y.bounds, m.x.value] == before
    assert m.pair.active
    assert m.other.active


@pytest.mark.parametrize("writer", WRITERS)
def test_a_variable_with_its_bound_needs_no_other_and_names_stay(writer: str, tmp_path: Path) -> None:
    m = pyo.ConcreteModel()
    m.force, m.gap = pyo.Var(bounds=(0, None)), pyo.Var([1, 2], bounds=(0, None))
    m.contact = Complementarity([1, 2], rule=lambda m, i: complements(m.gap[i] + m.force - i >= 0, m.gap[i] >= 0))
    m.cost = pyo.Objective(expr=m.force**2 + m.gap[1] + m.gap[2])
    problem = written_and_read(m, tmp_path / "m.nl", writer=writer)
    assert set(problem.variables) == {"force", "gap[1]", "gap[2]"}
    model = problem.model()
    assert sorted(model.pairs) == ["contact[1]", "contact[2]"]
    assert len(model.rows) == 0
    # Of the two rows the constants are in the bodies.
    model.x["force"].set_value(5.0)
    for name in ("gap[1]", "gap[2]"):
        model.x[name].set_value(0.0)
    assert sorted(pyo.value(pair.second) for pair in read_pairs(model)) == [3.0, 4.0]


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("name", OPTIMA)
def test_what_was_read_is_written_the_same_way(name: str, writer: str, tmp_path: Path) -> None:
    problem = read_file(COLLECTION / f"{name}.nl")
    model = problem.model()
    scatter(model, 1)
    again = written_and_read(model, tmp_path / "again.nl", writer=writer)
    assert len(again.variables) == len(problem.variables)
    check_same(model, again)


@pytest.mark.parametrize("writer", WRITERS)
def test_the_header_counts_the_pairs(writer: str, tmp_path: Path) -> None:
    """Linear, nonlinear, those between two bounds, and those of variables that are not just nonnegative."""
    m = pyo.ConcreteModel()
    m.a, m.b, m.c = pyo.Var(bounds=(0, None)), pyo.Var(bounds=(1, None)), pyo.Var(bounds=(-1, 1))
    m.linear = Complementarity(expr=complements(m.a >= 0, m.b + m.c >= 0))
    m.nonlinear = Complementarity(expr=complements(m.b >= 1, m.a**2 - m.c >= 0))
    m.between = Complementarity(expr=complements(pyo.inequality(-1, m.c, 1), m.a - m.b))
    m.row = pyo.Constraint(expr=m.a + m.b == 3)
    m.cost = pyo.Objective(expr=m.a)
    lines = write_file(m, tmp_path / "m.nl", writer=writer).read_text().split("\n")
    assert lines[1].split("#")[0].split() == ["3", "4", "1", "0", "1"]
    assert lines[2].split("#")[0].split() == ["1", "0", "2", "1", "1", "1"]


@pytest.mark.parametrize("writer", WRITERS)
def test_a_variable_that_only_its_pair_holds_is_written(writer: str, tmp_path: Path) -> None:
    """Writers show variables of rows and objectives; the variable of a pair may be in none."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(bounds=(1, None), initialize=1.5), pyo.Var(initialize=0.25)
    m.z = pyo.Var(bounds=(-1, 1), initialize=0.5)
    m.pair = Complementarity(expr=complements(m.x >= 1, m.y >= 0))
    m.range = Complementarity(expr=complements(pyo.inequality(-1, m.z, 1), m.y - 2))
    problem = written_and_read(m, tmp_path / "m.nl", writer=writer)
    assert {"x", "y", "z"} <= set(problem.variables)
    check_same(m, problem)


def test_variables_of_another_model_keep_their_bounds(tmp_path: Path) -> None:
    """Of Pyomo's writers only v2 takes them at all."""
    other, m = pyo.ConcreteModel(), pyo.ConcreteModel()
    other.x, m.y = pyo.Var(initialize=1.5), pyo.Var(initialize=0.25)
    m.pair = Complementarity(expr=complements(other.x >= 1, m.y + other.x >= 0))
    m.cost = pyo.Objective(expr=other.x + m.y)
    problem = written_and_read(m, tmp_path / "m.nl")
    assert other.x.bounds == (None, None)
    assert problem.check(problem.start).natural == 0.5
