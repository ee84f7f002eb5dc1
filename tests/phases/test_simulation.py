"""Forward simulation: it follows the equations to the integrator's tolerance, and says where it could not."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.phases import SCHEMES, exact_x, exact_y, integrator, one_phase, oscillators
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import InitialGuessError, SimulationFailed, TrajectoryError
from pyrobocop_pyomo.solving import starts

ALL = [*SCHEMES, rcp.schemes.find_scheme("explicit_euler")]
each_scheme = pytest.mark.parametrize("scheme", ALL, ids=str)


def pendulum(implicit: bool = False, **options: Any) -> Any:
    """A phase `swing` of a model."""
    m, b = one_phase("swing", **{"duration": 2.0, "elements": 8, **options})
    b.theta, b.omega = rcp.State(initial=0.5), rcp.State(initial=0)
    b.torque = rcp.Control(bounds=(-1, 1))
    b.g = rcp.Parameter(initial_guess=9.81)
    if implicit:
        b.pull = rcp.Algebraic()
        b.ode(lambda b, t: {b.theta: b.omega[t]})
        b.residual(weight_and_newton)
    else:
        b.ode(lambda b, t: {b.theta: b.omega[t], b.omega: b.torque[t] - b.g * pyo.sin(b.theta[t])}, name="swing")
    return m


def weight_and_newton(b: Any, t: float) -> Any:
    return [b.pull[t] == b.torque[t] - b.g * pyo.sin(b.theta[t]), b.derivative(b.omega)[t] - b.pull[t]]


@each_scheme
@pytest.mark.parametrize("duration", [1.5, rcp.Duration(bounds=(1.5, 1.5))], ids=["fixed", "free"])
def test_a_simulation_is_the_exact_motion(scheme: Any, duration: Any) -> None:
    m = oscillators(scheme=scheme, elements=3, duration=duration)
    trajectory = m.swing.simulate()
    np.testing.assert_allclose(trajectory.x, [exact_x(t) for t in trajectory.time], atol=1e-7)
    np.testing.assert_allclose(trajectory.y, [exact_y(t) for t in trajectory.time], atol=1e-7)
    assert all(v.value == 1 for v in m.swing.x.values())  # the model is as it was


@settings(max_examples=25)
@given(
    scheme=st.sampled_from(ALL),
    amplitude=st.floats(-5, 5),
    theta=st.floats(-3, 3),
    method=st.sampled_from(["DOP853", "RK45", "LSODA"]),
)
def test_elements_have_the_integrators_error(scheme: Any, amplitude: float, theta: float, method: str) -> None:
    b = pendulum(scheme=scheme).swing
    trajectory = b.simulate({"torque": lambda t: amplitude * math.cos(4 * t)}, initial={"theta": theta}, method=method)
    assert trajectory.theta[0] == theta
    assert trajectory.verify().element_error < 1e-6


@each_scheme
@pytest.mark.parametrize("implicit", [False, True])
def test_steps_of_the_scheme_solve_its_rows(scheme: Any, implicit: bool) -> None:
    b = pendulum(implicit, scheme=scheme).swing
    trajectory = b.simulate({"torque": math.sin}, method="scheme")
    verdict = trajectory.verify()
    assert max(verdict.defect, verdict.continuity, verdict.equations) < 1e-9
    b.initialize(trajectory)
    for row in b.component_data_objects(pyo.Constraint):
        assert abs(pyo.value(row.body) - row.lower) < 1e-9


def test_controls_are_given_or_as_the_phase_holds_them() -> None:
    b = pendulum().swing
    b.initialize(torque=3.0)  # moved onto its bound
    held, given_ = b.simulate(), b.simulate({"torque": 1.0})
    np.testing.assert_allclose(held.theta, given_.theta)
    assert set(b.simulate({"torque": 3.0}).torque) == {3.0}  # a simulation does not look at bounds
    with pytest.raises(InitialGuessError, match=r"'speed' is given to a simulation, but .* these are torque"):
        b.simulate({"speed": 1.0})
    with pytest.raises(InitialGuessError, match=r"'torque': the initial guess has 3 values; 8 elements need 8 or 24"):
        b.simulate({"torque": [1, 2, 3]})
    with pytest.raises(InitialGuessError, match="initial value is given for 'torque'; its states are theta, omega"):
        b.simulate(initial={"torque": 1.0})
    with pytest.raises(InitialGuessError, match="initial value of 'theta'.* is nan"):
        b.simulate(initial={"theta": math.nan})
    with pytest.raises(InitialGuessError, match="method 'euler' is unknown; choose one of RK45"):
        b.simulate(method="euler")
    b.torque[b.points.last()].value = None
    with pytest.raises(InitialGuessError, match=r"torque\[2.0\]' has no value to simulate with"):
        b.simulate()


def test_held_controls_and_phases_without_states() -> None:
    _, b = one_phase(elements=2, u=rcp.Control(parametrization="piecewise_constant"), f=rcp.Algebraic(initial_guess=1))

    b.residual(lambda b, t: b.f[t] ** 3 == b.u[t], name="cube")
    trajectory = b.simulate({"u": [8.0, 27.0]})
    assert trajectory.piecewise_constant == {"u"}
    np.testing.assert_allclose(trajectory.f, [2.0] * 3 + [3.0] * 3, atol=1e-8)
    assert trajectory.verify().equations < 1e-7


def contact() -> Any:
    _, b = one_phase(elements=4, x=rcp.State(initial=1))
    b.force, b.slack = rcp.Algebraic(bounds=(0, None), initial_guess=2), rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.x: b.force[t]})
    b.complementarity(lambda b, t: rcp.complements(b.force[t] >= 0, b.slack[t] >= 0), name="touch")
    return b


def test_algebraics_that_pairs_determine_are_given_or_keep_their_guess() -> None:
    b = contact()
    assert b.simulate().x[-1] == pytest.approx(3)
    assert b.simulate({"force": 5.0}).x[-1] == pytest.approx(6)
    b.residual(lambda b, t: b.slack[t] == b.x[t], name="height")
    assert b.simulate().x[-1] == pytest.approx(1)  # equation and pair are as many as force and slack
    b.other = rcp.Algebraic()
    with pytest.raises(
        InitialGuessError, match=r"has 1 residual equations and 1 pairs per point for 3 unknowns: force, slack, other"
    ):
        b.simulate()
    trajectory = b.simulate({"force": 2.0, "other": 0.0})
    np.testing.assert_allclose(trajectory.slack, trajectory(trajectory.points)["x"], atol=1e-9)


def explosion(rule: Any) -> Any:
    _, b = one_phase(duration=2.0, elements=4, x=rcp.State(initial=1.1))
    b.ode(rule)
    return b


@pytest.mark.heavy
@pytest.mark.parametrize("method", ["DOP853", "LSODA", "scheme"])
@pytest.mark.filterwarnings("ignore:lsoda")
def test_a_failure_names_the_time_and_keeps_what_it_has(method: str) -> None:
    b = explosion(lambda b, t: {b.x: b.x[t] ** 2})  # leaves the numbers at t = 1 / 1.1
    with pytest.raises(
        SimulationFailed, match=r"phase 'p': the simulation stopped at t = .* Kept in error.traj"
    ) as caught:
        b.simulate(method=method)
    error = caught.value
    assert 0.5 <= error.time <= 1.01
    np.testing.assert_allclose(error.trajectory.x, 1 / (1 / 1.1 - error.trajectory.time), rtol=0.05)
    assert error.trajectory.time[-1] == pytest.approx(0.5)


def test_equations_without_a_value_stop_a_simulation() -> None:
    b = explosion(lambda b, t: {b.x: 1 + pyo.sqrt(1.2 - b.x[t])})
    with pytest.raises(SimulationFailed, match=r"the equations have no value \(.*Kept in .*: nothing before"):
        b.simulate()


def test_equations_without_a_root_stop_a_simulation() -> None:
    m, b = one_phase(elements=2, f=rcp.Algebraic(initial_guess=1))
    b.residual(lambda b, t: b.f[t] ** 2 == 0.55 - t, name="no_root_in_the_end")
    with pytest.raises(SimulationFailed, match=r"stopped at t = 0.5: the rows of element 1 were not solved \(resid"):
        b.simulate()
    m.q = q = rcp.PhaseBlock(elements=2, scheme=rcp.schemes.lobatto(2))
    q.f = rcp.Algebraic()
    q.residual(lambda b, t: b.f[t] ** 2 == -1, name="no_root")
    with pytest.raises(SimulationFailed, match="the rows of element 0 were not solved"):
        q.simulate()


def test_a_rule_that_needs_the_grid_can_be_stepped() -> None:
    _, b = one_phase(elements=2)
    b.demand = pyo.Param(b.points, initialize=lambda b, t: 2.0)
    b.x = rcp.State(initial=0)
    b.ode(lambda b, t: {b.x: b.demand[t]})
    with pytest.raises(TrajectoryError, match="no rule says it at all times"):
        b.simulate()
    assert b.simulate(method="scheme").x[-1] == pytest.approx(2.0)


def test_a_linear_control_is_linear_within_elements_of_one_stage_too() -> None:
    _, b = integrator(x={"initial": 0}, u={"parametrization": "piecewise_linear"}, elements=1, scheme="implicit_euler")
    assert b.simulate({"u": [0.0, 1.0]}).x[-1] == pytest.approx(0.5)


# --------------------------------------------------------------------
# A motion as a start: the simulated one to plotting accuracy, and none where there is no moderate motion.


@pytest.mark.parametrize("implicit", [False, True])
def test_a_start_follows_the_controls(implicit: bool) -> None:
    m = pendulum(implicit, elements=20)
    m.swing.initialize(torque=math.cos)
    exact = m.swing.simulate()
    assert starts.put_motion(m)
    found = np.array([m.swing.theta[t].value for t in m.swing.time])
    assert np.abs(found - exact.theta).max() < 1e-2


def test_a_motion_that_explodes_is_no_start_and_changes_nothing() -> None:
    m, b = one_phase(duration=5, elements=5, x=rcp.State(initial=1, initial_guess=0.5), u=rcp.Control(initial_guess=1))
    b.ode(lambda b, t: {b.x: b.x[t] ** 3 + b.u[t]})
    before = [v.value for v in b.x.values()]
    assert not starts.put_motion(m)
    assert [v.value for v in b.x.values()] == before
