"""The mean of a Gaussian process with its derivatives, in NumPy: a model learned from data, as an `rcp.Function`.

`maze.py` learns the friction of a ball with it. It is no part of the package: whatever gives values and derivatives at
many points can be such a function.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

import pyrobocop_pyomo as rcp

Array = NDArray[np.float64]

# Hyperparameters are found on so many of the data: the time grows with the third power.
_MOST_POINTS = 400


class GaussianProcessMean:
    """``m(x) = offset + signal**2 * sum_j weight_j * exp(-1/2 * sum_d ((x_d - centre_jd) / length_scale_d)**2)``.

    Parameters
    ----------
    centres : float array, shape (centres, inputs)
    weights : float array, shape (centres,)
    length_scales : float array, shape (inputs,)
    signal : float
        Standard deviation of the prior.
    offset : float
        Mean of the prior.

    Attributes
    ----------
    centres, weights, length_scales, signal, offset
        As given.
    noise : float or None
        Standard deviation of the noise that `fit` used.

    Notes
    -----
    Rasmussen & Williams, Gaussian Processes for Machine Learning, MIT Press 2006, eq. 2.23 and 2.25 for the mean, eq.
    5.8 and 5.9 for the marginal likelihood and its gradient.
    """

    def __init__(
        self, centres: ArrayLike, weights: ArrayLike, length_scales: ArrayLike, signal: float = 1.0, offset: float = 0.0
    ) -> None:
        self.centres = centres = np.array(centres, dtype=float, ndmin=2)
        self.length_scales = self._lengths = np.array(length_scales, dtype=float)
        self.weights, self.signal, self.offset = np.array(weights, dtype=float), float(signal), float(offset)
        self._weights = self.signal**2 * self.weights
        self.noise: float | None = None
        # Around their middle: the second derivatives are differences of moments about the origin.
        self._middle = centres.mean(axis=0)
        self._centres = (centres - self._middle) / self._lengths
        self._products = (self._centres[:, :, None] * self._centres[:, None, :]).reshape(len(centres), -1)
        self._last: tuple[Array, Array, Array] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_last": None}

    @classmethod
    def fit(
        cls,
        inputs: ArrayLike,
        targets: ArrayLike,
        *,
        length_scales: ArrayLike | None = None,
        signal: float | None = None,
        noise: float | None = None,
    ) -> GaussianProcessMean:
        """The mean given data, around the mean of the targets.

        Parameters
        ----------
        inputs : float array, shape (data, inputs)
        targets : float array, shape (data,)
        length_scales : float array, shape (inputs,), optional
        signal, noise : float, optional
            Standard deviations. What is not given maximises the marginal likelihood of up to 400 of the data.

        """
        inputs, targets = np.array(inputs, dtype=float, ndmin=2), np.array(targets, dtype=float)
        offset = float(targets.mean())
        residuals = targets - offset
        if length_scales is None or signal is None or noise is None:
            chosen = np.unique(np.linspace(0, len(inputs) - 1, _MOST_POINTS).astype(int))
            length_scales, signal, noise = _most_likely(inputs[chosen], residuals[chosen], length_scales, signal, noise)
        lengths = np.array(length_scales, dtype=float)
        scaled = inputs / lengths
        covariance = signal**2 * _kernel(scaled, scaled)
        covariance.flat[:: len(inputs) + 1] += noise**2
        factor = cho_factor(covariance, lower=True, overwrite_a=True)
        found = cls(inputs, cho_solve(factor, residuals), lengths, signal, offset)
        found.noise = float(noise)
        return found

    def _terms(self, points: Array) -> tuple[Array, Array]:
        """Scaled points and the terms of the sum, shapes (points, inputs) and (points, centres)."""
        if self._last is None or self._last[0].shape != points.shape or not np.array_equal(self._last[0], points):
            scaled = (points - self._middle) / self._lengths
            self._last = np.array(points), scaled, _kernel(scaled, self._centres) * self._weights
        return self._last[1:]

    def value(self, points: Array) -> Array:
        """The mean at many points, shape (points,)."""
        return self.offset + self._terms(points)[1].sum(axis=1)

    def jacobian(self, points: Array) -> Array:
        """First derivatives, shape (points, inputs)."""
        scaled, terms = self._terms(points)
        return (terms @ self._centres - terms.sum(axis=1)[:, None] * scaled) / self._lengths

    def hessian(self, points: Array) -> Array:
        """Second derivatives, shape (points, inputs, inputs)."""
        scaled, terms = self._terms(points)
        total, first = terms.sum(axis=1), terms @ self._centres
        d = scaled.shape[1]
        mixed = first[:, :, None] * scaled[:, None, :]
        found = (terms @ self._products).reshape(-1, d, d) - mixed - mixed.swapaxes(1, 2)
        found += total[:, None, None] * (scaled[:, :, None] * scaled[:, None, :] - np.eye(d))
        return found / (self._lengths[:, None] * self._lengths)

    def as_function(self, name: str = "learned", inputs: Sequence[str] | None = None) -> rcp.Function:
        """The mean as a function that models may call, with exact derivatives.

        Parameters
        ----------
        name : str
        inputs : sequence of str, optional
            Names of the inputs.
        """
        return rcp.Function(
            self.value,
            self.jacobian,
            self.hessian,
            inputs=self._lengths.size if inputs is None else inputs,
            name=name,
        )


def _kernel(first: Array, second: Array) -> Array:
    return np.exp(-0.5 * cdist(first, second, "sqeuclidean"))


def _most_likely(
    inputs: Array, residuals: Array, length_scales: ArrayLike | None, signal: float | None, noise: float | None
) -> tuple[Array, float, float]:
    """The hyperparameters that are not given, by maximising the marginal likelihood in their logarithms."""
    n, d = inputs.shape
    spread = np.maximum(inputs.std(axis=0), 1e-8)
    deviation = max(float(residuals.std()), 1e-8)
    start = np.concatenate(
        [
            2.0 * spread if length_scales is None else np.array(length_scales, dtype=float),
            [deviation if signal is None else signal, 0.1 * deviation if noise is None else noise],
        ]
    )
    free = np.concatenate([np.full(d, length_scales is None), [signal is None, noise is None]])
    logarithms = np.log(start)

    def negative_likelihood(chosen: Array) -> tuple[float, Array]:
        theta = logarithms.copy()
        theta[free] = chosen
        lengths, deviations = np.exp(theta[:d]), np.exp(2 * theta[d:])
        scaled = inputs / lengths
        covariance = deviations[0] * _kernel(scaled, scaled)
        noisy = covariance + (deviations[1] + 1e-10 * deviations[0]) * np.eye(n)
        factor = cho_factor(noisy, lower=True)
        alpha = cho_solve(factor, residuals)
        inner = cho_solve(factor, np.eye(n)) - np.outer(alpha, alpha)
        weighted = inner * covariance
        by_lengths = [0.5 * np.sum(weighted * (x[:, None] - x) ** 2) for x in scaled.T]
        gradient = np.array([*by_lengths, weighted.sum(), deviations[1] * np.trace(inner)])
        value = 0.5 * residuals @ alpha + np.log(np.diag(factor[0])).sum()
        return float(value), gradient[free]

    # Within factors of a thousand: beyond, an input or the noise means nothing to the data.
    bounds = [(center - 7.0, center + 7.0) for center in logarithms[free]]
    found = minimize(
        negative_likelihood, logarithms[free], jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60}
    )
    logarithms[free] = found.x
    theta = np.exp(logarithms)
    return theta[:d], float(theta[d]), float(theta[d + 1])
