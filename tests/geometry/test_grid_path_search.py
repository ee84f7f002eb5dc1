"""Shortest paths on grids have the length of steps across faces, edges and corners, and pass no impassable cell."""

import numpy as np
import pytest

from pyrobocop_pyomo.obstacles.rerouting import grid_distances, grid_path


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_distances_on_an_open_grid(dimension: int) -> None:
    """The longest diagonals come first: a step advances along all axes on which the cell is not reached yet."""
    start = (1, 2, 0)[:dimension]
    shape = (5, 6, 4)[:dimension]
    found = grid_distances(np.ones(shape), np.full(dimension, 0.5), start)
    for cell in np.ndindex(*shape):
        offsets = np.sort(np.abs(np.subtract(cell, start)))
        steps = np.diff(offsets, prepend=0)
        assert found[cell] == pytest.approx(0.5 * (steps * np.sqrt(np.arange(dimension, 0, -1))).sum())


def test_a_path_is_as_long_as_its_distance_and_avoids_what_is_impassable() -> None:
    cost = np.ones((6, 7))
    cost[3, :5] = np.inf
    spacing = np.array([1.0, 2.0])
    path = grid_path(cost, spacing, (0, 0), (5, 1))
    assert path is not None
    assert path[0].tolist() == [0, 0]
    assert path[-1].tolist() == [5, 1]
    assert np.isfinite(cost[tuple(path.T)]).all()
    assert np.abs(np.diff(path, axis=0)).max() == 1
    length = np.linalg.norm(np.diff(path, axis=0) * spacing, axis=1).sum()
    assert length == pytest.approx(grid_distances(cost, spacing, (0, 0))[5, 1])


def test_a_closed_wall_has_no_path() -> None:
    cost = np.ones((5, 4))
    cost[2] = np.inf
    assert grid_path(cost, np.ones(2), (0, 0), (4, 0)) is None
    assert np.isinf(grid_distances(cost, np.ones(2), (0, 0))[3:]).all()
