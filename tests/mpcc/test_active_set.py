"""From branch to branch, with a certificate at the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from harness.quadratic_program import QuadraticProgram
from problems import at_origin, ipopt, ralph1, scholtes4, sides, trap

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Certificate
from pyrobocop_pyomo.mpcc.branch import Branch, branch_with, nearest_branch, restricted
from pyrobocop_pyomo.mpcc.linearisation import Linearisation
from pyrobocop_pyomo.mpcc.lpec import steepest_branch
from pyrobocop_pyomo.mpcc.multipliers import MultiplierProblem, classify, strong_multipliers
from pyrobocop_pyomo.mpcc.problem import ComplementarityProgram, Sides
from pyrobocop_pyomo.mpcc.stationarity import Stationarity

needs_ipopt = pytest.mark.casadi


@needs_ipopt
@pytest.mark.parametrize("make", [ralph1, scholtes4])
def test_b_stationary_points_that_are_not_strongly_stationary_are_certified(make):
    program = make()
    search = ActiveSetSearch(program, ipopt)
    found = search.descend(search.polish(at_origin(program)))
    assert search.certificate is Certificate.PROVEN
    assert found.objective == pytest.approx(0.0, abs=1e-7)
    kind = classify(MultiplierProblem(program, Linearisation.at(program.nlp, np.zeros(3)))).kind
    assert kind is Stationarity.M


@needs_ipopt
def test_an_m_stationary_point_that_is_not_b_is_left_along_the_branch_that_descends():
    program = trap()
    wrong = Branch(np.array([False]), np.array([True]))  # y held at zero: x^2 + 1 is least at the origin
    search = ActiveSetSearch(program, ipopt)
    found = search.descend(at_origin(program, wrong))
    assert search.certificate is Certificate.PROVEN
    np.testing.assert_allclose(found.x, [0.0, 1.0], atol=1e-6)


def many(pairs, gain, factor):
    """In each pair b costs 1 and a, which is held at zero, gains a little: it is free to leave."""
    c = factor * np.concatenate([np.full(pairs, -gain), np.ones(pairs)])
    nlp = QuadraticProgram(c, H=np.diag(np.abs(c)), x_lower=np.zeros(2 * pairs))
    return ComplementarityProgram(nlp, sides(np.arange(pairs)), sides(np.arange(pairs, 2 * pairs)))


@needs_ipopt
@pytest.mark.parametrize("factor", [1e-6, 1e-4, 1.0, 1e4, 1e6])
@pytest.mark.parametrize(("pairs", "gain", "descends"), [(1, 1e-4, True), (300, 5e-7, True), (300, 5e-9, False)])
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
    steepest = steepest_branch(program, point, 1e-3, stay=held.branch)
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

    def fails(nlp, start, iterations):
        outcome = ipopt(nlp, start)
        return type(outcome)(**{**vars(outcome), "x": np.array([0.0, 7.0])})

    assert ActiveSetSearch(program, fails).polish(start) is start


@needs_ipopt
@pytest.mark.parametrize("status", [IpoptStatus.TIME_LIMIT, IpoptStatus.INTERRUPTED])
def test_a_run_that_was_cut_replaces_no_solved_point(status):
    program = trap()
    wrong = Branch(np.array([False]), np.array([True]))

    def cut(nlp, start, iterations):
        return replace(ipopt(nlp, start), status=status)

    start = at_origin(program, wrong)
    assert ActiveSetSearch(program, cut).descend(start) is start


@needs_ipopt
def test_a_branch_is_not_tried_twice_from_the_same_point():
    program = trap()
    wrong = Branch(np.array([False]), np.array([True]))
    runs = []

    def fails(nlp, start, iterations):
        runs.append(nlp)
        outcome = ipopt(nlp, start)
        return replace(outcome, x=np.array([0.0, 7.0]))

    search = ActiveSetSearch(program, fails)
    start = at_origin(program, wrong)
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
