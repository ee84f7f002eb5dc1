"""Shortest paths on grids in any dimension, by Dijkstra's method over faces, edges and corners of the cells."""

from __future__ import annotations

import itertools

import numpy as np

from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.optional_imports import scipy


def grid_distances(cost: Array, spacing: Array, start: tuple[int, ...]) -> Array:
    """Length of the shortest path from one cell to every cell.

    Parameters
    ----------
    cost : (n_1, ..., n_d) array
        Factor of lengths in each cell; infinite where nothing may pass.
    spacing : (d,) array
        From one cell to the next, along each axis.
    start : d integers

    Returns
    -------
    (n_1, ..., n_d) array
        Infinite where no path leads.
    """
    numbers = np.arange(cost.size).reshape(cost.shape)
    found = scipy.sparse.csgraph.dijkstra(_graph(cost, spacing), directed=False, indices=numbers[start])
    return np.asarray(found).reshape(cost.shape)


def grid_path(cost: Array, spacing: Array, start: tuple[int, ...], goal: tuple[int, ...]) -> Indices | None:
    """Cells (k, d) of the shortest path from start to goal, see `grid_distances`; None if there is none."""
    numbers = np.arange(cost.size).reshape(cost.shape)
    _, before = scipy.sparse.csgraph.dijkstra(
        _graph(cost, spacing), directed=False, indices=numbers[start], return_predecessors=True
    )
    cells = [int(numbers[goal])]
    while cells[-1] != numbers[start]:
        cells.append(int(before[cells[-1]]))
        if cells[-1] < 0:
            return None
    return np.column_stack(np.unravel_index(cells[::-1], cost.shape))


def _graph(cost: Array, spacing: Array) -> scipy.sparse.csr_array:
    numbers = np.arange(cost.size, dtype=np.int32).reshape(cost.shape)  # SciPy 1.14 searches no graph of larger ones
    origins, targets, lengths = [], [], []
    for step in itertools.product((-1, 0, 1), repeat=cost.ndim):
        if step <= (0,) * cost.ndim:
            continue  # the other half of the neighbours are these, seen from the other end
        here = tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(step, cost.shape, strict=True))
        there = tuple(slice(max(0, d), n - max(0, -d)) for d, n in zip(step, cost.shape, strict=True))
        length = np.linalg.norm(np.array(step) * spacing) * 0.5 * (cost[here] + cost[there])
        passable = np.isfinite(length)
        origins.append(numbers[here][passable])
        targets.append(numbers[there][passable])
        lengths.append(length[passable])
    entries = np.concatenate(lengths), (np.concatenate(origins), np.concatenate(targets))
    return scipy.sparse.coo_array(entries, shape=(cost.size, cost.size)).tocsr()
