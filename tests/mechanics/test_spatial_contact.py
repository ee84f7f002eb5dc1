"""Laws of gaps, friction and motion in space, and of what phases state of bodies, robots and contact."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError, ObstacleError
from pyrobocop_pyomo.mechanics.bodies import SPACE
from pyrobocop_pyomo.mechanics.rotations import rotation_matrix, rotation_vector
from pyrobocop_pyomo.mechanics.shapes import Gap

spatial = rcp.mechanics.spatial
ROTATION, SPIN = SPACE.orientation, SPACE.twist[3:]
GRID: dict[str, Any] = {"duration": 0.4, "elements": 4, "scheme": "implicit_euler"}
SHAPES = {
    "sphere": spatial.Sphere(0.2),
    "capsule": spatial.Capsule(radius=0.05, half_length=0.45),
    "box": spatial.RoundedBox(radius=0.05, half_length=0.3, half_width=0.2, half_height=0.1),
}
BALL = spatial.RigidBody(spatial.Sphere(0.2), mass=0.6, inertia=0.4 * 0.6 * 0.2**2)
AFLOAT = spatial.RigidBody(spatial.Sphere(0.2), mass=0.6, inertia=0.4 * 0.6 * 0.2**2, gravity=0.0)
QUAD = spatial.SphereRobot(spatial.Sphere(0.12), mass=0.8, force_limit=((-10, 10), (-10, 10), (0, 20)), speed_limit=4.0)
DRONE = spatial.SphereRobot(spatial.Sphere(0.1), 1.0, ((-10, 10),) * 3, speed_limit=4.0, gravity=0.0)
REST = (0.0,) * 6

places = st.tuples(*3 * [st.floats(-2, 2)])


# ----------------------------------------------------------------- bodies


def alone(body: Any, elements: int = 20, duration: float = 1.0, **motion: Any) -> Any:
    """A model of a body under one wrench."""
    m, grid = pyo.ConcreteModel(), {"duration": duration, "elements": elements, "scheme": "implicit_euler"}
    m.push = rcp.PhaseBlock(rule=body.state_wrench, **grid)
    m.body = rcp.PhaseBlock(**grid)
    body.state_motion(m.body, [m.push], **{"start": REST, **motion})
    return m


def rotations(trajectory: Any) -> np.ndarray:
    return np.array([trajectory.states[name] for name in ROTATION]).T.reshape(-1, 3, 3)


def test_free_fall() -> None:
    """After k steps of implicit Euler: v = v_0 - k h g and z = z_0 + k h v_0 - h^2 g k (k + 1) / 2, turning evenly."""
    m = alone(BALL, start=(0, 0, 2, 0, 0, 0), velocity_at_start=(1, 0, 3, 0, 0.5, 0))
    fall = m.body.simulate()
    k = np.arange(21)
    np.testing.assert_allclose(fall.uz, 3 - 9.81 * 0.05 * k, atol=1e-9)
    np.testing.assert_allclose(fall.qz, 2 + 0.15 * k - 9.81 * 0.05**2 * k * (k + 1) / 2, atol=1e-9)
    np.testing.assert_allclose(fall.qx, 0.05 * k, atol=1e-9)
    np.testing.assert_allclose(rotations(fall), [rotation_matrix((0, 0.5 * t, 0)) for t in fall.time], atol=1e-9)
    assert fall.verify().largest_violation < 1e-9


def symmetric_top(elements: int) -> tuple[float, float, np.ndarray]:
    """Errors of the axis and of the angular momentum of a torque-free symmetric top after a second, and R'R - I."""
    across, along = 0.02, 0.03
    top = spatial.RigidBody(SHAPES["capsule"], mass=1.0, inertia=(along, across, across), gravity=0.0)
    spin = np.array([1.5, 0.5, 0.2])
    trajectory = alone(top, elements, velocity_at_start=(0, 0, 0, *spin)).body.simulate()
    turned = rotations(trajectory)
    momentum = np.diag([along, across, across]) @ spin
    # The axis of symmetry goes round the angular momentum at the rate |L| / across.
    exact = rotation_matrix(momentum / across) @ np.array([1.0, 0.0, 0.0])
    last = turned[-1] @ np.diag([along, across, across]) @ turned[-1].T @ [trajectory.states[w][-1] for w in SPIN]
    return (
        float(np.linalg.norm(turned[-1][:, 0] - exact)),
        float(np.linalg.norm(last - momentum) / np.linalg.norm(momentum)),
        turned.transpose(0, 2, 1) @ turned - np.eye(3),
    )


def test_a_symmetric_top_precesses_about_its_angular_momentum() -> None:
    """The error of implicit Euler is of first order, that of the rotation's orthogonality is rounding."""
    coarse, fine = symmetric_top(16), symmetric_top(32)
    assert fine[0] < 0.1
    assert coarse[0] / fine[0] == pytest.approx(2.0, abs=0.25)
    assert coarse[1] / fine[1] == pytest.approx(2.0, abs=0.25)
    assert np.abs(fine[2]).max() < 1e-12


@given(moments=st.tuples(st.floats(1, 1.9), st.floats(1, 1.9), st.floats(1, 1.9)), turn=places, spin=places, m=places)
def test_eulers_equations_are_the_rate_of_angular_momentum(moments: Any, turn: Any, spin: Any, m: Any) -> None:
    """``d(R J R' w)/dt = m``, by differences along the turn."""
    body = spatial.RigidBody(SHAPES["box"], mass=1.0, inertia=moments)
    rotation, h = rotation_matrix(turn), 1e-6
    acceleration = np.array(body.angular_acceleration(m, spin, rotation.tolist()))

    def momentum(time: float) -> np.ndarray:
        turned = rotation_matrix(np.multiply(time, spin)) @ rotation
        return turned @ np.diag(moments) @ turned.T @ (np.array(spin) + time * acceleration)

    np.testing.assert_allclose((momentum(h) - momentum(-h)) / (2 * h), m, atol=1e-6)


def test_a_goal_is_met_by_its_rotation_only() -> None:
    goal = (0.2, None, (0.0, 1.0), 0.3, -0.4, 0.5)
    m = alone(BALL, elements=4, goal=goal)
    end = m.body.final_time

    def missed(vector: Any) -> list[float]:
        for name, entry in zip(ROTATION, rotation_matrix(vector).ravel(), strict=True):
            m.body.component(name)[end].set_value(entry)
        rows = [m.body.goal_rotation[end, label] for label in ("x", "y", "z", "trace")]
        return [
            max(r.lower - pyo.value(r.body), pyo.value(r.body) - (math.inf if r.upper is None else r.upper))
            for r in rows
        ]

    assert max(missed(goal[3:])) < 1e-12
    assert max(missed((0.3, -0.4, 0.6))) > 0.05
    half = rotation_matrix(goal[3:]) @ np.diag([1.0, -1.0, -1.0])
    # A half turn satisfies the three equations; the trace leaves it out.
    assert max(np.abs(missed(rotation_vector(half))[:3])) < 1e-6
    assert missed(rotation_vector(half))[3] == pytest.approx(2.99 + 1)
    assert m.body.qx[end].fixed
    assert not m.body.qy[end].fixed
    assert (m.body.qz[end].lb, m.body.qz[end].ub) == (0.0, 1.0)
    assert m.body.uz[end].value == 0.0


def test_the_guess_of_the_motion_satisfies_its_kinematics() -> None:
    m = alone(AFLOAT, start=(0, 0, 2, 0.1, 0.2, 0.3), goal=(0.4, 0, 0.8, 0.9, -0.4, 0.2))
    # All but the last element, at whose end the body is to be at rest.
    for t in list(m.body.points)[:-1]:
        for name in ROTATION:
            assert pyo.value(m.body.component(f"{name}_step")[t].body) == pytest.approx(0.0, abs=1e-9)
        for label in ("turn_w", "turn_x", "turn_y", "turn_z"):
            row = m.body.turn_over_element[t, label]
            assert pyo.value(row.body) == pytest.approx(row.upper, abs=1e-9)
    for row in m.body.goal_rotation.values():
        assert pyo.value(row.body) == pytest.approx(3.0 if row.upper is None else 0.0, abs=1e-9)


def test_a_copy_follows_its_velocities() -> None:
    for body, turns in ((BALL, False), (spatial.RigidBody(SHAPES["box"], 1.0, 0.1), True)):
        m = pyo.ConcreteModel()
        m.body = rcp.PhaseBlock(**GRID)
        body.state_copy(m.body, start=REST, goal=(1, 0, 0, 0, 0, 1))
        assert (m.body.component("R11") is not None) is turns
        moved = m.body.simulate()
        assert moved.qx[-1] == pytest.approx(1.0)
        if turns:
            m.body.check()
            np.testing.assert_allclose(rotations(moved)[-1], rotation_matrix((0, 0, 1)), atol=1e-9)


# ----------------------------------------------------------------- contact


def touching(friction: float, body: Any = AFLOAT, start: float = -0.3 - 1e-6) -> pyo.ConcreteModel:
    """A robot that touches a ball from the left, for one step of 0.01 s; both start at rest."""
    m, grid = pyo.ConcreteModel(), {**GRID, "duration": 0.01, "elements": 1}
    m.push = rcp.PhaseBlock(rule=body.state_wrench, **grid)
    m.body, m.me = rcp.PhaseBlock(**grid), rcp.PhaseBlock(**grid)
    body.state_motion(m.body, [m.push], start=REST)
    DRONE.state_motion(m.me, m.push, start=(start, 0.0, 0.0), rest_at_end=False)
    spatial.Contact(body.shape, DRONE.shape, friction=friction).state(m.me, m.body, m.push)
    return m


@pytest.mark.parametrize("case", ["push", "leave", "roll", "slide"])
@pytest.mark.ipopt
def test_stick_slide_and_separate(case: str) -> None:
    """Analytic cases of a robot of 1 kg, driven by given forces at the side of a floating ball.

    Straight on, they move as one. Held back, the robot leaves. Driven along the surface, friction makes the ball move
    and turn: its surface has the compliance 1/m + r^2/I = 3.5/m. Friction that holds makes both speeds equal there;
    above what it can pass on, it passes that.
    """
    normal, tangential = {"push": (4.0, 0.0), "leave": (-4.0, 0.0), "roll": (4.0, 1.0), "slide": (4.0, 6.0)}[case]
    m, h, mass = touching(0.4), 0.01, 0.6
    end = m.me.points.last()
    m.me.tau_x[end].fix(normal)
    # Along the first tangent at this normal, an edge of the pyramid.
    along = np.array(
        spatial.Contact(AFLOAT.shape, DRONE.shape, friction=0.4).tangents(Gap(0.0, (-1.0, 0.0, 0.0), ()))[0]
    )
    m.me.tau_y[end].fix(tangential * along[1])
    m.me.tau_z[end].fix(tangential * along[2])
    m.cost = pyo.Objective(expr=m.me.c[end] + m.me.slip[end])
    assert rcp.solve(m, strategies=rcp.Strategy(exploration=0.0)).solved
    c = pyo.value(m.me.c[end])
    robot = np.array([pyo.value(v[end]) for v in (m.me.vx, m.me.vy, m.me.vz)])
    ball = np.array([pyo.value(v[end]) for v in (m.body.ux, m.body.uy, m.body.uz)])
    spin = np.array([pyo.value(m.body.component(w)[end]) for w in SPIN])
    if case == "leave":
        assert c == pytest.approx(0.0, abs=1e-6)
        np.testing.assert_allclose([*robot, *ball, *spin], [-0.04, *8 * [0.0]], atol=1e-6)
        return
    assert c == pytest.approx(normal * mass / (1 + mass), abs=0.02)
    friction = pyo.value(m.me.alpha_3[end] - m.me.alpha_1[end])  # on the ball, along the tangent
    if case == "slide":
        assert friction == pytest.approx(0.4 * c, rel=1e-4)
    elif case == "roll":
        assert friction == pytest.approx(tangential / (1 + 3.5 / mass), abs=2e-3)
        surface = ball + np.cross(spin, [-0.2, 0.0, 0.0])
        assert robot @ along == pytest.approx(surface @ along, abs=1e-5)
    assert robot @ along == pytest.approx(h * (tangential - friction), abs=5e-5)  # the normal turns a little
    assert ball @ along == pytest.approx(h * friction / mass, abs=5e-5)
    np.testing.assert_allclose(spin, h * friction * np.cross([-0.2, 0, 0], along) / BALL.inertia, atol=2e-3)


def test_all_ways_of_writing_a_contact_say_the_same() -> None:
    """The wrench as variables or as expressions."""
    body, wrenches = spatial.RigidBody(SHAPES["box"], mass=1.0, inertia=0.1), []
    for as_expressions in (False, True):
        m, grid = pyo.ConcreteModel(), {**GRID, "duration": 0.1, "elements": 1}
        m.push, m.body, m.me = (rcp.PhaseBlock(**grid) for _ in range(3))
        body.state_wrench(m.push, as_expressions=as_expressions)
        body.state_motion(m.body, [m.push], start=(0, 0, 0, 0.2, 0.3, -0.1))
        QUAD.state_motion(m.me, m.push, start=(0.3, -0.6, -0.2))
        spatial.Contact(body.shape, QUAD.shape, friction=0.5).state(m.me, m.body, m.push)
        t = m.me.points.last()
        for i, name in enumerate(("c", "alpha_1", "alpha_2", "alpha_3", "alpha_4")):
            m.me.component(name)[t].set_value(1.0 + i**2)
        found = []
        for name in ("fx", "fy", "fz", "mx", "my", "mz"):
            if as_expressions:
                found.append(pyo.value(m.push.component(name)[t]))
            else:
                row = m.me.contact_wrench[t, name]
                found.append(m.push.component(name)[t].value - (pyo.value(row.body) - row.upper))
                m.push.component(name)[t].set_value(found[-1])
        wrenches.append(found)
    assert wrenches[0] == pytest.approx(wrenches[1], abs=1e-12)


# ----------------------------------------------------------------- what is refused


def test_what_cannot_be_is_refused_before_anything_is_stated() -> None:
    with pytest.raises(ObstacleError, match="its gap needs the rotation of the body"):
        SHAPES["box"].gap_to_sphere(0.1, (1, 0, 0), (0, 0, 0))
    ball = spatial.Sphere(0.1)
    with pytest.raises(ModelError, match="mass = 0"):
        spatial.RigidBody(ball, mass=0, inertia=1.0)
    for inertia in (0.0, (1.0, 2.0), (1.0, math.nan, 1.0)):
        with pytest.raises(ModelError, match=r"inertia = .*; expected a positive number or three"):
            spatial.RigidBody(ball, mass=1, inertia=inertia)
    with pytest.raises(ModelError, match="no body has a principal moment above the sum of the others"):
        spatial.RigidBody(ball, mass=1, inertia=(1.0, 1.0, 2.1))
    with pytest.raises(ModelError, match="gravity = inf"):
        spatial.RigidBody(ball, mass=1, inertia=1.0, gravity=math.inf)
    with pytest.raises(ModelError, match=r"force_limit = \(\(1, 0\), .* a pair \(lowest, highest\)"):
        spatial.SphereRobot(ball, 1.0, ((1, 0), (0, 1), (0, 1)), 1.0)
    with pytest.raises(ModelError, match=r"never_normal = \(0, 0, 2\); expected a direction of length one"):
        spatial.Contact(ball, ball, friction=0.5, never_normal=(0, 0, 2))
    m = pyo.ConcreteModel()
    m.free = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 2)), elements=2, scheme="implicit_euler")
    m.late = rcp.PhaseBlock(**GRID)
    before = [list(phase.component_map()) for phase in (m.free, m.late)]
    with pytest.raises(ModelError, match="durations are numbers"):
        AFLOAT.state_motion(m.free, [], start=REST)
    with pytest.raises(ModelError, match="durations are numbers"):
        AFLOAT.state_copy(m.free, start=REST)
    with pytest.raises(ModelError, match=r"goal = \(0, 0\); expected 6 entries, a position and a rotation vector"):
        AFLOAT.state_motion(m.late, [], start=REST, goal=(0, 0))
    assert [list(phase.component_map()) for phase in (m.free, m.late)] == before
