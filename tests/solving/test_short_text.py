"""`print(result)`: one line where all is well, and at most eight where it is not."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.presentation import percent
from pyrobocop_pyomo.solving.short_text import MOST_CHARACTERS, MOST_LINES

pytestmark = pytest.mark.ipopt


def cart(duration: float = 2.0, force: float = 20.0) -> Any:
    m = pyo.ConcreteModel(name="cart")
    m.p = b = rcp.PhaseBlock(duration=duration, elements=10)
    b.x, b.v = rcp.State(initial=0, final=1), rcp.State(initial=0, final=0)
    b.u = rcp.Control(bounds=(-force, force))
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t]})
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    return m


def pair(goal: float) -> Any:
    m = pyo.ConcreteModel(name="pair")
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1), pyo.Var(bounds=(0, None), initialize=1)
    m.c = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2 + (m.y - goal) ** 2)
    return m


def test_success_is_one_line_with_the_errors_of_equations_and_mesh() -> None:
    (line,) = str(rcp.solve(cart())).splitlines()
    assert line.startswith("cart: solved. objective 1.5, ")
    assert "equations to " in line
    assert "mesh error " in line
    assert "on 10 elements" in line


def test_pairs_are_counted_and_certified_in_the_same_line() -> None:
    (line,) = str(rcp.solve(pair(2.0))).splitlines()
    assert "1 pair exact, no better branch nearby" in line


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        (lambda: cart(force=0.5), {}, ["NOT SOLVED, and proven to have no solution", "not met: ", "- 'p.u' "]),
        (cart, {"options": {"max_iter": 0}}, ["the iteration limit was reached", "max_iter"]),
    ],
)
def test_a_failure_says_why_and_what_to_do_in_eight_lines(model: Any, options: Any, words: list[str]) -> None:
    result = rcp.solve(model(), **options)
    assert not result.solved
    lines = str(result).splitlines()
    assert len(lines) <= MOST_LINES
    assert all(len(line) <= MOST_CHARACTERS for line in lines)
    assert all(word in str(result) for word in words)


def test_everything_else_is_in_the_report() -> None:
    result = rcp.solve(cart())
    assert result.solver in result.report()
    assert result.steps_table() in result.report()
    assert result.solver not in str(result)


@given(st.floats(0.0, 1.0))
def test_a_share_is_written_as_people_do(share: float) -> None:
    text = percent(share)
    assert text.endswith(" %")
    if share > 1e-9:
        assert "e" not in text
        assert float(text[:-2]) == pytest.approx(100 * share, rel=0.5)
    else:
        assert text.startswith("below")
