"""How much smaller the integrand of the Lagrangian could be at an instant, if the controls were free there.

A mesh places its controls at the stages, and what restrains them as well: between the stages the polynomials of the
controls neither make the integrand stationary nor meet the rows. Given the states and costates of an instant, a
quadratic model of the integrand is minimised over controls, and algebraics that equations determine, inside their
bounds and within the linearised rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.small_programs import solve_small_programs

# Of differences, relative to what changes; and below which part of the integrand a curvature counts as none.
_STEP, _FLAT = 1e-4, 1e-6
_SMALLEST = 1e-3
_SWEEPS = 12
# Rows that a small change of the controls, in their sizes, can meet.
_NEAR = 1e-4
# Newton's steps from one start, each followed by a look whether it made the integrand smaller.
_STEPS = 3

Values = Mapping[str, Array]


class Instants(Protocol):
    """Where the integrand is evaluated; arrays have the shape ``(q, N)``."""

    def integrand(self, given: Values, *, apart: bool = False) -> Array:
        """With some values replaced, in the sign of a minimum; `apart` leaves out rows that controls can meet."""

    def own_rows(self, given: Values) -> list[tuple[Array, Array, Array]]:
        """Body and bounds of the rows that controls can meet."""

    def limits(self, name: str) -> tuple[Array, Array]:
        """Least and largest value of a control or algebraic."""


def least_integrand(instants: Instants, here: Values, starts: Sequence[Values]) -> Array:
    """The least integrand inside the bounds that is found from some values of the controls.

    Parameters
    ----------
    instants : Instants
        Without rows that controls can meet.
    here : dict of name to array, shape (q, N)
        Controls of the answer.
    starts : sequence of the same
        Where else to look from: what is no quadratic function has more than one valley.
    """
    limits = {name: instants.limits(name) for name in here}
    best = np.full(next(iter(here.values())).shape, np.inf)
    for start in (here, *starts):
        # Between the stages a polynomial may leave its bounds; what it gains there is no gain.
        values = {name: np.clip(of, *limits[name]) for name, of in start.items()}
        level = instants.integrand(values)
        for _ in range(_STEPS):
            change = _step(instants, values)
            candidates = []
            for part in (1.0, 0.25):
                tried = {name: values[name] + part * of for name, of in change.items()}
                candidates.append((instants.integrand(tried), tried))
            for found, tried in candidates:
                better = np.isfinite(found) & (found < level)
                level = np.where(better, found, level)
                values = {name: np.where(better, tried[name], of) for name, of in values.items()}
        best = np.where(np.isfinite(level) & (level < best), level, best)
    return np.where(np.isfinite(best), best, instants.integrand(here))


def _step(instants: Instants, values: Values) -> dict[str, Array]:
    """Newton's step inside the bounds, by sweeps over the controls."""
    names = list(values)
    here, slope, curvature = _model(instants, values, apart=False)
    change = [np.zeros(here.shape) for _ in names]
    flat = [_FLAT * (np.abs(here).max() + 1e-300) / size**2 for size in _sizes(values)]
    room = [tuple(side - values[name] for side in instants.limits(name)) for name in names]
    for _ in range(_SWEEPS if len(names) > 1 else 1):
        for j, (lower, upper) in enumerate(room):
            downhill = slope[j] + sum(curvature[j][k] * change[k] for k in range(len(names)) if k != j)
            curved = curvature[j][j] > flat[j]
            newton = -downhill / np.where(curved, curvature[j][j], 1.0)
            to_bound = np.where(downhill > 0.0, lower, upper)
            linear = np.where(np.isfinite(to_bound), to_bound, 0.0)
            change[j] = np.clip(np.where(curved, newton, linear), lower, upper)
    return dict(zip(names, change, strict=True))


def least_integrand_within_rows(instants: Instants, here: Values) -> Array:
    """The least value of the quadratic model of the integrand, within the linearised rows.

    Parameters
    ----------
    instants : Instants
    here : dict of name to array, shape (q, N)
        Controls and algebraics of the answer.
    """
    names = list(here)
    shape = here[names[0]].shape
    level, slope, _ = _model(instants, here, apart=True)
    full, _, curvature = _model(instants, here, apart=False)
    sizes = _sizes(here)
    rows = instants.own_rows(here)
    gradients = []
    for name, size in zip(names, sizes, strict=True):
        up, down = (instants.own_rows({**here, name: here[name] + change}) for change in (_STEP * size, -_STEP * size))
        gradients.append([(a[0] - b[0]) / (2.0 * _STEP * size) for a, b in zip(up, down, strict=True)])
    # One program per instant, in units of the sizes.
    flat = np.diag(np.full(len(names), _FLAT * (np.abs(level).max() + 1e-300)))
    scaled = np.array([[curvature[j][k] * sizes[j] * sizes[k] for k in range(len(names))] for j in range(len(names))])
    quadratic = np.moveaxis(scaled.reshape(len(names), len(names), -1), 2, 0) + flat
    linear = np.array([slope[j] * sizes[j] for j in range(len(names))]).reshape(len(names), -1).T
    of_rows = np.array([[gradients[j][i] * sizes[j] for j in range(len(names))] for i in range(len(rows))])
    of_rows = np.moveaxis(of_rows.reshape(len(rows), len(names), -1), 2, 0)
    sides = tuple(np.array([(row[k] - row[0]).ravel() for row in rows]).T.reshape(-1, len(rows)) for k in (1, 2))
    limits = [instants.limits(name) for name in names]
    room = tuple(
        np.array([(limits[j][k] - here[names[j]]).ravel() / sizes[j] for j in range(len(names))]).T for k in (0, 1)
    )
    found, gained = np.zeros(linear.shape[0], dtype=bool), np.full(linear.shape[0], np.inf)
    # Where rows are no convex functions there are several stationary points, and the first one may be no minimum.
    for near in (0.0, _NEAR):
        change, ended = solve_small_programs(quadratic, linear, (room[0], room[1]), of_rows, (sides[0], sides[1]), near)
        gain = (linear * change).sum(axis=1) + 0.5 * np.einsum("pi,pij,pj->p", change, quadratic, change)
        better = ended & (~found | ((gained > 0.0) & (gain < gained)))
        found, gained = found | ended, np.where(better, gain, gained)
    gained = np.where(found, gained, 0.0)
    return np.where(found.reshape(shape), level + gained.reshape(shape), full)


def _sizes(values: Values) -> list[float]:
    return [_SMALLEST + float(np.abs(of).max()) for of in values.values()]


def _model(instants: Instants, values: Values, *, apart: bool) -> tuple[Array, list[Array], list[list[Any]]]:
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
