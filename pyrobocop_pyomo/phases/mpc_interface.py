"""`PhaseInterface`: a phase as the dynamic model that `pyomo.contrib.mpc` works with."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.contrib.mpc import DynamicModelInterface, TimeSeriesData
from pyomo.core.base.componentuid import ComponentUID
from pyomo.core.base.expression import Expression
from pyomo.core.base.reference import Reference
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import InitialGuessError

from .declarations import Control, Parameter, State
from .initial_guesses import guess_values
from .phase_values import expressions_over_time
from .record import PhaseRecord


class PhaseInterface(DynamicModelInterface):
    """`pyomo.contrib.mpc.DynamicModelInterface` of one phase.

    Its time set is `points`: there, and only there, states, algebraics and controls all have a variable. Pyomo's own
    interface takes what is indexed by one set, and would take controls, or states, for constants. Keys are those of
    `Trajectory.to_time_series`, such as ``push.theta[*]``; times are the phase's indices, from 0 to 1 with a free
    duration.
    """

    def __init__(self, block: Any) -> None:
        # Not Pyomo's __init__, which flattens the whole model by one index set; these are the attributes that it makes.
        record: PhaseRecord = block.record
        linear = [name for name in record.names(Control) if block.component(name).ctype is Expression]
        names = [name for name in (*record.names_of_states, *record.names_of_signals) if name not in linear]
        scalars = [block.component(name) for name in record.names(Parameter)]
        if block.has_free_duration:
            scalars.append(block.duration)
        self.model, self.time = block.model(), block.points
        self._block, self._record = block, record
        self._scalar_vars = scalars
        self._scalar_expr: list[Any] = []
        # A piecewise linear control is an expression at each point: it can be read, and loaded at its knots. The
        # user's Expressions can be read only.
        linear += expressions_over_time(block)
        self._dae_expr = [Reference(block.component(name)[:], ctype=Expression) for name in linear]
        self._dae_vars = [Reference(block.component(name)[:], ctype=Var) for name in names]
        self._scalar_var_cuids = [ComponentUID(scalar, context=self.model) for scalar in scalars]
        self._dae_var_cuids = [ComponentUID(f"{block.name}.{name}[*]") for name in names]
        self._dae_expr_cuids = [ComponentUID(f"{block.name}.{name}[*]") for name in linear]
        keys = [*self._dae_var_cuids, *self._dae_expr_cuids]
        self._names = dict(zip(map(str, keys), [*names, *linear], strict=True))

    def load_data(self, data: Any, time_points: Any = None, **options: Any) -> None:
        """Load data as Pyomo's interface does; a time series may have any times that cover the phase.

        Between its samples a series is interpolated linearly, and states get values at element boundaries as well. Like
        Pyomo's, this overwrites fixed values; `PhaseBlock.initialize` does not.

        Raises
        ------
        InitialGuessError
            When a series holds an unknown key, or does not cover the phase.
        """
        if not isinstance(data, TimeSeriesData) or time_points is not None or options:
            super().load_data(data, time_points=time_points, **options)
            return
        block, grid = self._block, self._record.grid
        times = np.array(data.get_time_points(), dtype=float)
        slack = 1e-9 * (grid.times[-1] - grid.times[0])
        loaded = []
        for key, samples in data.get_data().items():
            name = self._names.get(str(key))
            if name is None:
                raise InitialGuessError(
                    f"phase '{block.name}': the series has the key '{key}'; the phase has {', '.join(self._names)}."
                )
            if name not in self._record.declarations:
                continue  # an Expression, which follows
            is_state = isinstance(self._record.declarations[name], State)
            asked = np.array(grid.times if is_state else grid.points)
            if times[0] > asked[0] + slack or times[-1] < asked[-1] - slack:
                raise InitialGuessError(
                    f"phase '{block.name}': the series runs from {times[0]:g} to {times[-1]:g}; '{name}' needs "
                    f"{asked[0]:g} to {asked[-1]:g}. Shift the series, or load it through a Trajectory."
                )
            asked = np.array(self._record.nodes(name).sample_times)
            loaded += guess_values(block, name, np.interp(asked, times, np.array(samples, dtype=float)))
        for variable, number in loaded:
            variable.set_value(number)
