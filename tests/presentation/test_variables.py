"""Variables over time and declarations show themselves by what the user knows of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.solving import StopReason


def model() -> pyo.ConcreteModel:
    m = pyo.ConcreteModel()
    m.go = b = rcp.PhaseBlock(duration=2.0, elements=3)
    b.x = rcp.State(initial=-1.0, final=3.0)
    b.arm = rcp.State(index=2, initial=0.0)
    b.u = rcp.Control(parametrization="piecewise_linear")
    return m


def test_a_variable_over_time_shows_its_range() -> None:
    m = model()  # a block does not keep its model alive
    b = m.go
    b.force = rcp.Control()
    b.force.set_values(dict.fromkeys(b.force))
    assert repr(b.force).endswith("times, no values yet>")
    for t in b.x:
        b.x[t].set_value(2.0 * t - 1.0, skip_validation=True)
    assert repr(b.x) == f"<SignalVar: 'go.x' at {len(b.x)} times, -1 .. 3>"
    assert str(b.x) == "go.x"


def test_all_that_a_phase_holds_shows_itself() -> None:
    m = model()  # a block does not keep its model alive
    b = m.go
    for variable in b.component_objects(pyo.Var):
        assert len(repr(variable)) < 200
    assert "'go.u'" in repr(b.u)
    assert "<strong>" in b.u._repr_html_()


@given(st.dictionaries(st.sampled_from(["initial", "final", "initial_guess"]), st.floats(-9, 9), min_size=1))
def test_a_declaration_shows_what_was_given_and_can_be_read_back(given_values: dict[str, float]) -> None:
    declaration = rcp.State(**given_values)
    assert eval(repr(declaration), {"State": rcp.State}) == declaration
    assert repr(declaration).count("=") == len(given_values)


def test_declarations_hide_defaults() -> None:
    assert repr(rcp.Control(bounds=(-1, 1))) == "Control(bounds=(-1, 1))"
    assert repr(rcp.Duration(bounds=(0.5, 5))) == "Duration(bounds=(0.5, 5))"
    assert "\n" not in repr(rcp.State(initial=np.eye(4)))


@pytest.mark.casadi
@pytest.mark.parametrize(
    ("reason", "words"),
    [(StopReason.INTERRUPTED, "solved when interrupted."), (StopReason.TIME_LIMIT, "solved at the time limit.")],
)
def test_a_run_that_was_cut_short_says_so_in_its_line(reason: StopReason, words: str) -> None:
    m = pyo.ConcreteModel(name="cut")
    m.x = pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2.0) ** 2)
    result = rcp.solve(m)
    assert words not in repr(result)
    assert words in repr(replace(result, stop_reason=reason))
