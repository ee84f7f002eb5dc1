"""Every mistake of the catalogue is answered by its culprit and a remedy, and the remedy works when it is followed."""

import logging
import re
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import contents
from pyomo.core.base.block import Block

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.solving.result_text import MOST_CHARACTERS, MOST_LINES

from . import at_results, in_models, in_rules, in_solves, in_statements
from .entries import DIAGNOSED, MISTAKES, Diagnosed

STATED = [name for name, mistake in MISTAKES.items() if not mistake.solves]
SOLVED = [name for name, mistake in MISTAKES.items() if mistake.solves]


def says(text: str, words: tuple[str, ...]) -> None:
    for word in words:
        assert word in text, f"{word!r} is missing in:\n{text}"
    for noise in ("object at 0x", "NoneType"):
        assert noise not in text, text


def half_built(m: Any) -> list[str]:
    return [component.name for component in m.component_objects(descend_into=Block) if not component.is_constructed()]


@pytest.mark.ipopt
@pytest.mark.parametrize("name", STATED)
def test_a_statement_is_refused_and_its_remedy_is_not(name: str, caplog: pytest.LogCaptureFixture) -> None:
    mistake, m = MISTAKES[name], pyo.ConcreteModel(name="cart")
    with caplog.at_level(logging.WARNING), pytest.raises(Exception) as answer:  # noqa: PT011
        mistake.state(m, False)
    says(str(answer.value), mistake.words)
    assert not caplog.records  # what is raised is not printed as well
    assert not half_built(m)
    mistake.state(pyo.ConcreteModel(name="cart"), True)


@pytest.mark.ipopt
@pytest.mark.parametrize("name", SOLVED)
def test_a_solve_names_what_is_wrong_and_its_remedy_leads_to_a_solution(name: str) -> None:
    mistake, m = MISTAKES[name], pyo.ConcreteModel(name="cart")
    options = mistake.state(m, False) or {}
    try:
        result = rcp.solve(m, **options)
    except Exception as error:
        text = str(error)
    else:
        assert not result.solved
        lines = str(result).splitlines()
        assert len(lines) <= MOST_LINES
        assert max(map(len, lines)) <= MOST_CHARACTERS
        assert result.quality is not rcp.Quality.INFEASIBLE or "objective " not in lines[0]
        text = f"{result}\n{result.report()}"
    says(text, mistake.words)
    m = pyo.ConcreteModel(name="cart")
    options = mistake.state(m, True) or {}
    result = rcp.solve(m, **options)
    assert result.solved, str(result)


def everything(m: Any) -> list[Any]:
    """All components and rows by name, with the values, bounds and fixing of all variables."""
    variables = list(m.component_data_objects(pyo.Var))
    return [*contents(m), *((v.name, v.value, v.lb, v.ub, v.fixed) for v in variables)]


def findings(mistake: Diagnosed, followed: bool) -> list[Any]:
    m = pyo.ConcreteModel(name="cart")
    mistake.state(m, followed)
    before = everything(m)
    found = rcp.diagnose(m).findings
    assert everything(m) == before
    return [finding for finding in found if mistake.component in finding.components]


@pytest.mark.parametrize("name", DIAGNOSED)
def test_a_diagnosis_names_the_mistake_and_is_silent_without_it(name: str) -> None:
    words = DIAGNOSED[name].words
    (finding,) = (each for each in findings(DIAGNOSED[name], False) if re.search(words, each.message))
    assert finding.remedy.endswith((".", "?"))
    assert not any(re.search(words, each.message) for each in findings(DIAGNOSED[name], True))


def test_right_models_have_no_finding() -> None:
    m = pyo.ConcreteModel(name="cart")
    in_models.pushed(m)
    assert rcp.diagnose(m).findings == rcp.diagnose(m.p).findings == ()


def test_the_catalogue_is_large_and_its_files_are_all_read() -> None:
    assert len(MISTAKES) >= 60
    homes = {mistake.state.__module__ for mistake in MISTAKES.values()}
    assert homes == {module.__name__ for module in (at_results, in_rules, in_solves, in_statements)}
