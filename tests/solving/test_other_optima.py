"""Models without pairs: looks for better optima beyond a solution, beyond a saddle, and where the first run fails."""

from math import pi, sin
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.phases import mass, one_phase
from harness.routes import every_backend
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint
from pyrobocop_pyomo.solving import procedure, record, runner
from pyrobocop_pyomo.solving.curvature import direction_of_descent, is_convex
from pyrobocop_pyomo.solving.ipopt_options import IpoptOptions
from pyrobocop_pyomo.solving.iterates import Iterate
from pyrobocop_pyomo.solving.record import plain_work
from pyrobocop_pyomo.solving.strategies import STRATEGIES

pytestmark = pytest.mark.casadi


def hill(elements: int, guess: Any, height: float, place: float, sense: Any = pyo.minimize) -> pyo.ConcreteModel:
    """A path from one side of a hill to the other."""
    m, b = one_phase("path", model="hill", duration=1, elements=elements)
    b.r = rcp.State(index=2, initial=[-2, 0], final=[2, 0], initial_guess=guess)
    b.v = rcp.Control(index=2, initial_guess=[4, 0])
    b.ode(lambda b, t: {b.r: b.v[t]})
    sign = 1.0 if sense is pyo.minimize else -1.0

    def cost(b: Any, t: Any) -> Any:
        (x, y), (vx, vy) = b.r[t], b.v[t]
        return sign * (vx**2 + vy**2 + height * pyo.exp(-(x**2) - (y - place) ** 2))

    m.cost = pyo.Objective(expr=b.integral(cost), sense=sense)
    return m


def round_a_hill(elements: int = 16, sense: Any = pyo.minimize) -> pyo.ConcreteModel:
    """Which is not in the middle, guessed on its far side."""
    return hill(elements, lambda s: [-2 + 4 * s, -2 * sin(pi * s)], 80, -0.6, sense)


def over_a_hill() -> pyo.ConcreteModel:
    """Guessed straight over its top."""
    return hill(20, lambda s: [-2 + 4 * s, 0], 40.0, 0.0)


def two_wells() -> pyo.ConcreteModel:
    """A mass in the shallow one of two wells; the motion is stationary there, and the other well is worth the way."""
    m, b = mass(x={"initial": -1}, v={"initial": 0}, duration=10, elements=40)
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] ** 2 - 1) ** 2 - 0.5 * b.x[t] + 0.5 * b.u[t] ** 2))
    return m


def past_a_disc() -> pyo.ConcreteModel:
    """Through the middle of a disc says the guess. Along the way 4 s are the least, and beside it there is room."""
    m, b = one_phase("path", model="disc", duration=rcp.Duration(bounds=(0.5, 20), initial_guess=4), elements=40)
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
    result = solution(m)
    assert result.strategy == "other optimum"
    assert result.objective < before.objective - 10.0
    assert m.path.grid.mesh.elements == 80


def test_a_start_that_is_cut_short_takes_no_certificate_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(procedure, "FEW_ITERATIONS", 5)
    monkeypatch.setattr(record, "plain_work", lambda variables, iterations: 15.0)
    assert rcp.solve(round_a_hill()).solved


def test_a_start_that_is_cut_short_near_a_better_answer_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Out of a valley with a weak motor, by swings; three iterations before its end a run violates the rows by 2e-5."""

    def mountain_car() -> pyo.ConcreteModel:
        m, b = one_phase(duration=8.0, elements=60, u=rcp.Control(bounds=(-1, 1)))
        b.x, b.v = rcp.State(initial=-0.5, final=0.6, bounds=(-1.4, 0.6)), rcp.State(initial=0, bounds=(-3, 3))
        b.initialize_straight_lines()
        b.ode(lambda b, t: {b.x: b.v[t], b.v: b.u[t] - 2.5 * pyo.cos(3 * b.x[t])})
        m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2))
        return m

    whole = rcp.solve(mountain_car(), mesh_tolerance=None)
    enough = next(step.iterations for step in whole.steps if step.label == whole.strategy)
    monkeypatch.setattr(procedure, "FEW_ITERATIONS", enough - 3)
    monkeypatch.setattr(record, "plain_work", lambda variables, iterations: enough - 3.0)
    assert rcp.solve(mountain_car(), mesh_tolerance=None).objective == pytest.approx(whole.objective, rel=1e-6)


def test_the_caller_may_allow_more_iterations_but_not_to_starts_that_only_explore() -> None:
    result = rcp.solve(two_wells(), options={"max_iter": 2000})
    assert all(step.options["max_iter"] <= 500 for step in result.steps[1:])
    options = IpoptOptions(user={"max_iter": 10}).with_strategy({}, 50)
    assert options.resolve({"max_iter": 100})["max_iter"] == 10


def test_where_the_guess_is_in_the_way_a_start_from_its_side_follows_soon() -> None:
    result = solution(past_a_disc())
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


# --------------------------------------------------------------------
# A stationary point that is no minimum is not called optimal: runs go on from it, or the result says what it is.


def saddle(sense=pyo.minimize, limit=2.0):
    m = pyo.ConcreteModel(name="saddle")
    m.x, m.y = pyo.Var(initialize=0.0), pyo.Var(initialize=0.0, bounds=(-limit, limit))
    sign = 1.0 if sense is pyo.minimize else -1.0
    m.cost = pyo.Objective(expr=sign * ((m.x - 1) ** 2 - m.y**2), sense=sense)
    return m


def test_a_path_does_not_stay_on_the_ridge_where_its_guess_was():
    m = over_a_hill()
    result = solution(m, strategies=rcp.Strategy(exploration=0))
    assert labels(result) == ["solve", "beyond a saddle"]
    assert result.objective < result.steps[0].objective - 1.0
    assert max(abs(m.path.r[1, t].value) for t in m.path.time) > 0.5


@pytest.mark.parametrize("sense", [pyo.minimize, pyo.maximize])
@pytest.mark.parametrize("options", [{}, {"nlp_scaling_method": "gradient-based"}])
def test_a_saddle_is_left_whatever_the_sense_and_the_scaling(sense, options):
    m = saddle(sense)
    solution(m, options=options)
    assert abs(m.y.value) == pytest.approx(2.0, rel=1e-6)


@pytest.mark.executable
def test_a_saddle_is_left_by_the_executable(monkeypatch):
    monkeypatch.setattr(procedure, "ITERATIONS_OF_ONE", 3000)  # so many come to rest on it
    m = saddle()
    result = solution(m, backend="executable")
    assert labels(result) == ["solve", "beyond a saddle"]


def test_a_saddle_from_which_nothing_better_is_found_is_no_solution(monkeypatch):
    """Starts beside the saddle that are the saddle again."""
    monkeypatch.setattr(runner, "STEP_FROM_SADDLE", 0.0)
    result = rcp.solve(over_a_hill())
    assert not result.solved
    assert result.quality is rcp.Quality.FEASIBLE
    assert "stationary, but no minimum" in result.report()
    assert "DOUBTFUL" in str(result)
    assert len(result.doubts) == 1


def line_of_minima(m):
    """Nothing changes along it: the curvature is zero."""
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=3.0)
    m.cost = pyo.Objective(expr=(m.x + m.y - 1) ** 2)


def parabola(m):
    """The rows forbid the curvature."""
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=0.5)
    m.row = pyo.Constraint(expr=m.y == m.x**2)
    m.again = pyo.Constraint(expr=2 * m.y == 2 * m.x**2)
    m.cost = pyo.Objective(expr=3 * m.y - m.x**2)


def box(m):
    """Concave between its bounds: each of the ends is a minimum, also where a multiplier is small."""
    m.x, m.y = pyo.Var(bounds=(0, 1), initialize=0.9), pyo.Var(bounds=(0, 1), initialize=0.2)
    m.cost = pyo.Objective(expr=-(m.x**2) - 1e-3 * m.x - (m.y - 0.5) ** 2)


@pytest.mark.parametrize(("state", "x"), [(line_of_minima, None), (parabola, 0.0), (box, 1.0)])
def test_a_minimum_is_no_saddle_whatever_the_curvature_that_nothing_can_follow(state, x):
    m = pyo.ConcreteModel()
    state(m)
    assert labels(solution(m)) == ["solve"]
    assert x is None or m.x.value == pytest.approx(x, abs=1e-4)


@pytest.mark.parametrize("seed", range(12))
def test_a_direction_is_found_where_the_hessian_is_not_convex_on_the_null_space_of_the_rows(seed):
    """Against eigenvalues of the reduced Hessian, with a row that is there twice to first order."""
    random = np.random.default_rng(seed)
    n, m = 8, 3
    hessian, jacobian = random.standard_normal((n, n)), random.standard_normal((m, n))
    hessian = hessian + hessian.T + random.uniform(0, 6) * np.eye(n)
    jacobian[2] = jacobian[1]
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(n), initialize=0.0)
    x = np.array(list(model.x.values()))
    model.rows = pyo.Constraint(range(m), rule=lambda model, i: jacobian[i] @ x + (-1) ** i * x[0] ** 2 == 0)
    model.cost = pyo.Objective(expr=0.5 * x @ hessian @ x)
    nlp = CompiledModel(model, "casadi").nlp
    # Those of the two rows that are the same to first order cancel in the Hessian.
    multipliers = np.array([0.0, 1e5, 1e5])
    point = PrimalDualPoint(np.zeros(n), multipliers, np.zeros(n), np.zeros(n))
    jacobian_here = np.zeros((m, n))
    np.add.at(jacobian_here, nlp.jacobian_structure, nlp.jacobian(point.x))
    space = np.linalg.svd(jacobian_here)[2][2:].T
    least = np.linalg.eigvalsh(space.T @ hessian @ space)[0]
    found = direction_of_descent(nlp, point)
    assert (found is not None) == (least < -1e-3)
    if found is not None:
        assert np.abs(found).max() == pytest.approx(1.0)
        assert found @ hessian @ found == pytest.approx(least * (found @ found), rel=0.3)
        assert np.abs(jacobian_here @ found).max() < 1e-4


# --------------------------------------------------------------------
# What follows where the first run fails, and starts that cannot be evaluated.


def _goddard(elements: int = 12) -> pyo.ConcreteModel:
    """A rocket that climbs as high as it can: mass and height divide, and start at 0 where no guess is given."""
    m, b = one_phase("climb", model="rocket", duration=rcp.Duration(bounds=(0.01, 1)), elements=elements)
    b.height = rcp.State(initial=1)
    b.speed = rcp.State(initial=0)
    b.mass = rcp.State(initial=1, final=0.6)
    b.thrust = rcp.Control(bounds=(0, 3.5))

    @b.ode
    def flight(b, t):
        drag = 310 * b.speed[t] ** 2 * pyo.exp(-500 * (b.height[t] - 1))
        acceleration = (b.thrust[t] - drag) / b.mass[t] - 1 / b.height[t] ** 2
        return {b.height: b.speed[t], b.speed: acceleration, b.mass: -b.thrust[t] / 0.5}

    m.cost = pyo.Objective(expr=b.height[b.points.last()], sense=pyo.maximize)
    return m


@every_backend
def test_a_start_without_a_value_is_moved_and_named(backend: str) -> None:
    m = _goddard()
    m.climb.initialize({"height": 0.0})
    # From there Ipopt comes to one of two local optima, by its last digits.
    result = solution(m, backend=backend, strategies=rcp.Strategy(exploration=float("inf")))
    assert result.objective == pytest.approx(1.01283, abs=2e-4)
    assert "could not be evaluated: division by climb.height" in result.report()
    assert "in right-hand side of 'speed' of phase 'climb' at t = " in result.remarks[0]
    assert "element 0" in result.remarks[0]


def test_what_cannot_be_moved_ends_in_a_result_that_names_it() -> None:
    m = pyo.ConcreteModel(name="log")
    m.x = pyo.Var(initialize=-1.0, bounds=(None, -0.5))
    m.y = pyo.Var(initialize=0.0)
    m.row = pyo.Constraint(expr=pyo.log(m.x) + m.y == 0)
    m.cost = pyo.Objective(expr=m.y**2)
    result = rcp.solve(m)
    assert result.quality is rcp.Quality.INFEASIBLE
    assert "log(...) of x = -1, in constraint 'row'" in result.report()
    assert m.x.value == -1.0
    with pytest.raises(rcp.errors.SolveFailed, match=r"log\(\.\.\.\) of x = -1"):
        result.raise_for_status()


def test_what_has_no_solution_ends_after_a_few_tries() -> None:
    m = pyo.ConcreteModel(name="apart")
    m.x, m.y = pyo.Var(initialize=1.0), pyo.Var(initialize=2.0)
    m.circle = pyo.Constraint(expr=m.x**2 + m.y**2 <= 1)
    m.outside = pyo.Constraint(expr=m.x + m.y >= 4)
    m.cost = pyo.Objective(expr=m.x)
    result = rcp.solve(m)
    assert result.quality is rcp.Quality.INFEASIBLE
    assert result.stop_reason is rcp.StopReason.INFEASIBLE
    assert labels(result) == ["solve", "own units", "elastic rows", "solve from there"]
    assert sum(step.iterations for step in result.steps[1:]) <= max(1500, 2 * result.steps[0].iterations)
    alone = rcp.solve(m, strategies="solve")
    assert len(alone.steps) == 1


def test_rows_that_repeat_each_other_are_solved_with_elastic_rows() -> None:
    """Two equations of one variable: Ipopt refuses more equations than variables."""
    m = pyo.ConcreteModel(name="repeated")
    m.x = pyo.Var(initialize=0.5)
    m.first = pyo.Constraint(expr=m.x**2 == 4)
    m.second = pyo.Constraint(expr=m.x**3 == 8)
    m.cost = pyo.Objective(expr=m.x)
    result = solution(m)
    assert result.strategy == "elastic rows"
    assert m.x.value == pytest.approx(2.0, abs=1e-7)
    assert result.objective == pytest.approx(2.0, abs=1e-7)


def test_a_limit_of_the_caller_is_the_end() -> None:
    result = rcp.solve(_goddard(), options={"max_iter": 3})
    assert result.stop_reason is rcp.StopReason.ITERATION_LIMIT
    assert result.iterations == 3


@pytest.mark.parametrize("unit", [1.0, 1e3])
@pytest.mark.parametrize("kink", [0.0, 1.0], ids=["smooth", "with an absolute value"])
def test_one_run_solves_where_a_large_state_lies_at_zero(kink: float, unit: float) -> None:
    """A climb stays on the ground for half of its time: by what Ipopt loosens that bound no row is violated."""
    m, b = one_phase("b", model="late climb", duration=100, elements=20)
    b.height = rcp.State(initial=0, final=5e4 * unit, bounds=(0, 2.5e5 * unit))
    b.path = rcp.Control(bounds=(-1.5, 1.5))
    b.ode(lambda b, t: {b.height: 1e3 * unit * pyo.sin(b.path[t])})
    cost = b.integral(lambda b, t: b.height[t] + kink * 0.1 * abs(b.height[t] - 3e4 * unit))
    m.cost = pyo.Objective(expr=cost / (1e3 * unit) + b.integral(lambda b, t: b.path[t] ** 2))
    result = rcp.solve(m, strategies=rcp.Strategy(exploration=0), mesh_tolerance=None)
    assert labels(result) == ["solve"]
    assert result.solved, str(result)
    assert min(b.trajectory().height) >= 0.0


@pytest.mark.parametrize(("status", "first"), [("SOLVED", "tighter"), ("STEP_FAILED", "absolute values as pairs")])
def test_a_run_that_converged_met_no_kink(status: str, first: str) -> None:
    """Smaller tolerances take a few iterations, absolute values in two parts hundreds."""
    ended = Iterate.of_run("solve", IpoptStatus[status], iterations=26, seconds=0.1, delta=None, mu=None)
    assert next(row.name for row in STRATEGIES if ended.stop_reason in row.follows) == first
