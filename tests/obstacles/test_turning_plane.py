"""A plane whose normal is linear in time: rows, bounds, start values and plans."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import ARROW, WALL, avoiding, exact, set_poses, turning_move
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp

NUMBER = st.floats(-3, 3)
MODELS: dict[str, Any] = {}


def model() -> Any:
    if "one" not in MODELS:
        m = turning_move(elements=2)
        for state in (m.move.x, m.move.y, m.move.theta):
            state.unfix()
        avoiding(m, obstacles={"wall": WALL}, formulation="turning plane")
        MODELS["one"] = m
    return MODELS["one"]


@settings(max_examples=40)
@given(
    poses=st.lists(NUMBER, min_size=15, max_size=15),
    angles=st.tuples(st.floats(0, 6.3), st.floats(0, 6.3)),
    lengths=st.tuples(st.floats(0.2, 1.0), st.floats(0.2, 1.0)),
)
def test_no_turning_plane_proves_more_than_the_distance(
    poses: list[float], angles: tuple[float, float], lengths: tuple[float, float]
) -> None:
    m = model()
    avoid = m.move.avoid
    set_poses(m.move, np.resize(np.array(poses), (len(m.move.time), 3)))
    for index in avoid.separations:
        for end in (0, 1):
            normal = lengths[end] * np.array([np.cos(angles[end]), np.sin(angles[end])])
            for axis in (0, 1):
                avoid.end_normal[(*index, end, axis)].set_value(normal[axis], skip_validation=True)
    for index, gap in avoid.separation_gaps().items():
        segment = avoid.record.segments[index]
        assert gap <= min(exact(m.move, ARROW, WALL, list(segment.times))) + 1e-8


@settings(max_examples=40)
@given(poses=st.lists(NUMBER, min_size=15, max_size=15), turn=st.floats(-1.0, 1.0), offset=NUMBER)
def test_rows_that_hold_prove_what_is_required_and_normals_are_never_longer_than_one(
    poses: list[float], turn: float, offset: float
) -> None:
    """eq-turning-plane and eq-turning-length, with the rows evaluated by Pyomo."""
    m = model()
    avoid = m.move.avoid
    set_poses(m.move, np.resize(np.array(poses), (len(m.move.time), 3)))
    avoid.initialize()
    for index in avoid.separations:
        normals, offsets = avoid.record.formulation.ends(avoid, index)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        for axis, entry in enumerate(rotation @ normals[1]):
            avoid.end_normal[(*index, 1, axis)].set_value(entry, skip_validation=True)
        avoid.end_offset[(*index, 1)].set_value(offsets[1] + 0.1 * offset)
        segment = avoid.record.segments[index]
        rows = [
            row
            for name in ("first_shape", "second_shape")
            for key, row in getattr(avoid, name).items()
            if key[:3] == index
        ]
        violation = max(
            max(0.0, (row.lb or 0.0) - pyo.value(row.body)) if row.has_lb() else max(0.0, pyo.value(row.body))
            for row in rows
        )
        distances = exact(m.move, ARROW, WALL, list(segment.times))
        if violation <= 1e-9:
            assert min(distances) >= pyo.value(avoid.required[index]) - 1e-8
        ends = avoid.record.formulation.ends(avoid, index)[0]
        between = [np.linalg.norm((1 - s) * ends[0] + s * ends[1]) for s in np.linspace(0, 1, 11)]
        assert max(between) <= 1.0 + 1e-12


def test_the_gap_along_chords_bends_by_the_product_of_turn_and_way() -> None:
    """eq-turning-chord."""
    random = np.random.default_rng(4)
    normals, points = random.normal(size=(2, 2, 3))
    for s in np.linspace(0, 1, 7):
        normal, point = (1 - s) * normals[0] + s * normals[1], (1 - s) * points[0] + s * points[1]
        bent = s * (1 - s) * (normals[1] - normals[0]) @ (points[1] - points[0])
        assert normal @ point == pytest.approx((1 - s) * normals[0] @ points[0] + s * normals[1] @ points[1] - bent)


@pytest.mark.ipopt
def test_a_turning_plane_costs_no_more_than_one_that_stands_still() -> None:
    costs = {}
    for formulation in ("plane", "turning plane"):
        m = turning_move(elements=4)
        avoiding(m, obstacles={"wall": WALL}, formulation=formulation)
        m.move.avoid.initialize()
        costs[formulation] = rcp.solve(m).rounds[0].objective
        if formulation == "turning plane":
            assert rcp.solve(m).safe
    # Equal normals at both ends are the plane that stands still: on the same mesh it is one of the choices.
    assert costs["turning plane"] <= costs["plane"] + 1e-6


@pytest.mark.ipopt
def test_halves_of_a_turning_plane_keep_the_plan_safe() -> None:
    m = turning_move(elements=3)
    avoid = avoiding(m, obstacles={"wall": WALL}, formulation="turning plane")
    avoid.initialize()
    halves = avoid.split(*next(iter(avoid.separations)))
    assert [avoid.record.segments[half].local_times[0] for half in halves] == [0.0, 0.0]
    assert [avoid.record.segments[half].local_times[-1] for half in halves] == [1.0, 1.0]
    pyo.SolverFactory("pyrobocop.ipopt").solve(m)
    assert min(avoid.separation_gaps().values()) > pyo.value(next(iter(avoid.clearance.values()))) - 1e-6
