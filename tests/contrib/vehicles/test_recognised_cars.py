"""Cars are recognised by how they move, whatever their states are called and wherever their reference point is."""

import itertools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import keep_clear
from hypothesis import given, settings
from hypothesis import strategies as st
from obstacle_problems.scattered import scattered

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.vehicles.recognised_car import _axle, recognised_car
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE
from pyrobocop_pyomo.planning.recovery import Recovery
from pyrobocop_pyomo.solving.ipopt_options import SIDE_ITERATIONS

from .car_scenes import CAR, REVERSE, START, WHEELBASE

STEERING = 0.6


def in_the_street(states: dict[str, tuple[float, float]], pose: Any, ode: Any, shape: rcp.Polytope = CAR) -> Any:
    """A phase whose states go from one value to another, among the obstacles of a parking slot."""
    m = pyo.ConcreteModel(name="street")
    m.d = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(5, 120), initial_guess=25), elements=25, stages=2)
    for name, (first, last) in states.items():
        b.declare(name, rcp.State(initial=first, final=last))
    b.v = rcp.State(initial=0, final=0, bounds=(-1, 2))
    b.wheel = rcp.Control(bounds=(-STEERING, STEERING))
    b.push = rcp.Control(bounds=(-0.4, 0.4), parametrization="piecewise_constant")
    b.ode(ode)
    b.initialize_straight_lines()
    keep_clear(b, shape, REVERSE["obstacles"], pose)
    m.cost = pyo.Objective(expr=b.duration + b.integral(lambda b, t: b.push[t] ** 2 + 0.1 * b.wheel[t] ** 2))
    return m


def from_rear_axle(clockwise: bool = False, start: Any = START, goal: Any = REVERSE["goal"]) -> Any:
    """Heading counter-clockwise from x, or clockwise from y."""

    def heading(b: Any, t: Any) -> Any:
        return math.pi / 2 - b.q[t] if clockwise else b.q[t]

    def ode(b: Any, t: Any) -> Any:
        turn = b.v[t] * pyo.tan(b.wheel[t]) / WHEELBASE
        return {
            b.x: b.v[t] * pyo.cos(heading(b, t)), b.y: b.v[t] * pyo.sin(heading(b, t)),
            b.q: -turn if clockwise else turn, b.v: b.push[t],
        }  # fmt: skip

    ends = [math.pi / 2 - angle if clockwise else angle for angle in (start[2], goal[2])]
    states = {"x": (start[0], goal[0]), "y": (start[1], goal[1]), "q": (ends[0], ends[1])}
    return in_the_street(states, lambda b, t: rcp.planar_pose(b.x[t], b.y[t], heading(b, t)), ode)


def from_its_middle() -> Any:
    """The reference point in the middle between the axles, where the car moves aside as it turns."""
    half = WHEELBASE / 2

    def ode(b: Any, t: Any) -> Any:
        turn = b.v[t] * pyo.tan(b.wheel[t]) / WHEELBASE
        return {
            b.x: b.v[t] * pyo.cos(b.q[t]) - half * turn * pyo.sin(b.q[t]),
            b.y: b.v[t] * pyo.sin(b.q[t]) + half * turn * pyo.cos(b.q[t]),
            b.q: turn,
            b.v: b.push[t],
        }

    goal = REVERSE["goal"]
    states = {
        "x": (START[0] + half, goal[0] + half * math.cos(goal[2])),
        "y": (START[1], goal[1] + half * math.sin(goal[2])),
        "q": (START[2], goal[2]),
    }
    shape = CAR.placed(rcp.planar_pose(-half, 0.0))
    return in_the_street(states, lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.q[t]), ode, shape)


KINDS: dict[str, Callable[[], Any]] = {
    "rear axle": from_rear_axle, "clockwise": lambda: from_rear_axle(clockwise=True), "middle": from_its_middle,
}  # fmt: skip


@pytest.mark.heavy
@pytest.mark.parametrize("kind", KINDS)
def test_a_car_is_recognised_and_follows_its_path(kind: str) -> None:
    m = KINDS[kind]()
    b = m.d
    car = recognised_car(b.avoid)
    assert car is not None
    assert car.turning_radius == pytest.approx(WHEELBASE / math.tan(STEERING), rel=1e-4)
    assert car.speed == pytest.approx(1.0, rel=1e-4)
    # In its own frame it is the car from its rear axle.
    np.testing.assert_allclose(np.sort(car.shape.vertices, axis=0), np.sort(CAR.vertices, axis=0), atol=1e-6)
    path = car.path(b.avoid, 1.0, 60.0)
    assert car.follow(path)
    # Poses are on the path, and states and controls drive along it.
    first, last = (b.avoid.motion.pose_at_node(b.avoid.record.scene.bodies["body"].pose, t) for t in (0.0, 1.0))
    assert first.numbers()[1] == pytest.approx([b.x[0.0].value, b.y[0.0].value])
    assert last.numbers()[1] == pytest.approx([b.x[1.0].value, b.y[1.0].value], abs=1e-6)
    assert max(abs(b.v[t].value) for t in b.time) <= 1.0 + 1e-9
    assert min(b.v[t].value for t in b.time) < -0.5  # it backs into the slot


@pytest.mark.parametrize("turns", [True, False])
def test_what_moves_aside_or_cannot_turn_is_no_car(turns: bool) -> None:
    def ode(b: Any, t: Any) -> Any:
        return {b.x: b.v[t], b.y: b.wheel[t], b.q: b.push[t] if turns else 0.0, b.v: b.push[t]}

    m = in_the_street(
        {"x": (-6, 0), "y": (9, 8), "q": (0, 0)}, lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.q[t]), ode
    )
    assert recognised_car(m.d.avoid) is None


def test_an_end_that_is_whole_turns_away_is_told(caplog: pytest.LogCaptureFixture) -> None:
    m = from_rear_axle()
    car = recognised_car(m.d.avoid)
    assert car is not None
    path = car.path(m.d.avoid, 1.0, 60.0)
    m.d.q[1.0].fix(math.pi / 2 - 2 * math.pi)
    before = [v.value for v in m.d.x.values()]
    assert not car.follow(path)
    assert "State final=1.5708" in caplog.text
    assert [v.value for v in m.d.x.values()] == before


def test_a_car_turns_the_way_that_its_last_heading_says() -> None:
    last = -math.pi  # the easiest path ends half a turn the other way
    m = from_rear_axle(start=(-4, 9.5, 0), goal=(-8, 9, last))
    car = recognised_car(m.d.avoid)
    assert car is not None
    path = car.path(m.d.avoid, 1.0, None)
    assert path.poses[-1, 2] == last
    assert car.follow(path)


@pytest.mark.casadi
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["middle"])
def test_a_car_parks_from_a_straight_line(kind: str) -> None:
    result = rcp.solve(KINDS[kind]())
    assert result.safe
    assert any("along the path of a car" in made.purpose for made in result.rounds)
    assert result.rounds[0].purpose == "from the initial guess"
    assert result.rounds[0].iterations <= SIDE_ITERATIONS  # a start in a collision does not take the time of the others


def test_coordinates_that_leave_no_digits_are_refused() -> None:
    m = from_rear_axle()
    for t in m.d.time:
        m.d.x[t].set_value(1e9, skip_validation=True)
    with pytest.raises(rcp.errors.ObstacleError, match=r"coordinate 1e\+09 .* Move the origin near the start"):
        rcp.solve(m)


@given(
    angle=st.floats(-math.pi, math.pi), ahead=st.floats(-3, 3), aside=st.floats(-3, 3), seed=st.integers(0, 2**32 - 1)
)
@settings(max_examples=50, deadline=None)
def test_the_axle_is_found_from_velocities(angle: float, ahead: float, aside: float, seed: int) -> None:
    """eq-axle: the body's frame is anywhere on a car that drives with random speeds and turns."""
    speeds, turns = np.random.default_rng(seed).uniform(-1, 1, (2, 40))
    # The origin of the body's frame is at (ahead, aside) of the car, whose direction in the body's frame is the angle.
    own = np.array([speeds - turns * aside, turns * ahead])
    cosine, sine = math.cos(angle), math.sin(angle)
    found = _axle(np.column_stack([cosine * own[0] - sine * own[1], sine * own[0] + cosine * own[1], turns]))
    assert found is not None
    place, direction = found
    assert abs(math.cos(direction - angle)) == pytest.approx(1.0)
    # The rear axle is behind the frame by `ahead`; where along the axle the point is, nothing tells.
    assert float(place @ [cosine, sine]) == pytest.approx(-ahead, abs=1e-7)
    assert float(place @ [-sine, cosine]) == pytest.approx(0.0, abs=1e-7)


# --------------------------------------------------------------------
# When paths of cars are searched for as starts of plans, and when not.


IN_VAIN = SimpleNamespace(
    results=[SimpleNamespace(stop_reason=rcp.StopReason.ITERATION_LIMIT)],
    deadline=NO_DEADLINE,
    put_motion_without_obstacles=lambda: None,
)


def test_no_path_is_searched_twice_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not farther from obstacles where there is none near them."""
    m = scattered("unicycle", 6, 100, 20)
    m.move.avoid.initialize()
    recovery = Recovery(m, IN_VAIN)
    searched: list[float] = []

    def in_vain(*_: Any, clearance: float, **__: Any) -> None:
        searched.append(clearance)
        raise rcp.errors.InitialGuessError("none")

    monkeypatch.setattr("pyrobocop_pyomo.contrib.vehicles.recognised_car.staged_search", in_vain)
    count = sum(1 for _ in itertools.islice(recovery.starts(), 3))
    assert count == 3
    assert len(searched) == 1
