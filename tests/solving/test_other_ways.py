"""With pairs, beyond a certified point or before infeasibility is told: other ways down, other starts, shares."""

from dataclasses import replace
from functools import partial
from math import pi
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from known_mpccs.random_families import FAMILIES, random_problems
from mpcc_catalogue.point_check import PointCheck

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.solving import procedure
from pyrobocop_pyomo.solving.strategies import BARRIER, STRATEGIES

pytestmark = pytest.mark.casadi


# The quadratic ones are up to 500 dense pairs.
SMALL = [problem for problem in random_problems(1000, 2) if "quadratic" not in problem.tags]

solve = partial(rcp.solve, progress=False)


def made(family: str, seed: int) -> Any:
    return FAMILIES[family](np.random.default_rng(seed))[0]


def two_wells(paired: bool = True) -> Any:
    """The start is beside the higher one of two minima, which no choice of a side leads away from."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(bounds=(-2, 2), initialize=1.2)
    m.cost = pyo.Objective(expr=(m.x**2 - 1) ** 2 + 0.3 * m.x)
    if paired:
        m.y, m.z = pyo.Var(bounds=(0, None), initialize=0.5), pyo.Var(bounds=(0, None), initialize=0.5)
        m.sum = pyo.Constraint(expr=m.y + m.z == 1)
        m.pair = rcp.Complementarity(expr=rcp.complements(m.y >= 0, m.z >= 0))
        m.cost.set_value(m.cost.expr + m.y)
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
    near, far = two_wells(paired=False), two_wells(paired=False)
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


@pytest.mark.parametrize(("others", "seed"), [(STRATEGIES[1:], 100), ((), 101)], ids=["others", "none"])
def test_a_strategy_that_is_cut_short_leaves_the_solve_to_the_others_or_is_taken_up_again(
    others: Any, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(procedure, "STRATEGIES", (replace(BARRIER, most_iterations=3), *others))
    model = made("traffic", seed)
    check, result = PointCheck(model), solve(model, strategies=rcp.Strategy(exploration=0))
    assert result.solved
    assert result.strategy != "barrier"
    assert others or result.strategy == "barrier to the end"
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


def carts(elements: int = 20, *, apart: float = 5.0) -> Any:
    """The middle one of three carts is driven, and has to push the outer ones apart; all of them stand at the start."""
    h, start, goal = 0.15, (-3.0, 0.0, 3.0), (-apart, 0.0, apart)
    m = pyo.ConcreteModel(name="carts")
    times, steps = range(elements + 1), range(elements)
    m.q = pyo.Var(times, range(3), initialize=lambda m, k, i: start[i])
    m.v = pyo.Var(times, range(3), initialize=0.0)
    m.force = pyo.Var(steps, range(2), bounds=(0, None), initialize=0.0)
    m.drive = pyo.Var(steps, bounds=(-30, 30), initialize=0.0)
    for i in range(3):
        m.q[0, i].fix()
        m.v[0, i].fix()

    def push(m: Any, k: int, i: int) -> Any:
        return (-m.force[k, 0], m.drive[k] + m.force[k, 0] - m.force[k, 1], m.force[k, 1])[i]

    m.speeds = pyo.Constraint(steps, range(3), rule=lambda m, k, i: m.v[k + 1, i] == m.v[k, i] + h * push(m, k, i))
    m.places = pyo.Constraint(steps, range(3), rule=lambda m, k, i: m.q[k + 1, i] == m.q[k, i] + h * m.v[k + 1, i])

    def contact(m: Any, k: int, c: int) -> Any:
        return rcp.complements(m.q[k + 1, c + 1] - m.q[k + 1, c] - 1.0 >= 0, m.force[k, c] >= 0)

    m.contacts = rcp.Complementarity(steps, range(2), rule=contact)
    far = sum(
        (10.0, 0.001, 10.0)[i] * (m.q[elements, i] - goal[i]) ** 2 + 0.1 * m.v[elements, i] ** 2 for i in range(3)
    )
    m.cost = pyo.Objective(expr=100 * far + 0.001 * sum(m.drive[k] ** 2 for k in steps))
    return m


@pytest.mark.parametrize("apart", [5.0, 8.0])
def test_carts_that_stand_apart_learn_to_push(apart: float) -> None:
    """To do nothing is a local optimum that every branch nearby shares: the cost of the start."""
    m = carts(apart=apart)
    nothing = pyo.value(m.cost)
    check, result = PointCheck(m), solve(m)
    assert result.solved
    assert result.objective < 0.01 * nothing
    assert check.point().violation <= 1e-6
    assert check.point().natural <= 1e-6


@pytest.mark.parametrize("drag", [0.0, 0.1])
def test_with_linear_rows_the_mixed_integer_program_is_named(drag: float) -> None:
    m = carts(5)
    m.slow = pyo.Constraint(expr=m.drive[0] + drag * m.v[5, 1] ** 2 <= 20)
    result = solve(m, strategies=rcp.Strategy("elastic", exploration=0))
    assert ("complementarity_to_disjunctions" in result.report()) == (drag == 0.0)


@pytest.mark.parametrize("strategies", [None, "barrier", "tight", "continuation", "elastic"])
def test_the_answer_costs_no_more_than_an_exact_start(strategies: str | None) -> None:
    """Ways down through relaxed points leave the start, and may end at "do nothing" although a push was given."""
    m = carts()
    solve(m, strategies=rcp.Strategy("elastic", exploration=0))
    start = pyo.value(m.cost)
    again = solve(m, strategies=None if strategies is None else rcp.Strategy(strategies, exploration=0))
    assert again.solved
    assert again.objective <= start + 1e-6 * abs(start)


# --------------------------------------------------------------------
# Other starts before a problem is called infeasible.


def pendulum_between_walls(**guess: float) -> pyo.ConcreteModel:
    """It swings up between two soft walls."""
    m, b = one_phase("swing", model="pendulum", duration=3.0, elements=40, scheme="implicit_euler")
    b.angle, b.speed = rcp.State(initial=pi, final=0.0, **guess), rcp.State(initial=0.0, final=0.0)
    b.torque = rcp.Control(bounds=(-4, 4))
    b.left, b.right = rcp.Control(bounds=(0, None)), rcp.Control(bounds=(0, None))

    @b.ode
    def motion(b, t):
        fall = 9.81 * pyo.sin(b.angle[t]) - 0.1 * b.speed[t]
        return {"angle": b.speed[t], "speed": fall + b.torque[t] + b.left[t] - b.right[t]}

    @b.complementarity
    def walls(b, t):
        side = pyo.sin(b.angle[t])
        return [
            rcp.complements(b.left[t] >= 0, b.left[t] / 200 + side + 0.6 >= 0),
            rcp.complements(b.right[t] >= 0, b.right[t] / 200 - side + 0.6 >= 0),
        ]

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.torque[t] ** 2))
    return m


def test_a_start_at_rest_does_not_make_a_problem_infeasible() -> None:
    """No strategy gets further from there than local infeasibility, which says nothing of the problem."""
    stated = rcp.solve(pendulum_between_walls(), progress=False)
    elsewhere = rcp.solve(pendulum_between_walls(initial_guess=pi), progress=False)
    assert stated.solved
    assert elsewhere.solved
    assert elsewhere.objective <= stated.objective * (1 + 1e-6)
    assert elsewhere.strategy == "straight lines"


def test_what_is_infeasible_is_still_said_to_be() -> None:
    m = pendulum_between_walls()
    m.swing.torque.setub(0.01)
    m.swing.torque.setlb(-0.01)
    result = rcp.solve(m, progress=False)
    assert result.quality is rcp.Quality.INFEASIBLE
