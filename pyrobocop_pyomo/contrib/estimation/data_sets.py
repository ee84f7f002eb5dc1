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
    series: dict[str, Series] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("inputs", "initial"):
            object.__setattr__(self, name, getattr(self, name) or {})  # None stands for nothing here too
        object.__setattr__(self, "series", _read(self.measurements, f"data set '{self.name}'" if self.name else "data"))

    def _summary(self) -> str:
        return f"'{self.name}'"

    def samples(self, outputs: Sequence[str], error: Any = None) -> dict[str, Array]:
        """Times, values and standard deviations of the outputs that were measured, each an array of shape (samples, 3).

        Parameters
        ----------
        outputs : sequence of str
        error : number or mapping of output to number, optional
            Standard deviations where the data set says none; NaN stands for what is not known.

        Raises
        ------
        EstimationError
            When deviations are not positive or belong to nothing, or none of the outputs was measured.
        """
        label, series = f"data set '{self.name}'", {name: self.series[name] for name in outputs if name in self.series}
        if not series:
            raise EstimationError(f"{label}: has no data of {', '.join(outputs)}; it has {', '.join(self.series)}.")
        if isinstance(self.error, Mapping) and (strange := [name for name in self.error if name not in series]):
            raise EstimationError(f"{label}: has an error for '{strange[0]}', but no data of it.")
        given, found = error if self.error is None else self.error, {}
        for name, (times, values) in series.items():
            number = given.get(name) if isinstance(given, Mapping) else given
            try:
                deviations = np.broadcast_to(np.asarray(1.0 if number is None else number, dtype=float), values.shape)
            except (TypeError, ValueError):
                deviations = np.zeros(1)
            if not ((deviations > 0.0) & (deviations < np.inf)).all():
                raise EstimationError(
                    f"{label}: the error of '{name}' is {number!r}; expected a standard deviation, a positive number, "
                    "for all samples or for each."
                )
            found[name] = np.column_stack([times, values, deviations if number is not None else values * np.nan])
        return found


def as_data_sets(data: Any) -> list[DataSet]:
    """Data sets with names, from whatever the user gave: one, a list of them, or a mapping from names to them.

    Raises
    ------
    EstimationError
    """
    if isinstance(data, Mapping) and "time" not in data and any(map(_is_one, data.values())):
        listed = list(data.items())
    elif isinstance(data, Sequence) and not isinstance(data, str):
        listed = [("", each) for each in data]
    else:
        listed = [("", data)]
    if not listed:
        raise EstimationError("there are no data. Give at least one data set.")
    found = {}
    for number, (name, each) in enumerate(listed, start=1):
        name = str(name or getattr(each, "name", "") or f"set {number}")
        if name in found:
            raise EstimationError(f"two data sets have the name '{name}'; each needs one of its own.")
        found[name] = replace(each, name=name) if isinstance(each, DataSet) else DataSet(each, name=name)
    return list(found.values())


def _is_one(data: Any) -> bool:
    """Whether something is the data of an experiment, and not of an output."""
    return isinstance(data, (Mapping, DataSet)) or hasattr(data, "columns")


def _read(data: Any, label: str) -> dict[str, Series]:
    is_frame = hasattr(data, "columns")
    if not is_frame and not isinstance(data, Mapping):
        raise EstimationError(
            f"{label} is a {type(data).__name__}; expected a data frame with times as index, a mapping of names to "
            "numbers with the key 'time', a DataSet, or a list of them."
        )
    common = data.index if is_frame else data.get("time")
    series: dict[str, Series] = {}
    for name in data:
        if name == "time" and not is_frame:
            continue
        what, given, times = f"{label}: '{name}'", data[name], common
        if isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) == 1:
            times, given = given
        elif hasattr(given, "index") and hasattr(given, "to_numpy"):
            times = given.index
        if times is None:
            raise EstimationError(
                f"{what}: has no times. Give the key 'time' for all outputs, or a pair (times, values) for this one."
            )
        moments, values = _numbers(times, f"{what}: times"), _numbers(given, what)
        if moments.shape != values.shape:
            raise EstimationError(f"{what} has {values.size} values at {moments.size} times.")
        bad = ~np.isfinite(moments) | np.isinf(values)
        if bad.any():
            raise EstimationError(f"{what} is infinite at t = {moments[bad][0]:g}; a missing value is NaN.")
        series[str(name)] = moments, values
    if not any(np.isfinite(values).any() for _, values in series.values()):
        raise EstimationError(f"{label}: there is no number in it. Missing values are NaN, but not all can be.")
    return series


def _numbers(given: Any, label: str) -> Array:
    try:
        numbers = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise EstimationError(f"{label}: expected numbers ({error}).") from None
    if numbers.ndim != 1:
        raise EstimationError(f"{label}: has shape {numbers.shape}; expected a row of numbers.")
    return numbers
