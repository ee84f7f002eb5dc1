"""Reeds-Shepp paths, poses between poses, stops at cusps, and a path as the initial guess of a phase."""

import math
from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.contrib.vehicles import CarTiming
from pyrobocop_pyomo.contrib.vehicles.car_kinematics import follow_arc, follow_arcs
from pyrobocop_pyomo.contrib.vehicles.car_path import CarPath
from pyrobocop_pyomo.contrib.vehicles.free_space import FreeSpace, are_free
from pyrobocop_pyomo.contrib.vehicles.motion_primitives import reeds_shepp_paths
from pyrobocop_pyomo.errors import InitialGuessError

from .car_scenes import CAR, REVERSE, START, WHEELBASE, park

angles = st.floats(-math.pi, math.pi)
places = st.floats(-6, 6)


@given(x=places, y=places, heading=angles)
def test_every_reeds_shepp_path_ends_at_its_target(x: float, y: float, heading: float) -> None:
    ends = 0
    for turns, lengths, exists in reeds_shepp_paths(np.array([x]), np.array([y]), np.array([heading])):
        if exists[0]:
            ends += 1
            end = follow_arcs(np.zeros(3), lengths[0], turns)[-1]
            assert end[:2] == pytest.approx([x, y], abs=1e-6)
            assert math.cos(end[2] - heading) == pytest.approx(1.0, abs=1e-9)
    assert ends > 0


@given(x=places, y=places, heading=angles)
def test_the_shortest_path_back_is_as_long(x: float, y: float, heading: float) -> None:
    def shortest(x: float, y: float, heading: float) -> float:
        found = reeds_shepp_paths(np.array([x]), np.array([y]), np.array([heading]))
        return min(float(np.abs(lengths).sum()) for _, lengths, exists in found if exists[0])

    back_x = -x * math.cos(heading) - y * math.sin(heading)
    back_y = x * math.sin(heading) - y * math.cos(heading)
    assert shortest(x, y, heading) == pytest.approx(shortest(back_x, back_y, -heading), abs=1e-6)
    assert shortest(x, y, heading) >= math.hypot(x, y) - 1e-9


def test_known_shortest_paths() -> None:
    """To turn round on the spot takes three arcs of a third of half a turn; ahead and back are straight."""
    for pose, length in (
        ((0, 0, math.pi), math.pi),
        ((5, 0, 0), 5.0),
        ((-3, 0, 0), 3.0),
        ((1, 1, math.pi / 2), math.pi / 2),
    ):
        found = reeds_shepp_paths(*(np.array([float(number)]) for number in pose))
        assert min(np.abs(lengths).sum() for _, lengths, exists in found if exists[0]) == pytest.approx(length)


def distance(pose: Any, obstacle: rcp.Polytope) -> float:
    return rcp.scenes.signed_distance(CAR, obstacle, rcp.planar_pose(*pose)).distance


@given(pose=st.tuples(places, places, angles), corners=st.lists(st.tuples(places, places), min_size=1, max_size=6))
def test_a_pose_is_free_as_far_as_its_exact_distance(pose: Any, corners: Any) -> None:
    hull = rcp.Polytope.hull(corners, allow_flat=True, radius=0.1, name="hull")
    for obstacle in (hull, REVERSE["obstacles"]["left"], REVERSE["obstacles"]["wall"]):
        exact = distance(pose, obstacle)
        assume(abs(exact) > 1e-6)  # where both touch, rounding decides
        for clearance in (exact - 1e-6, exact + 1e-6):
            space = FreeSpace.around(CAR, [obstacle], max(clearance, 0.0), 30.0)
            assert are_free(space, np.array([pose])).tolist() == [max(clearance, 0.0) < exact]


@settings(max_examples=30)
@given(pose=st.tuples(places, st.floats(5, 10), angles), length=st.floats(-3, 3), curvature=st.floats(-0.25, 0.25))
def test_a_motion_that_is_called_clear_is_clear_all_along(pose: Any, length: float, curvature: float) -> None:
    """Poses a metre apart, so that something could hide in between."""
    obstacles = [*REVERSE["obstacles"].values(), rcp.Polytope.regular_polygon(5, 0.3, (2.0, 8.0))]
    space = FreeSpace.around(CAR, obstacles, 0.1, 30.0)
    steps = np.full(3, length / 3)
    motion = follow_arcs(np.array(pose), steps, np.full(3, curvature))
    clear = space.is_clear(motion[None], np.array([abs(curvature)]), np.array([abs(length) / 3]))[0]
    between = follow_arc(np.array(pose), np.linspace(0, length, 31), np.full(31, curvature))
    least = min(distance(each, obstacle) for each in between.tolist() for obstacle in obstacles) - 0.1
    if clear:
        assert least >= -1e-7
    elif least > 0.15:  # not over-careful: what one direction per step cannot prove is small
        pytest.fail(f"found not clear at a distance of {least}")


def simple_path() -> CarPath:
    return park((0, 2, 0), {"goal": (1, 4, 0.3), "obstacles": []})


def test_poses_between_poses_are_on_the_arcs() -> None:
    path = simple_path()
    np.testing.assert_allclose(path.poses_at(path.arc_lengths), path.poses, atol=1e-9)
    driven = np.linspace(0, path.length, 20001)
    dense = path.poses_at(driven)
    chords = np.hypot(*np.diff(dense[:, :2], axis=0).T).sum()
    assert path.length - (path.cusps + 1e-3) * driven[1] <= chords <= path.length + 1e-9  # a step may straddle a cusp
    slopes = np.abs(np.diff(dense[:, 2])) / np.diff(driven)
    assert slopes.max() <= math.tan(0.6) / WHEELBASE + 1e-6


@given(
    lengths=st.lists(st.floats(0.05, 20), min_size=1, max_size=5),
    speed=st.floats(0.1, 5),
    acceleration=st.floats(0.1, 5),
)
def test_timing_stops_at_cusps_and_keeps_its_limits(lengths: Any, speed: float, acceleration: float) -> None:
    legs = np.concatenate([[0.0], np.cumsum(lengths)])
    directions = np.resize([1.0, -1.0], len(lengths))
    timing = CarTiming.over_legs(legs, directions, speed, acceleration)
    times = np.linspace(0, timing.duration, 4001)
    driven, velocities = timing.arc_length_at(times), timing.velocity_at(times)
    assert np.abs(velocities).max() <= speed * (1 + 1e-9)
    assert np.all(np.diff(driven) >= -1e-9)
    assert [driven[0], driven[-1]] == pytest.approx([0.0, legs[-1]])
    step = times[1]
    np.testing.assert_allclose(
        np.diff(driven) / step, np.abs(velocities[1:] + velocities[:-1]) / 2, atol=2.1 * acceleration * step
    )
    np.testing.assert_allclose(np.diff(velocities), 0.0, atol=acceleration * step * (1 + 1e-6))
    stops = timing.times[::3]
    np.testing.assert_allclose(timing.arc_length_at(stops), legs, atol=1e-9)
    np.testing.assert_allclose(timing.velocity_at(stops), 0.0, atol=1e-9)


def car_phase(duration: Any, final_heading: float = math.pi / 2, elements: int = 120) -> Any:
    m = pyo.ConcreteModel(name="car")
    m.park = b = rcp.PhaseBlock(duration=duration, elements=elements, scheme="radau", stages=2)
    b.x = rcp.State(initial=START[0], final=0.0)
    b.y = rcp.State(initial=START[1], final=1.3)
    b.theta = rcp.State(initial=START[2], final=final_heading)
    b.v = rcp.State(initial=0, final=0)
    b.delta = rcp.Control(bounds=(-0.6, 0.6))
    b.a = rcp.Control()
    b.ode(lambda b, t: {
        b.x: b.v[t] * pyo.cos(b.theta[t]), b.y: b.v[t] * pyo.sin(b.theta[t]),
        b.theta: b.v[t] * pyo.tan(b.delta[t]) / WHEELBASE, b.v: b.a[t],
    })  # fmt: skip
    return b


NAMES = {"x": "x", "y": "y", "theta": "theta", "v": "v", "steering": "delta", "acceleration": "a"}


@pytest.mark.heavy
@pytest.mark.parametrize("duration", [20.0, rcp.Duration(bounds=(1, 100)), rcp.Duration(bounds=(1, 12))], ids=str)
def test_a_guess_nearly_follows_the_equations(duration: Any) -> None:
    path = park()
    b = car_phase(duration)
    b.initialize(path.initial_guess(b, speed=1.0, names=NAMES))
    real = pyo.value(b.duration)
    suggested = path.timed(1.0).duration
    assert real == pytest.approx(
        {float: 20.0}.get(type(duration), min(suggested, getattr(duration, "bounds", (0, 0))[1]))
    )
    trajectory = b.trajectory()
    assert trajectory.verify().element_error < 0.1  # controls jump within elements; the states are of the size of 10
    np.testing.assert_allclose([b.x[b.time.last()].value, b.y[b.time.last()].value], path.poses[-1, :2], atol=1e-9)


@pytest.mark.heavy
def test_steering_as_a_state_has_a_rate() -> None:
    m = pyo.ConcreteModel()
    m.p = b = rcp.PhaseBlock(duration=15.0, elements=150)
    b.steering, b.steering_rate = rcp.State(), rcp.Control()
    b.ode(lambda b, t: {b.steering: b.steering_rate[t]})
    b.initialize(park().initial_guess(b))
    assert b.trajectory().verify().element_error < 0.05
    assert max(abs(b.steering[t].value) for t in b.time) <= 0.6 + 1e-9


@pytest.mark.heavy
def test_headings_start_as_the_phase_does_and_whole_turns_at_the_end_are_refused() -> None:
    path = park()
    b = car_phase(20.0, elements=10)
    b.theta[b.time.first()].fix(2 * math.pi)
    with pytest.raises(
        InitialGuessError, match=r"'theta' is fixed at 1\.5708 there, 1 whole turn\(s\) away\. State final=7\.85398"
    ):
        path.initial_guess(b, names=NAMES)
    b.theta[b.time.last()].unfix()
    b.initialize(path.initial_guess(b, names=NAMES))
    assert b.theta[b.time.last()].value == pytest.approx(2.5 * math.pi)


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": {"x": "nothing"}}, "'x' is to be 'nothing', which phase 'park' does not have"),
        ({"names": {"speed": "v"}}, "'speed' is not known of a car's path; known are x, y"),
        ({"speed": 0.0}, "speed = 0"),
        ({"acceleration": math.nan}, "acceleration = nan"),
    ],
)
def test_guesses_that_do_not_fit_are_refused(options: Any, message: str) -> None:
    path, b = simple_path(), car_phase(20.0, elements=4)
    with pytest.raises(InitialGuessError, match=message):
        path.initial_guess(b, **options)
