"""Separations in space, for rotations by angles and by quaternions."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import solve_once
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp

# Not symmetric in any axis.
WEDGE = rcp.Polytope.from_vertices([(0, 0, 0), (0.8, 0, 0), (0, 0.5, 0.1), (0.1, 0.1, 0.4)])
FRAME = [rcp.Polytope.box(1, 1, 1, center=(2, 0, 0)), rcp.Polytope.capsule((0, 2, 0), (1, 2, 1), 0.2)]
NUMBER = st.floats(-3, 3)
MODELS = {}


def by_angles(m, t):
    return rcp.spatial_pose([m.p[k, t] for k in range(3)], euler=[m.a[k, t] for k in range(3)])


def by_quaternion(m, t):
    return rcp.spatial_pose([m.p[k, t] for k in range(3)], quaternion=[m.q[k, t] for k in range(4)])


def flying(pose, between):
    key = (pose, between)
    if key not in MODELS:
        m = pyo.ConcreteModel()
        m.p = pyo.Var(range(3), [0, 1], initialize=0)
        m.a = pyo.Var(range(3), [0, 1], initialize=0)
        m.q = pyo.Var(range(4), [0, 1], initialize=0.5)
        m.length = pyo.Constraint([0, 1], rule=lambda m, t: sum(m.q[k, t] ** 2 for k in range(4)) == 1)
        m.avoid = rcp.ObstacleAvoidanceBlock(
            [0, 1], body=WEDGE, pose=pose, obstacles=FRAME, clearance=0.1, between=between
        )
        MODELS[key] = m
    return MODELS[key]


@settings(max_examples=40)
@given(
    numbers=st.lists(NUMBER, min_size=14, max_size=14),
    pose=st.sampled_from([by_angles, by_quaternion]),
)
def test_started_separations_prove_the_distance_in_space(numbers, pose):
    m = flying(pose, None)
    numbers = np.array(numbers).reshape(2, 7)
    for t in (0, 1):
        for k in range(3):
            m.p[k, t].set_value(numbers[t, k])
            m.a[k, t].set_value(numbers[t, 3 + k])
        quaternion = numbers[t, 3:] + np.array([4.0, 0, 0, 0])
        for k, entry in enumerate(quaternion / np.linalg.norm(quaternion)):
            m.q[k, t].set_value(entry)
    m.avoid.initialize()
    for (_, name, t), proven in m.avoid.separation_gaps().items():
        shape = dict(zip(("obstacle 1", "obstacle 2"), FRAME, strict=True))[name]
        distance = rcp.scenes.signed_distance(WEDGE, shape, pose(m, t)).distance
        assert proven <= distance + 1e-8
        if distance > 1e-3:
            assert proven == pytest.approx(distance, abs=1e-7)
            rows = m.avoid.component_data_objects(pyo.Constraint)
            assert distance < 0.2 or all(
                (row.lb is None or pyo.value(row.body) >= row.lb - 1e-7)
                and (row.ub is None or pyo.value(row.body) <= row.ub + 1e-7)
                for row in rows
                if row.index()[1:3] == (name, t)
            )


@pytest.mark.executable
@pytest.mark.parametrize("between", ["plane", None])
def test_the_nearest_place_beside_a_box_is_at_the_clearance(between):
    m = flying(by_angles, between).clone()
    m.length.deactivate()
    m.a.fix(0.3)
    for t in (0, 1):
        for k, start in enumerate((2.0, 0.3, 1.5)):
            m.p[k, t].set_value(start)
    m.avoid.initialize()
    # Towards the middle of the box.
    m.near = pyo.Objective(expr=sum((m.p[0, t] - 2) ** 2 + m.p[1, t] ** 2 + m.p[2, t] ** 2 for t in (0, 1)))
    solve_once(m)
    for t in (0, 1):
        assert rcp.scenes.signed_distance(WEDGE, FRAME[0], by_angles(m, t)).distance == pytest.approx(0.1, abs=1e-6)
