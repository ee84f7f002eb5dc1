"""What a smooth problem is, what an answer to it is, and how answers are judged: by arrays, whoever computed them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Pair = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class SmoothProblem:
    """Least integral of a cost, by implicit Euler, from rest at zero and from an initial guess of zero.

    Attributes
    ----------
    name : str
        Of the problem and of the example that states it.
    states, controls : tuple of str
    final : tuple of (float or None)
        Of each state, at the end; None where it is free.
    state_bounds, rate_bounds, control_bounds : tuple of (lower, upper)
        Infinite where there is none. Finite bounds on rates keep derivatives as variables.
    rates : callable
        ``rates(x, u, f)`` gives the derivatives of the states, with sine and cosine of the namespace ``f``.
    cost : callable
        ``cost(x, u)`` per second.
    duration : float
        Seconds.
    elements : int
        As published.
    """

    name: str
    states: tuple[str, ...]
    controls: tuple[str, ...]
    final: tuple[float | None, ...]
    state_bounds: tuple[Pair, ...]
    rate_bounds: tuple[Pair, ...]
    control_bounds: tuple[Pair, ...]
    rates: Callable[[Sequence[Any], Sequence[Any], Any], Sequence[Any]]
    cost: Callable[[Sequence[Any], Sequence[Any]], Any]
    duration: float
    elements: int

    @property
    def keeps_rates(self) -> bool:
        """Whether derivatives are variables of their own."""
        return bool(np.isfinite(self.rate_bounds).any())


@dataclass(frozen=True)
class Answer:
    """Values, and what they cost.

    Attributes
    ----------
    x : array, shape (N + 1, n)
        States at the ends of the elements.
    u : array, shape (N, k)
        Controls in the elements.
    iterations, variables, rows : int
        Of Ipopt, and of what it was given.
    seconds : float
        CPU time from nothing to the answer.
    """

    x: np.ndarray
    u: np.ndarray
    iterations: int
    variables: int
    rows: int
    seconds: float

    def objective(self, problem: SmoothProblem) -> float:
        """Recomputed."""
        step = problem.duration / len(self.u)
        return step * sum(problem.cost(x, u) for x, u in zip(self.x[1:], self.u, strict=True))

    def residual(self, problem: SmoothProblem) -> float:
        """Largest violation of a differential equation, a bound or a boundary value."""
        step = problem.duration / len(self.u)
        slopes = np.diff(self.x, axis=0) / step
        rates = np.array([problem.rates(x, u, np) for x, u in zip(self.x[1:], self.u, strict=True)])
        ends = np.array([0.0 if last is None else self.x[-1, i] - last for i, last in enumerate(problem.final)])
        return max(
            np.abs(slopes - rates).max(),
            np.abs(self.x[0]).max(),
            np.abs(ends).max(),
            _excess(self.x[1:], problem.state_bounds),
            _excess(slopes, problem.rate_bounds),
            _excess(self.u, problem.control_bounds),
        )

    def reintegration_error(self, problem: SmoothProblem) -> float:
        """Largest difference at the end of an element, from the true motion under these controls."""
        step, state, worst = problem.duration / len(self.u), self.x[0], 0.0
        for u, wanted in zip(self.u, self.x[1:], strict=True):
            ended = solve_ivp(lambda t, x, u=u: problem.rates(x, u, np), (0, step), state, rtol=1e-9, atol=1e-11)
            state = ended.y[:, -1]
            worst = max(worst, float(np.abs(state - wanted).max()))
        return worst


def _excess(values: np.ndarray, bounds: Sequence[Pair]) -> float:
    lower, upper = np.array(bounds).T
    return float(max((lower - values).max(), (values - upper).max(), 0.0))
