"""Bodies that stay inside a convex region."""

import pickle

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, placed, set_poses, solve_once, turning_move
from hypothesis import given
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp

ROOM = rcp.Polytope.from_vertices([(-1, -2), (5, -2), (6, 1), (-1, 1.5)])
NUMBER = st.floats(-2, 6)


def held(m, **options):
    options = {"body": ARROW, "pose": placed, "region": ROOM, **options}
    m.move.inside = rcp.Containment(m.move.time, **options)
    return m.move.inside


@given(poses=st.lists(NUMBER, min_size=9, max_size=9), clearance=st.floats(0, 0.5), radius=st.floats(0, 0.3))
def test_rows_hold_where_every_corner_is_inside_by_the_clearance(poses, clearance, radius):
    m = turning_move(elements=1)
    inside = held(m, body=ARROW.padded(radius), clearance=clearance)
    set_poses(m.move, np.resize(np.array(poses), (len(m.move.time), 3)))
    normals, offsets = ROOM.halfspaces
    for time in m.move.time:
        corners = ARROW.placed(placed(m.move, time)).vertices
        room = float((offsets[:, None] - normals @ corners.T).min()) - radius
        rows = [row for index, row in inside.inside.items() if index[0] == time]
        assert len(rows) == 4 * 4
        assert min(row.ub - pyo.value(row.body) for row in rows) == pytest.approx(room - clearance, abs=1e-9)


@pytest.mark.executable
def test_a_turning_body_stays_inside_also_between_the_nodes_with_a_margin():
    m = turning_move(elements=6, stages=1, turn=3.0)
    inside = held(m, region=rcp.Polytope.box(8, 1, center=(2, 0)), clearance=0.01)
    solve_once(m)
    assert max(pyo.value(row.body) - row.ub for row in inside.inside.values()) < 1e-6
    report = inside.verify()
    assert 0 < 0.01 - report.worst.distance < 0.6 * (1 - np.cos(3 / 6 / 2))
    for interval in range(6):
        inside.set_margin(interval, 0.6 * (1 - np.cos(3 / 6 / 2)))
    solve_once(m)
    assert inside.verify().safe


def test_copies_and_indexed_blocks():
    m = turning_move(elements=2)
    held(m)
    for copy in (m.clone(), pickle.loads(pickle.dumps(m))):
        rows = copy.move.inside.inside
        assert len(rows) == len(m.move.inside.inside)
        assert copy.move.inside.verify().safe == m.move.inside.verify().safe
    regions = {1: ROOM, 2: rcp.Polytope.from_halfspaces([[0, 1]], [2], bounded=False)}
    m.move.both = rcp.Containment(
        [1, 2], rule=lambda block, i: block.build(m.move.time, body=ARROW, pose=placed, region=regions[i])
    )
    assert [len(m.move.both[i].inside) for i in (1, 2)] == [4 * 4 * 5, 4 * 5]


BAD = {
    "no pose": ({"pose": None}, "no pose"),
    "no region": ({"region": None}, "region is None"),
    "region in space": ({"region": rcp.Polytope.box(1, 1, 1)}, "'box' has dimension 3"),
    "rounded region": ({"region": rcp.Polytope.box(9, 9).padded(1)}, "radius 1"),
    "flat region": ({"region": rcp.Polytope.from_vertices([(0, 0), (1, 1)], allow_flat=True)}, "flat"),
    "unbounded body": ({"body": rcp.Polytope.from_halfspaces([[0, 1]], [2], bounded=False)}, "unbounded"),
    "negative clearance": ({"clearance": -1}, "clearance is -1"),
}


@pytest.mark.parametrize("case", BAD)
def test_refused_and_nothing_left(case):
    options, message = BAD[case]
    m = turning_move(elements=1)
    with pytest.raises(rcp.errors.ObstacleError, match=message):
        held(m, **options)
    assert m.move.component("inside") is None
