"""How much smaller the integrand of the Lagrangian could be at an instant, if the controls were free there.

A mesh places its controls at the stages, and what restrains them as well: between the stages the polynomials of the
controls neither make the integrand stationary nor meet the rows. Given the states and costates of an instant, a
quadratic model of the integrand is minimised over the controls, inside their bounds and the linearised inequalities
that they can meet.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.reintegration import SMALLEST_SCALE

# Of differences, relative to what changes; and below which part of the integrand a curvature counts as none.
_STEP, _FLAT = 1e-4, 1e-6
_SWEEPS = 12
# Newton's steps from one start, each followed by a look whether it made the integrand smaller.
_STEPS = 3

Values = Mapping[str, Array]


# A quadratic model of the integrand about some values of the controls: its value, slopes and curvatures.
_Model = tuple[Array, list[Array], list[list[Any]]]


def least_integrand(instants: Any, starts: Values) -> Array:
    """The least integrand inside the bounds that is found from some values of the controls.

    Parameters
    ----------
    instants : ElementInstants
        With the integrand and the limits of controls, and without rows that these can meet.
    starts : dict of name to array, shape (k, q, N)
        Controls of the answer, and where else to look from: what is no quadratic function has more than one valley.
    """
    # Between the stages a polynomial may leave its bounds; what it gains there is no gain.
    values = {name: np.clip(of, *instants.limits(name)) for name, of in starts.items()}
    level = instants.integrand(values)
    for _ in range(_STEPS):
        before, change = values, _least_change(instants, values, _model(instants, values, apart=False), [])
        for part in (1.0, 0.25):
            tried = {name: before[name] + part * of for name, of in zip(before, change, strict=True)}
            found = instants.integrand(tried)
            better = np.isfinite(found) & (found < level)
            level = np.where(better, found, level)
            values = {name: np.where(better, tried[name], of) for name, of in values.items()}
    best = np.where(np.isfinite(level), level, np.inf).min(axis=0)
    return np.where(np.isfinite(best), best, instants.integrand({name: of[0] for name, of in starts.items()}))


def least_integrand_within_rows(instants: Any, here: Values) -> Array:
    """The least value of the quadratic model of the integrand, within the linearised inequalities.

    Parameters
    ----------
    instants : ElementInstants
        With the integrand, and the limits and rows of controls.
    here : dict of name to array, shape (q, N)
        Controls of the answer.
    """
    full, _, curvature = _model(instants, here, apart=False)
    level, slope, _ = _model(instants, here, apart=True)
    gradients = []
    for name, size in zip(here, _sizes(here), strict=True):
        step = _STEP * size
        up, down = (instants.own_rows({**here, name: here[name] + change}) for change in (step, -step))
        gradients.append([(a[0] - b[0]) / (2.0 * step) for a, b in zip(up, down, strict=True)])
    rows = [(*row, [of[i] for of in gradients]) for i, row in enumerate(instants.own_rows(here))]
    change = _least_change(instants, here, (level, slope, curvature), rows)
    value = level + sum(each * of for each, of in zip(slope, change, strict=True))
    value = value + 0.5 * sum(curvature[j][k] * a * b for j, a in enumerate(change) for k, b in enumerate(change))
    return np.where(np.isfinite(value), value, full)


def _least_change(
    instants: Any, values: Values, model: _Model, rows: list[tuple[Array, Array, Array, list[Array]]]
) -> list[Array]:
    """The change of each control that minimises a model inside bounds and rows, by sweeps over the controls.

    A row is left to the other controls where this one would have to change by more than its size to meet it.
    """
    (level, slope, curvature), sizes = model, _sizes(values)
    change = [np.zeros(level.shape) for _ in values]
    limits = [[side - values[name] for side in instants.limits(name)] for name in values]
    flat = _FLAT * (_largest(level) + 1e-300)

    def of_others(slopes: list[Any], j: int) -> Any:
        return sum(slope * change[k] for k, slope in enumerate(slopes) if k != j)

    for _ in range(_SWEEPS if len(change) > 1 else 1):
        for j, (lower, upper) in enumerate(limits):
            for body, least, largest, slopes in rows:
                sides = [(side - body - of_others(slopes, j)) / slopes[j] for side in (least, largest)]
                low, high = np.fmin(*sides), np.fmax(*sides)
                low, high = np.where(low <= sizes[j], low, -np.inf), np.where(high >= -sizes[j], high, np.inf)
                lower, upper = np.maximum(lower, np.minimum(low, upper)), np.minimum(upper, np.maximum(high, lower))
            downhill = slope[j] + of_others(curvature[j], j)
            curved = curvature[j][j] > flat / sizes[j] ** 2
            newton = -downhill / np.where(curved, curvature[j][j], 1.0)
            to_bound = np.where(downhill > 0.0, lower, upper)
            linear = np.where(np.isfinite(to_bound), to_bound, 0.0)
            change[j] = np.clip(np.where(curved, newton, linear), lower, upper)
    return change


def _sizes(values: Values) -> list[Array]:
    return [SMALLEST_SCALE + _largest(of) for of in values.values()]


def _largest(of: Array) -> Array:
    """In size at all instants, of each start."""
    return np.abs(of).max(axis=(-2, -1), keepdims=True)


def _model(instants: Any, values: Values, *, apart: bool) -> _Model:
    """Value, slopes and curvatures by the given values, from differences."""
    names, steps = list(values), [_STEP * size for size in _sizes(values)]
    here = instants.integrand(values, apart=apart)

    def at(*changed: int) -> Array:
        moved = {names[j]: values[names[j]] + steps[j] for j in changed}
        return instants.integrand({**values, **moved}, apart=apart)

    count = len(names)
    slope, forward = [], []
    curvature: list[list[Any]] = [[None] * count for _ in names]
    for j, (name, step) in enumerate(zip(names, steps, strict=True)):
        up, down = at(j), instants.integrand({**values, name: values[name] - step}, apart=apart)
        slope.append((up - down) / (2.0 * step))
        curvature[j][j] = (up + down - 2.0 * here) / step**2
        forward.append(up)
    for j in range(count):
        for k in range(j):
            mixed = (at(j, k) - forward[j] - forward[k] + here) / (steps[j] * steps[k])
            curvature[j][k] = curvature[k][j] = mixed
    return here, slope, curvature
