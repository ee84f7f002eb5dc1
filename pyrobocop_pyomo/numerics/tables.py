"""Tables of numbers as smooth functions of one or two inputs, with exact derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property, partial
from itertools import combinations_with_replacement, product
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError, FunctionError
from pyrobocop_pyomo.modeling.functions import Function
from pyrobocop_pyomo.optional_imports import pandas, scipy

from .arrays import Array, Indices, finite_numbers, increasing_numbers
from .interval_arithmetic import Interval, TaylorForm, taylor_form_of_polynomial
from .polynomials import restrict
from .rounding import MET, NEGLIGIBLE

Kind = Literal["linear", "cubic", "natural", "quintic", "monotone"]
Outside = Literal["error", "linear", "constant"]


_CONTINUED: ContextVar[bool] = ContextVar("tables_continued", default=False)


@contextmanager
def tables_continued() -> Iterator[None]:
    """Let tables that refuse what is beyond them go on with their tangents: where a motion is judged, not planned.

    A plan that touches the edge of a table leaves it by a hair between its points, as does what it is compared with.
    """
    token = _CONTINUED.set(True)
    try:
        yield
    finally:
        _CONTINUED.reset(token)


class _Interpolant:
    """What tables evaluate: a spline and its derivatives at many points, also beyond its edges."""

    _FEWEST: ClassVar = {"linear": 2, "cubic": 4, "natural": 3, "quintic": 6, "monotone": 2}

    def __init__(
        self, name: str, inputs: Sequence[str], grids: list[Array], values: Array, kind: str, outside: str
    ) -> None:
        self.name, self.inputs, self.outside = name, list(inputs), outside
        self.lower = np.array([grid[0] for grid in grids])
        self.upper = np.array([grid[-1] for grid in grids])
        self.cells = np.array([np.diff(grid).min() for grid in grids])
        if kind == "monotone":
            self._spline = scipy.interpolate.PchipInterpolator(grids[0], values)
        else:
            degree = {"linear": 1, "quintic": 5}.get(kind, 3)
            ends = "natural" if kind == "natural" else None
            knots, coefficients = [], values
            for axis, grid in enumerate(grids):  # one axis after the other: a tensor product
                along = scipy.interpolate.make_interp_spline(grid, coefficients, k=degree, bc_type=ends, axis=axis)
                knots.append(along.t)
                coefficients = np.moveaxis(along.c, 0, axis)  # SciPy keeps the axis of a spline in front
            self._spline = scipy.interpolate.NdBSpline(tuple(knots), coefficients, degree)

    def derivative(self, by: tuple[int, ...], points: Array) -> Array:
        """The derivative by inputs, one after the other; without any, the value."""
        at, beyond, inside = self._places(points)
        moved = np.prod(inside[:, by], axis=1)
        factor = moved if by or self._outside == "constant" else np.ones(len(points))
        if self._outside == "linear":
            # Where one of the inputs is outside, the tangent has its slope: that of the edge at the other ones.
            for i in set(by):
                others = [j for j in by if j != i]
                if len(others) == len(by) - 1:
                    factor = factor + (1.0 - inside[:, i]) * np.prod(inside[:, others], axis=1)
        found = self._derivative(at, *by) * factor
        for i in range(self.lower.size if self._outside == "linear" else 0):
            found = found + moved * self._derivative(at, i, *by) * beyond[:, i]
        return np.asarray(found)

    def derivatives(self, by: tuple[int, ...], order: int, points: Array) -> Array:
        """All derivatives of an order of the one by inputs, shape (points, inputs, ...)."""
        inputs = range(points.shape[1])
        known = {some: self.derivative((*by, *some), points) for some in combinations_with_replacement(inputs, order)}
        every = [known[tuple(sorted(some))] for some in product(inputs, repeat=order)]
        return np.stack(every, axis=1).reshape(points.shape[0], *[len(inputs)] * order)

    def pieces(self, order: int) -> Any:
        """A derivative of a function of one input: the Bernstein coefficients of its polynomials between the knots."""
        interpolate, spline = scipy.interpolate, self._spline
        if not isinstance(spline, interpolate.PPoly):
            (degree,) = np.atleast_1d(spline.k).tolist()
            spline = interpolate.PPoly.from_spline((spline.t[0], spline.c, degree))
        kept = np.diff(spline.x) > 0.0  # knots at the ends of a spline are repeated
        plain = interpolate.PPoly(spline.c[:, kept], np.unique(spline.x))
        return interpolate.BPoly.from_power_basis(plain).derivative(order)

    @property
    def _outside(self) -> str:
        return "linear" if self.outside == "error" and _CONTINUED.get() else self.outside

    def _places(self, points: Array) -> tuple[Array, Array, Array]:
        """Where the spline is evaluated, how far from there the points are, and which inputs are inside (1 or 0)."""
        at = np.clip(points, self.lower, self.upper)
        if self._outside == "error":
            # A solver keeps bounds up to its tolerance: so far beyond its edge a table continues.
            far = np.abs(points - at) > MET * (self.upper - self.lower)
            if far.any():
                point, i = np.argwhere(far)[0]
                raise EvaluationError(
                    f"'{self.name}': {self.inputs[i]} = {points[point, i]:.6g} is outside of the table, from "
                    f"{self.lower[i]:g} to {self.upper[i]:g}. Bound what goes in, extend the table, or give "
                    "outside='linear' or 'constant'."
                )
            return points, np.zeros_like(points), np.ones_like(points)
        return at, points - at, (points == at).astype(float)

    def _derivative(self, at: Array, *by: int) -> Array:
        if isinstance(self._spline, scipy.interpolate.PchipInterpolator):
            return np.asarray(self._spline(at[:, 0], len(by), extrapolate=True))
        orders = np.bincount(np.array(by, dtype=int), minlength=self.lower.size)
        return np.asarray(self._spline(at, nu=orders, extrapolate=True))


class _Spline(Function):
    """An interpolant, or one of its derivatives, for expressions, numbers and arrays."""

    def __init__(self, interpolant: _Interpolant, by: tuple[int, ...], **options: Any) -> None:
        self._interpolant, self._by = interpolant, by
        self.lower, self.upper, self.cells = interpolant.lower, interpolant.upper, interpolant.cells
        functions = [partial(interpolant.derivatives, by, order) for order in range(3)]
        super().__init__(*functions, inputs=interpolant.inputs, check_derivatives=False, **options)

    def values_at(self, point: Sequence[float]) -> Array:
        """The value at one point, shape (1,)."""
        # What is remembered of the last point may not be legal there a moment later.
        return self.values(np.array([point], dtype=float))[0] if _CONTINUED.get() else super().values_at(point)

    @cached_property
    def _orders(self) -> list[Any]:
        """The function and its first two derivatives, between the knots."""
        return [self._interpolant.pieces(len(self._by) + order) for order in range(3)]

    def taylor_form(self, *arguments: Any) -> TaylorForm:
        """Bounds of the function and its derivatives, from the bounds of its argument; unknown where there are two.

        Where the slope jumps inside a subinterval the second derivative has no bound. Values have one nevertheless, and
        halving leaves few such subintervals.
        """
        moving = next(argument for argument in arguments if isinstance(argument, TaylorForm))
        low, high = moving.value.low, moving.value.high
        if len(arguments) > 1:
            return TaylorForm.constant(np.nan, len(low))
        knots, outside = self._orders[0].x, self._interpolant.outside
        rounding = 16 * np.finfo(float).eps * np.abs(knots).max()
        last = len(knots) - 2
        first_piece = np.clip(np.searchsorted(knots, low, side="right") - 1, 0, last)
        last_piece = np.clip(np.searchsorted(knots, high, side="left") - 1, first_piece, last)
        bounds_of_pieces = [self._bounds_on(first_piece, low - rounding, high + rounding)]
        for further in range(1, int((last_piece - first_piece).max(initial=0)) + 1):
            piece = np.minimum(first_piece + further, last_piece)
            bounds_of_pieces.append(self._bounds_on(piece, low - rounding, high + rounding))
        values, slopes, curvatures = (list(of) for of in zip(*bounds_of_pieces, strict=True))
        beyond = np.minimum(low + rounding - knots[0], 0.0), np.maximum(high - rounding - knots[-1], 0.0)
        is_beyond = (beyond[0] < 0.0) | (beyond[1] > 0.0)
        rests = _where(is_beyond, 0.0, 0.0)
        kinks, edges = self._kinks, knots[[0, -1]]
        if outside == "linear":
            kinks = np.setdiff1d(kinks, edges)
            for edge, distance in zip(edges, beyond, strict=True):
                end = self._orders[0](edge) + self._orders[1](edge) * distance
                values.append(Interval(end, end))
        else:
            slopes.append(rests)
        bends = np.searchsorted(kinks, high - rounding, "left") > np.searchsorted(kinks, low + rounding, "right")
        curvatures += [rests, _where(bends, -np.inf, np.inf)]
        unknown = ~np.isfinite(low) | ~np.isfinite(high) | (is_beyond & (outside == "error"))
        return moving.compose(*(_unless(unknown, _hull(bounds)) for bounds in (values, slopes, curvatures)))

    def _bounds_on(self, piece: Indices, low: Array, high: Array) -> tuple[Interval, Interval, Interval]:
        """Of a polynomial between two knots, where an argument is there."""
        origin, end = self._orders[0].x[piece], self._orders[0].x[piece + 1]
        start, stop = ((np.clip(at, origin, end) - origin) / (end - origin) for at in (low, high))
        value, slope, curvature = (restrict(of.c[:, piece].T, start, stop) for of in self._orders)
        form = taylor_form_of_polynomial((value, slope, curvature))
        return form.value, form.first, form.second

    @property
    def _kinks(self) -> Array:
        """Knots at which the slope jumps; the ends too, where it is not zero."""
        slopes = self._orders[1].c
        before, after = np.append(0.0, slopes[-1]), np.append(slopes[0], 0.0)
        return np.asarray(self._orders[0].x[np.abs(after - before) > NEGLIGIBLE * np.abs(slopes).max(initial=0.0)])

    def __call__(self, *arguments: Any) -> Any:
        """The function at these arguments: an expression, a number, or for arrays of numbers an array of their shape.

        Raises
        ------
        FunctionError
            When their count is wrong, or one of them is no number of Pyomo's.
        """
        if any(_is_numeric_array(a) for a in arguments) and len(arguments) == self.lower.size:
            try:
                arrays = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in arguments))
            except (TypeError, ValueError) as error:
                raise FunctionError(f"'{self.name}': {error}. Give arrays of one shape, or expressions.") from None
            points = np.stack([array.ravel() for array in arrays], axis=1)
            return self.values(points)[:, 0].reshape(arrays[0].shape)
        return super().__call__(*arguments)


class Table(_Spline):
    """A table of numbers as a smooth function of one or two inputs, for expressions, numbers and arrays.

    The function goes through all points of the table. As any `Function` it is legal wherever Pyomo's expressions are,
    has exact first and second derivatives, and is evaluated for all points of a model at once. `derivative` gives its
    slopes as functions of the same kind.

    Parameters
    ----------
    *grids_and_values : array-likes
        ``Table(x, values)`` for one input, shapes (n,) and (n,); ``Table(x, y, values)`` for two, shapes (n,), (m,) and
        (n, m): rows of the values belong to x. Grids increase strictly. ``Table(series)`` and ``Table(frame)`` of
        pandas take the grids from index and columns.
    kind : {"linear", "cubic", "natural", "quintic", "monotone"}
        Cubic splines have two continuous derivatives, quintic ones four; in two inputs they are tensor products.
        ``"cubic"`` has not-a-knot ends, ``"natural"`` no curvature there. ``"monotone"``, of one input only, never
        overshoots: between two points it stays between their values; its second derivative jumps at the points. That of
        ``"linear"`` is zero, and its slope jumps.
    outside : {"error", "linear", "constant"}
        Beyond the table: refused (a solver takes a shorter step then, and no solution lies there), continued by the
        tangent, or by the value at the edge. Both continuations have kinks at the edge, in the second and in the first
        derivative.
    inputs : sequence of str, optional
        Names of the inputs, for messages.
    name : str

    Attributes
    ----------
    lower, upper : float array, shape (inputs,)
        The range of the table.

    Raises
    ------
    FunctionError
        For grids that do not increase, too few points, values of another shape, or numbers that are not finite.
    EvaluationError
        When it is evaluated beyond the table, where that is refused.

    References
    ----------
    de Boor, A Practical Guide to Splines, Springer 1978. Fritsch and Butland, A method for constructing local monotone
    piecewise cubic interpolants, SIAM J. Sci. Stat. Comput. 5(2), 1984, doi:10.1137/0905021

    Examples
    --------
    >>> import numpy as np, pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> drag = rcp.Table([0, 1, 2, 3, 4], [0, 1, 8, 27, 64], name="drag")
    >>> m = pyo.ConcreteModel()
    >>> m.v = pyo.Var(initialize=2.5)
    >>> print(drag(m.v) / 2, round(drag(1.5), 6), drag(np.array([1.0, 2.0])).round(6))
    drag(v)/2 3.375 [1. 8.]
    """

    def __init__(
        self,
        *grids_and_values: Any,
        kind: Kind = "cubic",
        outside: Outside = "error",
        inputs: Sequence[str] | None = None,
        name: str = "table",
    ) -> None:
        if len(grids_and_values) == 1:
            grids_and_values = _of_pandas(name, grids_and_values[0])
        if len(grids_and_values) not in (2, 3):
            raise FunctionError(
                f"'{name}': {len(grids_and_values)} arrays are given. A table is Table(x, values) or "
                "Table(x, y, values)."
            )
        for word, given, known in (
            ("kind", kind, tuple(_Interpolant._FEWEST)),
            ("outside", outside, ("error", "linear", "constant")),
        ):
            if given not in known:
                raise FunctionError(f"'{name}': {word} is {given!r}; choose one of {', '.join(map(repr, known))}.")
        count = len(grids_and_values) - 1
        if kind == "monotone" and count == 2:
            raise FunctionError(f"'{name}': kind='monotone' is for tables of one input. Give kind='cubic'.")
        names = [f"input {i}" for i in range(count)] if inputs is None else list(inputs)
        if len(names) != count:
            raise FunctionError(f"'{name}': inputs has {len(names)} names for {count} grids.")
        fewest = _Interpolant._FEWEST[kind]
        grids = [
            increasing_numbers(grid, f"'{name}': points of {of}, kind={kind!r}", FunctionError, fewest)
            for of, grid in zip(names, grids_and_values, strict=False)
        ]
        values = finite_numbers(grids_and_values[-1], f"'{name}': values", FunctionError)
        shape = tuple(grid.size for grid in grids)
        if values.shape != shape:
            raise FunctionError(
                f"'{name}': values have the shape {values.shape}; the grids ask for {shape}."
                + (" Transpose them." if values.shape == shape[::-1] else "")
            )
        interpolant = _Interpolant(name, names, grids, values, kind, outside)
        super().__init__(interpolant, (), name=name)
        self._derivatives: dict[int, _Spline] = {}

    def derivative(self, *arguments: Any, by: int | str | None = None) -> Any:
        """The derivative by one of the inputs, at arguments as in a call: the spline's own, not a difference.

        Parameters
        ----------
        *arguments : variables, expressions, parameters, numbers or arrays of numbers
            As the table itself takes them. Beyond the table it is the derivative of the continuation.
        by : int or str, optional
            The input, by its number or its name; needed where there are two.

        Returns
        -------
        expression, number or array

        Raises
        ------
        FunctionError
            When it has no such input, or as for a call.
        EvaluationError
            When it is evaluated beyond the table, where that is refused.

        Examples
        --------
        >>> import pyrobocop_pyomo as rcp
        >>> cube = rcp.Table([0, 1, 2, 3, 4], [0, 1, 8, 27, 64])
        >>> round(cube.derivative(1.5), 6)  # 3 * 1.5 ** 2
        6.75
        """
        names = self._interpolant.inputs
        if by is None and len(names) == 1:
            by = 0
        if by not in names and by not in range(len(names)):
            raise FunctionError(
                f"'{self.name}': its derivative is requested by {by!r}; give by={' or by='.join(map(repr, names))}."
            )
        i = names.index(by) if isinstance(by, str) else int(by)  # type: ignore[arg-type]
        if i not in self._derivatives:
            self._derivatives[i] = _Spline(
                self._interpolant,
                (i,),
                name=f"{self.name}.derivative" + (f"_by_{names[i].replace(' ', '_')}" if len(names) > 1 else ""),
            )
        return self._derivatives[i](*arguments)

    @classmethod
    def from_csv(cls, path: str | Path, **options: Any) -> Table:
        """A table in a file of comma-separated values, which pandas reads.

        Parameters
        ----------
        path : str or Path
            Two columns below a line of titles: one input and the values. More columns: the first has the first input
            below any title, and the first line the second input above the values.
        **options : Any
            As for `Table`; the name is by default the file's.

        Raises
        ------
        FunctionError
            Naming the entry that is no number.
        """
        frame = pandas.read_csv(path, index_col=0)
        return cls(frame.squeeze("columns"), **{"name": Path(path).stem, **options})


def _hull(bounds: list[Interval]) -> Interval:
    return Interval(np.min([bound.low for bound in bounds], axis=0), np.max([bound.high for bound in bounds], axis=0))


def _where(condition: Any, low: float, high: float) -> Interval:
    """An interval where a condition holds, and the empty one elsewhere, which adds nothing to a hull."""
    return Interval(np.where(condition, low, np.inf), np.where(condition, high, -np.inf))


def _unless(unknown: Any, bounds: Interval) -> Interval:
    return Interval(np.where(unknown, np.nan, bounds.low), np.where(unknown, np.nan, bounds.high))


def _is_numeric_array(argument: Any) -> bool:
    return isinstance(argument, np.ndarray) and argument.ndim > 0 and argument.dtype.kind in "fiu"


def _of_pandas(name: str, given: Any) -> tuple[Any, ...]:
    if not hasattr(given, "index") or not hasattr(given, "to_numpy"):
        raise FunctionError(f"'{name}': only one array is given. A table is Table(x, values) or Table(x, y, values).")
    columns = [given.columns] if hasattr(given, "columns") else []
    return (given.index, *columns, given.to_numpy())
