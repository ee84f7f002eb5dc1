"""A stand-in for a phase at one instant, so that the user's rules can be asked anywhere.

The rules were written for a phase: ``rule(phase, t)`` reads ``phase.x[t]``. Given a `PointModel` instead,
they read scratch variables that hold the values of one instant, whatever ``t`` is; their answers are then
evaluated. This judges a trajectory by the equations as stated, not by the rows that were built from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Grid

from .declarations import Parameter
from .record import PhaseRecord, Statement


class _Signal:
    """What stands for an indexed variable: one scratch variable at every index."""

    def __init__(self, name: str, variable: Any) -> None:
        self.local_name = name
        self._variable = variable

    def __getitem__(self, t: float) -> Any:
        return self._variable


class PointModel:
    """See the module; what is not a declared variable is read from the phase itself.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    indices, grid : Grid
        The same grid in the phase's time indices and in real time, for rules that read the clock, the start or the
        duration.
    """

    def __init__(self, block: Any, record: PhaseRecord, indices: Grid, grid: Grid) -> None:
        scratch = ConcreteModel()
        self._block = block
        self._record = record
        self._scratch = scratch  # Pyomo holds parents by weak references: keep the owner alive
        self._variables: dict[str, Any] = {}
        self._derivatives: dict[str, Any] = {}
        self._signals: dict[str, Any] = {}
        self._forgotten: set[str] = set()
        for i, (name, declaration) in enumerate(record.declarations.items()):
            variable = Var()
            scratch.add_component(f"v{i}", variable)
            self._variables[name] = variable
            self._signals[name] = variable if isinstance(declaration, Parameter) else _Signal(name, variable)
        for i, name in enumerate(record.names_of_states):
            self._derivatives[name] = Var()
            scratch.add_component(f"d{i}", self._derivatives[name])
        self._indices, self._boundaries = indices.mesh.boundaries, grid.mesh.boundaries
        self.start = grid.mesh.boundaries[0]
        self.duration = grid.mesh.boundaries[-1] - grid.mesh.boundaries[0]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._signals:
            return self._signals[name]
        return getattr(self._block, name)

    def derivative(self, state: Any) -> _Signal:
        """The derivative of a state, as `PhaseBlock.derivative` gives it."""
        name = self.state_name(state)
        if name in self._forgotten:
            raise TrajectoryError(f"the rules read the derivative of '{name}', which is known at the grid only.")
        return _Signal("derivative", self._derivatives[name])

    def state_name(self, state: Any) -> str:
        """Name of a state given by its stand-in or its name."""
        return state if isinstance(state, str) else state.local_name

    def clock(self, t: float) -> float:
        """Real time of an index, as `PhaseBlock.clock` gives it."""
        if not self._record.normalised:
            return t
        return float(np.interp(t, self._indices, self._boundaries))

    def index(self, time: float) -> float:
        """The index of a real time: what `clock` undoes."""
        if not self._record.normalised:
            return time
        return float(np.interp(time, self._boundaries, self._indices))

    def set_values(self, values: Mapping[str, float], derivatives: Mapping[str, float] | None = None) -> None:
        """Hold other values: those of the instant that is asked next."""
        for name, value in values.items():
            self._variables[name].set_value(float(value), skip_validation=True)
        for name, value in (derivatives or {}).items():
            self._derivatives[name].set_value(float(value), skip_validation=True)
        self._forgotten -= set(derivatives or ())

    def forget_derivatives(self) -> None:
        """Refuse to answer `derivative` until new values are set."""
        self._forgotten = set(self._derivatives)

    def set_bounds(self, time: float) -> None:
        """Give the scratch variables the bounds of a time: pairs may mean a variable's own bound."""
        for name, declaration in self._record.declarations.items():
            lower, upper = declaration.bounds_at(time, name)
            self._variables[name].setlb(lower)
            self._variables[name].setub(upper)

    def ask(self, statement: Statement, time: float) -> Any:
        """The answer of a rule at a time index.

        Raises
        ------
        TrajectoryError
            When the rule is lost, or reads the model otherwise than through its first argument.
        """
        if statement.rule is None:
            raise TrajectoryError(
                f"phase '{self._block.name}': the rule '{statement.name}' did not survive pickling. Define it at "
                "the top level of a module."
            )
        try:
            return statement.rule(self, time)
        except KeyError as error:
            raise TrajectoryError(
                f"phase '{self._block.name}': the rule '{statement.name}' cannot be asked at t = {time:g} ({error}). "
                "Read variables through its first argument, not through the model."
            ) from error
