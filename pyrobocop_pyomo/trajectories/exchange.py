"""Named signals on common times: pandas frames, xarray data sets, and the time series of Pyomo's ``contrib.mpc``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.contrib.mpc import TimeSeriesData
from pyomo.core.base.componentuid import ComponentUID
from pyomo.core.base.set import Set

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Grid, Mesh, lobatto
from pyrobocop_pyomo.optional_imports import pandas, xarray

Array = NDArray[np.float64]


def as_data_frame(times: Array, values: Mapping[str, Array]) -> Any:
    """A data frame with one row per time and one column per signal."""
    return pandas.DataFrame(dict(values), index=pandas.Index(times, name="time"))


def as_time_series(owner: str, times: Array, values: Mapping[str, Array]) -> TimeSeriesData:
    """Time series with a key such as ``push.theta[*]`` per signal, as ``contrib.mpc`` reads and writes them."""
    index = Set(initialize=times.tolist(), ordered=True)
    index.construct()
    return TimeSeriesData({ComponentUID(f"{owner}.{name}[*]"): each.tolist() for name, each in values.items()}, index)


def as_data_set(times: Array, values: Mapping[str, Array], facts: Mapping[str, Any]) -> Any:
    """An xarray data set over the coordinate ``time``, with facts as its attributes."""
    variables = {name: ("time", each) for name, each in values.items()}
    return xarray.Dataset(variables, coords={"time": times}, attrs=dict(facts))


def facts_of_time_series(series: Any, like: Any = None) -> dict[str, Any]:
    """What a trajectory of a time series consists of; ``like`` is a trajectory whose grid and kinds it has.

    Raises
    ------
    TrajectoryError
        When it is no time series of one phase, or does not have the names and times of the other trajectory.
    """
    owner, times, values = _read(series)
    facts: dict[str, Any] = {"name": owner, "pairs": {}}
    if like is None:
        grid = Grid(lobatto(2), Mesh(tuple(times.tolist())))
        return {**facts, "grid": grid, "states": values, "signals": {}, "parameters": {}}
    same = len(times) == len(like.time) and np.allclose(times, like.time, rtol=0, atol=1e-9 * like.duration)
    if not same or set(values) != set(like.names):
        raise TrajectoryError(
            f"the time series has {', '.join(values)} at {len(times)} times, trajectory '{like.name}' has "
            f"{', '.join(like.names)} at {len(like.time)}; they must agree. Leave 'like' out to join the samples "
            "by straight lines."
        )
    positions = np.searchsorted(like.time, like.points)
    return {
        **facts,
        "grid": like.grid,
        "states": {name: values[name] for name in like.states},
        "signals": {name: values[name][positions] for name in like.signals},
        "parameters": like.parameters,
        "held": like.held,
        "phase": like.phase,
    }


def _read(series: Any) -> tuple[str, Array, dict[str, Array]]:
    """Owner, times and values by name of a time series whose keys look like ``push.theta[*]``.

    Raises
    ------
    TrajectoryError
        When it is no time series, or has fewer than two times, values that are not finite, or keys of several owners.
    """
    if not isinstance(series, TimeSeriesData):
        raise TrajectoryError(f"a {type(series).__name__} is no time series of pyomo.contrib.mpc.")
    times = np.array(series.get_time_points(), dtype=float)
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise TrajectoryError(f"a time series with the times {times.tolist()}; two or more that increase are needed.")
    owners, values = set(), {}
    for key, samples in series.get_data().items():
        owner, _, name = str(key).removesuffix("[*]").rpartition(".")
        owners.add(owner)
        values[name] = np.array(samples, dtype=float)  # None becomes NaN
        if not np.isfinite(values[name]).all():
            raise TrajectoryError(f"the time series has no finite value of '{key}' at every time.")
    if len(owners) != 1:
        raise TrajectoryError(
            f"the time series has keys of {', '.join(map(repr, sorted(owners))) or 'nothing'}; one trajectory is that "
            "of one phase. Use series.extract_variables(...) first."
        )
    return owners.pop(), times, values
