"""`estimate`: known answers, agreement with parmest, and what is refused."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import with_phase
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.estimation.fit_statistics import covariance_of, quantile, statistics_of
from pyrobocop_pyomo.contrib.estimation.identifiability import unseen_combinations
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


def information(start: float, rate: float) -> float:
    return float(((start * TIMES * np.exp(-rate * TIMES)) ** 2).sum())


@pytest.mark.casadi
def test_a_rate_and_its_standard_error_are_those_of_theory_and_the_model_holds_the_fit() -> None:
    m = decay()
    names = [component.name for component in m.component_objects()]
    found = rcp.estimate(m, rcp.estimation.DataSet(data(), inputs=None, initial=None), error=0.01)
    rate = found.estimates["rate"]
    gradient = TIMES * np.exp(-rate * TIMES) @ (data()["c"] - np.exp(-rate * TIMES))
    assert gradient == pytest.approx(0.0, abs=1e-5)
    assert found.standard_errors["rate"] == pytest.approx(0.01 / information(1.0, rate) ** 0.5, rel=1e-4)
    lower, upper = found.intervals["rate"]
    assert (upper - lower) / 2 == pytest.approx(1.959964 * found.standard_errors["rate"], rel=1e-6)
    assert m.tank.rate.value == rate
    assert m.tank.c[2.0].value == found.trajectory()(2.0)["c"] == pytest.approx(np.exp(-2 * rate), abs=1e-6)
    assert [component.name for component in m.component_objects()] == names
    assert found.solved
    assert found.residuals["set 1", "c"] == pytest.approx(data()["c"] - found.trajectory()(TIMES)["c"], abs=1e-12)


@pytest.mark.casadi
def test_an_unknown_variance_is_estimated() -> None:
    known, unknown = rcp.estimate(decay(), data(), error=0.01), rcp.estimate(decay(), data())
    assert unknown.estimates["rate"] == pytest.approx(known.estimates["rate"], rel=1e-7)
    assert unknown.statistics.freedom == 4
    scale = (unknown.statistics.sum_of_squares / 4) ** 0.5 / 0.01
    assert unknown.standard_errors["rate"] == pytest.approx(known.standard_errors["rate"] * scale, rel=1e-6)
    lower, upper = unknown.intervals["rate"]
    assert (upper - lower) / 2 == pytest.approx(2.776445 * unknown.standard_errors["rate"], rel=1e-6)


@pytest.mark.casadi
def test_residuals_that_the_stated_errors_do_not_explain_are_told() -> None:
    fits, too_small = rcp.estimate(decay(), data(), error=0.01), rcp.estimate(decay(), data(), error=0.001)
    assert not fits.statistics.remarks
    (remark,) = too_small.statistics.remarks
    times = (fits.statistics.sum_of_squares / 4) ** 0.5 * 10
    assert remark.startswith(f"the residuals are {times:.2g} times as large as the errors that were stated")
    assert remark in str(too_small)


@pytest.mark.casadi
@pytest.mark.parametrize("error", [0.01, None])
@pytest.mark.parametrize(("factor", "is_told"), [(1.0, False), (10.0, False), (180 / np.pi, True), (1000.0, True)])
def test_data_in_another_unit_than_the_model_are_told(factor: float, is_told: bool, error: float | None) -> None:
    measured = data() | {"c": factor * data()["c"]}
    found = rcp.estimate(decay(), measured, error=None if error is None else error * factor)
    told = [remark for remark in found.statistics.remarks if remark.startswith("the data of 'c' are ")]
    assert len(told) == is_told
    assert all("check their unit" in remark and remark in str(found) for remark in told)


@pytest.mark.casadi
@pytest.mark.parametrize("unit", [1e-4, 1.0, 1e4])
@pytest.mark.parametrize("distance", [0.0, 1.3e-12, 1e-9])
def test_an_estimate_as_good_as_at_its_bound_is_held_by_it_in_any_unit(distance: float, unit: float) -> None:
    """Data that ask for a negative loss, which a bound forbids: the standard errors are those without a loss."""
    m = decay()
    m.tank.loss = rcp.Parameter(bounds=(0, 5 * unit), initial_guess=0.5 * unit)
    m.tank.y = rcp.State(initial=1.0)
    m.tank.ode(lambda b, t: {b.y: b.flow[t] - b.rate * b.y[t] - b.loss / unit * b.y[t] ** 2})
    measured = {"time": TIMES, "y": 1 / (0.625 * np.exp(0.8 * TIMES) + 0.375)}  # y' = -0.8 y + 0.3 y**2
    found = rcp.estimate(m, measured, parameters=["rate", "loss"])
    found.problem.unknowns[1].put(distance * unit)
    statistics = statistics_of(found.problem)
    assert statistics.at_bound == ("loss",)
    m.tank.loss.fix(0.0)
    alone = rcp.estimate(m, measured, parameters=["rate"])
    assert statistics.standard_errors[0] == pytest.approx(alone.standard_errors["rate"], rel=1e-4)


@pytest.mark.casadi
@pytest.mark.parametrize("error", [0.01, None])
@pytest.mark.parametrize(("place", "factor"), [(3, 1.0), (0, 10.0), (3, 10.0), (8, 0.1)])
def test_a_mistyped_datum_is_named_before_the_table(place: int, factor: float, error: float | None) -> None:
    times = np.linspace(0.1, 2, 10)
    c = np.exp(-0.7 * times) + 0.01 * np.tile(ERRORS, 2)
    c[place] *= factor
    found = rcp.estimate(decay(), {"time": times, "c": c}, error=error)
    named = [remark for remark in found.statistics.remarks if remark.startswith("'c' of set 1 at t = ")]
    assert len(named) == (factor != 1.0)
    assert all(f"at t = {times[place]:g} is {c[place]:.4g}" in remark for remark in named)
    assert all(str(found).index(remark) < str(found).index("std. error") for remark in named)
    assert bool(found.statistics.remarks) == (factor != 1.0)


@pytest.mark.casadi
def test_an_estimate_that_a_coarse_mesh_shifts_is_told() -> None:
    def first_order(elements: int) -> Any:
        m, b = with_phase("tank", "decay", duration=2.0, elements=elements, scheme="implicit_euler")
        b.c = rcp.State(initial=1.0)
        b.rate = rcp.Parameter(bounds=(0.01, 10), initial_guess=1.0)
        b.ode(lambda b, t: {b.c: -b.rate * b.c[t]})
        return m

    exact = {"time": TIMES, "c": np.exp(-0.7 * TIMES)}
    coarse, fine = (rcp.estimate(first_order(elements), exact, error=0.01) for elements in (40, 400))
    shift = abs(0.7 - coarse.estimates["rate"]) / coarse.standard_errors["rate"]
    (remark,) = coarse.statistics.remarks
    said = remark.partition("shift 'rate' by about ")[2].partition(" ")[0]
    assert float(said) == pytest.approx(shift, rel=0.1)
    assert coarse.problem.estimates()[0] == coarse.estimates["rate"]
    assert not fine.statistics.remarks


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
    for error, criterion in ((0.01, "SSE_weighted"), (None, "SSE")):
        estimator = parmest.Estimator(experiments, obj_function=criterion)
        _, theirs = estimator.theta_est()
        ours = rcp.estimate(experiments if error else [decay_without_errors(each) for each in experiments])
        assert ours.estimates["tank.rate"] == pytest.approx(theirs["tank.rate"], rel=1e-6)
        if error:
            covariance = estimator.cov_est().to_numpy()[0, 0]
            assert ours.statistics.covariance[0, 0] == pytest.approx(covariance, rel=1e-3)


def decay_without_errors(experiment: Labelled) -> Any:
    m = experiment.get_labeled_model()
    for key in list(m.measurement_error):
        m.measurement_error[key] = None
    return m


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
    order = [found.names.index(name) for name in ("slope", "offset")]
    assert found.statistics.covariance[np.ix_(order, order)] == pytest.approx(covariance, rel=1e-5)


@pytest.mark.casadi
def test_shared_and_own_parameters_and_values_at_the_start() -> None:
    sets = {"low": data(1.0, 0.0), "high": data(2.0, 0.0)}
    found = rcp.estimate(decay(None), sets)
    assert found.estimates == pytest.approx({"rate": 0.7, "c at start (low)": 1.0, "c at start (high)": 2.0}, abs=1e-4)
    fast = {"time": TIMES, "c": np.exp(-1.4 * TIMES)}
    own = rcp.estimate(decay(), [data(1.0, 0.0), fast], own=["rate"])
    assert own.estimates == pytest.approx({"rate (set 1)": 0.7, "rate (set 2)": 1.4}, abs=1e-4)
    asked = rcp.estimate(decay(5.0), sets["high"], initial="estimated")
    assert asked.estimates == pytest.approx({"rate": 0.7, "c at start": 2.0}, abs=1e-4)
    given = rcp.estimate(decay(5.0), rcp.estimation.DataSet(sets["high"], initial={"c": 2.0}))
    assert given.estimates == pytest.approx({"rate": 0.7}, abs=1e-4)


@pytest.mark.casadi
def test_missing_data_do_not_count_whatever_the_form_of_the_data() -> None:
    pandas = pytest.importorskip("pandas")
    kept = [0, 1, 3, 4]
    plain = {"time": TIMES[kept], "c": data()["c"][kept]}
    with_gap = data()
    with_gap["c"] = np.where(np.arange(5) == 2, np.nan, with_gap["c"])
    forms = [
        plain,
        with_gap,
        pandas.DataFrame({"c": with_gap["c"]}, index=TIMES),
        {"c": (TIMES[kept], plain["c"])},
        {"c": pandas.Series(plain["c"], index=TIMES[kept])},
        rcp.estimation.DataSet(plain),
    ]
    answers = [rcp.estimate(decay(), form, error=0.01) for form in forms]
    for answer in answers[1:]:
        assert answer.estimates["rate"] == pytest.approx(answers[0].estimates["rate"], rel=1e-8)
        assert answer.standard_errors["rate"] == pytest.approx(answers[0].standard_errors["rate"], rel=1e-8)


@pytest.mark.casadi
def test_outputs_are_rules_expressions_and_applied_controls() -> None:
    state = rcp.estimate(decay(), data(), unidentifiable="ignore")
    doubled = {"time": TIMES, "y": 2 * data()["c"]}
    rule = rcp.estimate(decay(), doubled, outputs={"y": lambda b, t: 2 * b.c[t]}, unidentifiable="ignore")
    nested = rcp.estimate(decay(), doubled, outputs={"y": lambda b, t: b.twice[t]}, unidentifiable="ignore")
    named = rcp.estimate(decay(), doubled, outputs={"y": "twice"}, unidentifiable="ignore")
    for found in (rule, nested, named):
        assert found.estimates["rate"] == pytest.approx(state.estimates["rate"], rel=1e-7)
    m = decay()
    m.tank.flow.unfix()
    times = np.linspace(0, 2, 9)
    fed = {"c": (TIMES, data(1.0, 0.0)["c"]), "flow": (times, 0.0 * times)}
    assert rcp.estimate(m, fed).estimates["rate"] == pytest.approx(0.7, abs=1e-4)
    assert not any(variable.fixed for variable in m.tank.flow.values())


@pytest.mark.casadi
def test_a_fit_with_the_ranges_of_the_data_as_errors_does_not_depend_on_units() -> None:
    def fit(factor: float) -> Any:
        series = {"time": TIMES, "c": data()["c"], "y": factor * (data()["c"] + 0.05)}
        errors = {name: np.ptp(series[name]) for name in ("c", "y")}
        return rcp.estimate(decay(), series, outputs={"c": "c", "y": lambda b, t: factor * b.c[t]}, error=errors)

    one, other = fit(1.0), fit(1e4)
    assert one.estimates["rate"] == pytest.approx(other.estimates["rate"], rel=1e-6)
    assert one.nrmse == pytest.approx(other.nrmse, rel=1e-6)
    assert one.nrmse == pytest.approx((one.statistics.sum_of_squares / 10) ** 0.5, rel=1e-9)


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
    exact = rcp.estimate(leaning(), {"time": times, "x": true})
    assert exact.estimates == pytest.approx({"stiffness": 8.0, "damping": 0.8}, rel=1e-6)
    noisy = true + 0.005 * np.random.default_rng(3).normal(size=true.size)
    found = rcp.estimate(leaning(), {"time": times, "x": noisy}, error=0.005)
    assert found.result.certificate.name == "PROVEN"
    at = found.statistics.estimates
    columns = []
    for i in range(2):
        step = 1e-5 * at[i] * np.eye(2)[i]
        columns.append((stepped(*(at + step))[1] - stepped(*(at - step))[1]) / (2e-5 * at[i]))
    expected = 0.005**2 * np.linalg.inv(np.transpose(columns).T @ np.transpose(columns))
    assert found.statistics.covariance == pytest.approx(expected, rel=1e-4)


# ---------------------------------------------------------------- what the data cannot tell


@pytest.mark.casadi
def test_a_product_and_what_is_not_measured_are_named_before_the_fit() -> None:
    m = decay()
    m.tank.share = rcp.Parameter(bounds=(0.1, 5), initial_guess=1.0)
    m.tank.unseen = rcp.Parameter(bounds=(0.1, 5), initial_guess=2.0)
    m.tank.other = rcp.State(initial=1.0)
    m.tank.gone = rcp.State(initial=1.0)
    m.tank.ode(lambda b, t: {b.other: -b.share * b.rate * b.other[t], b.gone: -b.unseen})
    series = {"time": TIMES, "other": np.exp(-TIMES)}
    before = m.tank.rate.value
    with pytest.raises(EstimationError, match="nothing was fitted") as caught:
        rcp.estimate(m, series)
    assert {finding.components for finding in caught.value.diagnosis.errors} == {
        ("rate", "share"), ("unseen",)
    }  # fmt: skip
    assert m.tank.rate.value == before
    found = rcp.estimate(m, series, unidentifiable="report", error=0.1)
    assert found.diagnosis is not None
    assert np.isinf([found.standard_errors[name] for name in ("rate", "share", "unseen")]).all()
    both = rcp.estimate(m, {**series, "c": np.exp(-TIMES), "gone": 1 - 2 * TIMES})
    assert both.diagnosis.findings == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"data": 5}, "is a int; expected a data frame"),
        ({"data": []}, "there are no data"),
        ({"data": {"c": TIMES}}, "'c': has no times"),
        ({"data": {"time": TIMES, "c": [1.0]}}, "'c' has 1 values at 5 times"),
        ({"data": {"time": TIMES, "c": ["a"] * 5}}, "'c': expected numbers"),
        ({"data": {"time": TIMES, "c": [np.nan] * 5}}, "there is no number in it"),
        ({"data": {"time": TIMES, "c": [np.inf] * 5}}, "'c' is infinite at t = 0.1"),
        ({"data": {"time": TIMES, "d": TIMES}}, "the output 'd' is no state"),
        ({"data": {"time": TIMES + 1, "c": TIMES}}, "'c' was measured at t = 2.1; the phase runs from 0 to 2"),
        ({"outputs": ["d"]}, "the output 'd' is no state"),
        ({"outputs": {"c": lambda b, t: 1.0}}, "the rule of the output 'c' returned 1.0"),
        ({"outputs": {"c": lambda b, t: b.nothing[t]}}, "the rule of the output 'c' cannot be asked at t = 0.1"),
        ({"outputs": 3}, "outputs is 3"),
        ({"parameters": ["k"]}, "there is no parameter 'k'"),
        ({"parameters": "rate"}, "lists of names"),
        ({"own": ["k"]}, "own names 'k', which is not estimated"),
        ({"phase": "reactor"}, "has no phase 'reactor'"),
        ({"error": -1.0}, "the error of 'c' is -1.0; expected a standard deviation"),
        ({"error": {"c": [0.1, -0.1, 0.1, 0.1, 0.1]}}, "the error of 'c' is"),
        ({"initial": ["d"]}, "initial names 'd'"),
        ({"initial": "free"}, "initial = 'free'"),
        ({"confidence": 95}, "confidence = 95"),
        ({"unidentifiable": "maybe"}, "unidentifiable = 'maybe'"),
        ({"data": rcp.estimation.DataSet(data(), inputs={"heat": 1.0})}, "the input 'heat' is no control"),
        (
            {"data": rcp.estimation.DataSet(data(), initial={"d": 1.0})},
            "the initial value of 'd'",
        ),
        ({"model": 3}, "expected a model, found int"),
        ({"data": None}, "has no suffix 'experiment_outputs'"),
        ({"model": decay}, "expected a model, found function"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    m = decay()
    before = [(v.value, v.fixed) for v in m.component_data_objects(pyo.Var)]
    arguments = {"model": m, "data": data(), **changes}
    with pytest.raises(EstimationError, match=message):
        rcp.estimate(arguments.pop("model"), arguments.pop("data"), **arguments)
    assert [(v.value, v.fixed) for v in m.component_data_objects(pyo.Var)] == before


def test_a_control_that_nobody_knows_is_refused() -> None:
    m = decay()
    m.tank.flow.unfix()
    with pytest.raises(EstimationError, match="nothing says what the control 'flow' of phase"):
        rcp.estimate(m, data())
    short = {**data(), "flow": 0 * TIMES}
    with pytest.raises(EstimationError, match="the input 'flow' is known from t = 0.1 to 2, but is needed from"):
        rcp.estimate(m, short)


# ---------------------------------------------------------------- numbers


@given(st.integers(0, 1000))
@settings(max_examples=30)
def test_a_covariance_is_that_of_the_normal_equations_whatever_the_sizes(seed: int) -> None:
    generator = np.random.default_rng(seed)
    matrix, scales = generator.normal(size=(12, 3)), 10.0 ** generator.uniform(-3, 3, 3)
    expected = 0.3 * np.linalg.inv(matrix.T @ matrix) / np.outer(scales, scales)
    assert covariance_of(matrix * scales, 0.3) == pytest.approx(expected, rel=1e-8)


@given(st.integers(0, 1000))
@settings(max_examples=30)
def test_a_hidden_combination_is_found_whatever_the_sizes(seed: int) -> None:
    generator = np.random.default_rng(seed)
    scales = 10.0 ** generator.uniform(-3, 3, 4)
    direction = generator.normal(size=4)
    direction /= np.linalg.norm(direction)
    seen = generator.normal(size=(20, 4)) @ (np.eye(4) - np.outer(direction, direction))
    (found,) = unseen_combinations(seen / scales, scales, list("abcd"))
    expected = {name: share for name, share in zip("abcd", direction, strict=True) if abs(share) >= 0.05}
    sign = np.sign(expected[found.names[0]])
    assert dict(zip(found.names, found.shares, strict=True)) == pytest.approx(
        {name: sign * share for name, share in expected.items()}, abs=1e-6
    )


def test_quantiles_are_those_of_the_tables() -> None:
    assert quantile(0.95, None) == pytest.approx(1.959964, abs=1e-6)
    assert quantile(0.9, 5) == pytest.approx(2.015048, abs=1e-6)


# ---------------------------------------------------------------- measurements labelled for parmest


def test_labels_hold_polynomials_at_the_times_of_the_data() -> None:
    pandas = pytest.importorskip("pandas")
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
        ({"data": {"time": [1, 2], "c": [1, np.nan]}}, "the data of 'c' are missing or have a time twice"),
        ({"data": {"time": [1, 1], "c": [1, 1]}}, "the data of 'c' are missing or have a time twice"),
        ({"data": {"time": [1, 3], "c": [1, 1]}}, "measured at t = 3; the phase runs from 0 to 2"),
        ({"outputs": ["flow"]}, "has no data of flow; it has c"),
        ({"unknown": ["mass"]}, "there is no parameter 'mass'; there are rate"),
        ({"error": {"x": 1}}, "has an error for 'x', but no data of it"),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], message: str) -> None:
    m = decay()
    with pytest.raises(EstimationError, match=message):
        rcp.label_measurements(m, m.tank, **{"data": data(), **changes})
    assert m.component("experiment_outputs") is None


def two_tanks() -> Any:
    m = pyo.ConcreteModel("two tanks")
    m.tank = rcp.PhaseBlock(duration=2.0, elements=5)
    m.second = rcp.PhaseBlock(duration=1.0, start=m.tank, elements=3)
    for b in (m.tank, m.second):
        b.c, b.rate = rcp.State(initial_guess=1.0), rcp.Parameter(bounds=(0.01, 10), initial_guess=1.0)
        b.ode(lambda b, t: {b.c: -b.rate * b.c[t]})
    m.tank.c.at_start.fix(1.0)
    m.link = rcp.Link(m.tank, m.second, parameters=["rate"])
    rcp.label_measurements(m, m.tank, data(error=0.0), error=0.01)
    later = {"time": [2.2, 3.0], "c": np.exp(-0.7 * np.array([2.2, 3.0]))}
    return rcp.label_measurements(m, m.second, later, error=0.02, unknown=[])


def test_several_phases_of_a_model_are_labelled() -> None:
    m = two_tanks()
    assert [each.parent_block().name for each in m.experiment_outputs] == ["tank"] * 5 + ["second"] * 2
    assert list(m.measurement_error.values()) == [0.01] * 5 + [0.02] * 2
    assert [each.name for each in m.unknown_parameters] == ["tank.rate"]


@pytest.mark.ipopt
def test_a_parameter_is_estimated_from_the_data_of_two_phases() -> None:
    found = rcp.estimate([two_tanks()])
    assert found.estimates["tank.rate"] == pytest.approx(0.7, abs=1e-4)


def test_a_model_is_labelled_once_and_knows_its_times() -> None:
    m = decay()
    rcp.label_measurements(m, m.tank, data())
    with pytest.raises(EstimationError, match="phase 'tank': 'c' is labelled already"):
        rcp.label_measurements(m, m.tank, data())
    m = decay(duration=rcp.Duration(bounds=(1, 3)))
    with pytest.raises(EstimationError, match="give it a fixed start and duration"):
        rcp.label_measurements(m, m.tank, data())
