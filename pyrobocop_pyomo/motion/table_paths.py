"""`TablePath`: the pose rule of a body that moves along a table of times and positions.

Its `TableFunction`s join the values of a table, with bounds for the proof.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose, planar_pose, spatial_pose
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.numerics import Indices
from pyrobocop_pyomo.numerics.arrays import Array, finite_numbers, increasing_numbers
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
        values, slopes, curvatures = (list(of) for of in zip(*bounds, strict=True))
        outside = (low < self.knots[0] - rounding) | (high > self.knots[-1] + rounding)
        rests = _where(outside, 0.0, 0.0)
        kinks = self._kinks(output)
        inside = np.searchsorted(kinks, high - rounding, side="left") > np.searchsorted(
            kinks, low + rounding, side="right"
        )
        unknown = ~np.isfinite(low) | ~np.isfinite(high) | (outside & (not self.holds))
        value, slope, curvature = (
            Interval(np.where(unknown, np.nan, bound.low), np.where(unknown, np.nan, bound.high))
            for bound in map(_hull, (values, [*slopes, rests], [*curvatures, rests, _where(inside, -np.inf, np.inf)]))
        )
        return time.compose(value, slope, curvature)

    def _bounds_on(
        self, piece: Indices, low: Array, high: Array, rounding: float, output: int
    ) -> tuple[Interval, Interval, Interval]:
        origin, end = self.knots[piece], self.knots[piece + 1]
        start, stop = ((np.clip(at, origin, end) - origin) / (end - origin) for at in (low - rounding, high + rounding))
        value, slope, curvature = (restrict(of.c[:, piece, output].T, start, stop) for of in self._orders)
        form = taylor_form_of_polynomial((value, slope, curvature))
        return form.value, form.first, form.second

    def _kinks(self, output: int) -> Array:
        """Knots at which the slope jumps; the ends too, where it is not zero."""
        slopes = self._orders[1].c[:, :, output]
        before, after = np.append(0.0, slopes[-1]), np.append(slopes[0], 0.0)
        return np.asarray(self.knots[np.abs(after - before) > NEGLIGIBLE * np.abs(slopes).max(initial=0.0)])


def _hull(bounds: list[Interval]) -> Interval:
    return Interval(np.min([bound.low for bound in bounds], axis=0), np.max([bound.high for bound in bounds], axis=0))


def _where(condition: Array, low: float, high: float) -> Interval:
    """An interval where a condition holds, and the empty one elsewhere, which adds nothing to a hull."""
    return Interval(np.where(condition, low, np.inf), np.where(condition, high, -np.inf))


class TablePath:
    """A pose rule along a table: at each of the times the body is at a given place.

    It is the ``pose`` of a `Body`: ``Body(shape, pose=TablePath(times, x, y, theta))``. Between the rows it is followed
    exactly, also where they fall inside of the intervals of the plan, and where the duration of the plan is free.

    Parameters
    ----------
    times : sequence of float, shape (k,)
        Increasing.
    x, y : float or sequence of float, shape (k,)
    theta : float or sequence of float, shape (k,)
        Heading (yaw) in radians. From row to row it turns the shorter way: 3.1 is followed by -3.1 without a turn.
    z : float or sequence of float, optional
        Makes the pose one in space.
    roll, pitch : float or sequence of float
        In space, as ``euler`` of `spatial_pose`.
    kind : str
        ``"linear"`` from row to row, or ``"cubic"``: the natural spline.
    hold_ends : bool
        Whether the body rests where the table begins before the first time, and where it ends after the last one.
        Otherwise plans must not reach beyond.
    clock : callable, optional
        ``clock(block, t)`` returns the time of the table. By default ``block.time_at(t)`` where the rule is that of
        a phase, else ``t`` itself. A table that started 3.5 before the plan: ``lambda b, t: b.time_at(t) + 3.5``.

    Raises
    ------
    ObstacleError
        When columns do not fit the times, or times do not increase.

    Examples
    --------
    >>> import pyrobocop_pyomo as rcp
    >>> path = rcp.TablePath([0.0, 1.0, 3.0], x=[0.0, 2.0, 2.0], y=[0.0, 0.0, 4.0])
    >>> truck = rcp.Body(rcp.Polytope.box(2, 1), pose=path)
    >>> path(None, 2.0).translation
    (2.0, 2.0)
    """

    def __init__(
        self,
        times: Sequence[float],
        x: Any,
        y: Any,
        theta: Any = 0.0,
        *,
        z: Any = None,
        roll: Any = 0.0,
        pitch: Any = 0.0,
        kind: str = "linear",
        hold_ends: bool = False,
        clock: Callable[[Any, Any], Any] | None = None,
    ) -> None:
        if kind not in ("linear", "cubic"):
            raise ObstacleError(f'TablePath: kind is {kind!r}; it is "linear" or "cubic".')
        self.times = increasing_numbers(times, "TablePath: times", ObstacleError)
        self.kind, self.hold_ends, self.clock = kind, bool(hold_ends), clock
        given = {"x": x, "y": y, "theta": theta}
        if z is not None:
            given |= {"z": z, "roll": roll, "pitch": pitch}
        self.columns = {name: self._column(name, column) for name, column in given.items()}
        # What is the same in all rows is a number only where the body is known to rest beyond them.
        moving = [name for name, column in self.columns.items() if np.ptp(column) > 0.0 or not self.hold_ends]
        self._moving = tuple(moving)
        self._table = TableFunction(
            "table path",
            self.times,
            np.stack([self.columns[name] for name in moving], axis=1) if moving else np.zeros((len(self.times), 1)),
            moving or ["rest"],
            kind=kind,
            holds=self.hold_ends,
        )

    def _column(self, name: str, given: Any) -> Array:
        column = finite_numbers(given, f"TablePath: {name}", ObstacleError)
        if column.ndim == 0:
            column = np.full(len(self.times), float(column))
        if column.shape != self.times.shape:
            raise ObstacleError(
                f"TablePath: {name} has the shape {column.shape}; expected one number for each of the "
                f"{len(self.times)} times, or one for all."
            )
        return np.unwrap(column) if name in ("theta", "roll", "pitch") else column

    def __deepcopy__(self, memo: dict[int, Any]) -> TablePath:
        return self  # immutable: cloned models share it

    def __repr__(self) -> str:
        return f"TablePath({len(self.times)} rows from {self.times[0]:g} to {self.times[-1]:g}, {self.kind})"

    skips_points = True  # it is called at each point, since beyond its ends a table says nothing

    def __call__(self, block: Any, t: Any) -> Pose:
        """The pose at an index."""
        time = self._time(block, t)
        if time.__class__ in native_numeric_types or isinstance(time, np.number):
            time = self._inside(float(time))
        at = {name: float(column[0]) for name, column in self.columns.items()}
        at |= dict(zip(self._moving, self._table(time), strict=False))
        if "z" not in at:
            return planar_pose(at["x"], at["y"], at["theta"])
        return spatial_pose((at["x"], at["y"], at["z"]), euler=(at["roll"], at["pitch"], at["theta"]))

    def _time(self, block: Any, t: Any) -> Any:
        if self.clock is not None:
            return self.clock(block, t)
        of_phase = getattr(block, "has_normalised_time", None) is not None
        return block.time_at(t) if of_phase else t

    def _inside(self, time: float) -> float:
        start, end = float(self.times[0]), float(self.times[-1])
        nearly = NEGLIGIBLE * (end - start)
        if not self.hold_ends and not start - nearly <= time <= end + nearly:
            raise ObstacleError(
                f"{self!r} says nothing about time {time:g}. Extend the table, or let the body rest at its ends by "
                "hold_ends=True."
            )
        return min(max(time, start), end)
