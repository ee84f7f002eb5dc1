"""Trailers follow cars without slipping, exactly and both ways, and are recognised by how they move."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.moving import distances_by_shapely, placed
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.vehicles.car_kinematics import follow_arc, follow_arcs
from pyrobocop_pyomo.contrib.vehicles.car_path import CarPath
from pyrobocop_pyomo.contrib.vehicles.motion_primitives import CarSearch, MotionPrimitives
from pyrobocop_pyomo.contrib.vehicles.recognised_car import recognised_car
from pyrobocop_pyomo.errors import InitialGuessError

WHEELBASE, STEERING, LENGTH = 2.5, 0.6, 3.2
BODY = rcp.Polytope.box(3, 1.8, center=(0.5, 0))
HITCHES = st.sampled_from([-1.0, 0.0, 0.4])


def trailer(hitch: float = -1.0, length: float = LENGTH) -> rcp.scenes.Trailer:
    return rcp.scenes.Trailer(BODY, hitch, length, 1.0)


def pulling(hitch: float, *, slips: bool = False, rigid: bool = False) -> Any:
    """Headings as states; the trailer may move as if it slipped, or be a part of the car."""
    m = pyo.ConcreteModel(name="pulling")
    m.d = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(5, 120), initial_guess=25), elements=12, stages=1)
    ends = {"x": (-9, 9), "y": (0, 1), "q": (0, 0), "p": (0, 0)}
    for name, (first, last) in ends.items():
        b.declare(name, rcp.State(initial=first, final=last))
    b.v = rcp.Control(bounds=(-1, 2))
    b.wheel = rcp.Control(bounds=(-STEERING, STEERING))

    @b.ode
    def rolling(b: Any, t: Any) -> Any:
        turn, bend = b.v[t] * pyo.tan(b.wheel[t]) / WHEELBASE, b.q[t] - b.p[t]
        own = (b.v[t] * pyo.sin(bend) + hitch * turn * pyo.cos(bend)) / LENGTH
        return {
            b.x: b.v[t] * pyo.cos(b.q[t]), b.y: b.v[t] * pyo.sin(b.q[t]), b.q: turn,
            b.p: own + (0.3 * b.v[t] if slips else 0.0),
        }  # fmt: skip

    @b.constraint
    def not_too_bent(b: Any, t: Any) -> Any:
        return (-0.7, b.q[t] - b.p[t], 0.7)

    def behind(b: Any, t: Any) -> rcp.scenes.Pose:
        x, y = b.x[t] + hitch * pyo.cos(b.q[t]), b.y[t] + hitch * pyo.sin(b.q[t])
        if rigid:
            return rcp.planar_pose(x, y, b.q[t])
        return rcp.planar_pose(x - LENGTH * pyo.cos(b.p[t]), y - LENGTH * pyo.sin(b.p[t]), b.p[t])

    b.initialize_straight_lines()
    # The trailer first: the order says nothing.
    b.avoid = rcp.ObstacleAvoidanceBlock(
        b.time, bodies={
            "wagon": rcp.Body(BODY, pose=behind),
            "car": rcp.Body(BODY, pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t], b.q[t])),
        }, obstacles={"pallet": rcp.Polytope.box(2, 2)}, clearance=0.1, exclude=[("car", "wagon")],
    )  # fmt: skip
    return m


def integrated_angle(hitch: float, angle: float, length: float, bend: float) -> float:
    def rate(s: float, own: Any) -> Any:
        return -bend + (hitch * bend * np.cos(own) - np.sin(own)) / LENGTH

    return float(solve_ivp(rate, (0.0, length), [angle], rtol=1e-10, atol=1e-11).y[0, -1])


@given(hitch=HITCHES, angle=st.floats(-1, 1), bend=st.floats(-0.3, 0.3))
@settings(max_examples=25, deadline=None)
def test_a_trailer_does_not_slip(hitch: float, angle: float, bend: float) -> None:
    """eq-trailer: the hitch is a point of both bodies, and the axle does not move along itself."""
    towed, step = trailer(hitch), 1e-5
    poses = follow_arc(np.array([0.3, -0.2, 0.5, angle]), np.array([-step, 0.0, step]), np.full(3, bend), towed)
    own = towed.poses(poses)
    rate = (own[2] - own[0]) / (2.0 * step)
    ahead = np.array([math.cos(own[1, 2]), math.sin(own[1, 2])])
    assert rate[:2] @ [-ahead[1], ahead[0]] == pytest.approx(0.0, abs=1e-8)
    expected = towed.velocities(np.array(angle), np.array(1.0), np.array(bend))
    assert (rate[:2] @ ahead, rate[2]) == pytest.approx(tuple(map(float, expected)), abs=1e-8)
    of_car = poses[1, :2] + hitch * np.array([math.cos(poses[1, 2]), math.sin(poses[1, 2])])
    assert own[1, :2] + LENGTH * ahead == pytest.approx(of_car)


def test_a_car_backs_its_trailer_into_a_bay() -> None:
    """The way is clear by Shapely, the trailer rolls by its equation, and the car got there in reverse."""
    towed, clearance = trailer(), 0.1
    start, goal = (4.0, 4.0, 0.0, 0.0), (0.0, 0.3, 0.5 * math.pi, 0.0)
    walls = {
        "left": rcp.Polytope.box(7, 8, center=(-5.2, -4)), "right": rcp.Polytope.box(7, 8, center=(5.2, -4)),
        "far side": rcp.Polytope.box(30, 1, center=(0, 12)),
    }  # fmt: skip
    path = rcp.scenes.hybrid_a_star(
        start, goal, body=BODY, obstacles=walls, wheelbase=WHEELBASE, steering_limit=STEERING, trailer=towed,
        bounds=((-14, 14), (-1, 10)), clearance=clearance,
    )  # fmt: skip
    assert path.directions[-1] == -1.0
    assert path.poses[0] == pytest.approx(start)
    assert path.poses[-1] == pytest.approx(goal)
    assert np.abs(path.poses[:, 3]).max() <= towed.limit + 1e-9
    arcs, bends = path.directions * np.diff(path.arc_lengths, append=path.length), np.tan(path.steering) / WHEELBASE
    for k in range(len(arcs) - 1):
        angle = integrated_angle(towed.hitch, path.poses[k, 3], arcs[k], bends[k])
        assert angle == pytest.approx(path.poses[k + 1, 3], abs=1e-6)
    driven = path.poses_at(np.linspace(0.0, path.length, 1500))
    for places in (driven[:, :3], towed.poses(driven)):
        corners = placed(BODY.vertices, places)
        for wall in walls.values():
            others = np.broadcast_to(wall.vertices, (len(corners), *wall.vertices.shape))
            assert distances_by_shapely(corners, others).min() >= clearance - 1e-6


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_ways_end_with_the_angle_of_their_target(direction: float) -> None:
    primitives = MotionPrimitives.of(WHEELBASE, STEERING, CarSearch(), trailer=trailer())
    offsets = np.array([[-9.0, 0.8, 0.2, 0.2], [-9.0, 0.0, 0.0, 0.2], [-8.0, 0.5, 0.0, 0.0]])
    poses, target = offsets * [direction, 1, 1, 1], np.zeros(4)
    costs, lengths, turns = primitives.paths_to(poses, target)
    kind = costs.argmin(axis=0)
    arcs, bends, reached = primitives.connecting_arcs(poses, lengths[kind, np.arange(3)], turns[kind], target)
    assert reached.any()
    ends = primitives.follow(poses, arcs, bends)[reached, -1]
    np.testing.assert_allclose(ends, np.zeros_like(ends), atol=1e-3)
    assert np.abs(bends).max() <= math.tan(STEERING) / WHEELBASE + 1e-12
    assert (np.sign(arcs[arcs != 0.0]) == direction).all()


@pytest.mark.parametrize("hitch", [-1.0, 0.0])
def test_a_car_with_a_trailer_is_recognised_and_follows_its_path(hitch: float) -> None:
    m = pulling(hitch)
    car = recognised_car(m.d.avoid)
    assert car is not None
    assert car.bodies == ["car", "wagon"]
    assert car.trailer is not None
    assert (car.trailer.hitch, car.trailer.length) == pytest.approx((hitch, LENGTH), abs=1e-6)
    assert car.turning_radius == pytest.approx(WHEELBASE / math.tan(STEERING), rel=1e-4)
    assert 0.68 <= car.trailer.limit <= 0.7  # by the row
    for name in "xyqp":
        m.d.component(name)[1.0].unfix()  # the path ends elsewhere
    lengths, bends = np.full(18, 1.0), np.repeat([0.1, -0.1, 0.0], 6)
    poses = follow_arcs(np.array([-9.0, 0.0, 0.0, 0.0]), lengths, bends, car.trailer)
    steering = np.arctan(car.turning_radius * np.append(bends, 0.0))
    path = CarPath(poses, np.ones(19), steering, car.trailer)
    assert car.follow(path)
    driven = path.length * np.linspace(0, 1, 2001)
    near = path.poses_at(driven)
    inner = [t for t in m.d.time if 0.0 < t < 1.0]
    found = np.array([[m.d.component(name)[t].value for name in "xyqp"] for t in inner])
    nearest = np.hypot(*(found[:, None, :2] - near[:, :2]).T).argmin(axis=0)
    np.testing.assert_allclose(found[:, 2], near[nearest, 2], atol=0.01)
    np.testing.assert_allclose(found[:, 3], near[nearest, 2] + near[nearest, 3], atol=0.01)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"slips": True}, "'wagon' has no axle"),
        ({"rigid": True}, "expected 4 states: a position, and a heading for each body"),
    ],
)
def test_what_is_no_trailer_is_told(options: Any, reason: str, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        assert recognised_car(pulling(-1.0, **options).d.avoid) is None
    assert "'wagon' and 'car' not taken for a car" in caplog.text
    assert reason in caplog.text


def test_an_end_that_is_bent_too_far_is_refused() -> None:
    with pytest.raises(InitialGuessError, match=r"at the goal the angle between trailer and car is 1.2, beyond"):
        rcp.scenes.hybrid_a_star(
            (0, 0, 0, 0), (9, 0, 0, 1.2), body=BODY, obstacles={}, wheelbase=WHEELBASE, steering_limit=STEERING,
            bounds=((-15, 15), (-8, 8)), trailer=trailer(),
        )  # fmt: skip
