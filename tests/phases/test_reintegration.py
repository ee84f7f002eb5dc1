"""The motion of the equations under the controls of a plan, against SciPy and against motions that are known."""

from itertools import pairwise
from math import cos, exp, sin
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import one_phase
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError


def pendulum(elements: int = 6, scheme: str = "radau", stages: int | None = None, **control: Any) -> Any:
    _, b = one_phase(duration=2.0, elements=elements, scheme=scheme, stages=stages)
    b.angle, b.rate = rcp.State(initial=1.0), rcp.State(initial=0.0)
    b.torque = rcp.Control(**control)
    b.pull = rcp.Parameter(initial_guess=2.0)
    b.ode(lambda b, t: {b.angle: b.rate[t], b.rate: -b.pull * pyo.sin(b.angle[t]) + b.torque[t] * pyo.cos(3 * t)})
    b.initialize(torque=lambda t: 1.0 - t)
    b.initialize(b.simulate(method="scheme"))
    return b


def by_scipy(trajectory: Any, fractions: Any) -> Any:
    """Open loop at fractions of each element, shape (N, k, 2)."""
    state, found = [1.0, 0.0], []
    for start, end in pairwise(trajectory.grid.mesh.boundaries):

        def rates(t: float, s: Any, start: float = start, end: float = end) -> Any:
            torque = trajectory(max(t, np.nextafter(start, end)))["torque"]
            return [s[1], -2.0 * np.sin(s[0]) + torque * np.cos(3 * t)]

        times = np.append(start + (end - start) * fractions[:-1], end)
        piece = solve_ivp(rates, (start, end), state, rtol=1e-12, atol=1e-13, method="DOP853", t_eval=times)
        state = piece.y[:, -1]
        found.append(piece.y.T)
    return np.array(found)


@pytest.mark.parametrize(
    ("scheme", "stages", "control"),
    [
        ("radau", 3, {}),
        ("gauss", 2, {}),
        ("explicit_euler", None, {"parametrization": "piecewise_constant"}),
        ("radau", 2, {"parametrization": "piecewise_linear"}),
    ],
)
def test_the_open_loop_is_that_of_scipy(scheme: str, stages: int, control: dict[str, str]) -> None:
    b = pendulum(6, scheme, stages, **control)
    motion = b.reintegrate()
    expected = by_scipy(b.trajectory(), motion.fractions)
    np.testing.assert_allclose(motion.open_loop["angle"], expected[:, :, 0], atol=1e-8)
    np.testing.assert_allclose(motion.open_loop["rate"], expected[:, :, 1], atol=1e-8)
    planned = b.trajectory().element_polynomials(motion.fractions)
    np.testing.assert_array_equal(motion.planned["angle"], planned["angle"])
    largest = max(np.abs(of - planned[name]).max() for name, of in motion.open_loop.items())
    assert b.trajectory().verify().motion_error == pytest.approx(largest, rel=1e-9)


@pytest.mark.parametrize(("scheme", "stages"), [("radau", 1), ("radau", 2), ("gauss", 1), ("gauss", 2)])
def test_inside_elements_the_error_falls_with_the_degree_of_the_polynomial(scheme: str, stages: int) -> None:
    coarse, fine = (
        pendulum(n, scheme, stages, parametrization="piecewise_constant").reintegrate().errors.max() for n in (20, 40)
    )
    assert np.log2(coarse / fine) == pytest.approx(min(stages + 1, 2 * stages - (scheme == "radau")), abs=0.35)


def test_a_rule_that_has_to_know_the_time_says_nothing_between_the_points() -> None:
    _, b = one_phase(duration=2.0, elements=4, x=rcp.State(initial=1.0))
    b.ode(lambda b, t: {b.x: -b.x[t] if t < 5.0 else 0.0})
    b.initialize(b.simulate(method="scheme"))
    for asked in (b.reintegrate, b.simulate):
        with pytest.raises(TrajectoryError, match=r"the rule of its ode '<lambda>' \(.*\) has to know the time"):
            asked()
    assert "has to know the time" in str(b.trajectory().verify())


@pytest.mark.parametrize("kind", ["residual", "constraint"])
@pytest.mark.parametrize("pairs", ["none", "never read", "never active"])
def test_what_equations_determine_is_no_part_of_the_plan(kind: str, pairs: str) -> None:
    """x' = y with y = -20 x^2 is x' = -20 x^2, however y is stated, and whatever pairs stand beside it."""
    _, b = one_phase(duration=1.0, elements=2, x=rcp.State(initial=1.0), y=rcp.Algebraic(), force=rcp.Algebraic())
    b.ode(lambda b, t: {b.x: b.y[t] + (b.force[t] if pairs == "never active" else 0.0)})
    getattr(b, kind)(lambda b, t: b.y[t] == -20 * b.x[t] ** 2, name="law")
    if pairs == "none":
        b.residual(lambda b, t: b.force[t] == 0, name="none")
    else:
        b.complementarity(lambda b, t: (b.force[t] >= 0, b.x[t] + b.force[t] + 1.0 >= 0), name="wall")
    b.initialize(x=lambda t: 1.0 / (1.0 + 3.0 * t), y=lambda t: -20.0 / (1.0 + 3.0 * t) ** 2, force=0.0)
    motion = b.reintegrate()
    assert motion.contact == (pairs == "never active")
    times = (np.arange(2)[:, None] + motion.fractions) / 2
    np.testing.assert_allclose(motion.open_loop["x"], 1.0 / (1.0 + 20.0 * times), atol=1e-5)
    assert b.trajectory().verify().motion_error > 0.2


def ball(floor: Any, elements: int, scheme: str, stages: int | None) -> Any:
    _, b = one_phase(duration=1.2, elements=elements, scheme=scheme, stages=stages)
    b.h, b.v, b.force = rcp.State(initial=1.0), rcp.State(initial=0.0), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.h: b.v[t], b.v: b.force[t] - 9.81})
    b.complementarity(lambda b, t: rcp.complements(b.force[t] >= 0, b.h[t] + b.force[t] / floor >= 0))
    b.initialize(b.simulate())
    return b


@pytest.mark.parametrize(("scheme", "stages"), [("implicit_euler", None), ("radau", 2)])
@pytest.mark.parametrize("stiffness", [2000.0, np.inf])
def test_a_contact_inside_an_element_is_simulated_from_the_start_of_the_plan(
    scheme: str, stages: int | None, stiffness: float
) -> None:
    """A ball falls on a spring, and on a rigid floor, where it stays; the plan has neither at the right time."""
    b = ball(stiffness, 7, scheme, stages)
    motion = b.reintegrate()
    assert "simulated with contact" in motion.how
    times = (np.arange(7)[:, None] + motion.fractions) * 1.2 / 7
    if np.isinf(stiffness):
        expected = np.maximum(1.0 - 9.81 / 2 * times**2, 0.0)
    else:
        exact = solve_ivp(
            lambda t, s: [s[1], max(0.0, -stiffness * s[0]) - 9.81], (0, 1.2), [1.0, 0.0], rtol=1e-9, atol=1e-10,
            max_step=1e-3, dense_output=True,
        )  # fmt: skip
        expected = exact.sol(times.ravel())[0].reshape(times.shape)
    np.testing.assert_allclose(motion.open_loop["h"], expected, atol=5e-3)
    assert motion.errors.max() > 0.2


def tied(rows: Any) -> Any:
    m, b = one_phase(duration=1.0, elements=3, stages=2)
    b.x, b.y, b.u, b.w = rcp.State(initial=1.0), rcp.State(initial=0.0), rcp.Control(), rcp.Control()
    b.ode(lambda b, t: {b.x: b.u[t], b.y: b.w[t]})
    b.constraint(rows)
    b.initialize(x=1.0, y=0.0, u=-1.0, w=lambda t: t)
    return m


def test_an_equality_that_determines_a_control_leaves_none_of_it_to_the_plan() -> None:
    """u = -3 x is a feedback: x = exp(-3 t). Of u x = w it is not said which of the two follows."""
    motion = tied(lambda b, t: b.u[t] == -3 * b.x[t]).p.reintegrate()
    times = (np.arange(3)[:, None] + motion.fractions) / 3
    np.testing.assert_allclose(motion.open_loop["x"], np.exp(-3 * times), atol=1e-6)
    np.testing.assert_allclose(motion.open_loop["y"], times**2 / 2, atol=1e-6)
    linear = tied(lambda b, t: b.u[t] + b.w[t] == 0).p.reintegrate()  # holds between the points as well
    assert linear.open_loop["y"][-1, -1] == pytest.approx(0.5)
    with pytest.raises(TrajectoryError, match="'u', 'w'"):
        tied(lambda b, t: b.u[t] * b.x[t] == b.w[t]).p.reintegrate()


def test_what_pairs_leave_open_is_no_known_motion() -> None:
    """At the edge of the friction cone forces do not say how fast a finger slips; inside it does not."""
    _, b = one_phase(duration=1.0, elements=3)
    b.x, b.force, b.slip = rcp.State(initial=0.0), rcp.Control(), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.slip[t]})
    b.complementarity(lambda b, t: rcp.complements(b.slip[t] >= 0, 1.0 - b.force[t] >= 0))
    b.initialize(x=0.0, force=0.5, slip=0.0)
    assert b.reintegrate().open_loop["x"][-1, -1] == pytest.approx(0.0, abs=1e-9)
    b.initialize(force=1.0)
    with pytest.raises(TrajectoryError, match="leave open what happens"):
        b.reintegrate()


def test_rows_beside_the_phase_may_determine_what_nobody_knows_between_the_points() -> None:
    m = tied(lambda b, t: b.u[t] <= 5)
    assert m.p.reintegrate().open_loop["x"][-1, -1] == pytest.approx(0.0, abs=1e-9)
    m.brake = pyo.Constraint(m.p.points, rule=lambda m, t: m.p.u[t] == -(m.p.x[t] ** 2))
    with pytest.raises(TrajectoryError, match="'brake' may determine 'u'"):
        m.p.reintegrate()


def test_another_start_is_followed() -> None:
    b = pendulum(5)
    motion = b.reintegrate(initial={"angle": 1.1})
    assert motion.open_loop["angle"][0, 0] == pytest.approx(1.1)
    np.testing.assert_allclose(motion.local["angle"], b.reintegrate().local["angle"])


def test_a_motion_that_leaves_the_finite_numbers_is_said_to() -> None:
    _, b = one_phase(duration=3.0, elements=4, scheme="implicit_euler", x=rcp.State(initial=1.0, initial_guess=1.0))
    b.ode(lambda b, t: {b.x: b.x[t] ** 2})
    motion = b.reintegrate()
    assert motion.open_loop is None
    assert np.isinf(motion.errors).all()
    verdict = b.trajectory().verify()
    assert verdict.motion_error == np.inf
    assert any("unstable" in remark for remark in verdict.remarks)


@pytest.mark.parametrize("through_algebraic", [False, True])
def test_an_unstable_motion_is_followed_far_from_its_plan(through_algebraic: bool) -> None:
    """A pendulum let go near the top, in a plan that is near the bottom: it turns over and over."""
    _, b = one_phase(duration=8.0, elements=80)
    b.angle, b.rate = rcp.State(initial_guess=3.1), rcp.State(initial_guess=0.0)
    b.pull = rcp.Algebraic(initial_guess=0.0)
    b.ode(lambda b, t: {b.angle: b.rate[t], b.rate: b.pull[t] if through_algebraic else 9.81 * pyo.sin(b.angle[t])})
    b.residual(lambda b, t: b.pull[t] == 9.81 * pyo.sin(b.angle[t]))
    first = {"angle": 0.05, "rate": 0.0}
    found = b.reintegrate(initial=first).open_loop
    exact = solve_ivp(
        lambda t, y: [y[1], 9.81 * np.sin(y[0])], (0, 8.0), [*first.values()], rtol=1e-12, atol=1e-12,
        t_eval=b.grid.mesh.boundaries[1:],
    )  # fmt: skip
    assert abs(exact.y[0]).max() > np.pi
    np.testing.assert_allclose([found["angle"][:, -1], found["rate"][:, -1]], exact.y, atol=1e-3)


def test_an_integrand_may_read_the_model_otherwise_than_through_its_first_argument() -> None:
    m, b = one_phase("cart", duration=1.0, elements=3, x=rcp.State(initial=0), force=rcp.Control())
    b.ode(lambda b, t: {b.x: b.force[t]})
    outer = b.force
    b.integral(lambda b, t: outer[t] ** 2)
    for variable in m.component_data_objects(pyo.Var):
        variable.set_value(0.0)
    verification = b.trajectory().verify()
    assert verification.integral_error == pytest.approx(0.0, abs=1e-12)
    assert verification.element_error == pytest.approx(0.0, abs=1e-12)


def test_errors_that_cannot_be_estimated_are_explained() -> None:
    _, b = one_phase(elements=2, u=rcp.Control())
    with pytest.raises(TrajectoryError, match="has no states: there is no error to estimate"):
        b.reintegrate()
    b.x, b.f, b.g = rcp.State(), rcp.Algebraic(), rcp.Algebraic()
    b.ode(lambda b, t: {})
    b.residual(lambda b, t: [b.derivative(b.x)[t] == b.u[t] + b.f[t], b.f[t] == b.g[t]], name="half")
    with pytest.raises(TrajectoryError, match="the motion depends on .*, of which 'half' can determine only some"):
        b.reintegrate()


# --------------------------------------------------------------------
# Elements in which an explicit method is held back by stability are integrated by an implicit one.


RATE = 10000.0


def test_the_error_of_a_stiff_element_is_that_of_the_exact_motion() -> None:
    _, b = one_phase(model="stiff", duration=1.0, elements=1, x=rcp.State(initial=0))
    b.ode(lambda b, t: {b.x: -RATE * (b.x[t] - pyo.cos(t))})
    planned = {t: cos(t) + 0.01 * sin(3 * t) for t in b.time}
    for t, variable in b.x.items():
        variable.set_value(planned[t], skip_validation=True)
    b.x[0.0].set_value(1.0)

    def steady(t: float) -> float:
        return RATE * (RATE * cos(t) + sin(t)) / (RATE**2 + 1)

    exact = steady(1.0) + (1.0 - steady(0.0)) * exp(-RATE)
    (error,) = b.trajectory().verify().element_errors
    assert error == pytest.approx(abs(planned[1.0] - exact), rel=1e-6)


def test_the_reactions_of_robertson_agree_with_scipy() -> None:
    def rates(y: Any) -> list[Any]:
        slow, fast, square = 0.04 * y[0], 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
        return [-slow + fast, slow - fast - square, square]

    _, b = one_phase(model="reactions", duration=80.0, elements=4)
    b.slow, b.fast, b.last = rcp.State(initial=1.0), rcp.State(initial=0.0), rcp.State(initial=0.0)
    states = [b.slow, b.fast, b.last]
    b.ode(lambda b, t: dict(zip(states, rates([state[t] for state in states]), strict=True)))
    b.initialize(slow=0.9, fast=3e-5, last=0.1)
    exact = solve_ivp(lambda t, y: rates(y), (0, 80.0), [1.0, 0.0, 0.0], method="Radau", rtol=1e-10, atol=1e-13)
    found = b.reintegrate().open_loop
    for values, expected, size in zip(found.values(), exact.y[:, -1], [1.0, 1e-3, 1.0], strict=True):
        assert values[-1, -1] == pytest.approx(expected, abs=1e-6 * size)
