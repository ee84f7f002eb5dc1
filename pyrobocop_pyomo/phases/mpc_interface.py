"""`PhaseInterface`: a phase as the dynamic model that `pyomo.contrib.mpc` works with."""

from __future__ import annotations

from typing import Any

from pyomo.contrib.mpc import DynamicModelInterface, TimeSeriesData
from pyomo.core.base.componentuid import ComponentUID
from pyomo.core.base.expression import Expression
from pyomo.core.base.reference import Reference
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.trajectories import Trajectory

from .declarations import Control, Parameter, State
from .phase_values import PhaseValues, expressions_over_time
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
        record, times = self._record, data.get_time_points()
        for key in map(str, data.get_data()):
            if key not in self._names:
                raise InitialGuessError(
                    f"phase '{self._block.name}': the series has the key '{key}'; the phase has "
                    f"{', '.join(self._names)}."
                )
        values = PhaseValues(self._block)
        found = values.sampled(Trajectory.from_time_series(data), float)
        slack = 1e-9 * (record.grid.times[-1] - record.grid.times[0])
        for name in found:
            needed = record.grid.times if isinstance(record.declarations[name], State) else record.grid.points
            if times[0] > needed[0] + slack or times[-1] < needed[-1] - slack:
                raise InitialGuessError(
                    f"phase '{self._block.name}': the series runs from {times[0]:g} to {times[-1]:g}; '{name}' needs "
                    f"{needed[0]:g} to {needed[-1]:g}. Shift the series, or load it through a Trajectory."
                )
        loaded = [each for name in found for each in zip(values.variables[name], found[name].tolist(), strict=True)]
        for variable, number in loaded:
            variable.set_value(number)
