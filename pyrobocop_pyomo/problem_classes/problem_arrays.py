"""The arrays that methods of a problem class get: variables to read, rows to fill, derivatives kept track of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pyomo.common.numeric_types import native_numeric_types

from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, ExpressionArray, array, plain_entry


class ColumnArray(ExpressionArray):
    """Variables of one kind at one point, shape ``(n,)``.

    Authors write ``x[0]`` or ``x[0, 0]``: a second index chooses a column, of which there is one, or one per point of
    the first element for the initial state of a Mayer term.
    """

    columns: tuple[Any, ...] | None = None

    def __array_finalize__(self, source: Any) -> None:
        self.columns = None  # of a slice or a result, nothing is known

    def __getitem__(self, key: Any) -> Any:
        if self.ndim != 1 or not isinstance(key, tuple) or len(key) != 2:
            return super().__getitem__(key)
        row, column = key
        if isinstance(column, (int, np.integer)):
            return self._column(int(column))[row]
        if isinstance(column, slice) and row is not None:
            columns = [self._column(j) for j in range(len(self.columns or (self,)))[column]]
            return np.stack([np.asarray(values) for values in columns], axis=-1).view(ExpressionArray)[row]
        return super().__getitem__(key)

    def _column(self, j: int) -> Any:
        return (self.columns or (np.asarray(self),))[j]


def column_array(entries: Any, columns: Any = None) -> ColumnArray:
    """An array of entries; `columns` are what a second index chooses from."""
    made = array(list(entries)).view(ColumnArray)
    if columns is not None:
        made.columns = tuple(np.asarray(array(list(values))) for values in columns)
    return made


class ArrayToFill(ExpressionArray):
    """Zeros that a method fills in place; one column also takes a vector."""

    @classmethod
    def zeros(cls, shape: tuple[int, ...]) -> ArrayToFill:
        """All entries 0.0."""
        return np.full(shape, 0.0, dtype=object).view(cls)

    def __setitem__(self, key: Any, entry: Any) -> None:
        given: Any = array(entry)
        target = np.asarray(self)[key]
        if isinstance(target, np.ndarray) and given.shape != target.shape and given.size == target.size:
            given = np.reshape(given, target.shape)
        elif not isinstance(target, np.ndarray) and given.size == 1:
            given = np.reshape(given, ())
        super().__setitem__(key, given)


class LazyEntry(ArrayEntry):
    """An entry that is computed when it is first used."""

    __slots__ = ("_compute",)

    def __init__(self, compute: Callable[[], Any]) -> None:
        self._compute = compute

    @property
    def expression(self) -> Any:
        """What it stands for."""
        return self._compute()


class RateEntry(ArrayEntry):
    """``constant + sum_j coefficients[j] * xdot_j``: as long as derivatives occur so, their equations can be solved.

    Whatever is not affine in them takes `expression`, and the rates that it depends on are noted.

    Parameters
    ----------
    constant : number or expression
    coefficients : dict of int to number or expression
    rates : Rates
    """

    __slots__ = ("coefficients", "constant", "rates")

    def __init__(self, constant: Any, coefficients: dict[int, Any], rates: Rates) -> None:
        self.constant, self.coefficients, self.rates = constant, coefficients, rates

    @property
    def expression(self) -> Any:
        """The whole, in the derivatives themselves."""
        return self.rates.whole(self)

    def _plus(self, other: Any, sign: float, own_sign: float = 1.0) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        coefficients = {j: _times(own_sign, own) for j, own in self.coefficients.items()}
        if isinstance(other, RateEntry):
            for j, coefficient in other.coefficients.items():
                coefficients[j] = coefficients.get(j, 0.0) + _times(sign, coefficient)
            other = other.constant
        return RateEntry(_times(own_sign, self.constant) + _times(sign, plain_entry(other)), coefficients, self.rates)

    def _scaled(self, scale: Callable[[Any], Any]) -> RateEntry:
        return RateEntry(scale(self.constant), {j: scale(a) for j, a in self.coefficients.items()}, self.rates)

    def __add__(self, other: Any) -> Any:
        return self._plus(other, 1.0)

    __radd__ = __iadd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self._plus(other, -1.0)

    __isub__ = __sub__

    def __rsub__(self, other: Any) -> Any:
        return self._plus(other, 1.0, -1.0)

    def __neg__(self) -> RateEntry:
        return self._scaled(lambda part: -part)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        if isinstance(other, RateEntry):
            return ArrayEntry(self.expression * other.expression)
        factor = plain_entry(other)
        return self._scaled(lambda part: _times(factor, part))

    __rmul__ = __imul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        if isinstance(other, RateEntry):
            return ArrayEntry(self.expression / other.expression)
        divisor = plain_entry(other)
        return self._scaled(lambda part: part / divisor)

    __itruediv__ = __truediv__


class Rates:
    """The derivatives of one call, and which of them occurred otherwise than in an affine way.

    Parameters
    ----------
    derivatives : sequence
        What stands for each in a whole expression.
    """

    def __init__(self, derivatives: Any) -> None:
        self._derivatives = derivatives
        self.not_affine: set[int] = set()

    def entries(self) -> list[RateEntry]:
        """One entry per derivative."""
        return [RateEntry(0.0, {j: 1.0}, self) for j in range(len(self._derivatives))]

    def whole(self, entry: RateEntry) -> Any:
        """An entry as one expression."""
        self.not_affine |= set(entry.coefficients)
        return entry.constant + sum(_times(a, self._derivatives[j]) for j, a in entry.coefficients.items())


def _times(factor: Any, part: Any) -> Any:
    for first, second in ((factor, part), (part, factor)):
        if first.__class__ in native_numeric_types and first in (0, 1):
            return second if first == 1 else 0.0
    return factor * part
