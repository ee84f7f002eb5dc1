"""Kinds of stationarity, against their definitions."""

import threading
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from harness.quadratic_program import QuadraticProgram
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import at_origin, ipopt, paired, sides, trap

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Certificate
from pyrobocop_pyomo.mpcc.lpec import steepest_branch
from pyrobocop_pyomo.mpcc.multipliers import MultiplierProblem, Stationarity, classify, strong_multipliers
from pyrobocop_pyomo.mpcc.problem import (
    Branch,
    ComplementarityProgram,
    Linearisation,
    Sides,
    branch_with,
    nearest_branch,
    restricted,
)
from pyrobocop_pyomo.numerics.linear_programs import LinearProgram, LinearStatus
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint

TWO_MULTIPLIERS = st.tuples(st.sampled_from([-2.0, 0.0, 3.0]), st.sampled_from([-1.0, 0.0, 1.0]))


def kind_by_definition(nu, xi):
    """For unique multipliers at biactive pairs."""
    if (nu >= 0).all() and (xi >= 0).all():
        return Stationarity.S
    if (((nu > 0) & (xi > 0)) | (nu * xi == 0)).all():
        return Stationarity.M
    if (nu * xi >= 0).all():
        return Stationarity.C
    if ((nu >= 0) | (xi >= 0)).all():
        return Stationarity.A
    return Stationarity.W


def at(program, x):
    return MultiplierProblem(program, Linearisation.at(program.nlp, np.asarray(x, dtype=float)))


@given(signs=st.lists(TWO_MULTIPLIERS, min_size=1, max_size=4))
@settings(max_examples=40)
def test_without_constraints_the_gradient_is_the_multipliers(signs):
    nu, xi = np.array(signs).T
    k = len(signs)
    found = classify(at(paired(np.concatenate([nu, xi]), k, x_lower=np.zeros(2 * k)), np.zeros(2 * k)))
    assert found.kind is kind_by_definition(nu, xi)
    np.testing.assert_allclose(found.nu, nu, atol=1e-6)
    np.testing.assert_allclose(found.xi, xi, atol=1e-6)


@given(signs=TWO_MULTIPLIERS)
def test_a_side_that_falls_with_its_variable_has_the_mirrored_multiplier(signs):
    """``0 <= 1 - x ⟂ y >= 0`` at x = 1: the multiplier of 1 - x is minus the slope in x."""
    nlp = QuadraticProgram(signs, x_lower=[-np.inf, 0], x_upper=[1, np.inf])
    program = ComplementarityProgram(nlp, sides(0, sign=-1.0, offset=1.0), sides(1))
    found = classify(at(program, [1.0, 0.0]))
    assert found.kind is kind_by_definition(np.array([-signs[0]]), np.array([signs[1]]))
    assert found.nu[0] == pytest.approx(-signs[0], abs=1e-6)


@given(slopes=st.tuples(st.floats(-3, 3), st.floats(-3, 3)))
def test_a_strictly_complementary_pair_asks_for_no_sign(slopes):
    """At x = 0, y = 1 with y at its upper bound, every slope of x is balanced; one of y only if it is not positive."""
    found = classify(at(paired(slopes, x_lower=[0, 0], x_upper=[np.inf, 1]), [0.0, 1.0]))
    if slopes[1] <= 0:
        assert found.kind is Stationarity.S
        assert found.nu[0] == pytest.approx(slopes[0], abs=1e-6)
    elif slopes[1] > 1e-5:
        assert found.kind is Stationarity.NONE


def test_multipliers_are_a_matter_of_existence():
    """Two equal rows share a force in any way: some multipliers have wrong signs, others the right ones."""
    # At the origin: minimise x + y over x + y >= 0 (twice) and 0 <= x ⟂ y >= 0.
    program = paired([1, 1], A=[[1, 1], [2, 2]], g_lower=[0, 0], x_lower=[0, 0])
    assert classify(at(program, [0.0, 0.0])).kind is Stationarity.S


def test_a_row_that_repeats_a_side_has_no_multiplier_of_its_own():
    """Otherwise it could take the wrong sign off nu: minimise -y with x free of bounds, held by a row x >= 0."""
    with_row = paired([1, -1], A=[[1, 0]], g_lower=[0], x_lower=[-np.inf, 0])
    found = classify(at(with_row, [0.0, 0.0]))
    assert (found.kind, round(found.nu[0], 6), round(found.xi[0], 6)) == (Stationarity.A, 1.0, -1.0)


def test_a_solver_that_shares_the_multiplier_between_row_and_side_changes_nothing():
    """Minimise -y + (x + 3)^2 / 2 with x held at zero by the branch, and by a row x >= 0 that takes a part."""
    program = paired([3, 1], H=np.eye(2), A=[[2, 0]], g_lower=[0], x_lower=[-np.inf, 0])
    point = Linearisation.at(program.nlp, np.zeros(2))
    branch = Branch(np.array([True]), np.array([True]))
    for part in (0.0, 0.5, 1.5):
        solver = PrimalDualPoint(np.zeros(2), np.array([-part]), np.zeros(2), np.zeros(2))
        found = strong_multipliers(program, point, branch, solver, sizes=np.ones(2))
        assert found is not None
        assert (found.nu[0], found.xi[0]) == pytest.approx((3.0, 1.0))


# --------------------------------------------------------------------
# From branch to branch, with a certificate at the end.


needs_ipopt = pytest.mark.casadi
WRONG = Branch(np.array([False]), np.array([True]))  # of a trap: with y at zero x^2 + 1 is least at the origin


@needs_ipopt
def test_an_m_stationary_point_that_is_not_b_is_left_along_the_branch_that_descends():
    program = trap()
    search = ActiveSetSearch(program, ipopt)
    found = search.descend(at_origin(program, WRONG))
    assert search.certificate is Certificate.PROVEN
    np.testing.assert_allclose(found.x, [0.0, 1.0], atol=1e-6)


def ending(runs=None, **how):
    """Runs of Ipopt that end otherwise than they do."""

    def run(nlp, start, iterations):
        if runs is not None:
            runs.append(nlp)
        return replace(ipopt(nlp, start), **how)

    return run


def many(pairs, gain, factor):
    """In each pair b costs 1 and a, which is held at zero, gains a little: it is free to leave."""
    c = factor * np.concatenate([np.full(pairs, -gain), np.ones(pairs)])
    return paired(c, pairs, H=np.diag(np.abs(c)), x_lower=np.zeros(2 * pairs))


@needs_ipopt
@pytest.mark.parametrize(
    ("pairs", "gain", "descends", "factor"),
    [
        *((1, 1e-4, True, factor) for factor in (1e-6, 1.0, 1e6)),
        (300, 5e-7, True, 1e-6),
        (300, 5e-7, True, 1e6),
        (300, 5e-9, False, 1e-6),
        (300, 5e-9, False, 1e6),
    ],
)
def test_what_is_certified_does_not_depend_on_the_unit_of_the_objective(pairs, gain, descends, factor):
    """Neither multipliers nor linear programs call a point stationary from which small steps of many pairs descend."""
    program = many(pairs, gain, factor)
    held = at_origin(program, Branch(np.ones(pairs, dtype=bool), np.zeros(pairs, dtype=bool)))
    gradient = program.nlp.gradient(held.x)
    solved = replace(
        held.point, lower_multipliers=np.maximum(gradient, 0.0), upper_multipliers=np.maximum(-gradient, 0.0)
    )
    point = Linearisation.at(program.nlp, held.x)
    strong = strong_multipliers(program, point, held.branch, solved, np.ones(2 * pairs))
    steepest = steepest_branch(program, point, 1e-3, stay=held.branch, node_limit=1000)
    assert (strong is None) == descends
    assert (steepest.gain > 1e-5 * factor) == descends
    assert steepest.gain == pytest.approx(pairs * gain * factor if descends else 0.0, rel=1e-3, abs=1e-5 * factor)
    kind = classify(MultiplierProblem(program, point))
    assert kind.residual == pytest.approx(0.0 if pairs == 1 else gain, rel=0.1)
    assert kind.nu[0] == pytest.approx(-gain * factor if pairs == 1 else 0.0, abs=1e-9 * factor)


@needs_ipopt
def test_a_polished_point_is_exactly_complementary():
    program = trap()
    near = at_origin(program)
    near = BranchPoint(replace(near.point, x=np.array([1e-4, 0.9999])), 1.0, 0.0, 1e-4)
    found = ActiveSetSearch(program, ipopt).polish(near)
    assert found.natural_residual == 0.0
    np.testing.assert_allclose(found.x, [0.0, 1.0], atol=1e-6)


@needs_ipopt
def test_a_polish_that_ends_badly_is_not_kept():
    program = trap()
    start = at_origin(program, nearest_branch(program, np.zeros(2)))

    assert ActiveSetSearch(program, ending(x=np.array([0.0, 7.0]))).polish(start) is start


@needs_ipopt
def test_a_relaxed_point_whose_branches_are_not_solved_is_led_to_an_exact_one():
    """``x + y = 1`` with x ⟂ y, from a point between both branches: whatever Ipopt leaves, rows and pairs are met."""
    program = paired([1.0, 2.0], A=[[1.0, 1.0]], g_lower=[1.0], g_upper=[1.0], x_lower=[0.0, 0.0])
    point = PrimalDualPoint(np.array([1e-3, 0.998]), np.zeros(1), np.zeros(2), np.zeros(2))
    start = BranchPoint.at(program, point)

    fails = ending(status=IpoptStatus.ITERATION_LIMIT, x=np.array([0.0, 7.0]))
    found = ActiveSetSearch(program, fails).polish(start)
    np.testing.assert_allclose(found.x, [0.0, 1.0], atol=1e-9)
    assert found.branch is None  # no program was solved there


@needs_ipopt
@pytest.mark.parametrize("status", [IpoptStatus.TIME_LIMIT, IpoptStatus.INTERRUPTED])
def test_a_run_that_was_cut_replaces_no_solved_point(status):
    program = trap()
    start = at_origin(program, WRONG)
    assert ActiveSetSearch(program, ending(status=status)).descend(start) is start


@needs_ipopt
def test_a_branch_is_not_tried_twice_from_the_same_point():
    program, runs = trap(), []
    search = ActiveSetSearch(program, ending(runs, x=np.array([0.0, 7.0])))
    start = at_origin(program, WRONG)
    assert search.descend(start) is start
    assert search.descend(start) is start
    assert len(runs) == 1
    assert search.certificate is Certificate.DESCENT


def test_a_side_that_is_a_number_decides_its_pair():
    """One positive: the other is zero. Zero: the other stays free."""
    numbers = Sides(np.array([-1, -1, 0]), np.ones(3), np.array([2.0, 0.0, 0.0]))
    variables = sides([1, 2, 3])
    program = ComplementarityProgram(QuadraticProgram(np.zeros(4)), numbers, variables)
    for wanted in ([True, True, True], [False, False, True]):
        branch = branch_with(program, np.array(wanted))
        assert branch.a_zero.tolist() == [False, True, True]
        assert branch.b_zero.tolist() == [True, False, False]
    nlp = restricted(program, branch)
    assert (nlp.x_lower == nlp.x_upper).tolist() == [True, True, False, False]


# --------------------------------------------------------------------
# Linear programs: how they end, what their duals say, and limits of a search with integers.


NUMBERS = st.integers(-3, 3).map(float)


def test_a_limit_of_nodes_ends_the_search_and_is_told():
    """Of each pair the sides gain at random, and one row takes only some: nothing is shown at the first node."""
    k, random = 40, np.random.default_rng(0)
    gains, rows = -random.uniform(1, 2, 2 * k), random.uniform(0, 1, (20, 2 * k))
    program = paired(gains, k, A=rows, g_upper=np.full(20, 4.0), x_lower=np.zeros(2 * k))
    point, nodes = Linearisation.at(program.nlp, np.zeros(2 * k)), []
    found = steepest_branch(program, point, 1.0, node_limit=3, on_nodes=nodes.append)
    assert found is None or not found.proven
    assert nodes[0] <= 3 + 2 * np.log2(k)  # and linear programs, each of which halves what is left to decide


@pytest.mark.parametrize("k", [1, 2, 3])
def test_what_only_rounded_integers_gain_is_refuted(k):
    """Both sides gain the same. With binaries that are 1e-6 off, both leave zero a little, which gains more."""
    program = paired(-np.ones(2 * k), k, x_lower=np.zeros(2 * k))
    a_zero = np.ones(k, dtype=bool)
    point, stay = Linearisation.at(program.nlp, np.zeros(2 * k)), Branch(a_zero, ~a_zero)
    found = steepest_branch(program, point, 1e-3, stay=stay, least_gain=1e-7, node_limit=1000)
    assert (found.proven, found.gain) == (True, 0.0)


def test_without_one_choice_of_binaries_the_next_best_is_found():
    program = LinearProgram(-np.array([3.0]), np.zeros(1), np.ones(1)).with_binaries(2, [])
    program = replace(program, cost=np.array([-3.0, -2.0, -1.0]))
    found = []
    for _ in range(4):
        x = program.solve(NO_DEADLINE).x
        found.append(x[1:].round().astype(bool).tolist())
        program = program.without_binaries(x[1:] > 0.5)
    assert found == [[True, True], [True, False], [False, True], [False, False]]
    assert program.solve(NO_DEADLINE).status is LinearStatus.INFEASIBLE


def test_one_program_is_solved_within_other_bounds_and_some_contradict_each_other():
    program = LinearProgram(np.ones(1), np.array([-1.0]), np.array([1.0]), [(np.ones((1, 1)), 0.1, np.inf)])
    for lower, upper, ends in (
        (0.5, 0.2, (LinearStatus.INFEASIBLE, None, 1)),
        (0.5, 1.0, (LinearStatus.SOLVED, pytest.approx([0.5]), 1)),
        (-1.0, 0.0, (LinearStatus.INFEASIBLE, None, 1)),
    ):
        assert program.solve(NO_DEADLINE, bounds=(np.array([lower]), np.array([upper])))[:3] == ends
    assert program.solve(NO_DEADLINE).x == pytest.approx([0.1])


@given(c=st.lists(NUMBERS, min_size=3, max_size=3), A=st.lists(NUMBERS, min_size=9, max_size=9))
@settings(max_examples=40)
def test_duals_say_by_how_much_the_least_cost_grows_with_each_bound(c, A):
    """The rows have an upper, a lower, and both bounds, which are equal; a change by 1e-4 costs at least its dual."""
    matrix = scipy.sparse.csr_array(np.array(A).reshape(3, 3))
    lower, upper = np.array([-np.inf, -0.7, 0.0]), np.array([0.5, np.inf, 0.0])

    def program(change: np.ndarray) -> LinearProgram:
        return LinearProgram(np.array(c), -np.ones(3), np.ones(3), [(matrix, lower + change, upper + change)])

    _, x, _, duals = program(np.zeros(3)).solve(NO_DEADLINE)
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
def test_multipliers_leave_what_they_say_and_have_the_signs(c, A):
    program = paired(np.array(c), 2, A=np.array(A).reshape(2, 4), g_upper=[0.0, 0.0], x_lower=np.zeros(4))
    best = at(program, np.zeros(4)).find(Stationarity.S, most=np.inf)
    assert all((multipliers >= 0.0).all() for multipliers in (best.nu, best.xi, best.rows))
    left = np.array(c) + program.nlp.A.T @ best.rows - np.concatenate([best.nu, best.xi])
    scale = max(1.0, float(np.abs(c).max()))
    assert np.abs(left).max() / scale == pytest.approx(best.residual, abs=1e-9)
