"""`MovingHorizon`: the Kalman filter where that is exact, bounds where it knows none, and what is refused."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import mass, with_phase

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ComplementarityError, EstimationError, ModelError

pytestmark = pytest.mark.casadi

WIDTH = 0.1
PRIOR, NOISE, ERROR = {"x": 0.5, "v": 0.8, "bias": 0.6}, {"push": 0.7}, {"x": 0.05, "sum": 0.2}
OUTPUTS = {"sum": lambda b, t: b.x[t] + 2 * b.v[t]}
INPUTS = np.sin(np.arange(14))
SAMPLES = np.random.default_rng(5).normal([0.3, 1.0], [0.4, 1.0], (14, 2))
SAMPLES[3], SAMPLES[7, 0], SAMPLES[9, 1] = np.nan, np.nan, np.nan


def spring(elements: int = 4, **bounds: Any) -> Any:
    m, b = with_phase("window", "spring", duration=WIDTH * elements, elements=elements, scheme="implicit_euler")
    b.x = rcp.State(initial=0.2, bounds=bounds.get("x"))
    b.v = rcp.State(initial_guess=0.1)
    b.force = rcp.Control(parametrization="piecewise_constant")
    b.push = rcp.Control(parametrization="piecewise_constant")
    b.bias = rcp.Parameter(initial_guess=0.3)
    b.ode(lambda b, t: {b.x: b.v[t], b.v: b.bias - 2 * b.x[t] - 0.3 * b.v[t] + b.force[t] + b.push[t]})
    m.cost = pyo.Objective(expr=b.integral(lambda b, t: (b.x[t] - 7) ** 2))  # for another task
    return m


def estimator(elements: int = 4, per_sample: int = 1, **bounds: Any) -> rcp.estimation.MovingHorizon:
    m = spring(elements, **bounds)
    return rcp.estimation.MovingHorizon(
        m, m.window, error=ERROR, prior=PRIOR, noise=NOISE, outputs=OUTPUTS, elements_per_sample=per_sample
    )


def sample(k: int) -> dict[str, float | None]:
    return {name: None if np.isnan(number) else number for name, number in zip(ERROR, SAMPLES[k], strict=True)}


def kalman(samples: np.ndarray, per_sample: int = 1) -> Any:
    """Means and covariances of (x, v, bias) after each sample."""
    rates = np.array([[0.0, 1.0, 0.0], [-2.0, -0.3, 1.0], [0.0, 0.0, 0.0]])
    step = np.linalg.inv(np.eye(3) - WIDTH * rates)
    pushed = step @ [0.0, WIDTH, 0.0]
    mean, covariance = np.array([0.2, 0.1, 0.3]), np.diag(np.square(list(PRIOR.values())))
    for k, measured in enumerate(samples):
        for _ in range(per_sample if k else 0):
            mean = step @ mean + pushed * INPUTS[k]
            covariance = step @ covariance @ step.T + NOISE["push"] ** 2 * np.outer(pushed, pushed)
        seen = np.isfinite(measured)
        rows = np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])[seen]
        spread = rows @ covariance @ rows.T + np.diag(np.square(list(ERROR.values())))[seen][:, seen]
        gain = covariance @ rows.T @ np.linalg.inv(spread)
        mean, covariance = mean + gain @ (measured[seen] - rows @ mean), covariance - gain @ rows @ covariance
        yield mean, covariance


@pytest.mark.parametrize(("elements", "per_sample"), [(1, 1), (6, 2)])
def test_of_a_linear_system_it_is_the_kalman_filter(elements: int, per_sample: int) -> None:
    moving = estimator(elements, per_sample)
    for k, (mean, covariance) in enumerate(kalman(SAMPLES, per_sample)):
        step = moving.step(sample(k), {"force": INPUTS[k]} if k else None)
        assert step.solved
        np.testing.assert_allclose([*step.state.values(), *step.parameters.values()], mean, atol=1e-8)
        np.testing.assert_allclose(step.covariance, covariance, atol=1e-8)
    assert list(step.standard_errors) == ["x", "v", "bias"]
    assert step.standard_errors["v"] == pytest.approx(covariance[1, 1] ** 0.5)


def test_samples_may_be_taken_in_before_an_estimate_is_made() -> None:
    moving = estimator()
    for k in range(len(SAMPLES) - 1):
        moving.add(sample(k), {"force": INPUTS[k]} if k else None)
    step = moving.step(sample(len(SAMPLES) - 1), {"force": INPUTS[-1]})
    *_, (mean, _) = kalman(SAMPLES)
    np.testing.assert_allclose([*step.state.values(), *step.parameters.values()], mean, atol=1e-8)


def test_bounds_hold_in_the_window_and_not_beyond_the_last_sample() -> None:
    moving = estimator(elements=8, x=(0.15, None))
    unbounded = min(mean[0] for mean, _ in kalman(SAMPLES))
    for k in range(len(SAMPLES)):
        step = moving.step(sample(k), {"force": INPUTS[k]} if k else None)
        assert step.solved
        assert min(moving.phase.x[t].value for t in moving.phase.time) > 0.15 - 1e-7
    assert unbounded < 0.1


def moves_freely(limit: float) -> list[list[float]]:
    held = {"parametrization": "piecewise_constant"}
    m, b = mass(x={"initial": 0.0, "bounds": (None, limit)}, v={"initial": 1.0}, u=held, duration=2.0, elements=10)
    b.constraint(lambda b, t: b.x[t] + 0.1 * b.v[t] <= limit + 0.1, name="room")
    moving = rcp.estimation.MovingHorizon(m, b, error={"x": 0.1}, prior={"x": 0.1, "v": 1.0}, noise={"u": 0.1})
    return [[*moving.step({"x": measured}).state.values()] for measured in (0.0, 0.25, 0.45, 0.6)]


def test_a_prediction_that_would_leave_the_bounds_does_not_change_an_estimate() -> None:
    np.testing.assert_allclose(moves_freely(1.0), moves_freely(1000.0), atol=1e-7)


def pendulum(k: int, start: tuple[float, float] = (0.8, 0.0), damping: float = 0.4) -> tuple[float, float]:
    """The motion of implicit Euler: the same equations as those of the window."""
    angle, rate = start
    for _ in range(k):
        later = rate
        for _ in range(50):
            later = (rate - WIDTH * 9 * np.sin(angle + WIDTH * later)) / (1 + WIDTH * damping)
        angle, rate = angle + WIDTH * later, later
    return angle, rate


def swinging(guess: tuple[float, float, float], **options: Any) -> rcp.estimation.MovingHorizon:
    m, b = with_phase("window", "pendulum", duration=5 * WIDTH, elements=5, scheme="implicit_euler")
    b.angle, b.rate = rcp.State(initial=guess[0]), rcp.State(initial=guess[1])
    b.damping = rcp.Parameter(bounds=(0, 2), initial_guess=guess[2])
    b.ode(lambda b, t: {b.angle: b.rate[t], b.rate: -9 * pyo.sin(b.angle[t]) - b.damping * b.rate[t]})
    return rcp.estimation.MovingHorizon(
        m,
        m.window,
        error={"height": 0.01},
        prior={"angle": 0.3, "rate": 1.0, "damping": 0.3},
        outputs={"height": lambda b, t: 1 - pyo.cos(b.angle[t])},
        **options,
    )


def test_exact_data_leave_the_truth_and_lead_to_it() -> None:
    true, wrong = swinging((0.8, 0.0, 0.4)), swinging((0.6, 0.5, 0.6))
    errors = []
    for k in range(25):
        angle, rate = pendulum(k)
        measured = {"height": 1 - np.cos(angle)}
        step, other = true.step(measured), wrong.step(measured)
        assert step.solved
        assert other.solved
        assert [step.state["angle"], step.state["rate"]] == pytest.approx([angle, rate], abs=1e-7)
        assert step.parameters["damping"] == pytest.approx(0.4, abs=1e-7)
        errors.append(abs(other.state["angle"] - angle) + abs(other.state["rate"] - rate))
    assert errors[0] > 0.3
    assert max(errors[-3:]) < 0.01
    assert other.parameters["damping"] == pytest.approx(0.4, abs=0.02)


def test_without_a_solution_the_state_is_predicted_and_the_next_step_goes_on() -> None:
    moving = swinging((0.8, 0.0, 0.4))
    for k in range(8):
        step = moving.step({"height": 1 - np.cos(pendulum(k)[0])})
    failed = moving.step({"height": 1.0}, time_limit=0.0)
    assert not failed.solved
    assert failed.state["angle"] == pytest.approx(step.state["angle"], abs=0.5)
    assert moving.step({}).solved


REFUSED = [
    ({"prior": {"x": 0.5, "v": 0.8}}, "prior of 'bias' is None; expected a standard deviation"),
    ({"prior": {**PRIOR, "y": 1.0}}, "prior has 'y'; expected are x, v, bias"),
    ({"error": {"x": 0.0}}, "error of 'x' is 0.0"),
    ({"error": {"z": 1.0}}, "the output 'z' is no state"),
    ({"noise": {"wind": 1.0}}, "noise has 'wind'; expected are force, push"),
    ({"elements_per_sample": 3}, "elements_per_sample = 3, and 4 elements"),
]


@pytest.mark.parametrize(("changed", "message"), REFUSED)
def test_what_does_not_fit_is_refused_before_the_model_is_changed(changed: dict[str, Any], message: str) -> None:
    m = spring()
    with pytest.raises(EstimationError, match=message.replace("(", "\\(")):
        rcp.estimation.MovingHorizon(
            m, m.window, **{"error": ERROR, "prior": PRIOR, "noise": NOISE, "outputs": OUTPUTS, **changed}
        )
    assert m.cost.active
    assert m.window.x[0].fixed


STATED = [
    ({"x": {"final": 1.0}}, "'x' has initial=0.0 and final=1.0"),
    ({"x": {"initial": (0, 1)}}, r"initial=\(0, 1\)"),
    ({"w": {"parametrization": "collocated"}}, "the control 'w' has no value for each element"),
    ({"phase": {"mesh": (0, 0.1, 1.0)}}, "2 elements between 0.1 and 0.9 wide"),
]


@pytest.mark.parametrize(("changed", "message"), STATED)
def test_a_phase_that_is_no_window_is_refused(changed: dict[str, Any], message: str) -> None:
    m, b = with_phase("window", duration=1.0, **changed.get("phase", {}))
    b.x = rcp.State(**{"initial": 0.0, **changed.get("x", {})})
    b.w = rcp.Control(**{"parametrization": "piecewise_constant", **changed.get("w", {})})
    b.ode(lambda b, t: {b.x: b.w[t]})
    with pytest.raises(EstimationError, match=message):
        rcp.estimation.MovingHorizon(m, m.window, error={"x": 1}, prior={"x": 1}, noise={"w": 1})


def test_phases_and_pairs_are_refused_as_for_receding_horizons() -> None:
    m, other = spring(), spring()
    with pytest.raises(ModelError, match="is no phase of 'spring'"):
        rcp.estimation.MovingHorizon(m, other.window, error=ERROR, prior=PRIOR)
    m.window.complementarity(lambda b, t: rcp.complements(b.x[t] >= 0, b.v[t] >= 0))
    with pytest.raises(ComplementarityError, match="that a moving horizon works at"):
        rcp.estimation.MovingHorizon(m, m.window, error=ERROR, prior=PRIOR)


def test_samples_that_do_not_fit_are_refused_and_not_taken_in() -> None:
    moving, other = estimator(), estimator()
    for one in (moving, other):
        one.add(sample(0))
    for measured, inputs, message in [
        ({"x": np.inf}, {"force": 0.0}, "expected finite measurements, or NaN where one is missing"),
        ({"x": 0.1}, None, "a finite number for each of the inputs force"),
        ({"x": 0.1}, {"force": np.nan}, "a finite number for each of the inputs force"),
        ({"x": 0.1}, {"push": 1.0}, "inputs has 'push'; expected are force"),
        ({"v": 0.1}, {"force": 1.0}, "measured has 'v'; expected are x, sum"),
        ({"x": "far"}, {"force": 1.0}, "measured is {'x': 'far'}"),
    ]:
        with pytest.raises(EstimationError, match=message):
            moving.step(measured, inputs)
    assert moving.step(sample(1), {"force": 1.0}).state == other.step(sample(1), {"force": 1.0}).state


def test_what_is_known_ever_better_does_not_spoil_the_arrival_cost() -> None:
    m, b = with_phase("window", duration=4.0, elements=2, scheme="implicit_euler")
    b.fast, b.slow, b.level = rcp.State(initial=1.0), rcp.State(initial=1.0), rcp.State(initial=0.0)
    b.ode(lambda b, t: {b.fast: b.slow[t] - 5 * b.fast[t], b.slow: -b.slow[t], b.level: 0 * b.level[t]})
    moving = rcp.estimation.MovingHorizon(
        m, m.window, error={"level": 0.1, "fast": 0.1}, prior={"fast": 1.0, "slow": 1.0, "level": 1.0}
    )
    generator = np.random.default_rng(8)
    measured = 0.5 + 0.1 * generator.normal(size=100)
    for number in measured:
        step = moving.step({"level": number, "fast": 0.1 * generator.normal()})
        assert step.solved
        assert (np.linalg.eigvalsh(step.covariance) >= 0.0).all()
    assert step.state["level"] == pytest.approx(measured.sum() / (100 + 0.1**2), abs=1e-8)
    assert step.standard_errors["level"] == pytest.approx(0.1 / (100 + 0.1**2) ** 0.5, rel=1e-6)
