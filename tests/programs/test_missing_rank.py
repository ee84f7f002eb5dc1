"""Equations that are dependent to first order are counted: the law is the rank of a matrix with generic entries."""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.missing_rank import missing_rank


class Linear:
    """A program whose Jacobian is given; its rows are equations but for the last."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.m, self.n = matrix.shape
        rows, columns = np.nonzero(np.ones_like(matrix))
        self.jacobian_structure = rows, columns
        self._slopes = matrix[rows, columns]
        self.g_lower = np.zeros(self.m)
        self.g_upper = np.append(np.zeros(self.m - 1), 1.0)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        return self._slopes


@given(st.lists(st.booleans(), min_size=24, max_size=24), st.integers(0, 2**31))
def test_equations_without_a_variable_of_their_own_are_those_that_the_rank_of_generic_entries_lacks(pattern, seed):
    matrix = np.reshape(pattern, (6, 4)) * np.random.default_rng(seed).uniform(1.0, 2.0, (6, 4))
    assert missing_rank(Linear(matrix), np.zeros(4)) == 5 - np.linalg.matrix_rank(matrix[:5])


def thrown(angle: float) -> pyo.ConcreteModel:
    m = pyo.ConcreteModel(name="thrown")
    m.p = b = rcp.PhaseBlock(duration=2, elements=6)
    b.x, b.y, b.v = rcp.State(initial=0), rcp.State(initial=0, final=0.1), rcp.State(initial=0)
    b.angle = rcp.Control(bounds=(-3.2, 3.2), initial_guess=angle)

    @b.ode
    def flight(b, t):
        sine, cosine = pyo.sin(b.angle[t]), pyo.cos(b.angle[t])
        return {b.x: b.v[t] * cosine, b.y: b.v[t] * sine, b.v: 0.5 - sine}

    m.range = pyo.Objective(expr=b.x.at_end, sense=pyo.maximize)
    return m


@pytest.mark.casadi
def test_a_motion_at_rest_cannot_be_steered():
    for angle, dependent in ((0.0, 1), (0.3, 0)):
        compiled = CompiledModel(thrown(angle), "vectorised")
        assert missing_rank(compiled.nlp, compiled.current_point()) == dependent


@pytest.mark.ipopt
@pytest.mark.casadi
def test_a_solve_starts_from_the_motion_where_equations_depend_at_the_initial_guess():
    assert rcp.solve(thrown(0.0), backend="vectorised").steps[0].label == "simulated"
    assert rcp.solve(thrown(0.3), backend="vectorised").steps[0].label == "solve"
    chosen = rcp.solve(thrown(0.0), backend="vectorised", strategies="solve")
    assert [step.label for step in chosen.steps] == ["solve"]
