"""`TableFunction`: functions of one variable that join the values of a table, with bounds for the proof."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.bernstein import bernstein_matrix, derivative_coefficients, restrict
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial
from pyrobocop_pyomo.optional_imports import scipy

_EPS = float(np.finfo(float).eps)
# Slopes on both sides of a knot that differ by less, relative to the largest, are equal up to rounding.
_SAME_SLOPE = 1e-10


class TableFunction(Function):
    """Piecewise polynomials through the values of a table; constant before the first and after the last.

    Parameters
    ----------
    name : str
        In messages.
    knots : array, shape (k,)
        Increasing.
    values : array, shape (k, outputs)
    names : sequence of str
        Of the outputs.
    kind : str
        ``"linear"``, or ``"cubic"``: the natural spline.
    holds : bool
        Whether it is known to be constant outside of the knots; where it is not, nothing is proven there.
    """

    def __init__(
        self, name: str, knots: Array, values: Array, names: Sequence[str], *, kind: str = "linear", holds: bool = True
    ) -> None:
        self.knots, self.holds = knots, holds
        # Bernstein coefficients of each piece, shape (pieces, degree + 1, outputs).
        self.pieces = _linear_pieces(values) if kind == "linear" else _cubic_pieces(knots, values)
        super().__init__(
            self._value_at,
            self._slope_at,
            self._curvature_at,
            inputs=["time"],
            outputs=list(names),
            name=name,
            check_derivatives=False,
        )

    # ---------------------------------------------------------------- at instants

    def _place(self, points: Array) -> tuple[Indices, Array, Array]:
        """Piece, local fraction, and width of the piece; the ends of the table stand for what is outside."""
        times = np.clip(points[:, 0], self.knots[0], self.knots[-1])
        piece = np.clip(np.searchsorted(self.knots, times, side="right") - 1, 0, len(self.knots) - 2)
        width = self.knots[piece + 1] - self.knots[piece]
        return piece, (times - self.knots[piece]) / width, width

    def _derivative_at(self, points: Array, order: int) -> Array:
        piece, fraction, width = self._place(points)
        coefficients = np.moveaxis(self.pieces[piece], 1, 2)
        for _ in range(order):
            coefficients = derivative_coefficients(coefficients) / width[:, None, None]
        basis = bernstein_matrix(coefficients.shape[2] - 1, fraction)
        found = np.einsum("mok,mk->mo", coefficients, basis)
        outside = (points[:, 0] < self.knots[0]) | (points[:, 0] > self.knots[-1])
        return np.where(outside[:, None], 0.0, found) if order else found

    def _value_at(self, points: Array) -> Array:
        return self._derivative_at(points, 0)

    def _slope_at(self, points: Array) -> Array:
        return self._derivative_at(points, 1)[:, :, None]

    def _curvature_at(self, points: Array) -> Array:
        return self._derivative_at(points, 2)[:, :, None, None]

    # ---------------------------------------------------------------- bounds

    def taylor_form(self, time: TaylorForm, output: int) -> TaylorForm:
        """Bounds of one output and its derivatives, from those of the time.

        Where the slope jumps inside a subinterval the second derivative has no bound. Values have one nevertheless, and
        halving leaves few such subintervals.
        """
        low, high = time.value.low, time.value.high
        rounding = 16 * _EPS * np.abs(self.knots).max()
        last = len(self.knots) - 2
        first_piece = np.clip(np.searchsorted(self.knots, low, side="right") - 1, 0, last)
        last_piece = np.clip(np.searchsorted(self.knots, high, side="left") - 1, first_piece, last)
        bounds = [self._bounds_on(first_piece, low, high, rounding, output)]
        for further in range(1, int((last_piece - first_piece).max(initial=0)) + 1):
            piece = np.minimum(first_piece + further, last_piece)
            bounds.append(self._bounds_on(piece, low, high, rounding, output))
        value, slope, curvature = (_hull([bound[order] for bound in bounds]) for order in range(3))
        before, after = low < self.knots[0] - rounding, high > self.knots[-1] + rounding
        slope = _widened(slope, before | after, 0.0)
        curvature = _widened(curvature, before | after, 0.0)
        kinks = self._kinks(output)
        inside = np.searchsorted(kinks, high - rounding, side="left") > np.searchsorted(
            kinks, low + rounding, side="right"
        )
        curvature = Interval(np.where(inside, -np.inf, curvature.low), np.where(inside, np.inf, curvature.high))
        unknown = ~np.isfinite(low) | ~np.isfinite(high) | ((before | after) & (not self.holds))
        value, slope, curvature = (
            Interval(np.where(unknown, np.nan, bound.low), np.where(unknown, np.nan, bound.high))
            for bound in (value, slope, curvature)
        )
        return time.compose(value, slope, curvature)

    def _bounds_on(
        self, piece: Indices, low: Array, high: Array, rounding: float, output: int
    ) -> tuple[Interval, Interval, Interval]:
        width = self.knots[piece + 1] - self.knots[piece]
        start = (np.clip(low - rounding, self.knots[piece], self.knots[piece + 1]) - self.knots[piece]) / width
        end = (np.clip(high + rounding, self.knots[piece], self.knots[piece + 1]) - self.knots[piece]) / width
        values = self.pieces[piece, :, output]
        slopes = derivative_coefficients(values) / width[:, None]
        curvatures = derivative_coefficients(slopes) / width[:, None]
        form = taylor_form_of_polynomial(
            (
                restrict(values, start, end),
                restrict(slopes, start, end),
                restrict(curvatures, start, end),
            )
        )
        return form.value, form.first, form.second

    def _kinks(self, output: int) -> Array:
        """Knots at which the slope jumps; the ends too, where it is not zero."""
        coefficients = self.pieces[:, :, output]
        slopes = derivative_coefficients(coefficients) / np.diff(self.knots)[:, None]
        before, after = np.append(0.0, slopes[:, -1]), np.append(slopes[:, 0], 0.0)
        return self.knots[np.abs(after - before) > _SAME_SLOPE * np.abs(slopes).max(initial=0.0)]


def _linear_pieces(values: Array) -> Array:
    return np.stack([values[:-1], values[1:]], axis=1)


def _cubic_pieces(knots: Array, values: Array) -> Array:
    spline = scipy.interpolate.CubicSpline(knots, values, bc_type="natural")
    powers = spline.c[::-1] * np.diff(knots)[None, :, None] ** np.arange(4)[:, None, None]  # in local fractions
    shares = np.array([[comb(j, i) / comb(3, i) if i <= j else 0.0 for i in range(4)] for j in range(4)])
    return np.einsum("ji,ipo->pjo", shares, powers)


def _hull(bounds: list[Interval]) -> Interval:
    return Interval(np.min([bound.low for bound in bounds], axis=0), np.max([bound.high for bound in bounds], axis=0))


def _widened(bound: Interval, where: Array, number: float) -> Interval:
    return Interval(
        np.where(where, np.minimum(bound.low, number), bound.low),
        np.where(where, np.maximum(bound.high, number), bound.high),
    )


def checked_times(label: str, times: Sequence[float]) -> Array:
    """Times of a table as an array.

    Raises
    ------
    ObstacleError
        When they are not finite, do not increase, or are fewer than two.
    """
    found = np.asarray(times, dtype=float)
    if found.ndim != 1 or len(found) < 2 or not np.isfinite(found).all():
        raise ObstacleError(f"{label}: its times are {times!r}; expected at least two finite numbers.")
    if not (np.diff(found) > 0).all():
        k = int(np.argmax(np.diff(found) <= 0))
        raise ObstacleError(f"{label}: its times must increase, but {found[k]:g} is followed by {found[k + 1]:g}.")
    return found
