"""Values of a model's variables at one moment: read, compared, put back, carried to a twin of the model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from operator import attrgetter
from typing import Any
from zlib import crc32

from pyomo.common.collections import ComponentMap
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ModelError

Values = list[float | None]

_VALUE = attrgetter("value")


class VariableValues:
    """Some variables, and the values that they had when this was made.

    A model may grow or shrink meanwhile: `restore` leaves alone what was added, and what was removed.

    Parameters
    ----------
    variables : iterable of VarData

    Attributes
    ----------
    variables : list of VarData
        In the order in which values are read and written.
    taken : list of float or None
        Their values when this was made.
    """

    def __init__(self, variables: Iterable[Any]) -> None:
        self.variables = list(variables)
        self.taken = self.read()
        self._stale = [variable.stale for variable in self.variables]

    @classmethod
    def of_free(cls, model: Any) -> VariableValues:
        """Of the variables on active blocks that are not fixed: what a solver may change."""
        return cls(variable for variable in model.component_data_objects(Var, active=True) if not variable.fixed)

    @classmethod
    def of_all(cls, model: Any) -> VariableValues:
        """Of all variables, in an order that a model built again in the same way has as well."""
        return cls(model.component_data_objects(Var))

    @property
    def by_variable(self) -> ComponentMap:
        """The values when this was made, by variable."""
        return ComponentMap(zip(self.variables, self.taken, strict=True))

    def read(self) -> Values:
        """The values now."""
        return list(map(_VALUE, self.variables))

    def write(self, values: Sequence[float | None]) -> None:
        """Set values, in the order of `variables`; they may violate bounds by a solver's tolerance.

        Raises
        ------
        ModelError
            When there are more or fewer values than variables.
        """
        if len(values) != len(self.variables):
            raise ModelError(
                f"the model built again has {len(self.variables)} variables where {len(values)} were found. The "
                "function that builds it must give the same each time."
            )
        put_values(self.variables, values)

    def restore(self) -> None:
        """Put back the values, and the flags of stale values, that there were when this was made."""
        for variable, number, stale in zip(self.variables, self.taken, self._stale, strict=True):
            if variable.parent_component() is not None:
                variable.set_value(number, skip_validation=True)
                variable.stale = stale


def put_values(variables: Iterable[Any], values: Iterable[float | None]) -> None:
    """Give each variable its value; they may violate bounds by a solver's tolerance."""
    for variable, number in zip(variables, values, strict=True):
        variable.set_value(number, skip_validation=True)


def checksum(numbers: Iterable[Any]) -> int:
    """A number that other values hardly share, the same in every process."""
    return crc32(repr(list(numbers)).encode())


def checksum_of_model(model: Any) -> int:
    """The checksum of all variables and mutable parameters of a model."""
    variables = map(_VALUE, model.component_data_objects(Var))
    data = (map(_VALUE, of.values()) for of in model.component_objects(Param) if of.mutable)
    return checksum(chain(variables, *data))


@contextmanager
def values_restored(variables: Iterable[Any]) -> Iterator[VariableValues]:
    """Put the values of variables back at the end, whatever happens in between."""
    values = VariableValues(variables)
    try:
        yield values
    finally:
        values.restore()


def within(number: float, bounds: tuple[float | None, float | None]) -> float:
    """The number, moved onto the nearest bound if it lies outside."""
    lower, upper = bounds
    number = float(number) if lower is None else max(float(number), lower)
    return number if upper is None else min(number, upper)


def within_bounds(number: float, variable: Any) -> float:
    """The number, moved into the bounds of a variable."""
    return within(number, variable.bounds)
