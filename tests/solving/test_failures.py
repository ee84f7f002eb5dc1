"""What goes wrong in one part of `solve`, and an interruption, costs that part only."""

import contextlib
import itertools
import logging
import math
import pathlib
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.expression_zoo import cart_pole
from harness.observed_runs import interrupt_run
from harness.phases import one_phase
from harness.routes import backends_in_turn
from harness.timed_models import belt_drive, crossed_pairs, example
from known_mpccs import mpcc_problem
from test_finer_meshes import forced

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ComplementarityError, EvaluationError
from pyrobocop_pyomo.ipopt import ipopt_run
from pyrobocop_pyomo.ipopt.backends import find_ipopt_executable
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus

solve = partial(rcp.solve, progress=False)
IPOPTS_TOLERANCE = 1e-8


# ------------------------------------------------------------------------------------------------- no objective


def ball(elements: int = 10) -> pyo.ConcreteModel:
    """A ball that is dropped from 1 m onto a floor: a motion to be found, with nothing to be minimised."""
    m, b = one_phase("drop", model="ball", duration=1.0, elements=elements, scheme="implicit_euler")
    b.height = rcp.State(initial=1.0, bounds=(0, None), initial_guess=0.5)
    b.speed = rcp.State(initial=0.0)
    b.force = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.height: b.speed[t], b.speed: b.force[t] - 9.81})
    b.complementarity(lambda b, t: rcp.complements(b.height[t] >= 0, b.force[t] >= 0), name="floor")
    return m


@backends_in_turn("strategies", [(None,), ("barrier",), ("tight",), ("continuation",), ("elastic",)])
def test_a_model_without_an_objective_is_solved(strategies: Any, backend: str) -> None:
    m = ball()
    components = [c.name for c in m.component_objects()]
    result = solution(m, strategies=strategies, backend=backend)
    assert result.objective == 0.0
    assert m.drop.height[m.drop.final_time].value == pytest.approx(0.0, abs=1e-6)
    assert m.drop.trajectory().verify().largest_violation <= 1e-5
    assert [c.name for c in m.component_objects()] == components


# ------------------------------------------------------------------------------------------------- one strategy fails


class Broken:
    """A schedule that raises."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def steps(self) -> Iterator[float]:
        raise self.error


LOOSE = rcp.Strategy("loose", rcp.relaxations.Fixed(1e-4), polish=False)


@pytest.mark.casadi
def test_a_strategy_that_raises_loses_nothing(caplog: pytest.LogCaptureFixture) -> None:
    broken = rcp.Strategy("broken", Broken(ComplementarityError("no pair")))
    first = solve(mpcc_problem("bard1").build(), strategies=LOOSE)
    model = mpcc_problem("bard1").build()
    with caplog.at_level(logging.INFO):
        result = solve(model, strategies=[LOOSE, broken])
    assert result.strategy == "loose"
    assert result.objective == pytest.approx(first.objective)
    assert any("broken" in record.getMessage() for record in caplog.records)
    # Those after it are run.
    result = solution(mpcc_problem("bard1").build(), strategies=[LOOSE, broken, "tight"])
    assert result.strategy == "tight"


@pytest.mark.casadi
def test_an_error_of_the_only_strategy_is_told() -> None:
    with pytest.raises(ComplementarityError, match="no pair"):
        solve(mpcc_problem("bard1").build(), strategies=rcp.Strategy("broken", Broken(ComplementarityError("no pair"))))


@pytest.mark.casadi
@pytest.mark.parametrize("run", range(1, 8))
def test_an_error_in_any_later_run_keeps_what_was_found(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = itertools.count()
    set_options = ipopt_run.set_options

    def failing(*arguments: Any, **rest: Any) -> None:
        if next(runs) == run:
            raise EvaluationError("a derivative does not exist here")
        set_options(*arguments, **rest)

    monkeypatch.setattr(ipopt_run, "set_options", failing)
    result = solve(mpcc_problem("bard1").build(), strategies=("continuation", "tight", "barrier"))
    assert result.quality is not rcp.Quality.INFEASIBLE
    assert result.objective == pytest.approx(17.0, rel=1e-3)


# ------------------------------------------------------------------------------------------------- continuation


CONTINUED: dict[str, Callable[[], pyo.ConcreteModel]] = {
    "visweswaran 1996": mpcc_problem("visweswaran 1996").build,
    "candler-townsley 1982": mpcc_problem("candler-townsley 1982").build,
    "turbo car": lambda: example("turbo_car").build(elements=20),
    "40 crossed pairs": partial(crossed_pairs, 40),
    "belt": partial(belt_drive, 8, 1.5),
}
# Iterations in all and of the last step, where every step solves its own problem. A last step that has to go from
# delta = 1e-4 to 1e-8 at once took 84, 43, 677, 10 and 7.
MOST_ITERATIONS = {
    "visweswaran 1996": (80, 30),
    "candler-townsley 1982": (75, 20),
    "turbo car": (400, 60),
    "40 crossed pairs": (80, 8),
    "belt": (110, 8),
}


@pytest.mark.asl
@pytest.mark.parametrize("name", CONTINUED)
def test_every_step_of_the_continuation_solves_its_own_problem(name: str) -> None:
    result = solve(CONTINUED[name](), strategies=rcp.Strategy("continuation", polish=False), backend="asl")
    assert result.quality is not rcp.Quality.INFEASIBLE
    assert result.steps[-1].delta == 1e-8
    for step in result.steps:
        assert step.status.solved
        assert step.largest_product <= 2.0 * step.delta, str(step)
        expected = IPOPTS_TOLERANCE if step is result.steps[-1] else min(1e-4, step.delta / 10)
        assert step.options.get("tol", IPOPTS_TOLERANCE) == pytest.approx(expected)
    for before, step in itertools.pairwise(result.steps):
        assert step.delta < before.delta
        # It has moved, unless the point before was a solution already.
        assert step.iterations > 0 or before.largest_product <= step.delta
    most, last_step = MOST_ITERATIONS[name]
    assert result.steps[-1].iterations <= last_step
    assert result.iterations <= most


def fail_runs(monkeypatch: pytest.MonkeyPatch, fails: Callable[[dict[str, Any]], bool]) -> None:
    """Stop a run of Ipopt in this process after its first iteration if its options say so."""
    limits = ipopt_run._time_limit

    def failing(options: Any, deadline: Any) -> dict[str, float]:
        return limits(options, deadline) | ({"max_iter": 1} if fails(dict(options)) else {})

    monkeypatch.setattr(ipopt_run, "_time_limit", failing)


def is_warm(options: dict[str, Any]) -> bool:
    return options.get("warm_start_init_point") == "yes"


@pytest.mark.casadi
@pytest.mark.parametrize("every", [1, 2, 3])
def test_a_step_after_a_failed_one_is_shorter(every: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the last solved delta towards the one that failed, and never the same one twice in a row."""
    warm_runs = itertools.count(1)
    fail_runs(monkeypatch, lambda options: is_warm(options) and next(warm_runs) % every == 0)
    steps = solve(crossed_pairs(10), strategies=rcp.Strategy("continuation", polish=False)).steps
    assert any(not step.status.solved for step in steps)
    solved = None
    for step, after in itertools.pairwise(steps):
        if step.status.solved:
            solved = step.delta
        elif solved is not None and after.delta > step.delta:
            assert after.delta < solved
        assert after.delta != step.delta, [f"{each.delta:.2e} {each.status.name}" for each in steps]


# ------------------------------------------------------------------------------------------------- no derivative


FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "sqrt": lambda m: pyo.sqrt(m.x) + (m.y - 1) ** 2,
    "absolute value": lambda m: abs(m.x) + (m.y - 1) ** 2,
    "power 1.5": lambda m: m.x**1.5 + (m.y - 1) ** 2,
    "log": lambda m: -0.1 * pyo.log(m.x) + (m.y - 1) ** 2,
    "steep tanh": lambda m: pyo.tanh(1e3 * m.x) + (m.y - 1) ** 2,
    "tanh out of range": lambda m: pyo.tanh(1e4 * m.y) + (m.x - 1) ** 2,
    "exp out of range": lambda m: pyo.exp(1e3 * (m.y - m.x)) + (m.x - 1) ** 2,
    "acos": lambda m: pyo.acos(m.x) + (m.y - 1) ** 2,
    "norm": lambda m: pyo.sqrt(m.x**2 + m.y**2) + 0.1 * (m.x - 1) ** 2,
}


def without_derivative(name: str, paired: bool) -> pyo.ConcreteModel:
    """A function whose derivative does not exist, or overflows, at the point where x and y start or end."""
    m = pyo.ConcreteModel(name=name)
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=0.0), pyo.Var(bounds=(0, None), initialize=0.5)
    if paired:
        m.pair = rcp.Complementarity(expr=rcp.complements(m.x >= 0, m.y >= 0))
    m.cost = pyo.Objective(expr=FUNCTIONS[name](m))
    return m


@backends_in_turn("name,paired", itertools.product(FUNCTIONS, (True, False)))
def test_there_is_a_result_where_a_derivative_does_not_exist(name: str, paired: bool, backend: str) -> None:
    m = without_derivative(name, paired)
    result = solve(m, backend=backend, options={"max_iter": 200})
    assert result.steps
    assert isinstance(result.quality, rcp.Quality)
    assert all(v.value is not None and math.isfinite(v.value) for v in (m.x, m.y))
    assert (m.pair.active if paired else True) is True
    assert result.report()


# ------------------------------------------------------------------------------------------------- loops


@pytest.mark.casadi
def test_a_failed_step_of_a_receding_horizon_spoils_none_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def controller() -> rcp.studies.RecedingHorizon:
        model = cart_pole(10)
        return rcp.studies.RecedingHorizon(model, model.swing)

    kept, twin = controller(), controller()
    start = {name: 0.0 for name in kept.phase.record.names_of_states if kept.phase.component(name)[0].fixed}
    for each in (kept, twin):
        assert each.step(start).solved
    with monkeypatch.context() as failing:
        fail_runs(failing, lambda options: True)
        assert kept.step({**start, "q": 1.0}).status is IpoptStatus.ITERATION_LIMIT
    moved = {**start, "q": 0.02}
    after, expected = kept.step(moved), twin.step(moved)
    assert after.solved
    assert after.iterations == expected.iterations


# --------------------------------------------------------------------
# What a failure or an interruption may not cost, and what may not end in one.


RANK = {rcp.Quality.OPTIMAL: 2, rcp.Quality.FEASIBLE: 1, rcp.Quality.INFEASIBLE: 0}


@pytest.mark.asl
@pytest.mark.parametrize(("elements", "duration"), [(10, 6.0)])
def test_a_failed_polish_keeps_the_better_point_before_it(elements: int, duration: float) -> None:
    """Where the belt touches the pulley, the distance has no derivative, and the polish ends without multipliers."""
    rough = solve(belt_drive(elements, duration), strategies=rcp.Strategy("barrier", polish=False), backend="asl")
    polished = solve(belt_drive(elements, duration), strategies=rcp.Strategy("barrier", exploration=0), backend="asl")
    assert rough.quality is rcp.Quality.OPTIMAL
    assert RANK[polished.quality] >= RANK[rough.quality], str(polished)
    assert polished.objective <= rough.objective + 1e-4 * abs(rough.objective)


@pytest.mark.casadi
@pytest.mark.parametrize("paired", [True, False], ids=["paired", "plain"])
@pytest.mark.parametrize("name", ["steep tanh", "tanh out of range"])
def test_the_first_backend_has_derivatives_that_others_lack(name: str, paired: bool) -> None:
    """ASL has no derivative of tanh where its square overflows; CasADi has."""
    solution(without_derivative(name, paired))


@pytest.mark.asl
@pytest.mark.parametrize("backend", ["asl", "executable"])
def test_a_python_function_does_not_end_the_interpreter(backend: str) -> None:
    script = textwrap.dedent(
        f"""
        import pyomo.environ as pyo
        import pyrobocop_pyomo as rcp

        m = pyo.ConcreteModel(name="external")
        m.x = pyo.Var(initialize=1.0)
        m.f = pyo.ExternalFunction(lambda x: (x - 2) ** 2, lambda x, fixed: [2 * (x - 2)], lambda x, fixed: [2.0])
        m.cost = pyo.Objective(expr=m.f(m.x))
        try:
            print(rcp.solve(m, backend={backend!r}))
        except rcp.errors.PyRobocopError as error:
            print("refused:", error)
        """
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=900)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    if backend == "asl":
        assert "refused:" in ended.stdout


@pytest.mark.casadi
@pytest.mark.parametrize(
    "error", [ValueError("not finite"), ZeroDivisionError()], ids=lambda error: type(error).__name__
)
def test_an_error_of_other_code_leaves_the_best_point_on_the_model(error: Exception) -> None:
    first = solve(mpcc_problem("bard1").build(), strategies=LOOSE)
    model = mpcc_problem("bard1").build()
    with contextlib.suppress(type(error)):
        solve(model, strategies=[LOOSE, rcp.Strategy("broken", Broken(error))])
    (cost,) = model.component_data_objects(pyo.Objective)
    assert pyo.value(cost) == pytest.approx(first.objective)


@pytest.mark.executable
def test_an_executable_may_take_its_time_to_say_its_version(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pyomo waits for two seconds, which a machine under load needs to load the libraries of Ipopt."""
    slow = tmp_path / "ipopt"
    slow.write_text(f'#!/bin/sh\n[ "$1" = --version ] && sleep 3\nexec {find_ipopt_executable()} "$@"\n')
    slow.chmod(0o755)
    monkeypatch.setenv("PYROBOCOP_IPOPT_EXECUTABLE", str(slow))
    assert solve(mpcc_problem("bard1").build(), strategies="barrier", backend="executable").solved


def weighted() -> pyo.ConcreteModel:
    """A problem with pairs and a number to be changed."""
    m = mpcc_problem("bard1").build()
    m.weight = pyo.Param(initialize=1.0, mutable=True)
    (cost,) = m.component_data_objects(pyo.Objective)
    cost.set_value(m.weight * cost.expr)
    return m


@pytest.mark.casadi
def test_refinement_ends_with_the_mesh_that_was_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    options: Any = {"strategies": rcp.Strategy(exploration=0), "mesh_tolerance": 1e-8}
    assert len(rcp.solve(forced(), **options).steps) > 2
    runs = interrupt_run(monkeypatch, 1)
    found = rcp.solve(forced(), **options)
    assert len(runs) == 2
    assert found.stop_reason is rcp.StopReason.INTERRUPTED
    assert found.quality is not rcp.Quality.INFEASIBLE


@pytest.mark.casadi
def test_an_infinite_guess_is_no_guess_and_nothing_is_to_be_built(caplog: pytest.LogCaptureFixture) -> None:
    m = pyo.ConcreteModel(name="far")
    m.x = pyo.Var(initialize=math.inf)
    m.row = pyo.Constraint(expr=m.x >= 0)
    m.cost = pyo.Objective(expr=(m.x - 1) ** 2)
    result = solution(m)
    assert m.x.value == pytest.approx(1.0, abs=1e-6)
    assert "build_asl" not in result.report() + caplog.text
