"""Options of Ipopt that the user gives win over every other, in every run."""

from typing import Any

import pyomo.environ as pyo
import pytest
from harness.observed_runs import Options, observe_options
from harness.routes import every_backend
from harness.scenes import avoiding, turning_move
from known_mpccs import mpcc_problem
from test_failures import weighted

import pyrobocop_pyomo as rcp

USERS: Options = {"tol": 1e-9, "max_iter": 407, "mu_init": 0.05, "mu_strategy": "monotone"}
STRATEGIES = ["barrier", "tight", "continuation", "elastic"]


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Options]:
    return observe_options(monkeypatch)


def as_numbers(options: Any, names: Any = USERS) -> dict[str, str]:
    """In one form: the executable is given texts."""
    return {name: f"{options[name]:g}" if name != "mu_strategy" else options[name] for name in names if name in options}


def steps_of_ipopt(result: Any) -> list[Any]:
    return [step for step in result.steps if step.status is not None]


def own_path(backend: str, step: Any) -> bool:
    """Where delta follows mu from outside, ``mu_init`` and ``tol`` are those of one barrier problem."""
    return backend == "executable" and step.label.startswith("delta")


@every_backend
@pytest.mark.parametrize("strategy", STRATEGIES, ids=str)
@pytest.mark.parametrize("name", ["bard1", "crossed qpec 2x4"])
def test_every_run_of_every_strategy_uses_what_the_user_gave(
    name: str, strategy: Any, backend: str, seen: list[Options]
) -> None:
    result = rcp.solve(mpcc_problem(name).build(), strategies=strategy, backend=backend, options=USERS)
    check(result, seen, backend)


@every_backend
def test_the_whole_sequence_on_a_problem_without_solution(backend: str, seen: list[Options]) -> None:
    m = mpcc_problem("bard1").build()
    m.never = pyo.Constraint(expr=sum(v**2 for v in m.component_data_objects(pyo.Var)) <= -1)
    result = rcp.solve(m, backend=backend, options={**USERS, "max_iter": 57})
    assert result.quality is rcp.Quality.INFEASIBLE
    check(result, seen, backend, {**USERS, "max_iter": 57})


def check(result: Any, seen: list[Options], backend: str, users: Options = USERS) -> None:
    steps = steps_of_ipopt(result)
    assert seen
    assert len(seen) >= len(steps)
    for step in steps:
        names = [name for name in users if name not in ("mu_init", "tol") or not own_path(backend, step)]
        assert as_numbers(step.options, names) == as_numbers(users, names), step.label
    # What is reported is what was used.
    received = [as_numbers(options) for options in seen]
    for step in steps:
        assert as_numbers(step.options) in received, step.label
    for options in received:
        assert (options["max_iter"], options["mu_strategy"]) == (f"{users['max_iter']:g}", "monotone")
    assert received[0]["mu_init"] == "0.05"
    if backend != "executable":
        assert all(options == as_numbers(users) for options in received)


@every_backend
def test_a_model_without_pairs(backend: str, seen: list[Options]) -> None:
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=3.0)
    m.cost = pyo.Objective(expr=pyo.exp(m.x) - 2 * m.x)
    check(rcp.solve(m, backend=backend, options=USERS), seen, backend)


@pytest.mark.casadi
def test_every_round_of_planning_around_obstacles(seen: list[Options]) -> None:
    m = turning_move()
    avoiding(m)
    result = rcp.solve(m, options=USERS)
    assert result.safe
    check(result, seen, "vectorised")


@pytest.mark.casadi
def test_options_of_a_strategy_win_over_ours_and_lose_to_the_users() -> None:
    options = {"tol": 1e-7, "max_iter": 88, "mu_init": 0.02}
    strategy = rcp.Strategy("own", rcp.relaxations.Geometric(last=1e-8), options=options, polish=False)
    for users in ({}, {"tol": 1e-9}, {"max_iter": 90}):
        result = rcp.solve(mpcc_problem("bard1").build(), strategies=strategy, options=users)
        expected = as_numbers({**options, **users})
        for step in steps_of_ipopt(result):
            assert as_numbers(step.options) == expected


@pytest.mark.casadi
@pytest.mark.parametrize("name", ["bound_relax_factor", "linear_solver", "warm_start_init_point", "s_max"])
def test_options_that_are_also_set_here_are_the_users(name: str, seen: list[Options]) -> None:
    users = {"bound_relax_factor": 1e-9, "linear_solver": "mumps", "warm_start_init_point": "no", "s_max": 50.0}[name]
    result = rcp.solve(mpcc_problem("bard1").build(), strategies="continuation", options={name: users})
    assert all(options[name] == users for options in seen)
    assert all(step.options[name] == users for step in steps_of_ipopt(result))


@pytest.mark.casadi
def test_several_starts_and_paths_pass_the_options_on(seen: list[Options]) -> None:
    m = weighted()
    for outcome in rcp.studies.multistart(m, 3, options=USERS):
        check(outcome.result, seen, "asl")
    seen.clear()
    for step in rcp.studies.homotopy(m, {"weight": (0.5, 1.0)}, 2, options=USERS):
        check(step.result, seen, "asl")


@pytest.mark.casadi
@pytest.mark.parametrize("limit", [None, 30.0])
def test_a_time_limit_and_the_users_own_one_both_hold(limit: float | None) -> None:
    result = rcp.solve(mpcc_problem("bard1").build(), time_limit=limit, options={"max_wall_time": 20.0})
    assert all(step.options["max_wall_time"] <= 20.0 for step in steps_of_ipopt(result))
