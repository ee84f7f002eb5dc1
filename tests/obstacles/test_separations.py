"""Gaps that separations prove never exceed the exact distance."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, placed, set_poses, turning_move
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp

NUMBER = st.floats(-3, 3)
BODY = ARROW.padded(0.05)
SHAPES = {
    "box": rcp.Polytope.box(1, 2, center=(2, 0)),
    "ball": rcp.Polytope.ball(0.7, (1.5, 0.5)),
    "wedge": rcp.Polytope.from_halfspaces([[-1, 0.2], [0.3, -1]], [-1, 0.5], bounded=False),
    "triangle": rcp.Polytope.from_vertices([(1, 0), (3, 0), (2, 1)]),
}
MODELS = {}


def model(shape, between=None, elements=2):
    """Built once per kind: only values change between examples."""
    key = (shape, between)
    if key not in MODELS:
        m = turning_move(elements=elements)
        for state in (m.move.x, m.move.y, m.move.theta):
            state.unfix()
        body = rcp.Body(BODY, pose=placed)
        avoiding(m, bodies={"arrow": body}, obstacles={"wall": SHAPES[shape]}, between=between)
        MODELS[key] = m
    return MODELS[key]


def poses_of(m, numbers):
    rows = np.resize(np.array(numbers), (len(m.move.time), 3))
    set_poses(m.move, rows)


@settings(max_examples=40)
@given(
    shape=st.sampled_from(sorted(SHAPES)),
    poses=st.lists(NUMBER, min_size=15, max_size=15),
)
def test_started_separations_prove_the_exact_distance_wherever_shapes_are_apart(shape, poses):
    m = model(shape)
    poses_of(m, poses)
    m.move.avoid.initialize()
    avoid = m.move.avoid
    for index, proven in avoid.separation_gaps().items():
        time = index[2]
        (distance,) = exact(m.move, BODY, SHAPES[shape], [time])
        # 1e-9 of the scene's size: both numbers are differences of coordinates up to 5.
        assert proven <= distance + 1e-8
        if distance > 1e-3:
            assert proven == pytest.approx(distance, abs=1e-7)
            if SHAPES[shape].is_bounded:  # eq-plane: rows leave the distance less what is required, half to each shape
                half = (distance - 0.05) / 2
                rows = (avoid.first_shape, min), (avoid.second_shape, max)
                spare = [least(pyo.value(r.body) for key, r in of.items() if key[:3] == index) for of, least in rows]
                assert spare == pytest.approx([half, -half], abs=1e-7)
            assert pyo.value(avoid.unit[index].body) == pytest.approx(1.0, abs=1e-9)


@settings(max_examples=40)
@given(
    between=st.sampled_from(["plane", None]),
    shape=st.sampled_from(sorted(SHAPES)),
    poses=st.lists(NUMBER, min_size=15, max_size=15),
    angle=st.floats(0, 6.3),
    length=st.floats(1e-3, 1.2),
)
def test_no_normal_of_a_plane_proves_more_than_the_distance(between, shape, poses, angle, length):
    m = model(shape, between)
    poses_of(m, poses)
    avoid = m.move.avoid
    for index in avoid.separations:
        avoid.normal[(*index, 0)].set_value(length * np.cos(angle), skip_validation=True)
        avoid.normal[(*index, 1)].set_value(length * np.sin(angle), skip_validation=True)
    for index, proven in avoid.separation_gaps().items():
        assert proven <= min(exact(m.move, BODY, SHAPES[shape], avoid.record.segments[index].times)) + 1e-8


def test_a_normal_of_zero_proves_nothing():
    avoid = model("box").move.avoid
    for entry in avoid.normal.values():
        entry.set_value(0.0)
    assert set(avoid.separation_gaps().values()) == {-float("inf")}


def test_poses_at_a_moving_obstacle_and_between_bodies_are_both_turned():
    m = turning_move(elements=3, height=3)
    truck = rcp.Body(WALL, pose=lambda b, t: rcp.planar_pose(2 * t, -1.5, 0.3 * t))
    avoid = avoiding(m, obstacles={"truck": truck})
    avoid.initialize()
    for index, proven in avoid.separation_gaps().items():
        times = avoid.record.segments[index].times
        found = [
            rcp.scenes.signed_distance(ARROW, WALL, placed(m.move, t), rcp.planar_pose(2 * t, -1.5, 0.3 * t)).distance
            for t in times
        ]
        assert 0 < proven <= min(found) + 1e-9
