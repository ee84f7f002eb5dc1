"""`solve` on every backend: the same answers, the model given back, failures that keep their best point."""

import signal
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.observed_runs import Options, observe_options
from harness.phases import one_phase
from harness.routes import BACKENDS, every_backend
from harness.scenes import avoiding, turning_move
from harness.small_problems import corner
from known_mpccs import mpcc_problem
from test_failures import weighted

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ComplementarityError, SolverNotFoundError
from pyrobocop_pyomo.ipopt import backends
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.solving import in_process_session
from pyrobocop_pyomo.solving.iterates import Iterate


def touching_mass(elements: int = 15) -> pyo.ConcreteModel:
    """A mass pushed towards a wall at 0: the wall pushes back only where it is touched."""
    m, b = one_phase("move", model="mass at a wall", duration=1.5, elements=elements, scheme="implicit_euler")
    b.gap = rcp.State(initial=1.0, bounds=(0, None), initial_guess=0.5)
    b.speed = rcp.State(initial=-1.0)
    b.contact = rcp.Algebraic(bounds=(0, None))
    b.push = rcp.Control(bounds=(-2, 2))
    b.ode(lambda b, t: {b.gap: b.speed[t], b.speed: b.push[t] + b.contact[t]})
    b.complementarity(lambda b, t: rcp.complements(b.gap[t] >= 0, b.contact[t] >= 0), name="wall")
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: b.push[t] ** 2 + 4 * (b.gap[t] - 0.1) ** 2))
    return m


@every_backend
def test_every_backend_finds_the_corner(backend: str) -> None:
    m = corner()
    result = solution(m, backend=backend)
    result.raise_for_status()
    assert (m.x.value, m.y.value) == pytest.approx((2, 0), abs=1e-6)
    assert result.objective == pytest.approx(1.0, abs=1e-6)
    assert [each.name for each in result.residuals] == ["pair"]
    assert result.largest_product <= 1e-7
    assert min(step.delta for step in result.steps if step.delta is not None) == 1e-8
    assert "Ipopt" in result.solver
    assert result.derivatives.startswith("CasADi" if backend == "vectorised" else "ASL")


@every_backend
@pytest.mark.parametrize(
    "treatment",
    [
        rcp.Strategy(grouping="pair", schedule=rcp.relaxations.Fixed(1e-8)),
        rcp.Strategy(grouping="element", schedule=rcp.relaxations.Fixed(1e-8)),
        rcp.Strategy(grouping="pair", schedule=rcp.relaxations.FollowBarrier()),
        rcp.Strategy(grouping="element", schedule=rcp.relaxations.FollowBarrier()),
        rcp.Strategy(relaxation="penalty", schedule=rcp.relaxations.Fixed(1e-4)),
        rcp.Strategy(relaxation="penalty"),
        rcp.Strategy(schedule=rcp.relaxations.Geometric(first=1.0, factor=0.1, last=1e-8)),
    ],
    ids=["pair", "element", "pair-mu", "element-mu", "penalty", "penalty-continued", "geometric"],
)
def test_every_treatment_solves_the_mass_at_the_wall(backend: str, treatment: rcp.Strategy) -> None:
    m = touching_mass()
    result = solution(m, backend=backend, strategies=treatment)
    assert result.largest_product <= 1e-7
    assert m.move.trajectory().verify().largest_violation <= 2e-4  # a pair at delta = 1e-8 may keep min(a, b) = 1e-4
    assert result.objective == pytest.approx(BEST_MASS, rel=1e-3)


@pytest.mark.parametrize("backend", BACKENDS[:2])
@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_delta_follows_mu_inside_the_solve(backend: str, factor: float) -> None:
    schedule = rcp.relaxations.FollowBarrier(floor=1e-8, factor=factor)
    (step,) = rcp.solve(
        touching_mass(), backend=backend, strategies=rcp.Strategy(schedule=schedule, polish=False)
    ).steps
    mus, deltas = zip(*step.path, strict=True)
    assert len(mus) == step.iterations + 1
    assert mus[0] == pytest.approx(0.1)
    assert deltas[0] == factor * 0.1
    # eq-follow: the bound in force during an iteration is that of the barrier parameter one iteration before.
    assert list(deltas[1:]) == [max(1e-8, factor * mu) for mu in mus[:-1]]
    assert len(set(deltas)) > 3
    assert deltas[-1] == 1e-8
    assert list(deltas) == sorted(deltas, reverse=True)


@pytest.mark.executable
def test_from_outside_delta_walks_down_with_mu() -> None:
    """Ipopt's own rule for its barrier parameter, Wächter & Biegler (2006), eq. 7."""
    schedule = rcp.relaxations.FollowBarrier(factor=2.0)
    strategy = rcp.Strategy(schedule=schedule, polish=False)
    steps = rcp.solve(touching_mass(), backend="executable", strategies=strategy).steps
    mu, expected = 0.1, []
    for _ in steps:
        expected.append(max(1e-8, 2 * mu))
        mu = max(1e-9, min(0.2 * mu, mu**1.5))
    assert [step.delta for step in steps] == pytest.approx(expected)
    assert len(steps) > 5
    # Warm in primal and dual values: the steps after the first are short.
    assert max(step.iterations for step in steps[2:]) <= steps[0].iterations


@every_backend
def test_a_limit_is_told_apart_from_success_and_keeps_the_point(backend: str) -> None:
    m = touching_mass()
    start = m.move.push[m.move.final_time].value
    result = rcp.solve(
        m,
        backend=backend,
        options={"max_iter": 4},
        strategies=rcp.Strategy(schedule=rcp.relaxations.FollowBarrier(), polish=False),
    )
    assert result.stop_reason is rcp.StopReason.ITERATION_LIMIT
    assert result.quality is rcp.Quality.INFEASIBLE
    assert m.move.push[m.move.final_time].value != start
    with pytest.raises(
        rcp.errors.SolveFailed, match=r"(?s)mass at a wall: .*Ipopt reached its iteration limit.*'move.wall\["
    ):
        result.raise_for_status()


@pytest.mark.parametrize("backend", BACKENDS[:2])
@pytest.mark.ctrl_c
def test_ctrl_c_stops_cleanly_and_keeps_the_point(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def press(record):
        if record.iteration == 5:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(in_process_session, "_live_line", lambda *arguments: press)
    handler = signal.getsignal(signal.SIGINT)
    m = touching_mass()
    result = rcp.solve(m, backend=backend)
    assert result.stop_reason is rcp.StopReason.INTERRUPTED
    assert len(result.steps) == 1
    assert 5 <= result.iterations <= 6
    assert signal.getsignal(signal.SIGINT) is handler
    assert all(pair.active for pair in m.move.wall.values())
    assert m.move.push[m.move.final_time].value != 0.0


@pytest.mark.executable
def test_ctrl_c_during_the_executable_keeps_the_last_step(monkeypatch: pytest.MonkeyPatch) -> None:
    from pyomo.contrib.solver.solvers.ipopt import Ipopt

    calls = []

    def solve(self, *arguments, **options):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return original(self, *arguments, **options)

    original = Ipopt.solve
    monkeypatch.setattr(Ipopt, "solve", solve)
    result = rcp.solve(touching_mass(), backend="executable")
    assert result.stop_reason is rcp.StopReason.INTERRUPTED
    assert [step.status for step in result.steps][-1] is IpoptStatus.INTERRUPTED
    assert len(calls) == 3


def test_no_ipopt_anywhere_is_one_clear_message_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("find_ipopt_library", "find_ipopt_executable"):
        monkeypatch.setattr(backends, name, lambda: None)
    m = corner()
    with pytest.raises(SolverNotFoundError, match=r"no Ipopt is found(.|\n)*pip install(.|\n)*conda(.|\n)*build_asl"):
        rcp.solve(m)
    with pytest.raises(SolverNotFoundError, match="the ipopt executable.*not found.*found: none"):
        rcp.solve(m, backend="executable")
    assert m.pair.active
    assert list(m.component_map()) == ["x", "y", "pair", "cost"]


def test_an_unknown_backend_is_refused() -> None:
    with pytest.raises(
        ValueError, match="backend = 'amplify'; choose 'in process', 'asl', 'casadi', 'vectorised', 'executable'"
    ):
        rcp.solve(corner(), backend="amplify")


@pytest.mark.casadi
def test_delta_cannot_follow_mu_in_a_penalty() -> None:
    m = corner()
    with pytest.raises(ComplementarityError, match=r"'corner': delta cannot follow.*Use Strategy\(schedule=Geometric"):
        rcp.solve(m, strategies=rcp.Strategy(schedule=rcp.relaxations.FollowBarrier(), relaxation="penalty"))
    assert m.cost.active
    assert m.pair.active
    assert list(m.component_map()) == ["x", "y", "pair", "cost"]


def test_the_result_reads_well() -> None:
    step = Iterate("fixed delta", 1e-8, None, IpoptStatus.SOLVED, 12, 0.5, 3.25, 1e-12, 2e-9, 1e-9)
    assert str(step).split() == ["fixed", "delta", "1.0e-08", "12", "3.25", "1.0e-12", "2.0e-09", "0.50", "SOLVED"]


# Found by all backends and treatments alike; a worse value would be a wrong path, a better one a discovery.
BEST_MASS = 0.8070546


# --------------------------------------------------------------------
# Options of Ipopt that the user gives win over every other, in every run.


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
    """Where delta follows mu from outside, ``mu_init`` is that of one barrier problem."""
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
        names = [name for name in users if name != "mu_init" or not own_path(backend, step)]
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
def test_several_starts_pass_the_options_on(seen: list[Options]) -> None:
    m = weighted()
    for outcome in rcp.studies.multistart(m, 3, options=USERS):
        check(outcome.result, seen, "asl")


@pytest.mark.casadi
@pytest.mark.parametrize("limit", [None, 30.0])
def test_a_time_limit_and_the_users_own_one_both_hold(limit: float | None) -> None:
    result = rcp.solve(mpcc_problem("bard1").build(), time_limit=limit, options={"max_wall_time": 20.0})
    assert all(step.options["max_wall_time"] <= 20.0 for step in steps_of_ipopt(result))
