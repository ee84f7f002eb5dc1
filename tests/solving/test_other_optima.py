"""Models without pairs: a bounded look for better optima beyond a solution, by default."""

from __future__ import annotations

from math import pi, sin
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import mass
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.solving import procedure
from pyrobocop_pyomo.solving.curvature import is_convex
from pyrobocop_pyomo.solving.ipopt_options import IpoptOptions
from pyrobocop_pyomo.solving.polish import plain_work

pytestmark = pytest.mark.casadi


def round_a_hill(elements: int = 16, sense: Any = pyo.minimize) -> pyo.ConcreteModel:
    """Past a hill that is not in the middle, guessed on its far side."""
    m = pyo.ConcreteModel(name="hill")
    m.path = b = rcp.PhaseBlock(duration=1, elements=elements)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0], initial_guess=lambda s: [-2 + 4 * s, -2 * sin(pi * s)])
    b.v = rcp.Control(index=2, initial_guess=[4, 0])
    b.ode(lambda b, t: {b.r: b.v[t]})
    sign = 1.0 if sense is pyo.minimize else -1.0

    def cost(b: Any, t: Any) -> Any:
        (x, y), (vx, vy) = b.r[t], b.v[t]
        return sign * (vx**2 + vy**2 + 80 * pyo.exp(-(x**2) - (y + 0.6) ** 2))

    m.cost = pyo.Objective(expr=b.integral(cost), sense=sense)
    return m


def two_wells() -> pyo.ConcreteModel:
    """A mass in the shallow one of two wells; the motion is stationary there, and the other well is worth the way."""
    m, b = mass(x={"initial": -1}, v={"initial": 0}, duration=10, elements=40)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] ** 2 - 1) ** 2 - 0.5 * b.x[t] + 0.5 * b.u[t] ** 2))
    return m


def past_a_disc() -> pyo.ConcreteModel:
    """Through the middle of a disc says the guess. Along the way 4 s are the least, and beside it there is room."""
    m = pyo.ConcreteModel(name="disc")
    m.path = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.5, 20), initial_guess=4), elements=40)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0])
    b.v = rcp.State(index=2, initial=0, final=0)
    b.a = rcp.Control(index=2, bounds=(-1, 1))
    b.initialize_straight_lines()
    b.ode(lambda b, t: {b.r: b.v[t], b.v: b.a[t]})
    b.constraint(lambda b, t: b.r[t] @ b.r[t] >= 1)
    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def to_rest(power: int = 2) -> pyo.ConcreteModel:
    """A mass to rest, with the least squares of its force: linear rows and a convex objective."""
    rest = {"x": {"initial": 0, "final": 1}, "v": {"initial": 0, "final": 0}}
    m, b = mass(**rest, u={"bounds": (-10, 10)}, duration=1, elements=6)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** power))
    return m


def labels(result: rcp.SolveResult) -> list[str]:
    return [step.label for step in result.steps]


@pytest.mark.parametrize("sense", [pyo.minimize, pyo.maximize])
def test_a_guess_beside_the_worse_optimum_ends_at_the_better_one(sense: Any) -> None:
    near, far = round_a_hill(sense=sense), round_a_hill(sense=sense)
    before, result = rcp.solve(near, strategies=rcp.Strategy(exploration=0)), rcp.solve(far)
    assert labels(before) == ["solve"]
    assert before.remarks == ()
    assert before.solved
    assert result.solved
    gain = before.objective - result.objective
    assert (gain if sense is pyo.minimize else -gain) > 10.0
    assert "other ways and starts" in result.report()
    assert max(far.path.r[1, t].value for t in far.path.time) > 0.0 >= near.path.r[1, 0.5].value


@pytest.mark.slow
def test_a_motion_under_random_controls_leaves_a_well() -> None:
    before, result = rcp.solve(two_wells(), strategies=rcp.Strategy(exploration=0)), rcp.solve(two_wells())
    assert result.solved
    assert result.objective < before.objective - 1.0


def test_the_same_model_has_the_same_answer_again() -> None:
    first, again = rcp.solve(round_a_hill()), rcp.solve(round_a_hill())
    assert [(step.label, step.iterations, step.objective) for step in first.steps] == [
        (step.label, step.iterations, step.objective) for step in again.steps
    ]


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("exploration", [None, float("inf")])
def test_a_convex_problem_is_solved_once(power: int, exploration: float | None) -> None:
    assert labels(rcp.solve(to_rest(power), strategies=rcp.Strategy(exploration=exploration))) == ["solve"]


def test_what_is_no_convex_quadratic_is_looked_at_further() -> None:
    assert len(rcp.solve(to_rest(power=4)).steps) > 1


def test_a_fine_mesh_is_explored_on_a_coarser_one() -> None:
    m = round_a_hill(elements=80)
    before = rcp.solve(round_a_hill(elements=80), strategies=rcp.Strategy(exploration=0))
    result = rcp.solve(m)
    assert result.solved
    assert result.strategy == "other optimum"
    assert result.objective < before.objective - 10.0
    assert m.path.grid.mesh.elements == 80


def test_a_start_that_is_cut_short_takes_no_certificate_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(procedure, "FEW_ITERATIONS", 5)
    monkeypatch.setattr(procedure, "plain_work", lambda variables, iterations: 15.0)
    assert rcp.solve(round_a_hill()).solved


def test_the_caller_may_allow_more_iterations_but_not_to_starts_that_only_explore() -> None:
    result = rcp.solve(two_wells(), options={"max_iter": 2000})
    assert all(step.options["max_iter"] <= 500 for step in result.steps[1:])
    options = IpoptOptions(user={"max_iter": 10}).with_strategy({}, 50)
    assert options.resolve({"max_iter": 100})["max_iter"] == 10


def test_a_start_that_leads_nowhere_leaves_enough_for_the_next_one() -> None:
    """A pendulum swings to the other side by a seventh of the effort, which the second start finds."""
    m = pyo.ConcreteModel(name="pendulum as a multibody system")
    m.swing = b = rcp.PhaseBlock(duration=3, elements=10)
    b.r = rcp.State(index=2, initial=[1, 0], final=[0, None])
    b.v = rcp.State(index=2, initial=0, final=[0, None])
    b.tension, b.u = rcp.Algebraic(), rcp.Control()

    @b.ode
    def swing(b: Any, t: Any) -> Any:
        (x, y), tension, u = b.r[t], b.tension[t], b.u[t]
        return {b.r: b.v[t], b.v: [-2 * tension * x + u * y, -9.81 - 2 * tension * y - u * x]}

    b.residual(lambda b, t: b.v[t] @ b.v[t] - 2 * b.tension[t] - 9.81 * b.r[1, t] == 0)
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
    result = rcp.solve(m)
    assert result.strategy == "finer mesh"
    assert result.objective == pytest.approx(12.8739, rel=1e-3)


def test_where_the_guess_is_in_the_way_a_start_from_its_side_follows_soon() -> None:
    result = rcp.solve(past_a_disc())
    assert result.solved
    assert result.objective == pytest.approx(4.0, rel=1e-4)
    assert result.iterations < 1500


@pytest.mark.executable
def test_the_executable_looks_as_well() -> None:
    assert rcp.solve(round_a_hill(8), backend="executable").objective < 30.0


@given(st.integers(1, 10**6), st.integers(0, 10**4))
def test_the_effort_of_other_starts_follows_the_formula_of_the_page(n: int, k: int) -> None:
    assert plain_work(n, k) == pytest.approx(max(1 / 4, min(1.0, 500 / n)) * (80 + 0.4 * k))


@given(st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3), st.booleans())
def test_convex_is_what_has_linear_rows_and_no_negative_curvature(curvatures: list[float], curved: bool) -> None:
    """A turned quadratic, with a row that is linear or not."""
    turn = np.linalg.qr(np.array([[1.0, 2.0, 0.5], [0.0, 1.0, 3.0], [2.0, 0.0, 1.0]]))[0]
    matrix = turn @ np.diag(np.round(curvatures, 2)) @ turn.T
    m = pyo.ConcreteModel()
    m.x = pyo.Var(range(3), initialize=0.5, bounds=(-3, 3))
    x = np.array(list(m.x.values()))
    m.row = pyo.Constraint(expr=x.sum() + (m.x[0] ** 2 if curved else 0.0) <= 1)
    m.cost = pyo.Objective(expr=0.5 * x @ matrix @ x + m.x[1])
    compiled = CompiledModel(m, "casadi")
    expected = not curved and min(np.round(curvatures, 2)) >= 0.0
    assert is_convex(compiled.nlp, compiled.current_point()) == expected
