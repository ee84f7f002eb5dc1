"""`DataSet`: what was measured in one experiment, what was applied, and how it began."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented

Series = tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class DataSet(Presented):
    """Data of one experiment.

    Parameters
    ----------
    measurements : DataFrame or mapping
        A frame has the times as its index; a mapping has names of outputs with arrays, and the times under ``"time"``.
        An output with times of its own is a pair ``(times, values)`` or a Series with the times as its index. NaN
        stands for what is missing.
    error : number or mapping, optional
        Standard deviation of the measurements: a number for all, or by output a number or an array.
    inputs : mapping, optional
        Controls that were applied, by name: a number, an array over the nodes of the control, a function of time, or a
        pair ``(times, values)`` that is interpolated.
    initial : mapping of state name to number, optional
        Known values at the start.
    name : str

    Attributes
    ----------
    series : dict of str to (times, values)
        The measurements, by output.

    Raises
    ------
    EstimationError
        When the data are no numbers, or values and times differ in length.
    """

    measurements: Any
    error: float | Mapping[str, Any] | None = None
    inputs: Mapping[str, Any] = field(default_factory=dict)
    initial: Mapping[str, float] = field(default_factory=dict)
    name: str = ""

    def __post_init__(self) -> None:
        for name in ("inputs", "initial"):
            object.__setattr__(self, name, getattr(self, name) or {})  # None stands for nothing here too
        object.__setattr__(self, "series", _read(self.measurements, f"data set '{self.name}'" if self.name else "data"))

    series: dict[str, Series] = field(init=False, repr=False)

    def _summary(self) -> str:
        return f"'{self.name}'"


def as_data_sets(data: Any) -> list[DataSet]:
    """Data sets with names, from whatever the user gave: one, a list of them, or a mapping from names to them.

    Raises
    ------
    EstimationError
    """
    if isinstance(data, DataSet) or _is_frame(data) or _is_one_mapping(data):
        listed: list[tuple[str, Any]] = [("", data)]
    elif isinstance(data, Mapping):
        listed = [(str(name), each) for name, each in data.items()]
    elif isinstance(data, Sequence) and not isinstance(data, str):
        listed = [("", each) for each in data]
    else:
        raise EstimationError(
            f"data is a {type(data).__name__}; expected a data frame, a mapping with the key 'time', a DataSet, or a "
            "list of them."
        )
    if not listed:
        raise EstimationError("there are no data. Give at least one data set.")
    found = []
    for number, (name, each) in enumerate(listed, start=1):
        name = name or (each.name if isinstance(each, DataSet) else "") or f"set {number}"
        found.append(replace(each, name=name) if isinstance(each, DataSet) else DataSet(each, name=name))
    names = [each.name for each in found]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise EstimationError(f"two data sets have the name '{twice[0]}'; each needs one of its own.")
    return found


def _is_frame(data: Any) -> bool:
    return hasattr(data, "columns") and hasattr(data, "index")


def _is_one_mapping(data: Any) -> bool:
    """Whether a mapping is the data of one experiment: arrays by output, not experiments by name."""
    if not isinstance(data, Mapping):
        return False
    values = list(data.values())
    nested = [isinstance(value, (Mapping, DataSet)) or _is_frame(value) for value in values]
    return "time" in data or not any(nested)


def _read(data: Any, label: str) -> dict[str, Series]:
    series: dict[str, Series] = {}
    if _is_frame(data):
        times = _numbers(data.index, f"{label}: the index", whole=True)
        columns = {str(name): data[name] for name in data.columns}
        if len(columns) != len(data.columns):
            raise EstimationError(f"{label}: the frame has a column twice.")
        for name, column in columns.items():
            series[name] = (times, _numbers(column, f"{label}: '{name}'"))
    elif isinstance(data, Mapping):
        common = None if "time" not in data else _numbers(data["time"], f"{label}: 'time'", whole=True)
        for name, given in data.items():
            if name == "time":
                continue
            series[str(name)] = _with_times(given, common, f"{label}: '{name}'")
    else:
        raise EstimationError(
            f"{label}: measurements are a {type(data).__name__}; expected a data frame with times as index, or a "
            "mapping of names to numbers with the key 'time'."
        )
    for name, (times, values) in series.items():
        if times.ndim != 1 or times.shape != values.shape:
            raise EstimationError(f"{label}: '{name}' has {values.size} values at {times.size} times.")
        if np.isinf(values).any():
            raise EstimationError(f"{label}: '{name}' is infinite at t = {times[np.isinf(values)][0]:g}.")
    if not any(np.isfinite(values).any() for _, values in series.values()):
        raise EstimationError(f"{label}: there is no number in it. Missing values are NaN, but not all can be.")
    return series


def _with_times(given: Any, common: Array | None, label: str) -> Series:
    if isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) == 1:
        return _numbers(given[0], f"{label}: times", whole=True), _numbers(given[1], label)
    if hasattr(given, "index") and hasattr(given, "to_numpy"):
        return _numbers(given.index, f"{label}: the index", whole=True), _numbers(given, label)
    if common is None:
        raise EstimationError(
            f"{label}: has no times. Give the key 'time' for all outputs, or a pair (times, values) for this one."
        )
    return common, _numbers(given, label)


def _numbers(given: Any, label: str, *, whole: bool = False) -> Array:
    try:
        numbers = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise EstimationError(f"{label}: expected numbers ({error}).") from None
    if numbers.ndim != 1:
        raise EstimationError(f"{label}: has shape {numbers.shape}; expected a row of numbers.")
    if whole and not np.isfinite(numbers).all():
        raise EstimationError(f"{label}: holds a time that is not finite.")
    return numbers


def deviations_of(data: DataSet, name: str, count: int) -> Array | None:
    """Standard deviations of the samples of an output; None where they are not known.

    Raises
    ------
    EstimationError
        When they are not positive.
    """
    given = data.error.get(name) if isinstance(data.error, Mapping) else data.error
    if given is None:
        return None
    what = f"data set '{data.name}': the error of '{name}'"
    try:
        found = np.broadcast_to(np.asarray(given, dtype=float), count)
    except (TypeError, ValueError):
        raise EstimationError(f"{what} has no number for each of its {count} samples.") from None
    if not (np.isfinite(found) & (found > 0.0)).all():
        raise EstimationError(f"{what} is {given!r}; a standard deviation is positive.")
    return found
