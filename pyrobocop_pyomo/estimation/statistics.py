"""What the data say of estimates: covariance, intervals, and which combinations are not seen. Arrays only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

UNSEEN = 1e-9  # relative singular value, up to which a combination is not seen at all
BARELY_SEEN = 1e-6  # up to which it is hardly seen
SHARE = 0.05  # of a combination, from which on a parameter is named in it


@dataclass(frozen=True, eq=False)
class UnseenCombination:
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


def unseen_combinations(
    matrix: Array, scales: Array, names: Sequence[str], threshold: float = BARELY_SEEN
) -> list[UnseenCombination]:
    """Directions in which the weighted outputs hardly move, for changes of the unknowns relative to their scales.

    Parameters
    ----------
    matrix : array, shape (outputs, unknowns)
        Derivatives of the outputs, each over its standard deviation.
    scales : array, shape (unknowns,)
        Sizes of the unknowns.
    names : sequence of str
    threshold : float
        Relative singular value.
    """
    scaled = matrix * scales
    if not scaled.size:
        return []
    _, sizes, directions = np.linalg.svd(scaled, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(len(names) - sizes.size)])
    largest = max(float(sizes.max(initial=0.0)), 1e-300)
    found = []
    for size, direction in zip(sizes.tolist(), directions, strict=True):
        if size <= threshold * largest:
            order = np.argsort(-np.abs(direction), kind="stable")
            order = order[np.abs(direction[order]) >= SHARE]
            sign = np.sign(direction[order[0]])
            found.append(
                UnseenCombination(
                    tuple(names[i] for i in order), tuple((sign * direction[order]).tolist()), size / largest
                )
            )
    return found


def covariance_of(matrix: Array, weights: Array, variances: Array) -> Array:
    """Covariance of a weighted least-squares estimate of unknowns, to first order.

    Parameters
    ----------
    matrix : array, shape (outputs, unknowns)
        Derivatives S of the outputs.
    weights : array, shape (outputs,)
        Weights w of the squared residuals.
    variances : array, shape (outputs,)
        Of the independent errors.

    Returns
    -------
    array, shape (unknowns, unknowns)
        ``(S'WS)^-1 S'W V W S (S'WS)^-1``; infinite in what the data do not see.
    """
    count = matrix.shape[1]
    if not count:
        return np.zeros((0, 0))
    root = np.sqrt(weights)[:, None] * matrix
    sizes = np.maximum(np.linalg.norm(root, axis=0), 1e-300)
    # By the singular values of S and not by the inverse of S'S, which has twice as few digits.
    left, values, right = np.linalg.svd(root / sizes, full_matrices=root.shape[0] < count)
    rank = int((values > 1e-11 * values.max(initial=1e-300)).sum())
    pseudo = (right[:rank].T / values[:rank]) @ left[:, :rank].T / sizes[:, None]
    spread = np.sqrt(weights * variances)
    found = np.asarray((pseudo * spread) @ (pseudo * spread).T)
    # An unknown that takes part in a combination that is not seen may be anything.
    unseen = np.flatnonzero(np.abs(right[rank:]).max(axis=0, initial=0.0) > 1e-6)
    found[unseen, :] = found[:, unseen] = np.nan
    found[unseen, unseen] = np.inf
    return found


def quantile(level: float, freedom: int | None) -> float:
    """How many standard errors an interval reaches to either side; Student's t with a freedom, else normal."""
    tail = 0.5 + level / 2
    if freedom is None:
        return float(scipy.special.ndtri(tail))
    return float(scipy.special.stdtrit(max(freedom, 1), tail))


def correlation_of(covariance: Array) -> Array:
    """Correlations; NaN where a variance is not finite or zero."""
    deviations = np.sqrt(np.diag(covariance))
    with np.errstate(all="ignore"):
        found = covariance / np.outer(deviations, deviations)
    return np.where(np.isfinite(found), found, np.nan)
