"""Linear programs: how they end, what their duals say, and limits of a search with integers."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import scipy.sparse
from harness.quadratic_program import QuadraticProgram
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import sides

from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE
from pyrobocop_pyomo.mpcc.linear_programs import LinearProgram, LinearStatus
from pyrobocop_pyomo.mpcc.linearisation import Linearisation
from pyrobocop_pyomo.mpcc.lpec import steepest_branch
from pyrobocop_pyomo.mpcc.multipliers import MultiplierProblem
from pyrobocop_pyomo.mpcc.problem import ComplementarityProgram
from pyrobocop_pyomo.mpcc.stationarity import Stationarity

NUMBERS = st.integers(-3, 3).map(float)


def test_a_limit_of_nodes_ends_the_search_and_is_told():
    """Of each pair the sides gain at random, and one row takes only some: nothing is shown at the first node."""
    k, random = 40, np.random.default_rng(0)
    nlp = QuadraticProgram(
        -random.uniform(1, 2, 2 * k),
        A=random.uniform(0, 1, (20, 2 * k)),
        g_upper=np.full(20, 4.0),
        x_lower=np.zeros(2 * k),
    )
    program = ComplementarityProgram(nlp, sides(np.arange(k)), sides(k + np.arange(k)))
    nodes: list[int] = []
    found = steepest_branch(program, Linearisation.at(nlp, np.zeros(2 * k)), 1.0, node_limit=3, on_nodes=nodes.append)
    assert found is None or not found.proven
    assert nodes[0] <= 4


def test_bounds_that_contradict_each_other_have_no_point():
    def ends(lower: float, upper: float) -> tuple[LinearStatus, object, int]:
        return LinearProgram(np.ones(1), np.array([lower]), np.array([upper])).solve(NO_DEADLINE)

    assert ends(0.5, 0.2) == (LinearStatus.INFEASIBLE, None, 1)
    assert ends(0.5, 1.0) == (LinearStatus.SOLVED, pytest.approx([0.5]), 1)


@given(c=st.lists(NUMBERS, min_size=3, max_size=3), A=st.lists(NUMBERS, min_size=9, max_size=9))
@settings(max_examples=40)
def test_duals_say_by_how_much_the_least_cost_grows_with_each_bound(c, A):
    """The rows have an upper, a lower, and both bounds, which are equal; a change by 1e-4 costs at least its dual."""
    matrix = scipy.sparse.csr_array(np.array(A).reshape(3, 3))
    lower, upper = np.array([-np.inf, -0.7, 0.0]), np.array([0.5, np.inf, 0.0])

    def program(change: np.ndarray) -> LinearProgram:
        return LinearProgram(np.array(c), -np.ones(3), np.ones(3), [(matrix, lower + change, upper + change)])

    x, duals = program(np.zeros(3)).solve_with_duals(NO_DEADLINE)
    assert np.dot(c, x) == pytest.approx(np.dot(c, program(np.zeros(3)).solve(NO_DEADLINE).x), abs=1e-7)
    for change in 1e-4 * np.vstack([np.eye(3), -np.eye(3)]):
        changed = program(change).solve(NO_DEADLINE).x
        assert changed is None or np.dot(c, changed) >= np.dot(c, x) + duals @ change - 1e-7


def test_threads_may_take_turns():
    programs = [LinearProgram(np.array([-1.0]), np.zeros(1), np.array([float(size)])) for size in range(1, 9)]
    found: dict[int, list[float]] = {}

    def solve_all(thread: int) -> None:
        found[thread] = [float(program.solve(NO_DEADLINE).x[0]) for _ in range(5) for program in programs]

    threads = [threading.Thread(target=solve_all, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(answers == [float(size) for size in range(1, 9)] * 5 for answers in found.values())


@given(c=st.lists(NUMBERS, min_size=4, max_size=4), A=st.lists(NUMBERS, min_size=8, max_size=8))
@settings(max_examples=40)
def test_multipliers_of_the_least_sum_leave_what_they_say_and_have_the_signs(c, A):
    """Whatever they leave, the ones with the smallest largest residual leave no more."""
    nlp = QuadraticProgram(np.array(c), A=np.array(A).reshape(2, 4), g_upper=[0.0, 0.0], x_lower=np.zeros(4))
    program = ComplementarityProgram(nlp, sides([0, 1]), sides([2, 3]))
    problem = MultiplierProblem(program, Linearisation.at(nlp, np.zeros(4)))
    nearly = problem.find_nearly_strong()
    best = problem.find(Stationarity.S)
    assert best.residual <= nearly.residual + 1e-6
    assert (nearly.nu >= 0.0).all()
    assert (nearly.xi >= 0.0).all()
    assert (nearly.rows >= 0.0).all()
    left = np.array(c) + nlp.A.T @ nearly.rows - np.concatenate([nearly.nu, nearly.xi])
    scale = max(1.0, float(np.abs(c).max()))
    assert np.abs(left).max() / scale == pytest.approx(nearly.residual, abs=1e-9)
    assert (nearly.residual <= 1e-6) == (best.residual <= 1e-6)
