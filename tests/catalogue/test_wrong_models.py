"""Every mistake of the catalogue is found, named, and leaves nothing behind."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.phases import contents

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Subject

from .entries import pushed
from .wrong_models import WRONG_MODELS


def everything(m: Any) -> list[Any]:
    """All components and rows by name, with the values, bounds and fixing of all variables."""
    variables = list(m.component_data_objects(pyo.Var))
    return [*contents(m), *((v.name, v.value, v.lb, v.ub, v.fixed) for v in variables)]


@pytest.mark.parametrize("name", WRONG_MODELS)
def test_the_mistake_is_named_and_leaves_nothing_behind(name: str) -> None:
    wrong = WRONG_MODELS[name]
    m = pyo.ConcreteModel("wrong")
    stating = wrong.state(m)
    next(stating)
    if wrong.found_by == "statement":
        before = everything(m)
        with pytest.raises(wrong.expected, match=wrong.words):
            next(stating)
        assert everything(m) == before
        return
    next(stating, None)
    before = everything(m)
    if wrong.found_by == "check":
        with pytest.raises(wrong.expected, match=wrong.words):
            m.find_component(next(iter(m.component_map(pyo.Block)))).check()
        found = rcp.diagnose(m).about(Subject.INDEX) + rcp.diagnose(m).about(Subject.STATEMENT)
    else:
        found = [finding for finding in rcp.diagnose(m).about(wrong.expected) if wrong.component in finding.components]
    assert everything(m) == before
    (finding,) = found
    assert finding.remedy.endswith((".", "?"))
    with pytest.raises(AssertionError, match=wrong.words):
        raise AssertionError(finding.message)


@pytest.mark.parametrize("name", [name for name, wrong in WRONG_MODELS.items() if wrong.found_by == "diagnose"])
def test_without_the_mistake_nothing_of_the_kind_is_found(name: str) -> None:
    """What is stated up to the mistake is right, so that the finding is about the mistake and nothing else."""
    wrong = WRONG_MODELS[name]
    m = pyo.ConcreteModel("right")
    stating = wrong.state(m)
    next(stating)
    if name == "phase without a state":  # here the omission is the mistake
        return
    assert not [finding for finding in rcp.diagnose(m).about(wrong.expected) if wrong.component in finding.components]


def test_right_models_have_no_finding() -> None:
    m = pyo.ConcreteModel("right")
    pushed(m)
    assert rcp.diagnose(m).findings == ()
    assert rcp.diagnose(m.p).findings == ()


def test_the_catalogue_covers_all_who_speak() -> None:
    assert {wrong.found_by for wrong in WRONG_MODELS.values()} == {"statement", "check", "diagnose"}
    # What measurements see is found by `estimate`, which has data; an outcome, by a solve.
    assert {wrong.expected for wrong in WRONG_MODELS.values()} >= set(Subject) - {
        Subject.IDENTIFIABILITY,
        Subject.OUTCOME,
    }
