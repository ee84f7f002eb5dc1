"""Entries of sparse matrices that are added up in the same places again and again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .nonlinear_program import FloatArray, IndexArray


def summed(places: np.ndarray, blocks: Sequence[FloatArray], size: int) -> FloatArray:
    """The entries of all blocks, one after the other, added up in their places."""
    if not blocks:
        return np.zeros(size)
    # bincount adds repeated places up in one pass, several times faster than add.at.
    weights = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    return np.bincount(places, weights, size).astype(float, copy=False)


def merged_places(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]], n: int
) -> tuple[tuple[IndexArray, IndexArray], np.ndarray]:
    """Each pair of a row and a column once, and the place among them of every pair given; n columns."""
    rows = np.concatenate([np.empty(0, dtype=np.intp), *(row for row, _ in pairs)])
    columns = np.concatenate([np.empty(0, dtype=np.intp), *(column for _, column in pairs)])
    keys, places = np.unique(rows * n + columns, return_inverse=True)
    return ((keys // n).astype(np.int32), (keys % n).astype(np.int32)), places.ravel()


def ranges(starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """The integers from each start on, as many as counted, one after the other."""
    ends = np.cumsum(counts)
    total = int(ends[-1]) if ends.size else 0
    return np.arange(total) + np.repeat(starts - (ends - counts), counts)
