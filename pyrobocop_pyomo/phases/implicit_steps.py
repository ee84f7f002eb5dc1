"""One element of an implicit simulation: the rows of the scheme and the residual equations, solved by SciPy.

The unknowns of an element are the states at its nodes, and the algebraics and the slopes of implicit states at those of
its stages that the element before does not share.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.numerics import Scheme
from pyrobocop_pyomo.optional_imports import scipy

from .point_model import PointEquations
from .simulation_inputs import Unknowns

Array = NDArray[np.float64]

# Relative to the size of the terms; hybr often stops above its own tolerance at a residual that is rounding.
_SOLVED = 1e-9


def step_start(
    equations: PointEquations,
    times: tuple[float, ...],
    signals: dict[str, Array],
    rates: dict[str, Array],
    i: int,
    unknowns: Unknowns,
    start: Mapping[str, float],
    near: Mapping[str, float],
) -> float | None:
    """Find algebraics and slopes at the element start, where the states are known; None, or the residual left."""

    def residuals(guess: Array) -> Array:
        return _stage(equations, times[0], start, signals, rates, i, 0, unknowns, guess)

    guess = np.array([near[f"d {name}"] for name in unknowns.implicit] + [near[n] for n in unknowns.algebraics])
    left = _solve(residuals, guess)[1]
    return None if left <= _SOLVED else left


def step_element(
    equations: PointEquations,
    scheme: Scheme,
    width: float,
    times: tuple[float, ...],
    signals: dict[str, Array],
    rates: dict[str, Array],
    i: int,
    unknowns: Unknowns,
    start: Mapping[str, float],
    near: Mapping[str, float],
) -> dict[str, Array] | float:
    """Find everything on an element; returns the states at its nodes, or the residual left."""
    names, rows, stages = list(start), len(scheme.D), scheme.stages
    new = list(range(1 if scheme.starts_on_a_stage else 0, stages))
    first = 0 if scheme.starts_on_a_stage else 1
    per_stage = len(unknowns.implicit) + len(unknowns.algebraics)

    def nodes_of(guess: Array) -> dict[str, Array]:
        inner = guess[: rows * len(names)].reshape(len(names), rows)
        return {name: np.concatenate([[start[name]], inner[j]]) for j, name in enumerate(names)}

    def residuals(guess: Array) -> Array:
        nodes = nodes_of(guess)
        of_stages = guess[rows * len(names) :].reshape(len(new), per_stage)
        left = [
            _stage(
                equations, times[k], {name: float(nodes[name][first + k]) for name in names},
                signals, rates, i, k, unknowns, of_stages[j],
            )
            for j, k in enumerate(new)
        ]  # fmt: skip
        left += [scheme.D @ nodes[name] - width * (scheme.F @ rates[name][i]) for name in names]
        return np.concatenate(left) if left else np.empty(0)

    slopes = {
        name: float(rates[name][i, 0]) if scheme.starts_on_a_stage else near.get(f"d {name}", 0.0) for name in names
    }
    guess = [start[name] + width * slopes[name] * tau for name in names for tau in scheme.state_nodes[1:]]
    guess += [near[key] for _ in new for key in (*(f"d {n}" for n in unknowns.implicit), *unknowns.algebraics)]
    found, left = _solve(residuals, np.array(guess, dtype=float))
    return nodes_of(found) if left <= _SOLVED else left


def _stage(
    equations: PointEquations,
    time: float,
    states: Mapping[str, float],
    signals: dict[str, Array],
    rates: dict[str, Array],
    i: int,
    k: int,
    unknowns: Unknowns,
    guess: Array,
) -> Array:
    """Residual equations at a stage; stores what was tried in signals and rates."""
    implicit, algebraics = unknowns.implicit, unknowns.algebraics
    for name, slope in zip(implicit, guess[: len(implicit)].tolist(), strict=True):
        rates[name][i, k] = slope
    for name, number in zip(algebraics, guess[len(implicit) :].tolist(), strict=True):
        signals[name][i, k] = number
    values = {**states, **{name: float(each[i, k]) for name, each in signals.items()}}
    slopes = {name: float(rates[name][i, k]) for name in implicit}
    explicit = equations.rates(time, values, slopes)
    for name, rate in explicit.items():
        rates[name][i, k] = rate
    return np.array(equations.residuals(time, {**slopes, **explicit}), dtype=float)


def _solve(residuals: Any, guess: Array) -> tuple[Array, float]:
    """The root next to an initial guess, and the largest residual there relative to the largest value."""
    if len(guess) == 0:
        residuals(guess)
        return guess, 0.0
    left = np.inf
    for method in ("hybr", "lm"):
        answer = scipy.optimize.root(residuals, guess, method=method, tol=1e-13)
        # Asked once more, since the last call of a method need not be at its answer.
        left = float(np.abs(residuals(answer.x)).max() / (1.0 + np.abs(answer.x).max()))
        if left <= _SOLVED:
            break
    return answer.x, left if np.isfinite(left) else np.inf
