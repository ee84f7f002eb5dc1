"""The numbered formulas of the page on certificates, evaluated against the code."""

import itertools
from typing import Any

import numpy as np
import pytest
from harness.quadratic_program import QuadraticProgram
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mpcc.problems import sides
from scipy.optimize import linprog

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Certificate
from pyrobocop_pyomo.mpcc.lpec import steepest_branch
from pyrobocop_pyomo.mpcc.multipliers import STATIONARY, MultiplierProblem, Stationarity, classify
from pyrobocop_pyomo.mpcc.problem import (
    Branch,
    ComplementarityProgram,
    Linearisation,
    branch_with,
    restricted,
    violation,
)
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint

SMALL = st.integers(-3, 3).map(float)


def arrays(size):
    return st.lists(SMALL, min_size=size, max_size=size).map(np.array)


def two_pairs(c, A=None, g_upper=None):
    """Pairs (x0, x2) and (x1, x3)."""
    nlp = QuadraticProgram(c, A=A, g_upper=g_upper, x_lower=np.zeros(4))
    return ComplementarityProgram(nlp, sides([0, 1]), sides([2, 3]))


# ------------------------------------------------------------------------------ branches


@given(x=st.lists(st.sampled_from([0.0, 0.5, 2.0]), min_size=4, max_size=4))
def test_the_feasible_set_is_the_union_of_the_branches(x):
    """eq-mpcc and eq-branch."""
    point, program = np.array(x), two_pairs(np.ones(4))
    choices = [branch_with(program, np.array(each)) for each in itertools.product([True, False], repeat=2)]
    through = [branch for branch in choices if violation(restricted(program, branch), point) == 0.0]
    assert bool(through) == (point[0] * point[2] == 0 and point[1] * point[3] == 0)
    biactive = sum(bool(point[i] == point[i + 2] == 0) for i in range(2))
    assert not through or len(through) == 2**biactive


@given(c=arrays(4), A=arrays(8))
@settings(max_examples=40)
def test_strongly_stationary_points_are_b_stationary(c, A):
    """eq-s-implies-b, with its sum evaluated along the steepest step."""
    program = two_pairs(c, A.reshape(2, 4), [0.0, 0.0])
    point = Linearisation.at(program.nlp, np.zeros(4))
    found = classify(MultiplierProblem(program, point))
    assume(found.kind is Stationarity.S)
    steepest = steepest_branch(program, point, 1.0, node_limit=1000)
    assert steepest.decrease <= 1e-5
    d = np.zeros(4)
    d[:2] = 1.0  # into the branch where the second sides are held, if the rows let it
    if (program.nlp.A @ d <= 0).all():
        assert point.gradient @ d == pytest.approx(-found.rows @ program.nlp.A @ d + found.nu @ d[:2], abs=1e-4)
        assert point.gradient @ d >= -1e-4


# --------------------------------------------------------------------- existence


def least_residual(program, x, kind):
    """eq-existence by enumeration of the signs, for one biactive pair: x, rows with upper bounds, lower bounds at 0."""
    nlp = program.nlp
    gradient, distance = nlp.gradient(x), np.abs(nlp.g_upper - nlp.constraints(x))
    scale = max(1.0, np.abs(gradient).max())
    held = [int(program.a.index[0]), int(program.b.index[0])]
    bounded = [j for j in range(nlp.n) if nlp.x_lower[j] == 0 and j not in held]
    # Unknowns: rows >= 0, bounds z <= 0, nu, xi, and what is left of each condition.
    columns = np.hstack([nlp.A.T, np.eye(nlp.n)[:, bounded], -np.eye(nlp.n)[:, held]])
    width, count = columns.shape[1], nlp.n + nlp.m
    conditions = np.vstack([columns, np.hstack([np.diag(distance), np.zeros((nlp.m, width - nlp.m))])])
    right = np.concatenate([-gradient, np.zeros(nlp.m)])
    plus, minus, none, any_sign = (0, None), (None, 0), (0, 0), (None, None)
    signs = {
        Stationarity.W: [(any_sign, any_sign)],
        Stationarity.A: [(plus, any_sign), (any_sign, plus)],
        Stationarity.C: [(plus, plus), (minus, minus)],
        Stationarity.M: [(plus, plus), (none, any_sign), (any_sign, none)],
        Stationarity.S: [(plus, plus)],
    }[kind]
    answers = [
        linprog(
            np.concatenate([np.zeros(width), np.ones(count)]),
            A_ub=np.vstack([np.hstack([sign * conditions, -scale * np.eye(count)]) for sign in (1.0, -1.0)]),
            b_ub=np.concatenate([right, -right]),
            bounds=[*[plus] * nlp.m, *[minus] * len(bounded), *each, *[plus] * count],
        )
        for each in signs
    ]
    return min(answer.fun for answer in answers), count


@given(x=st.lists(st.sampled_from([0.0, 1e-5, 1e-3]), min_size=3, max_size=3), c=arrays(3))
@settings(max_examples=40)
def test_multipliers_leave_the_least_residuals_in_sum(x, c):
    """eq-existence: scholtes4 with any costs, biactive, its third variable a little away from its limits."""
    nlp = QuadraticProgram([1, 1, -1], A=[[-4, 0, 1], [0, -4, 1]], g_upper=[0, 0], x_lower=[0, 0, -np.inf])
    program = ComplementarityProgram(nlp, sides(0), sides(1))
    program.nlp.c[:] = c
    point = np.array([0.0, 0.0, -x[2]])
    problem = MultiplierProblem(program, Linearisation.at(program.nlp, point))
    for kind in (Stationarity.W, Stationarity.A, Stationarity.C, Stationarity.M, Stationarity.S):
        (least, count), largest = least_residual(program, point, kind), problem.find(kind, most=np.inf).residual
        assert largest >= least / count - 1e-6
        if kind in (Stationarity.W, Stationarity.S) or x[2] == 0.0:
            # With a choice of signs, one whose residual is not far from the least may be taken.
            assert largest <= least + 1e-6
            found = problem.find(kind)
            assert found is None or found.residual <= STATIONARY + 1e-6
            assert found is not None or least > STATIONARY - 1e-6


# ---------------------------------------------------------------------------- LPEC


def lpec_by_hand(program, x, radius):
    """eq-lpec, by enumeration of y; sides are variables with lower bound 0."""
    nlp = program.nlp
    a, b = x[program.a.index] / radius, x[program.b.index] / radius
    rows = (nlp.g_upper - nlp.constraints(x)) / radius
    best = 0.0
    for y in itertools.product([0, 1], repeat=program.pairs):
        lower = np.maximum(np.minimum((nlp.x_lower - x) / radius, 0.0), -1.0)
        upper = np.ones(nlp.n)
        for i, (ia, ib) in enumerate(zip(program.a.index, program.b.index, strict=True)):
            if max(a[i], b[i]) <= 1.0:
                upper[ia] = min(upper[ia], (a[i] + 1) * (1 - y[i]) - a[i])
                upper[ib] = min(upper[ib], (b[i] + 1) * y[i] - b[i])
            else:
                smaller = ia if a[i] <= b[i] else ib
                lower[smaller] = upper[smaller] = -x[smaller] / radius
        answer = linprog(
            nlp.gradient(x), A_ub=nlp.A, b_ub=np.maximum(rows, 0.0), bounds=list(zip(lower, upper, strict=True))
        )
        if answer.status == 0:
            best = min(best, answer.fun)
    return best


@given(
    c=arrays(4), A=arrays(8), x=st.lists(st.sampled_from([0.0, 0.04, 0.3]), min_size=2, max_size=2), first=st.booleans()
)
@settings(max_examples=60)
def test_the_linear_program_is_that_of_the_page(c, A, x, first):
    """eq-b and eq-lpec, near and far from biactive pairs."""
    program = two_pairs(c, A.reshape(2, 4), [0.7, 0.2])
    point = np.zeros(4)
    point[[0, 1] if first else [2, 3]] = x
    found = steepest_branch(program, Linearisation.at(program.nlp, point), 0.1, node_limit=1000)
    assert found.proven
    assert found.decrease == pytest.approx(-lpec_by_hand(program, point, 0.1), abs=1e-4)
    if not point.any():
        np.testing.assert_allclose(np.minimum(found.step[:2], found.step[2:]), 0.0, atol=1e-7)


def outcome_at(nlp, x):
    rows, bounds = np.zeros(nlp.m), np.zeros(nlp.n)
    return IpoptOutcome(IpoptStatus.SOLVED, x, nlp.objective(x), nlp.constraints(x), rows, bounds, bounds, 1, [], 0.0)


@pytest.mark.parametrize(("slope", "certificate"), [(-1e-6, Certificate.PROVEN), (-1e-3, Certificate.DESCENT)])
def test_what_counts_is_the_gain_beyond_the_present_branch(slope, certificate):
    """eq-gain: w is 1e-6 away from its bound, which any branch could gain; the other side of the pair has a slope."""
    nlp = QuadraticProgram([1.0, slope, 1.0], x_lower=[0, 0, 0], x_upper=[1, 1, 1])
    program = ComplementarityProgram(nlp, sides(0), sides(1))
    branch = Branch(np.array([False]), np.array([True]))  # y held at zero; x is at its own bound
    point = np.array([0.0, 0.0, 1e-6])
    start = BranchPoint.at(program, PrimalDualPoint(point, np.zeros(0), np.zeros(3), np.zeros(3)), branch)
    anywhere = steepest_branch(program, Linearisation.at(nlp, point), 1e-3, node_limit=1000)
    assert anywhere.decrease > 1e-5, "the distance from the bound alone is more than the tolerance"
    solved: list[Any] = []

    def in_vain(nlp, start, iterations):
        solved.append(nlp)
        return outcome_at(nlp, point)

    search = ActiveSetSearch(program, in_vain)
    assert search.descend(start) is start
    assert search.certificate is certificate
    assert bool(solved) == (certificate is Certificate.DESCENT)


# ------------------------------------------------------------------- polish, guard, presolve


@given(
    objectives=st.tuples(st.floats(-10, 10), st.sampled_from([-1e-1, -1e-9, 1e-8, 1e-5, 5e-4, 5e-3, 5e-2])),
    residuals=st.tuples(st.sampled_from([0.0, 1e-7, 1e-5]), st.sampled_from([0.0, 1e-7, 1e-5])),
)
def test_the_guard_is_that_of_the_page(objectives, residuals):
    """eq-guard: an objective f = x[2] that is free, and points that are feasible."""
    nlp = QuadraticProgram([0, 0, 1], x_lower=[0, 0, -np.inf])
    program = ComplementarityProgram(nlp, sides(0), sides(1))
    (f, change), (r, r_new) = objectives, residuals
    f_new = f + change * max(1.0, abs(f))
    point = PrimalDualPoint(np.array([r, r, f]), np.zeros(0), np.zeros(3), np.zeros(3))
    start = BranchPoint.at(program, point)
    answer = np.array([r_new, r_new, f_new])
    kept = ActiveSetSearch(program, lambda nlp, *_: outcome_at(nlp, answer)).polish(start) is not start
    alpha = 1e-7 if r_new >= r else (1e-3 if r <= 1e-6 else 1e-2)
    # Of branches that do not pass, one that is more exact is taken all the same; and a relaxed point is made exact.
    assert kept == (f_new <= f + alpha * max(1.0, abs(f)) or r_new < r or r > 1e-6)
