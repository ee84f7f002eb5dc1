"""How the values of variables at nodes define a motion between the nodes.

On every interval a signal is a polynomial of the local fraction ``s`` in [0, 1], ``x(s) = sum_k w_k(s) leaf_k``. The
leaves are the variables at the nodes. For schemes whose first stage is the start of the element they are the start
value and the increments ``h f``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pyomo.core.base.var import Var
from pyomo.dae import DerivativeVar

from pyrobocop_pyomo.continuous.record import Discretisation
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.rule_proxies import Signal
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.numerics.lagrange import evaluation_matrix
from pyrobocop_pyomo.phases.horizon import element_widths

Nodes = tuple[tuple[float, ...], ...]

STATES_ONLY = (
    "Between the nodes only states move continuously. Let the pose read states, numbers and functions of t and "
    "time_at(t) only. Make anything else that it needs a state, with an ode."
)


class Interpolation(Protocol):
    """The motion on the intervals of a set of points."""

    @property
    def intervals(self) -> Nodes:
        """Nodes of each interval, both ends included."""

    def check(self, signal: Signal) -> None:
        """Raise `ObstacleError` for a signal that is not continuous."""

    def leaves(self, signal: Signal, interval: int) -> list[Any]:
        """Variables and expressions that define the polynomial of one interval."""

    def weights(self, signal: Signal, interval: int, fractions: ArrayLike) -> Array:
        """Weights of the leaves at local fractions, shape ``(len(fractions), leaves)``."""

    def is_time_of(self, block: Any) -> bool:
        """Whether ``block.time_at`` maps the indices to time."""

    def time_at(self, index: float) -> Any:
        """Time at an index: a number or an expression."""


# ---------------------------------------------------------------------------------------------- collocation polynomials


class CollocatedStates(Protocol):
    """States on a collocation grid: those of a phase, or of a discretised continuous set."""

    @property
    def grid(self) -> Grid:
        """Scheme and mesh, in indices."""

    def check(self, signal: Signal) -> None:
        """Raise `ObstacleError` for what is not a state."""

    def rates(self, signal: Signal) -> Any:
        """Derivative of a state by collocation point; None where it has none."""

    def width(self, interval: int) -> Any:
        """Width of an element, in time."""

    def time_at(self, index: float) -> Any:
        """Time at an index."""


class CollocationInterpolation:
    """States follow the polynomial of their scheme, the same one that `Trajectory` evaluates."""

    def __init__(self, states: CollocatedStates) -> None:
        self.states = states
        grid = states.grid
        starts = grid.mesh.boundaries[:-1]
        ends = grid.mesh.boundaries[1:]
        self.intervals = tuple(
            nodes if nodes[-1] == end else (*nodes, end)
            for nodes, start, end in zip(grid.node_times, starts, ends, strict=True)
        )

    def check(self, signal: Signal) -> None:
        """Only states are continuous."""
        self.states.check(signal)

    def _rates(self, signal: Signal) -> Any:
        scheme = self.states.grid.scheme
        # The values at the nodes alone leave the polynomial of such a scheme one degree short.
        return self.states.rates(signal) if scheme.starts_on_a_stage and scheme.is_collocation else None

    def leaves(self, signal: Signal, interval: int) -> list[Any]:
        """Values at the nodes, or the start value and the increments."""
        grid, rates = self.states.grid, self._rates(signal)
        nodes = grid.node_times[interval]
        if rates is None:
            return [signal.at(node) for node in nodes]
        width = self.states.width(interval)
        return [signal.at(nodes[0]), *(width * rates[stage] for stage in grid.stage_times[interval])]

    def weights(self, signal: Signal, interval: int, fractions: ArrayLike) -> Array:
        """Weights that the scheme defines."""
        scheme = self.states.grid.scheme
        if self._rates(signal) is None:
            return scheme.state_at(fractions)
        increments = scheme.increments_at(fractions)
        return np.column_stack([np.ones(len(increments)), increments])

    def is_time_of(self, block: Any) -> bool:
        """True for the phase of the states only."""
        return block is getattr(self.states, "phase", None)

    def time_at(self, index: float) -> Any:
        """Time of the phase; the index itself on a continuous set."""
        return self.states.time_at(index)


class PhaseStates:
    """States of a `PhaseBlock`."""

    def __init__(self, phase: Any) -> None:
        self.phase = phase

    @property
    def grid(self) -> Grid:
        """Grid of the phase."""
        return self.phase.grid

    def _name_of(self, signal: Signal) -> str | None:
        # States, algebraics and controls alike have a value at a collocation point.
        component = parent_of(signal.at(self.grid.points[0]))
        name = getattr(component, "local_name", None)
        return name if name in self.phase.record.names_of_states and self.phase.component(name) is component else None

    def check(self, signal: Signal) -> None:
        """Refuse what is no state of the phase."""
        if self._name_of(signal) is None:
            raise ObstacleError(f"'{signal.name}' is no state of phase '{self.phase.name}'. {STATES_ONLY}")

    def rates(self, signal: Signal) -> Any:
        """Derivative of a state, where it has an equation."""
        name = self._name_of(signal)
        known = name in self.phase.record.rates or self.phase.component(f"{name}_derivative") is not None
        return self.phase.derivative(name) if known else None

    def width(self, interval: int) -> Any:
        """Width of an element, in time."""
        return self._widths[interval]

    @cached_property
    def _widths(self) -> list[Any]:
        return element_widths(self.phase, self.phase.record)

    def time_at(self, index: float) -> Any:
        """Time of the phase."""
        return self.phase.time_at(index)


class ContinuousSetStates:
    """States along a `ContinuousSet` that the transformation `pyrobocop.collocation` has discretised."""

    def __init__(self, discretisation: Discretisation) -> None:
        self.discretisation = discretisation

    @property
    def grid(self) -> Grid:
        """Grid of the transformation."""
        return self.discretisation.grid

    def check(self, signal: Signal) -> None:
        """Refuse what has no derivative along the set."""
        component = parent_of(signal.at(self.grid.points[0]))
        if not any(state is component for state in self.discretisation.states):
            raise ObstacleError(
                f"'{signal.name}' has no derivative along '{self.discretisation.domain.name}'. {STATES_ONLY}"
            )

    def rates(self, signal: Signal) -> Any:
        """Derivative of a state: a variable, or the right-hand side that was substituted for it."""
        data = {time: signal.at(time) for time in self.grid.points}
        component = parent_of(data[self.grid.points[0]])
        derivative = next(derivative for state, derivative in self.discretisation.derivatives if state is component)
        substituted = (
            substitution.expression
            for substitution in self.discretisation.substitutions
            if substitution.derivative is derivative
        )
        shown = next(substituted, derivative)
        return {time: shown[variable.index()] for time, variable in data.items()}

    def width(self, interval: int) -> Any:
        """Width of an element."""
        return float(self.grid.mesh.widths[interval])

    def time_at(self, index: float) -> Any:
        """The index is the time."""
        return index


# ------------------------------------------------------------------------------------------- polynomials through nodes


@dataclass(frozen=True, eq=False)
class NodalInterpolation:
    """Polynomials through given nodes of each interval.

    Attributes
    ----------
    intervals : tuple of tuples
        Nodes within each closed interval.
    support : tuple of tuples
        The nodes among them that the polynomial goes through.
    refuse : callable
        ``refuse(signal)`` raises `ObstacleError` for a signal that is not continuous.
    """

    intervals: Nodes
    support: Nodes
    refuse: Callable[[Signal], None]

    def check(self, signal: Signal) -> None:
        """Raise what `refuse` raises."""
        self.refuse(signal)

    def leaves(self, signal: Signal, interval: int) -> list[Any]:
        """Values at the nodes."""
        return [signal.at(node) for node in self.support[interval]]

    def weights(self, signal: Signal, interval: int, fractions: ArrayLike) -> Array:
        """Lagrange polynomials on the nodes."""
        start, end = self.intervals[interval][0], self.intervals[interval][-1]
        local = [(node - start) / (end - start) for node in self.support[interval]]
        return evaluation_matrix(local, fractions)

    def is_time_of(self, block: Any) -> bool:
        """False: the indices are the time."""
        return False

    def time_at(self, index: float) -> Any:
        """The index is the time."""
        return index


def dae_interpolation(domain: Any) -> NodalInterpolation:
    """Interpolation on a continuous set that `pyomo.dae` itself has discretised.

    With collocation, variables that have a derivative follow the polynomial through the start of the element and its
    collocation points. With finite differences they change linearly from point to point.

    Raises
    ------
    ObstacleError
        When the set is not discretised.
    """
    facts = domain.get_discretization_info()
    if "scheme" not in facts:
        raise ObstacleError(
            f"'{domain.name}': a continuous set that is not discretised. Apply pyrobocop.collocation, or a "
            "transformation of pyomo.dae, before obstacles are added."
        )
    points = tuple(domain)

    def refuse(signal: Signal) -> None:
        component = parent_of(signal.at(points[0]))
        if component is None or not _has_derivative(component, domain):
            raise ObstacleError(f"'{signal.name}' has no derivative along '{domain.name}'. {STATES_ONLY}")

    if "tau_points" not in facts:
        intervals = tuple(itertools.pairwise(points))
        return NodalInterpolation(intervals, intervals, refuse)
    boundaries = domain.get_finite_elements()
    intervals = tuple(
        tuple(point for point in points if start <= point <= end) for start, end in itertools.pairwise(boundaries)
    )
    count = len(facts["tau_points"])
    return NodalInterpolation(intervals, tuple(nodes[:count] for nodes in intervals), refuse)


def _has_derivative(component: Any, domain: Any) -> bool:
    """Whether the model has a derivative of a variable along a set now: it may be declared later than the motion."""
    # pyomo.dae turns the derivatives that it has discretised into plain variables.
    components = domain.model().component_objects((Var, DerivativeVar), descend_into=True)
    return any(
        derivative.get_state_var() is component
        for derivative in components
        if isinstance(derivative, DerivativeVar)
        and any(along is domain for along in derivative.get_continuousset_list())
    )


def parent_of(data: Any) -> Any:
    """The component that holds a variable, also where the variable was reached through a reference."""
    return data.parent_component() if hasattr(data, "parent_component") else None
