"""`TableFunction`: functions of one variable that join the values of a table, with bounds for the proof."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.bernstein import restrict
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial
from pyrobocop_pyomo.optional_imports import scipy

_EPS = float(np.finfo(float).eps)


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
        interpolate = scipy.interpolate
        if kind == "linear":
            curve = interpolate.BPoly(np.stack([values[:-1], values[1:]]), knots)
        else:
            curve = interpolate.BPoly.from_power_basis(interpolate.CubicSpline(knots, values, bc_type="natural"))
        # Polynomials of the local fraction of each piece, by Bernstein coefficients (degree + 1, pieces, outputs).
        self._orders = [curve.derivative(order) for order in range(3)]
        super().__init__(
            *(partial(self._derivative_at, order) for order in range(3)),
            inputs=["time"],
            outputs=list(names),
            name=name,
            check_derivatives=False,
        )

    # ---------------------------------------------------------------- at instants

    def _derivative_at(self, order: int, points: Array) -> Array:
        times = points[:, 0]
        found = self._orders[order](np.clip(times, self.knots[0], self.knots[-1]))
        outside = (times < self.knots[0]) | (times > self.knots[-1])
        found = np.where(outside[:, None], 0.0, found) if order else found
        return np.reshape(found, (*found.shape, *[1] * order))

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
        value, slope, curvature = (restrict(of.c[:, piece, output].T, start, end) for of in self._orders)
        form = taylor_form_of_polynomial((value, slope, curvature))
        return form.value, form.first, form.second

    def _kinks(self, output: int) -> Array:
        """Knots at which the slope jumps; the ends too, where it is not zero."""
        slopes = self._orders[1].c[:, :, output]
        before, after = np.append(0.0, slopes[-1]), np.append(slopes[0], 0.0)
        return np.asarray(self.knots[np.abs(after - before) > NEGLIGIBLE * np.abs(slopes).max(initial=0.0)])


def _hull(bounds: list[Interval]) -> Interval:
    return Interval(np.min([bound.low for bound in bounds], axis=0), np.max([bound.high for bound in bounds], axis=0))


def _widened(bound: Interval, where: Array, number: float) -> Interval:
    return Interval(
        np.where(where, np.minimum(bound.low, number), bound.low),
        np.where(where, np.maximum(bound.high, number), bound.high),
    )
