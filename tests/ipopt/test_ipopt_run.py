"""What can happen during a run of Ipopt in this process."""

import os
import signal
import threading
import time

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.small_problems import every_derivative, hock_schittkowski_71

from pyrobocop_pyomo.errors import EvaluationError, ModelError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint
from pyrobocop_pyomo.programs.wrapped_programs import ShiftedRows

OPTIMUM = 17.0140172891520542
FIRST_POINT = [1.0, 5.0, 5.0, 1.0]


def written_71(derivatives: str) -> CompiledModel:
    return CompiledModel(hock_schittkowski_71()[0], derivatives)


@pytest.fixture(params=[pytest.param("asl", marks=pytest.mark.asl), pytest.param("casadi", marks=pytest.mark.casadi)])
def nlp(request):
    return written_71(request.param).nlp


def run(nlp, options=None, **keywords):
    return run_ipopt(nlp, options or {}, **keywords)


def test_an_outcome_is_complete(nlp):
    outcome = run(nlp)
    assert outcome.status is IpoptStatus.SOLVED
    assert outcome.objective == pytest.approx(OPTIMUM)
    assert [record.iteration for record in outcome.records] == list(range(outcome.iterations + 1))
    assert outcome.records[0].mu > outcome.records[-1].mu > 0
    assert outcome.seconds > 0
    assert outcome.g == pytest.approx(nlp.constraints(outcome.x), abs=1e-8)
    # The stationarity condition holds with the multipliers in the signs that the docstring states.
    jacobian = np.zeros((nlp.m, nlp.n))
    np.add.at(jacobian, nlp.jacobian_structure, nlp.jacobian(outcome.x))
    stationarity = nlp.gradient(outcome.x) + outcome.g_multipliers @ jacobian
    assert stationarity - outcome.lower_multipliers + outcome.upper_multipliers == pytest.approx(0, abs=1e-6)


def test_a_program_is_solved_again_from_where_it_ended(nlp):
    first = run(nlp)
    warm = {"warm_start_init_point": "yes", "mu_init": 1e-9}
    warm |= dict.fromkeys(("warm_start_bound_push", "warm_start_mult_bound_push", "warm_start_slack_bound_push"), 1e-9)
    again = run(
        nlp, warm, start=first.point,
    )  # fmt: skip
    assert again.status is IpoptStatus.SOLVED
    assert again.iterations < first.iterations / 2


def complementary_corner(base: float) -> pyo.ConcreteModel:
    """The closest point to (2, 1) where x or y is zero; Scholtes' relaxation x y <= base."""
    m = pyo.ConcreteModel("corner")
    m.x, m.y = pyo.Var(bounds=(0, None), initialize=1.0), pyo.Var(bounds=(0, None), initialize=1.0)
    m.cost = pyo.Objective(expr=(m.x - 2) ** 2 + (m.y - 1) ** 2)
    m.product = pyo.Constraint(expr=m.x * m.y <= base)
    return m


@every_derivative
def test_a_bound_that_follows_mu_takes_fewer_iterations_than_a_bound_of_zero(derivatives):
    still = ShiftedRows(CompiledModel(complementary_corner(1e-2), derivatives).nlp, [0], 1e-2)
    still.delta = 0.0
    compiled = CompiledModel(complementary_corner(1e-2), derivatives)
    moving = ShiftedRows(compiled.nlp, [compiled.row_of[compiled.model.product]], 1e-2)
    pairs = []

    def follow(record):
        moving.delta = record.mu
        pairs.append((record.mu, moving.delta))

    at_zero, following = run(still), run(moving, on_iteration=follow)
    assert at_zero.status.solved
    assert following.status.solved
    assert following.iterations < at_zero.iterations
    assert following.x == pytest.approx([2, 0], abs=1e-3)
    assert following.x.prod() < 1e-6
    assert [mu for mu, _ in pairs] == [record.mu for record in following.records]
    assert all(mu == delta for mu, delta in pairs)
    assert pairs[0][0] >= 0.1
    assert pairs[-1][0] < 1e-8


@pytest.mark.ctrl_c
def test_ctrl_c_keeps_the_point_and_the_handler(nlp):
    def press_soon(record):
        if record.iteration == 0:  # no earlier: a press before the run ends the test session
            timer.start()
        time.sleep(0.05)

    handler = signal.getsignal(signal.SIGINT)
    timer = threading.Timer(0.12, os.kill, (os.getpid(), signal.SIGINT))
    outcome = run(nlp, on_iteration=press_soon)
    timer.join()
    assert outcome.status is IpoptStatus.INTERRUPTED
    assert 0 < outcome.iterations < 8
    assert np.isfinite(outcome.x).all()
    assert outcome.x.tolist() != FIRST_POINT
    assert outcome.objective == pytest.approx(outcome.records[-1].objective)
    assert signal.getsignal(signal.SIGINT) is handler


@pytest.mark.ctrl_c
def test_a_second_ctrl_c_is_a_keyboard_interrupt(nlp):
    def press_twice(record):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        run(nlp, on_iteration=press_twice)
    assert signal.getsignal(signal.SIGINT) is handler


@pytest.mark.casadi
def test_a_run_outside_of_the_main_thread_leaves_signals_alone():
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(run(written_71("casadi").nlp)))
    thread.start()
    thread.join()
    assert outcomes[0].status is IpoptStatus.SOLVED


def test_the_callback_stops_ipopt_at_the_current_point(nlp):
    outcome = run(nlp, on_iteration=lambda record: record.iteration < 3)
    assert outcome.status is IpoptStatus.STOPPED
    assert outcome.iterations == 3
    assert outcome.objective == pytest.approx(outcome.records[3].objective)


def test_an_exception_of_the_callback_comes_out(nlp):
    def fail(record):
        if record.iteration == 2:
            raise LookupError("of the callback")

    with pytest.raises(LookupError, match="of the callback"):
        run(nlp, on_iteration=fail)


class Wrapped:
    """A program with one method replaced."""

    def __init__(self, nlp, **replaced):
        self._nlp = nlp
        self.__dict__.update(replaced)

    def __getattr__(self, name):
        return getattr(self._nlp, name)


@pytest.mark.parametrize("method", ["objective", "gradient", "constraints", "jacobian", "hessian"])
def test_an_exception_of_an_evaluation_comes_out(method, nlp):
    def fail(*arguments):
        raise ZeroDivisionError(method)

    with pytest.raises(ZeroDivisionError, match=method):
        run(Wrapped(nlp, **{method: fail}))


@pytest.mark.parametrize("how", ["by itself", "raises", "nan"])
@every_derivative
def test_where_a_function_has_no_value_ipopt_shortens_the_step(how, derivatives):
    """min x - log(x) from x = 10 with a full Newton step to the negative side."""
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=10.0)
    m.cost = pyo.Objective(expr=m.x - pyo.log(m.x))
    nlp = CompiledModel(m, derivatives).nlp
    refused = []

    def objective(x):
        if x[0] <= 0:
            refused.append(x[0])
            if how == "nan":
                return float("nan")
            raise EvaluationError("no logarithm")
        return nlp.objective(x)

    outcome = run(nlp if how == "by itself" else Wrapped(nlp, objective=objective))
    if how == "by itself":
        assert outcome.undefined_at is not None
        assert outcome.undefined_at[0] <= 0.0
    else:
        assert refused
    assert outcome.x == pytest.approx([1.0], abs=1e-6)


def test_limits_keep_the_point(nlp):
    limited = run(nlp, {"max_iter": 2})
    assert limited.status is IpoptStatus.ITERATION_LIMIT
    assert limited.iterations == 2
    assert limited.x.tolist() != FIRST_POINT
    nap = {"on_iteration": lambda record: time.sleep(0.03)}
    late = run(nlp, {"max_wall_time": 0.05}, **nap)
    assert late.status is IpoptStatus.TIME_LIMIT
    assert late.x.tolist() != FIRST_POINT


@every_derivative
def test_infeasibility_and_too_few_freedoms_are_told_apart(derivatives):
    m = pyo.ConcreteModel()
    m.x = pyo.Var(initialize=1.0)
    m.cost = pyo.Objective(expr=m.x)
    m.row = pyo.Constraint(expr=m.x**2 <= -1)
    assert run(CompiledModel(m, derivatives).nlp).status is IpoptStatus.INFEASIBLE
    m.row.deactivate()
    m.equations = pyo.Constraint([1, 2], rule=lambda m, i: m.x**i == 1)
    few = run(CompiledModel(m, derivatives).nlp)
    assert few.status is IpoptStatus.TOO_FEW_FREEDOMS
    assert few.x.tolist() == [1.0]
    assert few.g == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("value", [100, 100.0, "100"], ids=repr)
def test_an_integer_option_may_be_written_in_any_way(value, nlp):
    assert run(nlp, {"max_iter": value}).status is IpoptStatus.SOLVED


def test_numbers_words_and_truth_values_reach_ipopt(nlp, capfd):
    options = {"tol": 1, "mu_strategy": "adaptive", "print_user_options": True, "mu_init": "0.2"}
    assert run(nlp, options).status is IpoptStatus.SOLVED
    assert capfd.readouterr().out == ""  # Ipopt comments on each type that it did not expect


@pytest.mark.casadi
@pytest.mark.parametrize(
    ("option", "value", "reason"),
    [
        ("tolerance", 1e-6, r"'tolerance': the value 1e-06 .* It is not a valid option"),
        ("tol", -1.0, r"'tol': the value -1\.0 .* Allowed, with the default in brackets: 0 < \(1e-08\) <= \+inf"),
        ("mu_strategy", "clever", r"'mu_strategy': the value 'clever'"),
        ("max_iter", None, r"'max_iter': the value None"),
        ("max_iter", 2.5, r"'max_iter': the value 2\.5"),
    ],
)
def test_a_bad_option_is_named_with_the_reason(option, value, reason, capfd):
    with pytest.raises(ModelError, match=reason):
        run(written_71("casadi").nlp, {option: value})
    assert capfd.readouterr().out == ""


@pytest.mark.casadi
def test_wrong_sizes_are_named():
    with pytest.raises(ValueError, match=r"'x' has shape \(3,\); this problem needs \(4,\)"):
        run(written_71("casadi").nlp, start=PrimalDualPoint(np.zeros(3)))
