"""How the values of variables at nodes define a motion between the nodes.

On every interval a signal is a polynomial of the local fraction ``s`` in [0, 1], ``x(s) = sum_k w_k(s) leaf_k``. The
leaves are the variables at the nodes. For schemes whose first stage is the start of the element they are the start
value and the increments ``h f``.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value
from pyomo.dae import DerivativeVar
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.continuous.record import Discretisation
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.expressions import same_expression
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.numerics.lagrange import evaluation_matrix
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.phases.horizon import element_widths
from pyrobocop_pyomo.rules.slots import Item

Nodes = tuple[tuple[float, ...], ...]

STATES_ONLY = (
    "Between the nodes only states move continuously. Let the pose read states, numbers and functions of t and "
    "time_at(t) only. Make anything else that it needs a state, with an ode."
)


class Interpolation(ABC):
    """The motion on the intervals of a set of points.

    Attributes
    ----------
    intervals : tuple of tuples
        Nodes of each interval, both ends included.
    is_assumed : bool
        Whether nothing in the model says that the motion between the nodes is this one.
    phase : PhaseBlock or None
        Whose states move.
    has_equations : bool
        Whether the equations of the motion, where it has any, are on the model.
    """

    intervals: Nodes
    is_assumed: bool = False
    phase: Any = None
    has_equations: bool = True

    @property
    @abstractmethod
    def description(self) -> str:
        """What the motion between the nodes is, in words."""

    @abstractmethod
    def refuse(self, signal: Item, *, early: bool = False) -> None:
        """Raise `ObstacleError` for a signal whose polynomial is not continuous.

        Parameters
        ----------
        signal : Item
        early : bool
            True while the model is still being stated: what ties two durations may come later.
        """

    @abstractmethod
    def polynomial(self, signal: Item, interval: int) -> list[Any]:
        """Variables and expressions that define the polynomial of one interval."""

    @abstractmethod
    def polynomial_weights(self, signal: Item, interval: int, fractions: ArrayLike) -> Array:
        """Weights of these at local fractions, shape ``(len(fractions), leaves)``."""

    def joins_lines(self, signal: Item) -> bool:
        """Whether a signal has values at the nodes only, which are joined by lines: parameters over the nodes."""
        return signal.component.ctype is Param

    def check(self, signal: Item, *, early: bool = False) -> None:
        """Raise `ObstacleError` for a signal that is not continuous; `early` as for `refuse`."""
        if not self.joins_lines(signal):
            self.refuse(signal, early=early)

    def leaves(self, signal: Item, interval: int) -> list[Any]:
        """What the motion of a signal on one interval is made of."""
        if self.joins_lines(signal):
            return [item_at(signal, node) for node in self.intervals[interval]]
        return self.polynomial(signal, interval)

    def weights(self, signal: Item, interval: int, fractions: ArrayLike) -> Array:
        """Weights of the leaves at local fractions, shape ``(len(fractions), leaves)``."""
        if self.joins_lines(signal):
            return line_weights(self.intervals[interval], fractions)
        return self.polynomial_weights(signal, interval, fractions)

    def check_time_of(self, phase: Any) -> None:
        """Raise `ObstacleError` where ``phase.time_at`` does not map the indices to time."""
        raise ObstacleError(f"time_at(t) is read from '{phase.name}', whose time is not that of the set of points.")

    def time_at(self, index: float) -> Any:
        """Time at an index: a number or an expression."""
        return index

    def node_times(self) -> dict[float, float]:
        """The time of every node, as a number."""
        # Between the boundaries of an element time is linear in the index.
        times: dict[float, float] = {}
        for nodes in self.intervals:
            start, end = (float(value(self.time_at(node))) for node in (nodes[0], nodes[-1]))
            for node in nodes:
                times[node] = start + (node - nodes[0]) / (nodes[-1] - nodes[0]) * (end - start)
        return times

    @property
    def interval_ends(self) -> Array:
        """Times of the start and the end of each interval, shape ``(intervals, 2)``."""
        times = self.node_times()
        return np.array([[times[nodes[0]], times[nodes[-1]]] for nodes in self.intervals])


# ---------------------------------------------------------------------------------------------- collocation polynomials


def intervals_of_grid(grid: Grid) -> Nodes:
    """The nodes of each element, its end included."""
    ends = grid.mesh.boundaries[1:]
    return tuple(nodes if nodes[-1] == end else (*nodes, end) for nodes, end in zip(grid.node_times, ends, strict=True))


class CollocationInterpolation(Interpolation):
    """States follow the polynomial of their scheme, the same one that `Trajectory` evaluates.

    Parameters
    ----------
    grid : Grid
        Scheme and mesh, in indices.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid, self.intervals = grid, intervals_of_grid(grid)

    @property
    @abstractmethod
    def owner(self) -> str:
        """What the states belong to, in words."""

    @abstractmethod
    def rates(self, signal: Item) -> Any:
        """Derivative of a state by collocation point; None where it has none."""

    @property
    def description(self) -> str:
        """The polynomials of a scheme."""
        return f"the polynomials of the states {self.owner} ({self.grid.scheme.name})"

    def width(self, interval: int) -> Any:
        """Width of an element, in time."""
        return float(self.grid.mesh.widths[interval])

    def _rates(self, signal: Item) -> Any:
        scheme = self.grid.scheme
        # The values at the nodes alone leave the polynomial of such a scheme one degree short.
        return self.rates(signal) if scheme.starts_on_a_stage and scheme.is_collocation else None

    def polynomial(self, signal: Item, interval: int) -> list[Any]:
        """Values at the nodes, or the start value and the increments."""
        grid, rates = self.grid, self._rates(signal)
        nodes = grid.node_times[interval]
        if rates is None:
            return [item_at(signal, node) for node in nodes]
        width = self.width(interval)
        return [item_at(signal, nodes[0]), *(width * rates[stage] for stage in grid.stage_times[interval])]

    def polynomial_weights(self, signal: Item, interval: int, fractions: ArrayLike) -> Array:
        """Weights that the scheme defines."""
        scheme = self.grid.scheme
        if self._rates(signal) is None:
            return scheme.state_at(fractions)
        increments = scheme.increments_at(fractions)
        return np.column_stack([np.ones(len(increments)), increments])


class PhaseInterpolation(CollocationInterpolation):
    """States of a `PhaseBlock`."""

    def __init__(self, phase: Any) -> None:
        super().__init__(phase.grid)
        self.phase = phase
        self._phases = [phase]  # and others at the same times, whose states were read

    @property
    def owner(self) -> str:
        """The phases."""
        names = ", ".join(f"'{phase.name}'" for phase in self._phases)
        return f"of phase{'s' if len(self._phases) > 1 else ''} {names}"

    def _home_of(self, component: Any) -> Any:
        """The phase that something is a state of; this one unless it is read from another."""
        home = None if component is None else component.parent_block()
        return home if isinstance(home, PhaseBlockData) else self.phase

    def _state_of(self, signal: Item) -> tuple[Any, str | None]:
        """Phase and name of a state; no name for what is none."""
        # States, algebraics and controls alike have a value at a collocation point.
        component = parent_of(item_at(signal, self.grid.points[0]))
        home, name = self._home_of(component), getattr(component, "local_name", None)
        is_state = name in home.record.names_of_states and home.component(name) is component
        return home, name if is_state else None

    def refuse(self, signal: Item, *, early: bool = False) -> None:
        """Refuse what is no state of the phase, or of one at the same times."""
        refuse_other_times(self.phase, self._home_of(signal.component), early=early)
        home, name = self._state_of(signal)
        refuse_other_times(self.phase, home, early=early)
        if name is None:
            raise ObstacleError(f"'{signal.name}' is no state of phase '{home.name}'. {STATES_ONLY}")
        if not any(home is phase for phase in self._phases):
            self._phases.append(home)

    def rates(self, signal: Item) -> Any:
        """Derivative of a state, where it has an equation."""
        home, name = self._state_of(signal)
        known = name in home.record.rates or home.component(f"{name}_derivative") is not None
        return home.derivative(name) if known else None

    def check_time_of(self, phase: Any) -> None:
        """Refuse a phase that does not happen at the same time."""
        refuse_other_times(self.phase, phase)

    def width(self, interval: int) -> Any:
        """Width of an element, in time."""
        return self._widths[interval]

    @cached_property
    def _widths(self) -> list[Any]:
        return element_widths(self.phase)

    def time_at(self, index: float) -> Any:
        """Time of the phase."""
        return self.phase.time_at(index)


def refuse_other_times(phase: Any, other: Any, *, early: bool = False) -> None:
    """Refuse to read the states of a phase at the times of another one, unless both are the same times.

    Parameters
    ----------
    phase, other : PhaseBlockData
        The phase whose times are the set of points, and the one that is read.
    early : bool
        True while the model is still being stated: what ties two durations may come later.

    Raises
    ------
    ObstacleError
        Naming both phases.
    """
    if phase is other:
        return
    remedy = "Give both phases the same start, duration, mesh and scheme, or add a block for each of them."
    if phase.grid.scheme.name != other.grid.scheme.name or phase.grid.times != other.grid.times:
        raise ObstacleError(
            f"states of phase '{other.name}' are read at the times of phase '{phase.name}', which has other points of "
            f"time. {remedy}"
        )
    if not (phase.has_normalised_time or other.has_normalised_time) or early:
        return
    free = phase.record.free_widths or other.record.free_widths
    if free or not (_same(phase.start, other.start) and _same_durations(phase, other)):
        raise ObstacleError(
            f"states of phase '{other.name}' are read at the times of phase '{phase.name}', but nothing says that both "
            f"happen at the same time. Tie them by a constraint, {phase.name}.duration == {other.name}.duration, with "
            "the same fixed start and without free element widths; or give both the same fixed duration."
        )


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, Real) and isinstance(second, Real):
        return abs(float(first) - float(second)) <= ROUNDING * max(1.0, abs(float(first)))
    return not isinstance(first, Real) and not isinstance(second, Real) and same_expression(first, second)


def _same_durations(phase: Any, other: Any) -> bool:
    pair = (phase.duration, other.duration)
    if any(isinstance(duration, Real) for duration in pair):
        return _same(*pair)
    wanted = {id(duration) for duration in pair}
    for row in phase.model().component_data_objects(Constraint, active=True, descend_into=True):
        if row.equality and {id(v) for v in variables_in(row.body)} == wanted:
            form = generate_standard_repn(row.body - row.upper)
            size = max(map(abs, form.linear_coefs), default=0.0)
            if form.is_linear() and max(abs(sum(form.linear_coefs)), abs(form.constant)) <= ROUNDING * size:
                return True
    return False


class ContinuousSetInterpolation(CollocationInterpolation):
    """States along a `ContinuousSet` that the transformation `pyrobocop.collocation` has discretised."""

    def __init__(self, discretisation: Discretisation) -> None:
        super().__init__(discretisation.grid)
        self.discretisation = discretisation

    @property
    def owner(self) -> str:
        """The set."""
        return f"along '{self.discretisation.domain.name}'"

    def refuse(self, signal: Item, *, early: bool = False) -> None:
        """Refuse what has no derivative along the set."""
        component = parent_of(item_at(signal, self.grid.points[0]))
        if not any(state is component for state in self.discretisation.states):
            raise ObstacleError(
                f"'{signal.name}' has no derivative along '{self.discretisation.domain.name}'. {STATES_ONLY}"
            )

    def rates(self, signal: Item) -> Any:
        """Derivative of a state: a variable, or the right-hand side that was substituted for it."""
        data = {time: item_at(signal, time) for time in self.grid.points}
        component = parent_of(data[self.grid.points[0]])
        derivative = next(derivative for state, derivative in self.discretisation.derivatives if state is component)
        substituted = (
            substitution.expression
            for substitution in self.discretisation.substitutions
            if substitution.derivative is derivative
        )
        shown = next(substituted, derivative)
        return {time: shown[variable.index()] for time, variable in data.items()}


# ------------------------------------------------------------------------------------------- polynomials through nodes


@dataclass(frozen=True, eq=False)
class NodalInterpolation(Interpolation):
    """Polynomials through given nodes of each interval.

    Attributes
    ----------
    intervals : tuple of tuples
        Nodes within each closed interval.
    support : tuple of tuples
        The nodes among them that the polynomial goes through.
    refusal : callable
        ``refusal(signal)`` raises `ObstacleError` for a signal that is not continuous.
    description : str
        What the motion is, in words.
    is_assumed : bool
        Whether nothing in the model says so.
    """

    intervals: Nodes
    support: Nodes
    refusal: Callable[[Item], None]
    description: str = "straight lines between the points, which is assumed"
    is_assumed: bool = True

    def refuse(self, signal: Item, *, early: bool = False) -> None:
        """Raise what `refusal` raises."""
        self.refusal(signal)

    def polynomial(self, signal: Item, interval: int) -> list[Any]:
        """Values at the nodes."""
        return [item_at(signal, node) for node in self.support[interval]]

    def polynomial_weights(self, signal: Item, interval: int, fractions: ArrayLike) -> Array:
        """Lagrange polynomials on the nodes."""
        start, end = self.intervals[interval][0], self.intervals[interval][-1]
        local = [(node - start) / (end - start) for node in self.support[interval]]
        return evaluation_matrix(local, fractions)


def _refuse_nothing(signal: Item) -> None:
    """What is read at points that have no order is not followed between them."""


# Of points that are not ordered in time.
ALONE = NodalInterpolation(
    (), (), _refuse_nothing, "the points alone; nothing is known of the motion between them", is_assumed=False
)


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

    def refuse(signal: Item) -> None:
        component = parent_of(item_at(signal, points[0]))
        if component is None or not _has_derivative(component, domain):
            raise ObstacleError(f"'{signal.name}' has no derivative along '{domain.name}'. {STATES_ONLY}")

    if "tau_points" not in facts:
        intervals = tuple(itertools.pairwise(points))
        words = f"straight lines between the points of '{domain.name}' ({facts['scheme']}), which is assumed"
        return NodalInterpolation(intervals, intervals, refuse, words)
    boundaries = domain.get_finite_elements()
    intervals = tuple(
        tuple(point for point in points if start <= point <= end) for start, end in itertools.pairwise(boundaries)
    )
    count = len(facts["tau_points"])
    words = f"the polynomials of the states along '{domain.name}' ({facts['scheme']})"
    return NodalInterpolation(intervals, tuple(nodes[:count] for nodes in intervals), refuse, words, is_assumed=False)


def _has_derivative(component: Any, domain: Any) -> bool:
    """Whether the model has a derivative of a variable along a set."""
    # pyomo.dae turns the derivatives that it has discretised into plain variables.
    components = domain.model().component_objects((Var, DerivativeVar), descend_into=True)
    return any(
        derivative.get_state_var() is component
        for derivative in components
        if isinstance(derivative, DerivativeVar)
        and any(along is domain for along in derivative.get_continuousset_list())
    )


def line_weights(nodes: Sequence[float], fractions: ArrayLike) -> Array:
    """Weights of the values at the nodes of an interval where they are joined by lines."""
    local = (np.asarray(nodes, dtype=float) - nodes[0]) / (nodes[-1] - nodes[0])
    at = np.atleast_1d(np.asarray(fractions, dtype=float))
    return np.stack([np.interp(at, local, unit) for unit in np.eye(len(local))], axis=-1)


def item_at(item: Item, time: Any) -> Any:
    """The variable of a signal at a node.

    Raises
    ------
    ObstacleError
        When there is none.
    """
    try:
        return item.component[item.key_at(time)]
    except KeyError:
        raise ObstacleError(
            f"'{item.name}': has no value at t = {time!r}, where a pose needs it. Poses may read what has a value "
            "at every node, such as the states of a phase."
        ) from None


def parent_of(data: Any) -> Any:
    """The component that holds a variable, also where the variable was reached through a reference."""
    return data.parent_component() if hasattr(data, "parent_component") else None
