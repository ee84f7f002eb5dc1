"""The motion of the equations under the controls of a plan, against SciPy and against motions that are known."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics.flows import integrate_flows


def pendulum(elements: int = 6, scheme: str = "radau", stages: int | None = None, **control: Any) -> Any:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=elements, scheme=scheme, stages=stages)
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
        ("radau", 1, {}),
        ("radau", 3, {}),
        ("gauss", 2, {}),
        ("lobatto", 3, {}),
        ("explicit", 1, {"parametrization": "piecewise_constant"}),
        ("radau", 2, {"parametrization": "piecewise_linear"}),
    ],
)
def test_the_open_loop_is_that_of_scipy(scheme: str, stages: int, control: dict[str, str]) -> None:
    b = pendulum(6, scheme, stages, **control)
    motion = b.reintegrate()
    expected = by_scipy(b.trajectory(), motion.fractions)
    np.testing.assert_allclose(motion.open_loop["angle"], expected[:, :, 0], atol=1e-8)
    np.testing.assert_allclose(motion.open_loop["rate"], expected[:, :, 1], atol=1e-8)
    assert motion.states is motion.open_loop
    planned = b.trajectory().element_polynomials(motion.fractions)
    np.testing.assert_array_equal(motion.planned["angle"], planned["angle"])
    largest = max(np.abs(motion.open_loop[name] - planned[name]).max() for name in planned)
    assert b.trajectory().verify().motion_error == pytest.approx(largest, rel=1e-9)


@pytest.mark.parametrize(("scheme", "stages"), [("radau", 1), ("radau", 2), ("gauss", 1), ("gauss", 2)])
def test_inside_elements_the_error_falls_with_the_degree_of_the_polynomial(scheme: str, stages: int) -> None:
    coarse, fine = (
        pendulum(n, scheme, stages, parametrization="piecewise_constant").reintegrate().errors.max() for n in (20, 40)
    )
    assert np.log2(coarse / fine) == pytest.approx(min(stages + 1, 2 * stages - (scheme == "radau")), abs=0.35)


def test_a_rule_that_is_no_formula_is_integrated_by_instants() -> None:
    """An `if` on the time cannot be asked for all times at once; the answer is the same."""
    formula, instants = pendulum(4), pendulum(4)
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=2.0, elements=4)
    b.angle, b.rate = rcp.State(initial=1.0), rcp.State(initial=0.0)
    b.torque = rcp.Control()

    def rule(b: Any, t: Any) -> Any:
        factor = 2.0 if t < 5.0 else 0.0
        return {b.angle: b.rate[t], b.rate: -factor * pyo.sin(b.angle[t]) + b.torque[t] * pyo.cos(3 * t)}

    b.ode(rule)
    trajectory = formula.trajectory()
    b.initialize({name: trajectory.states[name] for name in trajectory.states})
    b.initialize(torque=trajectory.torque)
    expected, found = instants.reintegrate(), b.reintegrate()
    common = np.isin(expected.fractions, found.fractions)  # formulas are looked at after some of their steps, too
    for name in ("angle", "rate"):
        np.testing.assert_allclose(found.open_loop[name], expected.open_loop[name][:, common], atol=1e-8)
        np.testing.assert_allclose(found.local[name], expected.local[name][:, common], atol=1e-8)


def test_stiff_equations_are_left_to_scipy() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=2)
    b.x = rcp.State(initial=1.0)
    b.ode(lambda b, t: {b.x: -20_000.0 * (b.x[t] - pyo.cos(t))})
    b.initialize(b.simulate(method="scheme"))
    motion = b.reintegrate()
    assert motion.open_loop["x"][-1, -1] == pytest.approx(np.cos(1.0), abs=1e-4)


def test_algebraics_are_found_again() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=3, scheme="implicit_euler")
    b.x, b.y = rcp.State(initial=1.0), rcp.Algebraic(initial_guess=1.0)
    b.ode(lambda b, t: {b.x: -b.y[t]})

    def algebraic(b: Any, t: Any) -> Any:
        return b.y[t] == b.x[t]

    b.residual(algebraic)
    b.initialize(b.simulate(method="scheme"))
    motion = b.reintegrate()
    assert motion.open_loop["x"][-1, -1] == pytest.approx(np.exp(-1.0), abs=1e-5)
    assert motion.planned["x"][-1, -1] == pytest.approx(0.75**3)


def test_with_contacts_each_element_counts_from_its_own_start() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=1.0, elements=4, scheme="implicit_euler")
    b.x = rcp.State(initial=1.0)
    b.force = rcp.Algebraic()
    b.ode(lambda b, t: {b.x: -1.5 * b.x[t] + b.force[t]})

    def wall(b: Any, t: Any) -> Any:
        return (b.x[t] >= 0, b.force[t] >= 0)

    b.complementarity(wall)
    b.initialize(b.simulate())
    motion = b.reintegrate()
    assert motion.contact
    assert motion.states is motion.local
    np.testing.assert_allclose(motion.local["x"][:, 0], motion.planned["x"][:, 0], atol=1e-14)
    assert np.abs(motion.open_loop["x"] - motion.planned["x"]).max() > motion.errors.max()


def test_another_start_is_followed() -> None:
    b = pendulum(5)
    motion = b.reintegrate(initial={"angle": 1.1})
    assert motion.open_loop["angle"][0, 0] == pytest.approx(1.1)
    np.testing.assert_allclose(motion.local["angle"], b.reintegrate().local["angle"])


def test_a_motion_that_leaves_the_finite_numbers_is_said_to() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=3.0, elements=4, scheme="implicit_euler")
    b.x = rcp.State(initial=1.0, initial_guess=1.0)
    b.ode(lambda b, t: {b.x: b.x[t] ** 2})
    motion = b.reintegrate()
    assert motion.open_loop is None
    assert np.isinf(motion.errors).all()
    verdict = b.trajectory().verify()
    assert verdict.motion_error == np.inf
    assert any("unstable" in remark for remark in verdict.remarks)


@pytest.mark.parametrize("growth", [0.0, 1.0, 8.0])
def test_ends_meet_for_unstable_equations_too(growth: float) -> None:
    """eq-open-loop: x' = growth x, from starts that are off by far more than the answer."""
    starts = np.linspace(1.0, 1.2, 10)[:, None]
    flows = integrate_flows(lambda s, x: 0.1 * growth * x, starts, np.ones(1), np.linspace(0.0, 1.0, 5), 1e-10)
    assert flows is not None
    times = (np.arange(10)[:, None] + flows.fractions[None, :]) * 0.1
    np.testing.assert_allclose(flows.whole[:, :, 0], np.exp(growth * times), rtol=1e-7)
    np.testing.assert_allclose(flows.local[:, -1, 0], starts[:, 0] * np.exp(0.1 * growth), rtol=1e-8)


def test_an_unstable_motion_is_followed_far_from_its_plan() -> None:
    """A pendulum let go near the top, in elements that start near the bottom: the whole turns over and over."""
    width, elements = 0.1, 80

    def rates(fraction: float, states: np.ndarray) -> np.ndarray:
        return width * np.stack([states[1], 9.81 * np.sin(states[0])])

    starts = np.tile([3.1, 0.0], (elements, 1))
    first = np.array([0.05, 0.0])
    flows = integrate_flows(rates, starts, np.array([3.0, 6.0]), np.linspace(0.0, 1.0, 5), 1e-9, first)
    assert flows is not None
    assert flows.whole is not None
    exact = solve_ivp(
        lambda t, y: [y[1], 9.81 * np.sin(y[0])], (0, width * elements), first, rtol=1e-12, atol=1e-12,
        t_eval=width * np.arange(1, elements + 1),
    )  # fmt: skip
    assert abs(exact.y[0]).max() > np.pi
    np.testing.assert_allclose(flows.whole[:, -1, :], exact.y.T, atol=1e-3)


def test_what_cannot_be_integrated_is_explained() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(elements=2, scheme="implicit_euler")
    b.x = rcp.State(initial=0)
    b.step_map(lambda b, t, previous: {b.x: previous.x + 1.0})
    with pytest.raises(TrajectoryError, match="Step maps lead them"):
        b.reintegrate()


def test_an_integrand_may_read_the_model_otherwise_than_through_its_first_argument() -> None:
    m = pyo.ConcreteModel()
    m.cart = b = rcp.PhaseBlock(duration=1.0, elements=3)
    b.x = rcp.State(initial=0)
    b.force = rcp.Control()
    b.ode(lambda b, t: {b.x: b.force[t]})
    outer = b.force
    b.integral(lambda b, t: outer[t] ** 2)
    for variable in m.component_data_objects(pyo.Var):
        variable.set_value(0.0)
    verification = b.trajectory().verify()
    assert verification.integral_error == pytest.approx(0.0, abs=1e-12)
    assert verification.element_error == pytest.approx(0.0, abs=1e-12)
