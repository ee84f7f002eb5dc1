"""What the data say of estimates: covariance, intervals, and which combinations are not seen. Arrays only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

BARELY_SEEN = 1e-6  # relative singular value, up to which a combination is hardly seen
SHARE = 0.05  # of a combination, from which on a parameter is named in it


class UnseenCombination(NamedTuple):
    """A combination of unknowns along which the outputs hardly move.

    Attributes
    ----------
    names : tuple of str
    shares : tuple of float
        Of each in a direction of unit length, in relative changes.
    singular_value : float
        Relative to the largest.
    """

    names: tuple[str, ...]
    shares: tuple[float, ...]
    singular_value: float

    def __str__(self) -> str:
        parts = [f"{share:+.2g} '{name}'" for name, share in zip(self.names, self.shares, strict=True)]
        return " ".join(parts).lstrip("+").strip()


def unseen_combinations(matrix: Array, scales: Array, names: Sequence[str]) -> list[UnseenCombination]:
    """Directions in which the weighted outputs hardly move, for changes of the unknowns relative to their scales.

    Parameters
    ----------
    matrix : array, shape (outputs, unknowns)
        Derivatives of the outputs, each over its standard deviation.
    scales : array, shape (unknowns,)
        Sizes of the unknowns.
    names : sequence of str
    """
    _, sizes, directions = np.linalg.svd(matrix * scales, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(len(names) - sizes.size)])
    shares = sizes / max(float(sizes.max(initial=0.0)), 1e-300)
    found = []
    for size, direction in zip(shares.tolist(), directions, strict=True):
        if size <= BARELY_SEEN:
            order = np.argsort(-np.abs(direction), kind="stable")
            order = order[np.abs(direction[order]) >= SHARE]
            parts = direction[order] * np.sign(direction[order[0]])
            found.append(UnseenCombination(tuple(names[i] for i in order), tuple(parts.tolist()), size))
    return found


def covariance_of(matrix: Array, variance: float = 1.0) -> Array:
    """Covariance of a least-squares estimate of unknowns, to first order.

    Parameters
    ----------
    matrix : array, shape (outputs, unknowns)
        Derivatives S of the outputs, each over its standard deviation, or over what is in proportion to it.
    variance : float
        Of the outputs after this division.

    Returns
    -------
    array, shape (unknowns, unknowns)
        ``variance (S'S)^-1``; infinite in what the data do not see.
    """
    sizes = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    # By the singular values of S and not by the inverse of S'S, which has twice as few digits.
    _, values, right = np.linalg.svd(matrix / sizes, full_matrices=len(matrix) < len(sizes))
    rank = int((values > 1e-11 * values.max(initial=1e-300)).sum())
    root = (right[:rank].T / values[:rank]) / sizes[:, None]
    found: Array = variance * root @ root.T
    # An unknown that takes part in a combination that is not seen may be anything.
    unseen = np.flatnonzero(np.abs(right[rank:]).max(axis=0, initial=0.0) > 1e-6)
    found[unseen, :] = found[:, unseen] = np.nan
    found[unseen, unseen] = np.inf
    return found


def quantile(level: float, freedom: int | None) -> float:
    """How many standard errors an interval reaches to either side; Student's t with a freedom, else normal."""
    tail = 0.5 + level / 2
    return float(scipy.special.ndtri(tail) if freedom is None else scipy.special.stdtrit(max(freedom, 1), tail))
