"""`estimate` and `label_measurements`: known answers, agreement with parmest, and what is refused."""

from typing import Any

import numpy as np
import pandas
import pyomo.environ as pyo
import pytest
from harness.phases import with_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EstimationError

TIMES = np.array([0.1, 0.33, 0.8, 1.1, 2.0])
ERRORS = np.array([0.3, -1.2, 0.7, 0.4, -0.1])


def decay(start: float | None = 1.0, duration: Any = 2.0) -> Any:
    m, b = with_phase("tank", "decay", duration=duration, elements=5)
    b.c = rcp.State(initial=start, initial_guess=1.0)
    b.flow = rcp.Control(initial_guess=0.0)
    b.rate = rcp.Parameter(bounds=(0.01, 10), initial_guess=1.0)
    b.ode(lambda b, t: {b.c: b.flow[t] - b.rate * b.c[t]})
    b.flow.fix()
    b.twice = pyo.Expression(b.time, rule=lambda b, t: 2 * b.c[t])
    return m


def data(start: float = 1.0, error: float = 0.01) -> dict[str, Any]:
    return {"time": TIMES, "c": start * np.exp(-0.7 * TIMES) + error * ERRORS}


def fit(measured: Any = None, m: Any = None, **labels: Any) -> rcp.estimation.EstimationResult:
    m = m or decay()
    return rcp.estimate(rcp.label_measurements(m, m.tank, data() if measured is None else measured, **labels))


def information(start: float, rate: float) -> float:
    return float(((start * TIMES * np.exp(-rate * TIMES)) ** 2).sum())


@pytest.mark.casadi
def test_a_rate_and_its_standard_error_are_those_of_theory_and_the_model_holds_the_fit() -> None:
    m = decay()
    found = fit(m=m, error=0.01)
    rate = found.estimates["tank.rate"]
    gradient = TIMES * np.exp(-rate * TIMES) @ (data()["c"] - np.exp(-rate * TIMES))
    assert gradient == pytest.approx(0.0, abs=1e-5)
    assert found.standard_errors["tank.rate"] == pytest.approx(0.01 / information(1.0, rate) ** 0.5, rel=1e-4)
    row = found.to_pandas().loc["tank.rate"]
    assert (row["upper"] - row["lower"]) / 2 == pytest.approx(1.959964 * row["std. error"], rel=1e-6)
    assert m.tank.rate.value == rate
    assert m.tank.c[2.0].value == pytest.approx(np.exp(-2 * rate), abs=1e-6)
    assert found.result is not None
    assert found.result.solved
    fitted = m.tank.trajectory()(TIMES)["c"]
    assert found.residuals["residual"].to_numpy() == pytest.approx(data()["c"] - fitted, abs=1e-12)
    assert found.rmse["tank.c_measured"] == pytest.approx(np.sqrt(((data()["c"] - fitted) ** 2).mean()), rel=1e-9)


@pytest.mark.casadi
def test_an_unknown_variance_is_estimated() -> None:
    known, unknown = fit(error=0.01), fit()
    assert unknown.estimates["tank.rate"] == pytest.approx(known.estimates["tank.rate"], rel=1e-7)
    assert unknown.freedom == 4
    scale = (unknown.sum_of_squares / 4) ** 0.5 / 0.01
    assert unknown.standard_errors["tank.rate"] == pytest.approx(known.standard_errors["tank.rate"] * scale, rel=1e-6)
    row = unknown.to_pandas().loc["tank.rate"]
    assert (row["upper"] - row["lower"]) / 2 == pytest.approx(2.776445 * row["std. error"], rel=1e-6)


@pytest.mark.casadi
def test_residuals_that_the_stated_errors_do_not_explain_are_told() -> None:
    fits, too_small = fit(error=0.01), fit(error=0.001)
    assert not fits.remarks
    (remark,) = too_small.remarks
    times = (fits.sum_of_squares / 4) ** 0.5 * 10
    assert remark.startswith(f"the residuals are {times:.2g} times as large as the errors that were stated")
    assert remark in str(too_small)


@pytest.mark.casadi
@pytest.mark.parametrize(("distance", "unit"), [(0.0, 1e-4), (1.3e-12, 1e4), (1e-9, 1.0)])
def test_an_estimate_as_good_as_at_its_bound_is_held_by_it_in_any_unit(distance: float, unit: float) -> None:
    """Data that ask for a negative loss, which a bound forbids: the standard errors are those without a loss."""

    def lossy() -> Any:
        m = decay()
        m.tank.loss = rcp.Parameter(bounds=(0, 5 * unit), initial_guess=0.5 * unit)
        m.tank.y = rcp.State(initial=1.0)
        m.tank.ode(lambda b, t: {b.y: b.flow[t] - b.rate * b.y[t] - b.loss / unit * b.y[t] ** 2})
        return m

    measured = {"time": TIMES, "y": 1 / (0.625 * np.exp(0.8 * TIMES) + 0.375)}  # y' = -0.8 y + 0.3 y**2
    found = fit(measured, lossy())
    found.problem.variables[1].set_value(distance * unit)
    statistics = rcp.estimation.statistics_of(found.problem)
    assert statistics.at_bound == ("tank.loss",)
    without = lossy()
    without.tank.loss.fix(0.0)
    alone = fit(measured, without)
    assert list(alone.estimates.index) == ["tank.rate"]
    assert statistics.standard_errors.iloc[0] == pytest.approx(alone.standard_errors.iloc[0], rel=1e-4)


class Labelled:
    def __init__(self, start: float) -> None:
        self.start = start

    def get_labeled_model(self) -> Any:
        m = decay(self.start)
        return rcp.label_measurements(m, m.tank, data(self.start), outputs=["c"], error=0.01)


@pytest.mark.executable
@pytest.mark.casadi
@pytest.mark.slow
def test_estimates_and_covariance_are_those_of_parmest() -> None:
    parmest = pytest.importorskip("pyomo.contrib.parmest.parmest")
    experiments = [Labelled(1.0), Labelled(2.0)]
    estimator = parmest.Estimator(experiments, obj_function="SSE_weighted")
    _, theirs = estimator.theta_est()
    ours = rcp.estimate(experiments)
    assert ours.estimates["tank.rate"] == pytest.approx(theirs["tank.rate"], rel=1e-6)
    covariance = estimator.cov_est().to_numpy()[0, 0]
    assert ours.covariance.to_numpy()[0, 0] == pytest.approx(covariance, rel=1e-3)


@pytest.mark.casadi
def test_params_that_are_labelled_as_unknown_are_estimated_too() -> None:
    m = pyo.ConcreteModel()
    m.slope = pyo.Param(initialize=1.0, mutable=True)
    m.offset = pyo.Var(initialize=0.0)
    x = np.arange(6.0)
    m.y = pyo.Var(range(6), initialize=0.0)
    m.line = pyo.Constraint(range(6), rule=lambda m, i: m.y[i] == m.offset + m.slope * x[i])
    y = 2 + 3 * x + np.array([0.1, -0.2, 0.05, 0.1, -0.1, 0.05])
    m.experiment_outputs = pyo.Suffix()
    m.experiment_outputs.update((m.y[i], y[i]) for i in range(6))
    m.unknown_parameters = pyo.Suffix()
    m.unknown_parameters.update([(m.slope, None), (m.offset, None)])
    found = rcp.estimate(m)
    design = np.column_stack([x, np.ones(6)])
    expected, squares = np.linalg.lstsq(design, y, rcond=None)[:2]
    assert [found.estimates["slope"], found.estimates["offset"]] == pytest.approx(expected, abs=1e-6)
    covariance = squares[0] / 4 * np.linalg.inv(design.T @ design)
    order = ["slope", "offset"]
    assert found.covariance.loc[order, order].to_numpy() == pytest.approx(covariance, rel=1e-5)


@pytest.mark.casadi
def test_phases_of_one_model_share_what_the_model_says_and_have_their_own_unknowns() -> None:
    m = pyo.ConcreteModel("two tanks")
    for name in ("low", "high"):
        b = rcp.PhaseBlock(duration=2.0, elements=5)
        m.add_component(name, b)
        b.c, b.rate = rcp.State(initial_guess=1.0), rcp.Parameter(bounds=(0.01, 10), initial_guess=1.0)
        b.ode(lambda b, t: {b.c: -b.rate * b.c[t]})
    m.same = pyo.Constraint(expr=m.high.rate == m.low.rate)
    rcp.label_measurements(m, m.low, data(1.0, 0.0), unknown=["rate", m.low.c.at_start])
    rcp.label_measurements(m, m.high, data(2.0, 0.0), unknown=[m.high.c.at_start])
    found = rcp.estimate(m)
    expected = {"low.rate": 0.7, "low.c[0.0]": 1.0, "high.c[0.0]": 2.0}
    assert found.estimates.to_dict() == pytest.approx(expected, abs=1e-4)
    assert np.isfinite(found.standard_errors).all()


@pytest.mark.casadi
def test_missing_data_do_not_count_whatever_the_form_of_the_data() -> None:
    kept = [0, 1, 3, 4]
    plain = {"time": TIMES[kept], "c": data()["c"][kept]}
    with_gap = data() | {"c": np.where(np.arange(5) == 2, np.nan, data()["c"])}
    forms = [
        plain,
        with_gap,
        pandas.DataFrame({"c": with_gap["c"]}, index=TIMES),
        {"c": pandas.Series(plain["c"], index=TIMES[kept])},
    ]
    answers = [fit(form, error=0.01) for form in forms]
    for answer in answers[1:]:
        assert answer.estimates["tank.rate"] == pytest.approx(answers[0].estimates["tank.rate"], rel=1e-8)
        assert answer.standard_errors.iloc[0] == pytest.approx(answers[0].standard_errors.iloc[0], rel=1e-8)


@pytest.mark.casadi
def test_data_are_exchanged_in_a_problem() -> None:
    m = decay()
    problem = rcp.estimation.EstimationProblem(rcp.label_measurements(m, m.tank, data(), error=1.0))
    with_gap = np.where(np.arange(5) == 2, np.nan, data()["c"])
    problem.put(with_gap, error=0.01)
    assert rcp.solve(problem.model).solved
    found, expected = rcp.estimation.statistics_of(problem), fit({"time": TIMES, "c": with_gap}, error=0.01)
    assert found.estimates.iloc[0] == pytest.approx(expected.estimates.iloc[0], rel=1e-7)
    assert found.standard_errors.iloc[0] == pytest.approx(expected.standard_errors.iloc[0], rel=1e-6)
    with pytest.raises(EstimationError, match="3 measurements were given; the problem has 5"):
        problem.put(TIMES[:3])


@pytest.mark.casadi
def test_outputs_are_rules_and_expressions() -> None:
    doubled, state = {"time": TIMES, "y": 2 * data()["c"]}, fit()
    for output in (lambda b, t: 2 * b.c[t], lambda b, t: b.twice[t], "twice"):
        found = fit(doubled, outputs={"y": output})
        assert found.estimates["tank.rate"] == pytest.approx(state.estimates["tank.rate"], rel=1e-7)


# ---------------------------------------------------------------- with pairs


def leaning() -> Any:
    """A mass that is pushed against a soft wall at 0.5: p of the wall, q of the damping."""
    m, b = with_phase("push", "leaning", duration=3.0, elements=30, scheme="implicit_euler")
    b.x = rcp.State(initial=0.0)
    b.wall = rcp.Algebraic(bounds=(0, None))
    b.stiffness = rcp.Parameter(bounds=(0.1, 50), initial_guess=2.0)
    b.damping = rcp.Parameter(bounds=(0.1, 10), initial_guess=2.0)
    b.ode(lambda b, t: {b.x: (np.sin(2 * t) - b.wall[t]) / b.damping})

    @b.complementarity
    def soft_wall(b, t):
        return rcp.complements(b.wall[t] >= 0, b.wall[t] - b.stiffness * (b.x[t] - 0.3) >= 0)

    return m


def stepped(stiffness: float, damping: float) -> tuple[np.ndarray, np.ndarray]:
    x, rows, times = 0.0, [], 0.1 * np.arange(1, 31)
    for t in times:
        free = x + 0.1 * np.sin(2 * t) / damping
        x = free if free <= 0.3 else (free + 0.1 * stiffness * 0.3 / damping) / (1 + 0.1 * stiffness / damping)
        rows.append(x)
    return times, np.array(rows)


@pytest.mark.casadi
def test_a_soft_wall_is_found_exactly_and_its_covariance_is_that_of_differences() -> None:
    times, true = stepped(8.0, 0.8)
    assert 3 < (true > 0.3).sum() < 25
    m = leaning()
    exact = rcp.estimate(rcp.label_measurements(m, m.push, {"time": times, "x": true}))
    assert exact.estimates.to_dict() == pytest.approx({"push.stiffness": 8.0, "push.damping": 0.8}, rel=1e-6)
    noisy = true + 0.005 * np.random.default_rng(3).normal(size=true.size)
    m = leaning()
    found = rcp.estimate(rcp.label_measurements(m, m.push, {"time": times, "x": noisy}, error=0.005))
    assert found.result is not None
    assert found.result.certificate.name == "PROVEN"
    at = found.estimates.to_numpy()
    columns = []
    for i in range(2):
        step = 1e-5 * at[i] * np.eye(2)[i]
        columns.append((stepped(*(at + step))[1] - stepped(*(at - step))[1]) / (2e-5 * at[i]))
    expected = 0.005**2 * np.linalg.inv(np.transpose(columns).T @ np.transpose(columns))
    assert found.covariance.to_numpy() == pytest.approx(expected, rel=1e-4)


# ---------------------------------------------------------------- what the data cannot tell


@pytest.mark.casadi
def test_what_is_not_measured_is_named_and_has_no_finite_standard_error() -> None:
    def partly_seen() -> Any:
        m = decay()
        m.tank.share = rcp.Parameter(bounds=(0.1, 5), initial_guess=1.0)
        m.tank.unseen = rcp.Parameter(bounds=(0.1, 5), initial_guess=2.0)
        m.tank.other = rcp.State(initial=1.0)
        m.tank.gone = rcp.State(initial=1.0)
        m.tank.ode(lambda b, t: {b.other: -b.share * b.rate * b.other[t], b.gone: -b.unseen})
        return m

    series = {"time": TIMES, "other": np.exp(-TIMES)}
    found = fit(series, partly_seen(), error=0.1)
    assert np.isinf(found.standard_errors).all()
    (remark,) = found.remarks
    assert remark.startswith("the measurements do not determine tank.rate, tank.share, tank.unseen")
    assert remark in str(found)
    both = fit({**series, "c": np.exp(-TIMES), "gone": 1 - 2 * TIMES}, partly_seen(), error=0.1)
    assert np.isfinite(both.standard_errors).all()
    assert not both.remarks


@pytest.mark.casadi
def test_unknowns_that_nothing_ties_have_no_standard_errors() -> None:
    m = decay(None)
    found = fit(m=m)
    assert found.standard_errors.isna().all()
    assert found.remarks[0].startswith("no standard errors")


@pytest.mark.parametrize("labelled", [3, decay, []])
def test_what_is_no_labelled_model_is_refused(labelled: Any) -> None:
    with pytest.raises(EstimationError, match="expected a labelled model|there are no experiments"):
        rcp.estimate(labelled)
    with pytest.raises(EstimationError, match="has no suffix 'experiment_outputs' with entries"):
        rcp.estimate(decay())


# ---------------------------------------------------------------- numbers


# ---------------------------------------------------------------- measurements labelled for parmest


def test_labels_hold_polynomials_at_the_times_of_the_data() -> None:
    m = decay()
    m.tank.initialize(c=lambda t: t**3)
    for t, flow in m.tank.flow.items():
        flow.set_value(t)
    frame = pandas.DataFrame({"c": TIMES, "flow": -TIMES}, index=TIMES)
    assert rcp.label_measurements(m, m.tank, frame, error={"c": 0.1, "flow": 0.2}, unknown=["rate"]) is m
    predicted = [pyo.value(each) for each in m.experiment_outputs]
    start_fixed = [t**3 for t in TIMES]  # the fixed initial value 1 bends the first element only
    assert predicted[2:5] == pytest.approx(start_fixed[2:], abs=1e-12)
    assert predicted[5:] == pytest.approx(TIMES, abs=1e-12)
    assert list(m.experiment_outputs.values()) == [*TIMES, *-TIMES]
    assert list(m.measurement_error.values()) == [0.1] * 5 + [0.2] * 5
    assert [(each.name, number) for each, number in m.unknown_parameters.items()] == [("tank.rate", 1.0)]
    assert m.tank.c_measured[0.33].index() == 0.33


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"data": 5}, "expected a data frame with the times as its index"),
        ({"data": {"c": TIMES}}, "there are no times; give the key 'time'"),
        ({"data": {"time": TIMES, "c": [1.0]}}, "expected a data frame .* same length"),
        ({"data": {"time": TIMES, "c": [np.inf] * 5}}, "the data are infinite at t = 0.1"),
        ({"data": {"time": TIMES, "d": TIMES}}, "the output 'd' is no state"),
        ({"data": {"time": [1, 1], "c": [1, 1]}}, "the data of 'c' have a time twice"),
        ({"data": {"time": [1, 3], "c": [1, 1]}}, "measured at t = 3; the phase runs from 0 to 2"),
        ({"outputs": ["flow"]}, "there are no data of 'flow', but of c"),
        ({"outputs": {"c": lambda b, t: 1.0}}, "the rule of the output 'c' returned 1.0"),
        ({"outputs": {"c": lambda b, t: b.nothing[t]}}, "the rule of the output 'c' cannot be asked at t = 0.1"),
        ({"outputs": 3}, "outputs is 3"),
        ({"unknown": ["mass"]}, "there is no variable 'mass' to estimate; its parameters are rate"),
        ({"error": -1.0}, "the error of 'c' is -1.0; expected a standard deviation"),
        ({"error": {"x": 1}}, "there are no data of 'x'"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], message: str) -> None:
    m = decay()
    with pytest.raises(EstimationError, match=message):
        rcp.label_measurements(m, m.tank, **{"data": data(), **changes})
    assert m.component("experiment_outputs") is None


def test_a_control_that_nobody_knows_is_refused() -> None:
    m = decay()
    m.tank.flow.unfix()
    with pytest.raises(EstimationError, match="nothing says what the control 'flow' was"):
        rcp.label_measurements(m, m.tank, data())


def test_labels_without_a_number_are_refused() -> None:
    m = decay()
    rcp.label_measurements(m, m.tank, {"time": TIMES, "c": [np.nan] * 5})
    with pytest.raises(EstimationError, match="has no suffix 'experiment_outputs' with entries"):
        rcp.estimate(m)


def test_a_model_is_labelled_once_and_knows_its_times() -> None:
    m = decay()
    rcp.label_measurements(m, m.tank, data())
    with pytest.raises(EstimationError, match="phase 'tank': 'c' is labelled already"):
        rcp.label_measurements(m, m.tank, data())
    m = decay(duration=rcp.Duration(bounds=(1, 3)))
    with pytest.raises(EstimationError, match="give it a fixed start and duration"):
        rcp.label_measurements(m, m.tank, data())
