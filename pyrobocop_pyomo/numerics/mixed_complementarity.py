"""Small mixed complementarity problems: equations, and statements ``l <= F <= u ⟂ H``, in as many unknowns.

A statement says that F is at l where H > 0, at u where H < 0, and between them where H = 0; a pair ``0 <= a ⟂ b >= 0``
has ``F = a``, ``l = 0`` and no upper bound. Two ways are tried one after the other, each from where the unknowns
were last, so that of several solutions the one that Newton's method reaches from there is found:

1. Newton's method on ``F - mid(l, F - H, u)``, which guesses for each statement which of its equations holds, and
   corrects the guesses (Qi and Sun, A nonsmooth version of Newton's method, 1993, doi:10.1007/BF01581275);
2. the least squares, by SciPy, of the function of Fischer and Burmeister (Fischer, A special Newton-type optimization
   method, 1992, doi:10.1080/02331939208843795; for two bounds Billups, 1995).

Where both fail they are tried once more from a few points around.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.optional_imports import scipy

from .arrays import Array

Choice = NDArray[np.int64]


class _Held:
    """What a statement's equation may be: F at a bound, or H zero."""

    LOWER = -1
    FREE = 0
    UPPER = 1


_NEWTON_STEPS = 25
_LEAST_SQUARES_STEPS = 60


@dataclass(frozen=True, eq=False)
class ComplementarityValues:
    """Everything at one point.

    Attributes
    ----------
    rows : array, shape (m,)
        Left minus right sides of the equations.
    body, other : arrays, shape (p,)
        F and H of each statement.
    rows_jacobian, body_jacobian, other_jacobian : arrays, shapes (m, n), (p, n) and (p, n)
        With ``n = m + p``.
    """

    rows: Array
    body: Array
    other: Array
    rows_jacobian: Array
    body_jacobian: Array
    other_jacobian: Array


@dataclass(frozen=True, eq=False)
class MixedComplementarity:
    """A problem.

    Attributes
    ----------
    evaluate : callable
        From a point, shape ``(n,)``, to its `ComplementarityValues`.
    lower, upper : arrays, shape (p,)
        Bounds l and u; one of them may be infinite.
    either : array of bool, shape (p,)
        Statements ``F >= l`` and ``(F - l) H = 0``, where H has any sign: all three are not asked of them.
    """

    evaluate: Callable[[Array], ComplementarityValues]
    lower: Array
    upper: Array
    either: NDArray[np.bool_]

    def residuals(self, values: ComplementarityValues) -> Array:
        """Zero at a solution, shape ``(m + p,)``: the equations, and ``F - mid(l, F - H, u)``."""
        return np.concatenate([values.rows, self._natural(values)])

    def _natural(self, values: ComplementarityValues) -> Array:
        body, other = values.body, values.other
        gap = body - self.lower
        either = np.where(gap <= np.abs(other), gap, other)
        middle = np.minimum(np.maximum(body - other, self.lower), self.upper)
        return np.where(self.either, either, body - middle)

    def matrices(self, values: ComplementarityValues, little: float) -> Iterator[Array]:
        """Derivatives of the equations nearest to holding; then, where both sides are zero, of the others too."""
        nearest = self.choice(values)
        yield _equations(self, values, nearest)[1]
        both = (np.abs(values.body - self.lower) <= little) & (np.abs(values.other) <= little)
        if both.any():
            yield _equations(
                self,
                values,
                np.where(both, np.where(nearest == _Held.FREE, _Held.LOWER, _Held.FREE), nearest),
            )[1]

    def choice(self, values: ComplementarityValues) -> Choice:
        """Which equation of each statement is the nearest to holding."""
        body, other = values.body, values.other
        at_lower = np.where(self.either, body - self.lower <= np.abs(other), body - other <= self.lower)
        at_upper = ~self.either & (body - other >= self.upper)
        return np.where(at_lower, _Held.LOWER, np.where(at_upper, _Held.UPPER, _Held.FREE))


@dataclass(frozen=True, eq=False)
class ComplementaritySolution:
    """Where a solve ended.

    Attributes
    ----------
    point : array, shape (n,)
        The best that was found.
    residual : float
        Largest residual there, relative to the largest unknown where that is above one.
    worst : int
        Which residual is the largest: an equation below m, and statement ``worst - m`` from there.
    solved : bool
    """

    point: Array
    residual: float
    worst: int
    solved: bool


def solve_mixed_complementarity(
    problem: MixedComplementarity, start: Array, tolerance: float = 1e-9, *, thorough: bool = True
) -> ComplementaritySolution:
    """A solution next to a point.

    Parameters
    ----------
    problem : MixedComplementarity
    start : array, shape (n,)
    tolerance : float
        Of the residual of a solution.
    thorough : bool
        Whether other ways follow where Newton's method from the point fails, and one more step where it does not.

    Returns
    -------
    ComplementaritySolution
        ``solved`` is False where no way led to a solution; then it is the point with the smallest residual.
    """
    start = np.asarray(start, dtype=float)
    best = _solution_at(problem, start, tolerance)
    for begin in _starts(start) if thorough else [start]:
        for way in (_by_newton, _by_least_squares)[: None if thorough else 1]:
            if best.solved:
                break
            for point in way(problem, begin, tolerance):
                solution = _solution_at(problem, point, tolerance)
                best = solution if solution.residual < best.residual else best
                if best.solved:
                    break
    if best.solved and thorough:  # one more step: what was solved to a tolerance is usually solved to rounding next
        refined = next(_by_newton(problem, best.point, 0.0), best.point)
        solution = _solution_at(problem, refined, tolerance)
        best = solution if solution.residual < best.residual else best
    return best


def _starts(start: Array) -> Iterator[Array]:
    """The point, and then others around it: at the point itself products of unknowns may have no slope at all."""
    yield start
    random = np.random.default_rng(0)  # the same each time, so that a simulation can be repeated
    for size in np.geomspace(1e-3, 1.0, 5):  # relative to one and to the size of each unknown
        yield start + size * (1.0 + np.abs(start)) * random.uniform(-1.0, 1.0, len(start))


def _solution_at(problem: MixedComplementarity, point: Array, tolerance: float) -> ComplementaritySolution:
    try:
        residuals = np.abs(problem.residuals(problem.evaluate(point)))
    except (ArithmeticError, ValueError):
        return ComplementaritySolution(point, np.inf, 0, False)
    if not len(residuals):
        return ComplementaritySolution(point, 0.0, 0, True)
    residuals = np.where(np.isfinite(residuals), residuals, np.inf)
    worst = int(residuals.argmax())
    relative = float(residuals[worst]) / max(1.0, float(np.abs(point).max()))
    return ComplementaritySolution(point, relative, worst, relative <= tolerance)


def _equations(problem: MixedComplementarity, values: ComplementarityValues, choice: Choice) -> tuple[Array, Array]:
    """The equations that hold by a choice, and their Jacobian."""
    bound = np.where(choice == _Held.UPPER, problem.upper, problem.lower)
    with np.errstate(invalid="ignore"):  # a bound that is not chosen may be infinite
        chosen = np.where(choice == _Held.FREE, values.other, values.body - bound)
    jacobian = np.where((choice == _Held.FREE)[:, None], values.other_jacobian, values.body_jacobian)
    return np.concatenate([values.rows, chosen]), np.concatenate([values.rows_jacobian, jacobian])


def _step(jacobian: Array, residuals: Array) -> Array:
    """A Newton step; the shortest one where equations depend on each other."""
    try:
        step = np.linalg.solve(jacobian, -residuals)
        left = np.abs(jacobian @ step + residuals).max(initial=0.0)
        if np.isfinite(step).all() and left <= 1e-8 * max(1.0, np.abs(residuals).max(initial=0.0)):
            return np.asarray(step, dtype=np.float64)
    except np.linalg.LinAlgError:
        pass
    return np.asarray(np.linalg.lstsq(jacobian, -residuals, rcond=1e-11)[0])


def _by_newton(problem: MixedComplementarity, start: Array, tolerance: float) -> Iterator[Array]:
    point = start
    for _ in range(_NEWTON_STEPS):
        try:
            values = problem.evaluate(point)
            point = point + _step(*reversed(_equations(problem, values, problem.choice(values))))
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):
            return
        if not np.isfinite(point).all():
            return
        yield point


def _by_least_squares(problem: MixedComplementarity, start: Array, tolerance: float) -> Iterator[Array]:
    def residuals(point: Array) -> Array:
        try:
            return _fischer_burmeister(problem, problem.evaluate(point))[0]
        except ArithmeticError:
            return np.full(len(start), np.nan)  # which is no step

    def jacobian(point: Array) -> Array:
        return _fischer_burmeister(problem, problem.evaluate(point))[1]

    with suppress(ArithmeticError, ValueError, np.linalg.LinAlgError):
        options = {**dict.fromkeys(("ftol", "xtol", "gtol"), np.finfo(float).eps), "max_nfev": _LEAST_SQUARES_STEPS}
        yield scipy.optimize.least_squares(residuals, start, jacobian, x_scale="jac", **options).x


def _fischer_burmeister(problem: MixedComplementarity, values: ComplementarityValues) -> tuple[Array, Array]:
    """``phi(F - l, -phi(u - F, -H))`` with ``phi(a, b) = a + b - sqrt(a^2 + b^2)``, and its Jacobian."""
    body, other = values.body, values.other
    inner, by_gap, by_other = _phi(problem.upper - body, -other)
    above = np.isfinite(problem.upper)
    second = np.where(above, -inner, other)
    d_body = np.where(above, by_gap, 0.0)  # of -phi(u - F, -H)
    d_other = np.where(above, by_other, 1.0)
    outer, by_first, by_second = _phi(body - problem.lower, second)
    below = np.isfinite(problem.lower)
    phi = np.where(below, outer, second)
    d_body = np.where(below, by_first + by_second * d_body, d_body)
    d_other = np.where(below, by_second * d_other, d_other)
    near = problem.choice(values)
    phi = np.where(problem.either, np.where(near == _Held.LOWER, body - problem.lower, other), phi)
    d_body = np.where(problem.either, near == _Held.LOWER, d_body)
    d_other = np.where(problem.either, near != _Held.LOWER, d_other)
    jacobian = d_body[:, None] * values.body_jacobian + d_other[:, None] * values.other_jacobian
    return np.concatenate([values.rows, phi]), np.concatenate([values.rows_jacobian, jacobian])


def _phi(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """The function of Fischer and Burmeister and an element of its generalised gradient."""
    with np.errstate(invalid="ignore", over="ignore"):
        norm = np.hypot(a, b)
        kink = norm == 0
        safe = np.where(kink, 1.0, norm)
        return (
            a + b - norm,
            np.where(kink, 1 - np.sqrt(0.5), 1 - a / safe),
            np.where(kink, 1 - np.sqrt(0.5), 1 - b / safe),
        )
