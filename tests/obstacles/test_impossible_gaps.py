"""What is told to be impossible is so, and gaps that a body passes are never refused."""

import numpy as np
import pyomo.environ as pyo
import pytest
from harness.scenes import keep_clear, state_point
from hypothesis import given, settings
from hypothesis import strategies as st

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.geometry import Polytope
from pyrobocop_pyomo.obstacles.impossible_gaps import closed_gaps, gap_that_separates
from pyrobocop_pyomo.obstacles.rerouting import distance_lower_bounds, grid_distances

box = Polytope.box
seeds = st.integers(0, 10**6)


def ring(count: int, radius: float, size: float, open_by: float = 0.0) -> list[Polytope]:
    """Discs on a circle, evenly spaced but for one gap that is wider by `open_by`."""
    angles = np.linspace(0.0, 2 * np.pi - open_by / radius, count, endpoint=False)
    return [Polytope.ball(size, radius * np.array([np.cos(a), np.sin(a)])) for a in angles]


def separating_width(shapes: list[Polytope], grown: float, start: tuple, goal: tuple) -> float | None:
    gaps = closed_gaps(tuple(shapes), (grown,) * len(shapes))
    unbounded = [k for k, shape in enumerate(shapes) if not shape.is_bounded]
    found = gap_that_separates(gaps, len(shapes), np.array(start), np.array(goal), unbounded)
    return None if found is None else found.width


@settings(max_examples=25)
@given(seed=seeds, grown=st.floats(0.1, 0.5))
def test_where_a_grid_finds_a_way_nothing_is_refused(seed: int, grown: float) -> None:
    """eq-grown and eq-parity, against an independent search."""
    rng = np.random.default_rng(seed)
    shapes = []
    for _ in range(14):
        corners = rng.normal(size=(5, 2)) * rng.uniform(0.1, 0.8) + rng.uniform(-3, 3, 2)
        hull = Polytope.from_vertices(corners[rng.permutation(5)[:3]])
        shapes.append(hull.padded(0.2) if rng.random() < 0.3 else hull)
    axis = np.linspace(-6, 6, 121)
    room = distance_lower_bounds(np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2), shapes)
    cost = np.where(room.reshape(121, 121) > grown, 1.0, np.inf)
    free = np.argwhere(np.isfinite(cost))
    start = tuple(free[rng.integers(len(free))])
    # The line between two neighbouring cells that are free keeps at least this.
    gaps = closed_gaps(tuple(shapes), (grown - 0.08,) * len(shapes))
    reached = np.isfinite(grid_distances(cost, np.full(2, 0.1), start))
    for cell in free[:: max(len(free) // 40, 1)]:
        if reached[tuple(cell)]:
            assert gap_that_separates(gaps, len(shapes), axis[list(start)], axis[cell]) is None


@given(st.integers(5, 12), st.floats(0.05, 0.4), st.floats(0, 6.3), st.floats(0.01, 0.2))
def test_a_ring_is_closed_until_its_widest_gap_is_wide_enough(
    count: int, size: float, turn: float, more: float
) -> None:
    shapes = ring(count, 2.0, size, open_by=more)
    widths = [
        float(np.linalg.norm(a.vertices - b.vertices)) - 2 * size
        for a, b in zip(shapes, shapes[1:] + shapes[:1], strict=True)
    ]
    outside = 20 * np.array([np.cos(turn), np.sin(turn)])
    if min(widths) > 0:
        closed = separating_width(shapes, max(widths) / 2 * 1.01 + 1e-3, (0.0, 0.0), outside)
        assert closed == pytest.approx(max(widths), abs=1e-9)
        assert separating_width(shapes, max(widths) / 2 * 0.99 - 1e-3, (0.0, 0.0), outside) is None
    # Two places outside are never shut off from each other by it.
    assert separating_width(shapes, 1.0, outside, -outside) is None


def test_a_wall_with_a_door_between_unbounded_walls() -> None:
    left = Polytope.from_halfspaces([[1, 0], [0, 1]], [-0.2, 0.5], bounded=False)
    right = Polytope.from_halfspaces([[-1, 0], [0, 1]], [-0.2, 0.5], bounded=False)
    assert separating_width([left, right], 0.19, (0, 5), (0, -5)) is None
    below = Polytope.from_halfspaces([[-1, 0], [0, -1]], [-0.2, 0.5], bounded=False)
    post = box(0.1, 4.0, center=(0.0, 0.0))
    assert separating_width([left, below, post], 0.16 / 2, (0, 5), (0, -5)) == pytest.approx(0.15)
    assert separating_width([left, below, post], 0.14 / 2, (0, 5), (0, -5)) is None


def room_with_a_door(door: float, clearance: float = 0.05) -> pyo.ConcreteModel:
    """From outside into a room whose only door has the given width."""
    m = pyo.ConcreteModel()
    m.move = b = rcp.PhaseBlock(duration=4.0, elements=8)
    state_point(b, (-3, 0), (0, 0))
    b.initialize_straight_lines()
    side = 2.0 - door / 2
    keep_clear(
        b,
        box(0.6, 0.3),
        {
            "upper": box(0.2, side, center=(-1.5, door / 2 + side / 2)),
            "lower": box(0.2, side, center=(-1.5, -door / 2 - side / 2)),
            "rest": [box(3, 0.2, center=(0, 1.9)), box(3, 0.2, center=(0, -1.9)), box(0.2, 4, center=(1.5, 0))],
        },
        clearance=clearance,
    )
    return m


def test_a_door_that_is_too_narrow_is_told_before_a_solve() -> None:
    with pytest.raises(rcp.errors.ObstacleError, match="free width between 'upper' and 'lower' is 0.3, needed is 0.4"):
        rcp.solve(room_with_a_door(0.3))
    room_with_a_door(0.41).move.avoid.initialize()
    free_goal = room_with_a_door(0.3)
    free_goal.move.x[4.0].unfix()
    free_goal.move.avoid.initialize()
