"""Named signals on common times as a pandas frame, or as the time series of Pyomo's ``contrib.mpc``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.contrib.mpc import TimeSeriesData
from pyomo.core.base.componentuid import ComponentUID
from pyomo.core.base.set import Set

from pyrobocop_pyomo.optional_imports import pandas

Array = NDArray[np.float64]


def as_data_frame(times: Array, values: Mapping[str, Array]) -> Any:
    """A data frame with one row per time and one column per signal."""
    return pandas.DataFrame(dict(values), index=pandas.Index(times, name="time"))


def as_time_series(owner: str, times: Array, values: Mapping[str, Array]) -> TimeSeriesData:
    """Time series with a key such as ``push.theta[*]`` per signal, as ``contrib.mpc`` reads and writes them."""
    index = Set(initialize=times.tolist(), ordered=True)
    index.construct()
    return TimeSeriesData({ComponentUID(f"{owner}.{name}[*]"): each.tolist() for name, each in values.items()}, index)
