"""Beyond a certified point: other ways down and random starts, within the budget of exploring; and shares of effort."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.observed_runs import interrupt_run
from known_mpccs.random_families import FAMILIES, random_problems
from mpcc_catalogue.point_check import PointCheck

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.solving import found_points, procedure
from pyrobocop_pyomo.solving.iterates import StopReason
from pyrobocop_pyomo.solving.strategies import BARRIER, BARRIER_TO_THE_END, DEFAULT_SEQUENCE

pytestmark = pytest.mark.casadi

# The quadratic ones are up to 500 dense pairs.
SMALL = [problem for problem in random_problems(1000, 2) if "quadratic" not in problem.tags]

solve = partial(rcp.solve, progress=False)


def made(family: str, seed: int) -> Any:
    return FAMILIES[family](np.random.default_rng(seed))[0]


def two_wells() -> Any:
    """The start is beside the higher one of two minima, which no choice of a side leads away from."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(-2, 2), initialize=1.2)
    m.y, m.z = pyo.Var(bounds=(0, None), initialize=0.5), pyo.Var(bounds=(0, None), initialize=0.5)
    m.sum = pyo.Constraint(expr=m.y + m.z == 1)
    m.pair = rcp.Complementarity(expr=rcp.complements(m.y >= 0, m.z >= 0))
    m.cost = pyo.Objective(expr=(m.x**2 - 1) ** 2 + 0.3 * m.x + m.y)
    return m


def test_a_random_start_finds_the_better_of_two_certified_optima() -> None:
    near, far = two_wells(), two_wells()
    before = solve(near, strategies=rcp.Strategy(exploration=0))
    check, result = PointCheck(far), solve(far)
    assert before.certificate is result.certificate is Certificate.PROVEN
    assert near.x.value > 0 > far.x.value
    assert result.objective < before.objective - 0.1
    assert check.point().violation <= 1e-6
    assert check.point().natural <= 1e-6
    assert "random start" in str(result.remarks)


def test_without_pairs_other_starts_are_on_request() -> None:
    def wells() -> Any:
        m = pyo.ConcreteModel()
        m.x = pyo.Var(bounds=(-2, 2), initialize=1.2)
        m.cost = pyo.Objective(expr=(m.x**2 - 1) ** 2 + 0.3 * m.x)
        return m

    near, far = wells(), wells()
    assert not any("start" in remark for remark in solve(near).remarks)
    result = solve(far, strategies=rcp.Strategy(exploration=float("inf")))
    assert near.x.value > 0 > far.x.value
    assert result.solved
    assert "random start" in str(result.remarks)


@pytest.mark.parametrize("family", ["bilevel", "contact", "packing"])
def test_more_exploration_is_never_worse_and_repeats_itself(family: str) -> None:
    near, far, again = (made(family, 3) for _ in range(3))
    check = PointCheck(far)
    least = solve(near, strategies=rcp.Strategy(exploration=0))
    most = solve(far, strategies=rcp.Strategy(exploration=float("inf")))
    assert most.objective <= least.objective + 1e-6 * max(1.0, abs(least.objective))
    assert check.point().natural <= 1e-6
    assert solve(again, strategies=rcp.Strategy(exploration=float("inf"))).objective == pytest.approx(
        most.objective, rel=1e-6, abs=1e-9
    )


def test_strategies_that_are_chosen_are_all_that_runs() -> None:
    result = solve(two_wells(), strategies=rcp.Strategy("barrier", exploration=float("inf")))
    assert not any("random start" in remark for remark in result.remarks)


def test_ctrl_c_on_another_way_keeps_the_certified_point(monkeypatch: pytest.MonkeyPatch) -> None:
    before = solve(two_wells(), strategies=rcp.Strategy(exploration=0))
    runs = sum(step.status is not None for step in before.steps)
    model = two_wells()
    interrupt_run(monkeypatch, runs + 2)
    result = solve(model)
    assert result.stop_reason is StopReason.INTERRUPTED
    assert pyo.value(next(model.component_data_objects(pyo.Objective))) <= before.objective + 1e-6


def test_a_strategy_that_is_cut_short_leaves_the_solve_to_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    short = replace(BARRIER, small_problem_iterations=3, large_problem_iterations=3)
    monkeypatch.setattr(procedure, "DEFAULT_SEQUENCE", (short, *DEFAULT_SEQUENCE[1:]))
    model = made("traffic", 100)
    check, result = PointCheck(model), solve(model, strategies=rcp.Strategy(exploration=0))
    assert result.solved
    assert result.strategy != "barrier"
    assert check.point().natural <= 1e-6


def test_what_nothing_else_solved_is_taken_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    short = replace(BARRIER, small_problem_iterations=3, large_problem_iterations=3)
    monkeypatch.setattr(procedure, "DEFAULT_SEQUENCE", (short, BARRIER_TO_THE_END))
    monkeypatch.setattr(found_points, "CROSS_CHECKED_PAIRS", 0)
    model = made("traffic", 101)
    check, result = PointCheck(model), solve(model, strategies=rcp.Strategy(exploration=0))
    assert result.strategy == "barrier to the end"
    assert result.solved
    assert check.point().natural <= 1e-6


# Rounding decides whether some strategy ends at a point that is feasible: with CasADi's derivatives none does, and NOT
# SOLVED is said.
BY_ASL = ("badly scaled 1001",)


@pytest.mark.slow
@pytest.mark.asl
@pytest.mark.parametrize("problem", SMALL, ids=lambda problem: problem.name)
def test_fresh_problems_end_at_what_is_known(problem: Any) -> None:
    model = problem.build()
    check, result = PointCheck(model), solve(model, **({"backend": "asl"} if problem.name in BY_ASL else {}))
    if not problem.feasible:
        assert not result.solved
        return
    point = check.point()
    assert point.violation <= 1e-6
    assert point.natural <= 1e-6
    assert point.as_good_as(problem.best, check.maximise)
