"""What every entry of the catalogue of complementarity problems has to satisfy, without solving anything."""

from __future__ import annotations

import pyomo.environ as pyo
import pytest
from known_mpccs import MpccProblem, mpcc_problem, mpcc_problems

from .point_check import PointCheck, read_pairs

PROBLEMS = mpcc_problems()
BY_NAME = [
    pytest.param(problem, id=problem.name, marks=[pytest.mark.heavy] if "large" in problem.tags else [])
    for problem in PROBLEMS
]
every_problem = pytest.mark.parametrize("problem", BY_NAME)


def test_enough_problems_and_no_name_twice() -> None:
    assert sum(problem.feasible for problem in PROBLEMS) >= 70
    assert sum(not problem.feasible for problem in PROBLEMS) >= 6
    assert len({problem.name for problem in PROBLEMS}) == len(PROBLEMS)


def test_every_kind_is_there() -> None:
    tags = frozenset().union(*(problem.tags for problem in PROBLEMS))
    wanted = {"academic", "bilevel", "linear", "biactive", "b-not-s", "infeasible", "mixed form", "maximise", "large"}
    assert wanted <= tags


@every_problem
def test_a_build_is_new_and_has_pairs_and_a_start(problem: MpccProblem) -> None:
    first, second = problem.build(), problem.build()
    assert first is not second
    assert read_pairs(first)
    decided = [v for v in first.component_data_objects(pyo.Var) if not v.name.startswith("kkt")]
    assert all(v.value is not None for v in decided)
    assert ("maximise" in problem.tags) == PointCheck(first).maximise


@every_problem
def test_a_source_or_a_note_says_where_it_is_from(problem: MpccProblem) -> None:
    assert problem.source or problem.notes or not problem.feasible
    assert problem.name in str(problem)


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


def test_one_by_its_name_and_similar_names_in_the_message() -> None:
    assert mpcc_problem("ralph1").name == "ralph1"
    with pytest.raises(KeyError, match="'ralph1'"):
        mpcc_problem("ralf1")


def test_an_entry_cannot_contradict_itself() -> None:
    with pytest.raises(ValueError, match="feasible is True and best is None"):
        MpccProblem("odd", pyo.ConcreteModel, None)
    with pytest.raises(ValueError, match=r"feasible is False and best is 1\.0"):
        MpccProblem("odd", pyo.ConcreteModel, 1.0, feasible=False)
