"""Motions over phases, continuous sets and ordered numbers: what moves along them, and by which polynomials."""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var
from pyomo.dae import ContinuousSet, DerivativeVar
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.continuous.record import Discretisation, discretisation_of
from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.modeling.expressions import same_expression
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.numerics.arrays import increasing_numbers
from pyrobocop_pyomo.numerics.rounding import ROUNDING
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.phases.horizon import element_widths
from pyrobocop_pyomo.templates.slots import Item

from .motion import Motion, Nodes
from .rules_along_motion import item_at, parent_of

STATES_ONLY = (
    "Between the nodes only states move continuously. Let the pose read states, numbers and functions of t and "
    "time_at(t) only. Make anything else that it needs a state, with an ode."
)


# ---------------------------------------------------------------------------------------------- collocation polynomials


def intervals_of_grid(grid: Grid) -> Nodes:
    """The nodes of each element, its end included."""
    ends = grid.mesh.boundaries[1:]
    return tuple(nodes if nodes[-1] == end else (*nodes, end) for nodes, end in zip(grid.node_times, ends, strict=True))


class CollocationMotion(Motion):
    """States follow the polynomial of their scheme, the same one that `Trajectory` evaluates.

    Parameters
    ----------
    block, points
        As for `Motion`.
    grid : Grid
        Scheme and mesh, in indices.
    """

    def __init__(self, block: Any, points: tuple[Any, ...], grid: Grid) -> None:
        self.block, self.points = block, points
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

    def polynomial(self, signal: Item, interval: int) -> tuple[Array, list[Any]]:
        """Values at the nodes; where these leave it one degree short, values that the rates lead to."""
        grid, scheme = self.grid, self.grid.scheme
        nodes = grid.node_times[interval]
        rates = self.rates(signal) if scheme.starts_on_a_stage and scheme.is_collocation else None
        if rates is None:
            return scheme.state_nodes, [item_at(signal, node) for node in nodes]
        fractions, width = np.linspace(0.0, 1.0, scheme.stages + 1), self.width(interval)
        moved = [width * rates[stage] for stage in grid.stage_times[interval]]
        weights = scheme.increments_at(fractions).tolist()
        return fractions, [item_at(signal, nodes[0]) + dot(row, moved) for row in weights]


class PhaseMotion(CollocationMotion):
    """States of a `PhaseBlock`."""

    def __init__(self, block: Any, points: tuple[Any, ...], phase: Any) -> None:
        super().__init__(block, points, phase.grid)
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


class ContinuousSetMotion(CollocationMotion):
    """States along a `ContinuousSet` that the transformation `pyrobocop.collocation` has discretised."""

    def __init__(self, block: Any, points: tuple[Any, ...], discretisation: Discretisation) -> None:
        super().__init__(block, points, discretisation.grid)
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
        shown = self.discretisation.substitutions.get(derivative, derivative)
        return {time: shown[variable.index()] for time, variable in data.items()}


# ------------------------------------------------------------------------------------------- polynomials through nodes


@dataclass(frozen=True, eq=False)
class NodalMotion(Motion):
    """Polynomials through given nodes of each interval.

    Attributes
    ----------
    block, points
        As for `Motion`.
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

    block: Any
    points: tuple[Any, ...]
    intervals: Nodes
    support: Nodes
    refusal: Callable[[Item], None]
    description: str = "straight lines between the points, which is assumed"
    is_assumed: bool = True

    def refuse(self, signal: Item, *, early: bool = False) -> None:
        """Raise what `refusal` raises."""
        self.refusal(signal)

    def polynomial(self, signal: Item, interval: int) -> tuple[list[float], list[Any]]:
        """Values at the nodes."""
        start, end = self.intervals[interval][0], self.intervals[interval][-1]
        support = self.support[interval]
        return [(node - start) / (end - start) for node in support], [item_at(signal, node) for node in support]


def _refuse_nothing(signal: Item) -> None:
    """What is read at points that have no order is not followed between them."""


def _dae_motion(block: Any, domain: Any) -> NodalMotion:
    """Motion along a continuous set that `pyomo.dae` itself has discretised.

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
        return NodalMotion(block, points, intervals, intervals, refuse, words)
    boundaries = domain.get_finite_elements()
    intervals = tuple(
        tuple(point for point in points if start <= point <= end) for start, end in itertools.pairwise(boundaries)
    )
    support = tuple(nodes[: len(facts["tau_points"])] for nodes in intervals)
    words = f"the polynomials of the states along '{domain.name}' ({facts['scheme']})"
    return NodalMotion(block, points, intervals, support, refuse, words, is_assumed=False)


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


def motion_of(point_set: Any, parent_block: Any) -> Motion:
    """The motion over a set of points.

    Parameters
    ----------
    point_set : Set or sequence
        ``time`` or ``points`` of a `PhaseBlock`, or a discretised `ContinuousSet`: intervals are the elements, and
        states follow the collocation polynomial. Numbers in increasing order: two consecutive points are an interval,
        on which everything that is indexed by the set changes linearly. Anything else: there are no intervals.
    parent_block : Block
        First argument of pose rules.

    Raises
    ------
    ObstacleError
        For a continuous set that is not discretised, and for numbers that do not increase.
    """
    if getattr(point_set, "ctype", None) is ContinuousSet:
        ours = discretisation_of(point_set)
        if ours is None:
            return _dae_motion(parent_block, point_set)
        return ContinuousSetMotion(parent_block, tuple(point_set), ours)
    home = point_set.parent_block() if hasattr(point_set, "parent_block") else None
    if isinstance(home, PhaseBlockData) and (point_set is home.time or point_set is home.points):
        return PhaseMotion(parent_block, tuple(point_set), home)
    points = tuple(point_set)
    alone = "the points alone; nothing is known of the motion between them"
    if not _is_ordered(point_set) or not all(map(_is_number, points)) or len(points) < 2:
        return NodalMotion(parent_block, points, (), (), _refuse_nothing, alone, is_assumed=False)
    increasing_numbers(points, f"'{getattr(point_set, 'name', 'points')}': numbers are times, and", ObstacleError)
    intervals = tuple(itertools.pairwise(points))
    return NodalMotion(parent_block, points, intervals, intervals, _refuse_sampled_states(points[0]))


def _is_ordered(point_set: Any) -> bool:
    if isinstance(point_set, (list, tuple, range, np.ndarray)):
        return True
    return bool(getattr(point_set, "isordered", bool)())


def _is_number(point: Any) -> bool:
    return isinstance(point, Real) and not isinstance(point, bool)


def _refuse_sampled_states(point: float) -> Callable[[Item], None]:
    """What has a motion of its own must not be read at plain numbers: lines between them would hide that motion."""

    def refuse(signal: Item) -> None:
        data = item_at(signal, point)
        # Through a reference the variable is that of another component.
        component = parent_of(data) or signal.component
        owner = component.parent_block()
        if isinstance(owner, PhaseBlockData):
            raise ObstacleError(
                f"'{signal.name}' belongs to phase '{owner.name}', whose states do not change linearly between points. "
                f"Give '{owner.name}.time' as the set of points."
            )
        for subset in component.index_set().subsets():
            phase = subset.parent_block()
            if subset.ctype is ContinuousSet or isinstance(phase, PhaseBlockData):
                raise ObstacleError(
                    f"'{signal.name}' is indexed by '{subset.name}', along which it moves in a way that plain numbers "
                    f"do not tell. Give '{subset.name}' itself as the set of points, not a list of its members."
                )

    return refuse
