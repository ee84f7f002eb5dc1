"""Where collocation grids come from: phases, and continuous sets that `pyrobocop.collocation` has discretised."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from pyrobocop_pyomo.continuous.record import Discretisation
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.rule_proxies import Series
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.phases.horizon import element_widths

STATES_ONLY = (
    "Between the nodes only states move continuously. Let the pose read states and numbers, or functions of t and "
    "clock(t); what else it needs can be made a state by an ode."
)


def parent_of(data: Any) -> Any:
    """The component that holds a variable, also where it was reached through a reference."""
    return data.parent_component() if hasattr(data, "parent_component") else None


class PhaseSource:
    """A `PhaseBlock`."""

    def __init__(self, phase: Any) -> None:
        self.phase = phase

    @property
    def grid(self) -> Grid:
        """Of the phase."""
        return self.phase.grid

    def _state_of(self, series: Series) -> str | None:
        # States, algebraics and controls alike have a value at a collocation point.
        component = parent_of(series.at(self.grid.points[0]))
        name = getattr(component, "local_name", None)
        return name if name in self.phase.record.names_of_states and self.phase.component(name) is component else None

    def check(self, series: Series) -> None:
        """Refuse what is no state of the phase."""
        if self._state_of(series) is None:
            raise ObstacleError(f"'{series.name}' is no state of phase '{self.phase.name}'. {STATES_ONLY}")

    def rates(self, series: Series) -> Any:
        """Derivative of a state, where it has an equation."""
        name = self._state_of(series)
        known = name in self.phase.record.equation_of or self.phase.component(f"{name}_derivative") is not None
        return self.phase.derivative(name) if known else None

    def width(self, interval: int) -> Any:
        """Of an element, in real time."""
        return self._widths[interval]

    @cached_property
    def _widths(self) -> list[Any]:
        return element_widths(self.phase, self.phase.record)

    def clock(self, index: float) -> Any:
        """Of the phase."""
        return self.phase.clock(index)


class ContinuousSetSource:
    """A `ContinuousSet` of `pyomo.dae` that the transformation `pyrobocop.collocation` has discretised."""

    def __init__(self, done: Discretisation) -> None:
        self.done = done

    @property
    def grid(self) -> Grid:
        """That of the transformation."""
        return self.done.grid

    def check(self, series: Series) -> None:
        """Refuse what has no derivative along the set."""
        component = parent_of(series.at(self.grid.points[0]))
        if not any(each is component for each in self.done.states):
            raise ObstacleError(f"'{series.name}' has no derivative along '{self.done.domain.name}'. {STATES_ONLY}")

    def rates(self, series: Series) -> Any:
        """Derivative of a state: a variable, or the right-hand side that was substituted for it."""
        data = {time: series.at(time) for time in self.grid.points}
        component = parent_of(data[self.grid.points[0]])
        derivative = next(derivative for state, derivative in self.done.derivatives if state is component)
        shown = next((each.expression for each in self.done.substitutions if each.derivative is derivative), derivative)
        return {time: shown[each.index()] for time, each in data.items()}

    def width(self, interval: int) -> Any:
        """Of an element."""
        return float(self.grid.mesh.widths[interval])

    def clock(self, index: float) -> Any:
        """The index is the time."""
        return index
