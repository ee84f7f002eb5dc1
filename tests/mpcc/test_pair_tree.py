"""Choices of sides by branch and bound: the least of all branches, within limits, by whatever solves the programs."""

from __future__ import annotations

import itertools
import threading

import numpy as np
import pytest
import scipy.sparse
from harness.quadratic_program import QuadraticProgram
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import sides

from pyrobocop_pyomo.mpcc import linear_programs
from pyrobocop_pyomo.mpcc.linear_programs import LinearProgram, LinearStatus
from pyrobocop_pyomo.mpcc.linearisation import Linearisation
from pyrobocop_pyomo.mpcc.multipliers import MultiplierProblem
from pyrobocop_pyomo.mpcc.pair_tree import OpenSides, PairTree
from pyrobocop_pyomo.mpcc.problem import ComplementarityProgram
from pyrobocop_pyomo.mpcc.stationarity import Stationarity

NUMBERS = st.integers(-3, 3).map(float)


def tree_of(cost: np.ndarray, rows: np.ndarray, right: np.ndarray) -> PairTree:
    """Pairs of the first and the second half of nonnegative variables up to 1."""
    k = cost.size // 2
    program = LinearProgram(
        cost, np.zeros(2 * k), np.ones(2 * k), [(scipy.sparse.csr_array(rows), np.full(right.size, -np.inf), right)]
    )
    first, second = (OpenSides(np.arange(k) + shift, np.ones(k), np.zeros(k)) for shift in (0, k))
    return PairTree(program, first, second, np.ones(k, dtype=bool), time_limit=60.0)


@st.composite
def trees(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    k = draw(st.integers(1, 4))
    cost = np.array(draw(st.lists(NUMBERS, min_size=2 * k, max_size=2 * k)))
    rows = np.array(draw(st.lists(NUMBERS, min_size=4 * k, max_size=4 * k))).reshape(2, 2 * k)
    return cost, rows, np.array([0.5, 1.0])


@given(given_tree=trees())
@settings(max_examples=40)
def test_the_tree_finds_the_least_of_all_branches(given_tree):
    tree = tree_of(*given_tree)
    k = given_tree[0].size // 2
    costs = {
        choice: tree.cost_of(np.array(choice), ~np.array(choice))
        for choice in itertools.product([True, False], repeat=k)
    }
    found = tree.search(node_limit=1000)
    assert found.proven
    assert found.cost == pytest.approx(min(costs.values()), abs=1e-6)
    assert costs[tuple(found.a_zero.tolist())] == pytest.approx(found.cost, abs=1e-6)
    below = tree.search(ceiling=min(costs.values()) - 1e-3, node_limit=1000)
    assert below.x is None
    assert below.proven


@given(given_tree=trees(), data=st.data())
@settings(max_examples=30)
def test_a_node_is_no_better_than_the_one_before(given_tree, data):
    """eq-pair-tree: holding one more side cannot lower the least cost."""
    tree = tree_of(*given_tree)
    k = given_tree[0].size // 2
    a_zero, b_zero = (np.array(data.draw(st.lists(st.booleans(), min_size=k, max_size=k))) for _ in range(2))
    more = a_zero.copy()
    more[data.draw(st.integers(0, k - 1))] = True
    assert tree.cost_of(more, b_zero) >= tree.cost_of(a_zero, b_zero) - 1e-7


def test_a_limit_of_nodes_ends_the_search_and_is_told():
    """Either side of each pair gains 1: a relaxed program promises twice of what any branch gives."""
    k = 4
    no_rows = np.empty((0, 2 * k)), np.empty(0)
    limited = tree_of(-np.ones(2 * k), *no_rows).search(node_limit=3)
    assert not limited.proven
    assert limited.nodes <= 3
    found = tree_of(-np.ones(2 * k), *no_rows).search(node_limit=1000)
    assert found.proven
    assert found.cost == pytest.approx(-k)


@given(given_tree=trees())
@settings(max_examples=15)
def test_without_an_object_of_highs_the_answers_are_the_same(given_tree):
    kept = tree_of(*given_tree).search(node_limit=1000)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(linear_programs, "_kept_solver", lambda: None)
        anew = tree_of(*given_tree).search(node_limit=1000)
    assert anew.cost == pytest.approx(kept.cost, abs=1e-6)
    assert anew.proven == kept.proven


def test_bounds_that_contradict_each_other_have_no_point():
    program = LinearProgram(np.ones(1), np.zeros(1), np.ones(1))
    assert program.solve(np.array([0.5]), np.array([0.2]), time_limit=1.0) == (LinearStatus.INFEASIBLE, None)
    status, x = program.solve(np.array([0.5]), np.array([1.0]), time_limit=1.0)
    assert status is LinearStatus.SOLVED
    np.testing.assert_allclose(x, [0.5])


@pytest.mark.parametrize("threads", [0, 2])
def test_the_users_own_runs_of_highs_keep_their_threads_and_ours_go_on(threads: int) -> None:
    """HiGHS refuses a run that asks for another number of threads than the first run of the thread did."""
    highspy = pytest.importorskip("highspy")
    program = LinearProgram(np.array([-1.0]), np.zeros(1), np.ones(1))

    def users_own_run() -> object:
        highs = highspy.Highs()
        highs.setOptionValue("output_flag", False)
        highs.setOptionValue("threads", threads)
        highs.addVariable(0.0, 5.0, -1.0)
        highs.run()
        return highs.getModelStatus()

    for _ in range(2):
        assert users_own_run() == highspy.HighsModelStatus.kOptimal
        assert program.solve(time_limit=5.0)[0] is LinearStatus.SOLVED


def test_each_thread_has_an_object_of_its_own_and_programs_may_take_turns():
    programs = [LinearProgram(np.array([-1.0]), np.zeros(1), np.array([float(size)])) for size in range(1, 9)]
    found: dict[int, list[float]] = {}

    def solve_all(thread: int) -> None:
        found[thread] = [float(program.solve(time_limit=5.0)[1][0]) for _ in range(5) for program in programs]

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
    nearly = problem.find_nearly(Stationarity.S)
    best = problem.find(Stationarity.S)
    assert best.residual <= nearly.residual + 1e-6
    assert (nearly.nu >= 0.0).all()
    assert (nearly.xi >= 0.0).all()
    assert (nearly.rows >= 0.0).all()
    left = np.array(c) + nlp.A.T @ nearly.rows - np.concatenate([nearly.nu, nearly.xi])
    scale = max(1.0, float(np.abs(c).max()))
    assert np.abs(left).max() / scale == pytest.approx(nearly.residual, abs=1e-9)
    assert (nearly.residual <= 1e-6) == (best.residual <= 1e-6)
