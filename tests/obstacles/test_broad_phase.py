"""What the broad phase leaves out by itself, what it brings back, and that the plan is one of the whole problem."""

from typing import Any

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import keep_clear, state_point
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.obstacles.avoidance_record import Snapshot
from pyrobocop_pyomo.obstacles.broad_phase import EARLIER_OR_LATER, least_reach, swept_distances

box = Polytope.box
CART = box(0.6, 0.3)


def field(
    obstacles: Any, elements: int = 20, height: float = 0.0, side: float = 10.0, clearance: Any = 0.05, **options: Any
) -> Any:
    """From left to right; the initial guess is an arc of the given height."""
    m = pyo.ConcreteModel(name="field")
    m.move = b = rcp.PhaseBlock(duration=5.0, elements=elements, stages=1)
    state_point(b, end=(side, 0))
    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.u[t] ** 2 + b.v[t] ** 2))
    b.initialize_straight_lines()
    b.initialize({"y": lambda t: height * np.sin(np.pi * t / 5.0)})
    keep_clear(b, CART, obstacles, clearance=clearance, **options)
    return m


def rows_of_rocks(count: int = 12, at: tuple[float, ...] = (-4.0, -2.0, 2.0, 4.0)) -> list[Polytope]:
    return [Polytope.regular_polygon(5, 0.4, center=(x, y)) for x in np.linspace(0, 10, count) for y in at]


def test_few_separations_are_all_kept() -> None:
    m = field([box(1, 1, center=(5, 50 + k)) for k in range(10)], elements=20)
    assert len(m.move.avoid.separations) == 200
    assert len(field([box(1, 1, center=(5, 50 + k)) for k in range(11)], elements=20).move.avoid.separations) == 0


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_what_is_left_out_is_beyond_the_reach(seed: int) -> None:
    """eq-broad-phase: kept are the segments within the reach, and those next to them in time."""
    rng = np.random.default_rng(seed)
    rocks = [Polytope.regular_polygon(4, 0.3, center=rng.uniform((0, -5), (10, 5))) for _ in range(15)]
    m = field(rocks, elements=25)
    record = m.move.avoid.record
    snapshot = Snapshot(record, "field")
    everywhere = [*record.segments.values(), *record.pruned.values()]
    distances, _ = swept_distances(snapshot, everywhere)
    reach = least_reach(record) + max(-distances.min(), 0.0)
    assert least_reach(record) == pytest.approx(0.1 + np.hypot(0.6, 0.3))
    near = {s.index for s, distance in zip(everywhere, distances, strict=True) if distance <= reach}
    beside = int(np.ceil(EARLIER_OR_LATER * 25))
    wanted = {
        segment.index
        for segment in everywhere
        if any(
            other.index in near and other.second == segment.second and abs(other.interval - segment.interval) <= beside
            for other in everywhere
        )
    }
    assert set(record.segments) == wanted


def test_distances_of_all_segments_at_once_are_those_of_each() -> None:
    m = field(rows_of_rocks(4), elements=6)
    record = m.move.avoid.record
    segments = [*record.segments.values(), *record.pruned.values()]
    distances, normals = swept_distances(Snapshot(record, "field"), segments)
    for segment, distance, normal in zip(segments, distances, normals, strict=True):
        shape = record.scene.parts[segment.second].shape
        # Between the poses the hull may be nearer than at any of them, never farther away.
        poses = [rcp.planar_pose(m.move.x[t], m.move.y[t]) for t in segment.times]
        exact = [rcp.scenes.signed_distance(CART, shape, pose).distance for pose in poses]
        assert distance <= min(exact) + 1e-12
        first, second = Snapshot(record, "field").placed_pair(segment)
        reach = (first.vertices @ normal).min() - (second.vertices @ normal).max()
        assert reach == pytest.approx(distance, abs=1e-9)


def test_a_block_without_a_guess_is_not_built_in_full() -> None:
    m = pyo.ConcreteModel()
    m.t = pyo.Set(initialize=range(51), ordered=True)
    m.x, m.y = pyo.Var(m.t), pyo.Var(m.t)
    options: dict[str, Any] = {"body": CART, "pose": lambda b, t: rcp.planar_pose(b.x[t], b.y[t]), "clearance": 0.05}
    m.many = rcp.ObstacleAvoidanceBlock(m.t, obstacles=rows_of_rocks(12), **options)
    assert len(m.many.separations) == 0
    assert len(m.many.record.pruned) == 48 * 50
    m.few = rcp.ObstacleAvoidanceBlock(m.t, obstacles=rows_of_rocks(6), **options)
    assert len(m.few.separations) == 24 * 50


def test_nothing_is_left_out_where_the_clearance_is_to_be_found() -> None:
    far = [box(1, 1, center=(5, 50 + k)) for k in range(11)]
    room = pyo.Var(bounds=(0.05, None), initialize=0.05)
    room.construct()
    m = field(far, clearance=room)
    assert len(m.move.avoid.separations) == 220


@pytest.mark.casadi
def test_a_straight_line_through_several_obstacles_is_led_around_them() -> None:
    rocks = [*rows_of_rocks(6, (-2.5, 2.5)), box(0.5, 1.5, center=(3, 0.4)), box(0.5, 1.5, center=(7, -0.4))]
    m = field(rocks, elements=16)
    result = rcp.solve(m)
    assert result.safe
    assert result.rounds[0].purpose == "led around all obstacles"
    # Where the user says where to pass, the guess is taken as it is.
    m = field(rocks, elements=16)
    m.move.avoid.initialize(directions={("body", "obstacle 13"): (0, 1)})
    assert rcp.solve(m).rounds[0].purpose == "from the initial guess"
