"""Small mixed complementarity problems: equations, and statements ``l <= F <= u ⟂ H``, in as many unknowns.

A statement says that F is at l where H > 0, at u where H < 0, and between them where H = 0; a pair ``0 <= a ⟂ b >= 0``
has ``F = a``, ``l = 0`` and no upper bound. Three ways are tried one after the other, each from where the unknowns
were last, so that of several solutions the one that Newton's method reaches from there is found:

1. Newton's method on ``F - mid(l, F - H, u)``, which guesses for each statement which of its equations holds, and
   corrects the guesses (Qi and Sun, A nonsmooth version of Newton's method, 1993, doi:10.1007/BF01581275);
2. a damped Gauss-Newton method on the function of Fischer and Burmeister (Fischer, A special Newton-type optimization
   method, 1992, doi:10.1080/02331939208843795; for two bounds Billups, 1995);
3. Lemke's pivots on successive linearisations (Cottle, Pang, Stone, The Linear Complementarity Problem, sec. 4.4,
   doi:10.1137/1.9780898719000), and for few statements the enumeration of what may hold.

Where all of them fail they are tried once more from a few points around.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

Choice = NDArray[np.int64]

# What a statement's equation may be.
LOWER, FREE, UPPER = -1, 0, 1

_NEWTON_STEPS = 25
_DAMPED_STEPS = 60
_LINEARISATIONS = 8
_MOST_CHOICES = 1024

# How far other starts are from the given one, relative to one and to the size of each unknown.
_SCATTER = (1e-3, 0.1, 0.1, 0.5, 1.0)


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
        return np.where(self.either, either, body - np.clip(body - other, self.lower, self.upper))

    def matrices(self, values: ComplementarityValues, little: float) -> Iterator[Array]:
        """Derivatives of the equations nearest to holding; then, where both sides are zero, of the others too."""
        nearest = self.choice(values)
        yield _equations(self, values, nearest)[1]
        both = (np.abs(values.body - self.lower) <= little) & (np.abs(values.other) <= little)
        if both.any():
            yield _equations(self, values, np.where(both, np.where(nearest == FREE, LOWER, FREE), nearest))[1]

    def choice(self, values: ComplementarityValues) -> Choice:
        """Which equation of each statement is the nearest to holding."""
        body, other = values.body, values.other
        at_lower = np.where(self.either, body - self.lower <= np.abs(other), body - other <= self.lower)
        at_upper = ~self.either & (body - other >= self.upper)
        return np.where(at_lower, LOWER, np.where(at_upper, UPPER, FREE))


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
    best = _judged(problem, start, tolerance)
    for begin in _starts(start) if thorough else [start]:
        for way in (_by_newton, _by_damping, _by_pivots, _by_enumeration)[: None if thorough else 1]:
            if best.solved:
                break
            for point in way(problem, begin, tolerance):
                found = _judged(problem, point, tolerance)
                best = found if found.residual < best.residual else best
                if best.solved:
                    break
    if best.solved and thorough:  # one more step: what was solved to a tolerance is usually solved to rounding next
        refined = next(_by_newton(problem, best.point, 0.0), best.point)
        found = _judged(problem, refined, tolerance)
        best = found if found.residual < best.residual else best
    return best


def _starts(start: Array) -> Iterator[Array]:
    """The point, and then others around it: at the point itself products of unknowns may have no slope at all."""
    yield start
    random = np.random.default_rng(0)  # the same each time, so that a simulation can be repeated
    for size in _SCATTER:
        yield start + size * (1.0 + np.abs(start)) * random.uniform(-1.0, 1.0, len(start))


def _judged(problem: MixedComplementarity, point: Array, tolerance: float) -> ComplementaritySolution:
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
    bound = np.where(choice == UPPER, problem.upper, problem.lower)
    with np.errstate(invalid="ignore"):  # a bound that is not chosen may be infinite
        chosen = np.where(choice == FREE, values.other, values.body - bound)
    jacobian = np.where((choice == FREE)[:, None], values.other_jacobian, values.body_jacobian)
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


def _by_damping(problem: MixedComplementarity, start: Array, tolerance: float) -> Iterator[Array]:
    point, damping = start, 1e-3

    def merit(at: Array) -> float:
        try:
            residuals, _ = _fischer_burmeister(problem, problem.evaluate(at))
        except (ArithmeticError, ValueError):
            return np.inf
        size = float(residuals @ residuals)
        return size if np.isfinite(size) else np.inf

    now = merit(point)
    for _ in range(_DAMPED_STEPS):
        try:
            residuals, jacobian = _fischer_burmeister(problem, problem.evaluate(point))
            normal = jacobian.T @ jacobian
            step = np.linalg.solve(normal + min(damping, now) * np.eye(len(point)), -jacobian.T @ residuals)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):
            return
        length = next((2.0**-k for k in range(12) if merit(point + 2.0**-k * step) < now * (1 - 1e-4 * 2.0**-k)), 0.0)
        if length == 0.0:
            damping *= 100
            if damping > 1e6:
                return
            continue
        damping = max(damping / 10, 1e-12)
        point = point + length * step
        now = merit(point)
        yield point


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
    phi = np.where(problem.either, np.where(near == LOWER, body - problem.lower, other), phi)
    d_body = np.where(problem.either, near == LOWER, d_body)
    d_other = np.where(problem.either, near != LOWER, d_other)
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


def _by_enumeration(problem: MixedComplementarity, start: Array, tolerance: float) -> Iterator[Array]:
    """All choices, those that differ least from the nearest one first."""
    finite = np.isfinite(problem.upper) & ~problem.either, np.isfinite(problem.lower)
    options = [
        [FREE, *([LOWER] if below else []), *([UPPER] if above else [])] for above, below in zip(*finite, strict=True)
    ]
    count = float(np.prod([float(len(each)) for each in options]))
    if count > _MOST_CHOICES:
        return
    try:
        nearest = problem.choice(problem.evaluate(start))
    except (ArithmeticError, ValueError):
        return
    for choice in sorted(itertools.product(*options), key=lambda each: int((np.array(each) != nearest).sum())):
        point, chosen = start, np.array(choice, dtype=np.int64)
        for _ in range(_LINEARISATIONS):
            try:
                step = _step(*reversed(_equations(problem, problem.evaluate(point), chosen)))
            except (ArithmeticError, ValueError, np.linalg.LinAlgError):
                break
            point = point + step
            if not np.isfinite(point).all():
                break
            if np.abs(step).max(initial=0.0) <= tolerance * max(1.0, float(np.abs(point).max(initial=0.0))):
                yield point
                break


def _by_pivots(problem: MixedComplementarity, start: Array, tolerance: float) -> Iterator[Array]:
    """Linear complementarity problems of successive linearisations, by Lemke's pivots."""
    if problem.either.any() or not len(problem.lower):
        return
    point = start
    for _ in range(_LINEARISATIONS):
        try:
            step = _linear_step(problem, problem.evaluate(point))
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):
            return
        if step is None or not np.isfinite(step).all():
            return
        point = point + step
        yield point


def _linear_step(problem: MixedComplementarity, values: ComplementarityValues) -> Array | None:
    """The step that solves the linearised problem, or None where pivots find none."""
    count = len(values.body)
    # Of each statement one side, or the other, is free to move; together with the rows they give all unknowns.
    two_bounds = np.isfinite(problem.lower) & np.isfinite(problem.upper)
    sides = [[0] if two else [0, 1] for two in two_bounds.tolist()]
    chosen = _independent_sides(values, sides)
    independent = np.where(np.array(chosen)[:, None] == 0, values.other_jacobian, values.body_jacobian)
    inverse = np.linalg.inv(np.concatenate([values.rows_jacobian, independent]))
    m = len(values.rows)
    shift, basis = -inverse[:, :m] @ values.rows, inverse[:, m:]  # step = shift + basis @ change of the free sides
    matrix, columns = [], []
    for i, side in enumerate(chosen):
        lower, upper = problem.lower[i], problem.upper[i]
        if side == 0:  # H is free to move, F follows
            if np.isfinite(lower):
                columns.append((i, 1.0, 0.0))
                matrix.append((i, 1.0, 0, -lower))
            if np.isfinite(upper):
                columns.append((i, -1.0, 0.0))
                matrix.append((i, -1.0, 0, upper))
        elif np.isfinite(lower):
            columns.append((i, 1.0, lower))
            matrix.append((i, 1.0, 1, 0.0))
        else:
            columns.append((i, -1.0, upper))
            matrix.append((i, -1.0, 1, 0.0))
    # Sides in terms of y >= 0: side_i = base_i + sum of sign * y; the change is that minus the value now.
    value_now = np.where(np.array(chosen) == 0, values.other, values.body)
    base = np.zeros(count)
    to_side = np.zeros((count, len(columns)))
    for k, (i, sign, start) in enumerate(columns):
        base[i] = start
        to_side[i, k] = sign
    fixed = shift + basis @ (base - value_now)
    moving = basis @ to_side
    rows_m, rows_q = [], []
    for i, sign, which, constant in matrix:
        gradient = values.body_jacobian[i] if which == 0 else values.other_jacobian[i]
        number = values.body[i] if which == 0 else values.other[i]
        rows_m.append(sign * gradient @ moving)
        rows_q.append(sign * (number + gradient @ fixed) + constant)
    found = lemke(np.array(rows_m), np.array(rows_q))
    return None if found is None else fixed + moving @ found


def _independent_sides(values: ComplementarityValues, sides: list[list[int]]) -> list[int]:
    """For each statement the side that adds most to what the rows and the sides before leave open: 0 is H, 1 is F."""
    basis: list[Array] = []

    def remainder(gradient: Array) -> Array:
        for direction in basis:
            gradient = gradient - (gradient @ direction) * direction
        return gradient

    for row in values.rows_jacobian:
        left = remainder(remainder(row))
        if (size := float(np.linalg.norm(left))) > 1e-12 * max(1.0, float(np.linalg.norm(row))):
            basis.append(left / size)
    chosen = []
    for i, allowed in enumerate(sides):
        candidates = [(values.other_jacobian, values.body_jacobian)[side][i] for side in allowed]
        rests = [remainder(remainder(candidate)) for candidate in candidates]
        sizes = [
            float(np.linalg.norm(rest)) / max(1e-300, float(np.linalg.norm(whole)))
            for rest, whole in zip(rests, candidates, strict=True)
        ]
        k = 0 if sizes[0] > 1e-3 else int(np.argmax(sizes))
        chosen.append(allowed[k])
        if sizes[k] > 1e-12:
            basis.append(rests[k] / np.linalg.norm(rests[k]))
    return chosen


def lemke(matrix: Array, offset: Array, most_pivots: int = 500) -> Array | None:
    """``z >= 0`` with ``w = M z + q >= 0`` and ``z^T w = 0``, by Lemke's complementary pivots; None on a ray.

    Parameters
    ----------
    matrix : array, shape (p, p)
        M; pivots end with a solution where M is copositive-plus and there is one.
    offset : array, shape (p,)
        q.
    most_pivots : int

    Returns
    -------
    array, shape (p,), or None
    """
    count = len(offset)
    if count == 0 or offset.min() >= 0:
        return np.zeros(count)
    # Columns: w, z, the artificial variable, right-hand side.
    table = np.concatenate([np.eye(count), -matrix, -np.ones((count, 1)), offset[:, None]], axis=1)
    basic = np.arange(count)
    row, entering = int(offset.argmin()), 2 * count
    for _ in range(most_pivots):
        table[row] /= table[row, entering]
        others = np.arange(count) != row
        table[others] -= np.outer(table[others, entering], table[row])
        leaving, basic[row] = int(basic[row]), entering
        if leaving == 2 * count:
            found = np.zeros(2 * count + 1)
            found[basic] = table[:, -1]
            return np.asarray(np.maximum(found[count : 2 * count], 0.0))
        entering = leaving + count if leaving < count else leaving - count
        column = table[:, entering]
        able = column > 1e-11
        if not able.any():
            return None
        ratios = np.where(able, table[:, -1] / np.where(able, column, 1.0), np.inf)
        tied = np.flatnonzero(ratios <= ratios.min() + 1e-12)
        artificial = [int(k) for k in tied if basic[k] == 2 * count]
        row = artificial[0] if artificial else int(tied[0])
    return None
