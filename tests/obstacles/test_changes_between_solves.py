"""Changes between solves: splits, the broad phase, margins, norms."""

import itertools
import logging

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, solve_once, turning_move
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp

FAR = {"near": WALL, "far": rcp.Polytope.box(1, 1, center=(2, 20))}


@settings(max_examples=15)
@given(choices=st.lists(st.integers(0, 100), min_size=1, max_size=6))
def test_splitting_keeps_the_whole_motion_covered(choices):
    m = turning_move(elements=3, height=3)
    avoid = avoiding(m)
    avoid.initialize()
    for choice in choices:
        before = list(avoid.separations)
        index = before[choice % len(before)]
        avoid.set_margin(*index, 0.01)
        left, right = avoid.split(*index)
        assert pyo.value(avoid.margin[left]) == pyo.value(avoid.margin[right]) == 0.01
        assert set(avoid.separations) == (set(before) - {index}) | {left, right}
    segments = avoid.record.by_part_pair()["arrow", "wall"]
    assert segments[0].times[0] == 0.0
    assert segments[-1].times[-1] == 1.0
    for before, after in itertools.pairwise(segments):
        assert before.times[-1] == after.times[0]
    # Rows, variables and segments have the same separations.
    for component in (avoid.offset, avoid.required, avoid.unit):
        assert set(component) == set(avoid.separations) == set(avoid.record.segments)
    assert {key[:3] for key in avoid.first_shape} == set(avoid.separations)
    gaps = avoid.separation_gaps()
    assert min(gaps.values()) > 0
    # Where a segment was split, the pose is that of the collocation polynomial.
    trajectory = m.move.trajectory()
    for (body, time), pose in avoid.record.poses.items():
        if body == "arrow":
            there = trajectory(time)
            assert pose.numbers()[1] == pytest.approx([there["x"], there["y"]], abs=1e-12)


def test_broad_phase_leaves_out_what_is_far_and_brings_it_back():
    m = turning_move(elements=4, height=3)
    avoid = avoiding(m, obstacles=FAR, broad_phase=2.0)
    avoid.initialize()
    assert not any(second == "far" for _, second, _ in avoid.separations)
    record = avoid.record
    for segment in record.pruned.values():
        shape = FAR[segment.second]
        assert min(exact(m.move, ARROW, shape, segment.times)) > 2.0
    assert len(record.segments) + len(record.pruned) == 2 * 4
    (index,) = avoid.restore([("arrow", "far", 2)])
    assert index == ("arrow", "far", m.move.grid.mesh.boundaries[2])
    assert avoid.separation_gaps()[index] > 2.0
    avoid.initialize()
    assert index in avoid.separations
    assert avoid.restore([("arrow", "far", 2)]) == []
    # All body pairs are checked, those left out as well.
    assert {(pair.first, pair.second) for pair in avoid.verify().body_pairs} == {("arrow", "near"), ("arrow", "far")}


@pytest.mark.executable
def test_margins_and_changed_clearances_are_kept_as_asked():
    m = turning_move()
    avoid = avoiding(m)
    avoid.initialize()
    avoid.clearance["arrow", "wall"] = 0.025
    for index in avoid.separations:
        avoid.set_margin(*index, 0.1)
    solve_once(m)
    gaps = avoid.separation_gaps()
    assert min(gaps.values()) == pytest.approx(0.125, abs=1e-5)


def test_norm_bounds_or_fixes_the_length():
    m = turning_move(height=3)
    avoid = avoiding(m, between=None)
    assert not any(row.equality for row in avoid.unit.values())
    avoid.initialize()
    assert all(row.equality for row in avoid.unit.values())
    avoid.set_norm("ball")
    assert not any(row.equality for row in avoid.unit.values())
    assert {row.ub for row in avoid.unit.values()} == {1.0}


def test_auto_takes_the_ball_where_the_guess_overlaps(caplog):
    m = turning_move(height=0)
    avoid = avoiding(m)
    with caplog.at_level(logging.INFO, logger="pyrobocop_pyomo"):
        avoid.initialize()
    assert "'arrow' and 'wall'" in caplog.text
    assert not any(row.equality for row in avoid.unit.values())


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda a: a.split("arrow", "wall", 0.123), "no separation"),
        (lambda a: a.set_margin("arrow", "wall", 0.0, -1), "margin"),
        (lambda a: a.set_norm("cube"), "'cube'.*'ball' or 'sphere'"),
        (lambda a: a.initialize(directions={("arrow", "nobody"): (0, 1)}), "'nobody'"),
        (lambda a: a.initialize(directions={("arrow", "wall"): (0, 0)}), "not all zero"),
        (lambda a: a.initialize(directions={("arrow", "wall"): (0, 0, 1)}), "expected 2 numbers"),
    ],
)
def test_what_cannot_be_changed_is_refused_and_changes_nothing(ask, message):
    m = turning_move(elements=2, height=3)
    avoid = avoiding(m)
    avoid.initialize()
    before = [(variable.name, pyo.value(variable)) for variable in avoid.component_data_objects(pyo.Var)]
    with pytest.raises(rcp.errors.ObstacleError, match=message):
        ask(avoid)
    assert before == [(variable.name, pyo.value(variable)) for variable in avoid.component_data_objects(pyo.Var)]


def test_a_separation_of_one_time_cannot_be_split():
    m = turning_move(elements=2, height=3)
    avoid = avoiding(m, between=None)
    with pytest.raises(rcp.errors.ObstacleError, match="one time only"):
        avoid.split("arrow", "wall", 0.0)


def normals_along_time(avoid):
    segments = avoid.record.by_part_pair()["arrow", "wall"]
    return np.array([[avoid.normal[(*segment.index, axis)].value for axis in (0, 1)] for segment in segments])


@settings(max_examples=20)
@given(height=st.floats(-1, 1), elements=st.integers(5, 20))
def test_sides_never_flip_along_time(height, elements):
    m = turning_move(elements=elements, height=height)
    avoid = avoiding(m)
    avoid.initialize()
    normals = normals_along_time(avoid)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    # A quarter turn at a time at most, up to the tilt that breaks ties.
    assert (normals[1:] * normals[:-1]).sum(axis=1).min() > -0.3
