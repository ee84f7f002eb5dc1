"""`Motion`: the points of a motion, and what the values of variables at nodes say of the motion between them.

On every interval a signal is a polynomial of the local fraction ``s`` in [0, 1], ``x(s) = sum_k w_k(s) leaf_k``. The
leaves are the variables at the nodes. For schemes whose first stage is the start of the element they are the start
value and the increments ``h f``. `motion_of` finds the motion over a phase, a continuous set or ordered numbers.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import value
from pyomo.dae import ContinuousSet
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.continuous.structure import Discretisation, discretisation_of
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

from .rules_along_motion import item_at, parent_of, pose_along

STATES_ONLY = (
    "Between the nodes only states move continuously. Let the pose read states, numbers and functions of t and "
    "time_at(t) only. Make anything else that it needs a state, with an ode; places over time are an rcp.Table of "
    "time_at(t)."
)
Nodes = tuple[tuple[float, ...], ...]


@dataclass(eq=False)
class Motion:
    """A set of points and the motion between them; made by `motion_of`.

    Attributes
    ----------
    block : Block
        First argument of pose rules.
    points : tuple
        Members of the set.
    intervals : tuple of tuples
        Nodes of each interval, both ends included.
    description : str
        What the motion between the points is, and how that is known, in words.
    polynomial : callable
        ``polynomial(signal, interval)`` returns local fractions of one interval, and the variables and expressions
        there that the polynomial of a signal goes through.
    refuse : callable
        ``refuse(signal, early)`` raises `ObstacleError` for a signal whose polynomial is not continuous; early means
        that the model is still being stated: what ties two durations may come later.
    is_assumed : bool
        Whether nothing in the model says that the motion between the nodes is this one.
    has_equations : bool
        Whether the equations of the motion, where it has any, are on the model.
    phase : PhaseBlock or None
        Whose states move along the points.
    """

    block: Any
    points: tuple[Any, ...]
    intervals: Nodes
    description: str
    polynomial: Callable[[Item, int], tuple[Any, list[Any]]]
    refuse: Callable[[Item, bool], None]
    is_assumed: bool = False
    has_equations: bool = True
    phase: Any = None

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

    @property
    def nodes(self) -> list[float]:
        """All nodes of the intervals, in order."""
        return sorted({node for nodes in self.intervals for node in nodes})

    def local_fractions(self, interval: int) -> tuple[float, ...]:
        """Positions of the nodes within an interval, from 0 to 1."""
        nodes = self.intervals[interval]
        return tuple((node - nodes[0]) / (nodes[-1] - nodes[0]) for node in nodes)

    def index_at(self, interval: int, fraction: float) -> float:
        """Index at a local fraction of an interval; exactly the node where the fraction is one of a node."""
        nodes = self.intervals[interval]
        local = self.local_fractions(interval)
        nearest = min(range(len(nodes)), key=lambda k: abs(local[k] - fraction))
        if abs(local[nearest] - fraction) <= ROUNDING:
            return nodes[nearest]
        return float(nodes[0] + fraction * (nodes[-1] - nodes[0]))

    def pose_at_node(self, rule: Callable[..., Any], t: Any, *, name: str = "body") -> Any:
        """Pose at a point of the set, or at a node of an interval.

        Raises
        ------
        ObstacleError
            Naming the body and the time, when the rule has no result there, or no pose.
        """
        return pose_along(self, rule, name).at_node(t)

    def pose_at(self, rule: Callable[..., Any], interval: int, fraction: float, *, name: str = "body") -> Any:
        """Pose at a local fraction of an interval, in expressions of the variables at the nodes.

        Parameters
        ----------
        rule : callable
            ``rule(block, t)``, as for a `Body`.
        interval : int
            Position of the interval.
        fraction : float
            From 0 at its start to 1 at its end. At a node the result is the same as of `pose_at_node`.
        name : str
            Name of the body in messages.

        Raises
        ------
        ObstacleError
            When the pose reads a signal that is not continuous, or the rule cannot be evaluated between nodes.
        """
        return pose_along(self, rule, name).at(interval, fraction)


# ---------------------------------------------------------------------------------------------- collocation polynomials


def intervals_of_grid(grid: Grid) -> Nodes:
    """The nodes of each element, its end included."""
    ends = grid.mesh.boundaries[1:]
    return tuple(nodes if nodes[-1] == end else (*nodes, end) for nodes, end in zip(grid.node_times, ends, strict=True))


def _through_stages(
    grid: Grid, rates_of: Callable[[Item], Any], width: Callable[[int], Any], signal: Item, interval: int
) -> tuple[Array, list[Any]]:
    """The polynomial of a scheme, the same one that `Trajectory` evaluates.

    It goes through values at the nodes; where these leave it one degree short, through values that the rates lead to.

    Parameters
    ----------
    grid : Grid
        Scheme and mesh, in indices.
    rates_of : callable
        From a state to its derivatives by collocation point; to None where it has none.
    width : callable
        From an element to its width, in time.
    signal, interval
        As for `Motion.polynomial`.
    """
    scheme, nodes = grid.scheme, grid.node_times[interval]
    rates = rates_of(signal) if scheme.starts_on_a_stage else None
    if rates is None:
        return scheme.state_nodes, [item_at(signal, node) for node in nodes]
    fractions, size = np.linspace(0.0, 1.0, scheme.stages + 1), width(interval)
    moved = [size * rates[stage] for stage in grid.stage_times[interval]]
    weights = scheme.increments_at(fractions).tolist()
    return fractions, [item_at(signal, nodes[0]) + dot(row, moved) for row in weights]


class PhaseMotion(Motion):
    """States of a `PhaseBlock`, and of others at the same times."""

    def __init__(self, block: Any, points: tuple[Any, ...], phase: Any) -> None:
        polynomial = partial(_through_stages, phase.grid, self._rates, lambda interval: self._widths[interval])
        intervals = intervals_of_grid(phase.grid)
        super().__init__(block, points, intervals, "", polynomial, self._refuse_other_signals, phase=phase)
        self._phases: list[Any] = []
        self._note(phase)

    def _note(self, phase: Any) -> None:
        """Say of a phase that its states were read."""
        self._phases.append(phase)
        names = ", ".join(f"'{of.name}'" for of in self._phases)
        many = "s" if len(self._phases) > 1 else ""
        self.description = f"the polynomials of the states of phase{many} {names} ({phase.grid.scheme.name})"

    def _home_of(self, component: Any) -> Any:
        """The phase that something is a state of; this one unless it is read from another."""
        home = None if component is None else component.parent_block()
        return home if isinstance(home, PhaseBlockData) else self.phase

    def _state_of(self, signal: Item) -> tuple[Any, str | None]:
        """Phase and name of a state; no name for other variables."""
        # States, algebraics and controls alike have a value at a collocation point.
        component = parent_of(item_at(signal, self.phase.grid.points[0]))
        home, name = self._home_of(component), getattr(component, "local_name", None)
        is_state = name in home.record.names_of_states and home.component(name) is component
        return home, name if is_state else None

    def _refuse_other_signals(self, signal: Item, early: bool) -> None:
        """Refuse what is no state of the phase, or of one at the same times."""
        refuse_other_times(self.phase, self._home_of(signal.component), early=early)
        home, name = self._state_of(signal)
        refuse_other_times(self.phase, home, early=early)
        if name is None:
            raise ObstacleError(f"'{signal.name}' is no state of phase '{home.name}'. {STATES_ONLY}")
        if not any(home is phase for phase in self._phases):
            self._note(home)

    def _rates(self, signal: Item) -> Any:
        """Derivative of a state, where it has an equation."""
        home, name = self._state_of(signal)
        known = name in home.record.rates or home.component(f"{name}_derivative") is not None
        return home.derivative(name) if known and name not in home.record.discrete_states else None

    @cached_property
    def _widths(self) -> list[Any]:
        return element_widths(self.phase)

    def check_time_of(self, phase: Any) -> None:
        """Refuse a phase that does not happen at the same time."""
        refuse_other_times(self.phase, phase)

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


# ------------------------------------------------------------------------------------------------ along continuous sets


def _motion_along_discretisation(block: Any, points: tuple[Any, ...], discretisation: Discretisation) -> Motion:
    """Motion along a `ContinuousSet` that the transformation `pyrobocop.collocation` has discretised."""
    domain, grid = discretisation.domain, discretisation.grid

    def rates(signal: Item) -> Any:
        """Derivative of a state: a variable, or the right-hand side that was substituted for it."""
        data = {time: item_at(signal, time) for time in grid.points}
        component = parent_of(data[grid.points[0]])
        derivative = next(derivative for state, derivative in discretisation.derivatives if state is component)
        shown = discretisation.substitutions.get(derivative, derivative)
        return {time: shown[variable.index()] for time, variable in data.items()}

    def refuse(signal: Item, early: bool) -> None:
        component = parent_of(item_at(signal, grid.points[0]))
        if not any(state is component for state in discretisation.states):
            raise ObstacleError(f"'{signal.name}' has no derivative along '{domain.name}'. {STATES_ONLY}")

    return Motion(
        block,
        points,
        intervals_of_grid(grid),
        f"the polynomials of the states along '{domain.name}' ({grid.scheme.name})",
        partial(_through_stages, grid, rates, lambda interval: float(grid.mesh.widths[interval])),
        refuse,
    )


def _line(intervals: Nodes, signal: Item, interval: int) -> tuple[list[float], list[Any]]:
    """The line between the ends of an interval."""
    return [0.0, 1.0], [item_at(signal, node) for node in intervals[interval]]


def motion_of(point_set: Any, parent_block: Any) -> Motion:
    """The motion over a set of points.

    Parameters
    ----------
    point_set : Set or sequence
        ``time`` or ``points`` of a `PhaseBlock`, or a `ContinuousSet` that ``pyrobocop.collocation`` has discretised:
        intervals are the elements, and states follow the collocation polynomial. Numbers in increasing order: two
        consecutive points are an interval, on which everything that is indexed by the set changes linearly.
    parent_block : Block
        First argument of pose rules.

    Raises
    ------
    ObstacleError
        For a continuous set that is not discretised, and for points that are no numbers, or do not increase.
    """
    if getattr(point_set, "ctype", None) is ContinuousSet:
        ours = discretisation_of(point_set)
        if ours is None:
            raise ObstacleError(
                f"'{point_set.name}': a continuous set that is not discretised by pyrobocop.collocation. Apply that "
                "before obstacles are added."
            )
        return _motion_along_discretisation(parent_block, tuple(point_set), ours)
    home = point_set.parent_block() if hasattr(point_set, "parent_block") else None
    if isinstance(home, PhaseBlockData) and (point_set is home.time or point_set is home.points):
        return PhaseMotion(parent_block, tuple(point_set), home)
    points, name = tuple(point_set), f"'{getattr(point_set, 'name', 'points')}'"
    if not _is_ordered(point_set) or not all(map(_is_number, points)):
        raise ObstacleError(
            f"{name}: nothing is known of a motion between these points. Give the times of a phase, a discretised "
            "ContinuousSet or ordered numbers."
        )
    increasing_numbers(points, f"{name}: numbers are times, and", ObstacleError)
    intervals: Nodes = tuple(itertools.pairwise(points))
    words = "straight lines between the points, which is assumed"
    refuse = partial(_refuse_sampled_state, points[0])
    return Motion(parent_block, points, intervals, words, partial(_line, intervals), refuse, is_assumed=True)


def _is_ordered(point_set: Any) -> bool:
    if isinstance(point_set, (list, tuple, range, np.ndarray)):
        return True
    return bool(getattr(point_set, "isordered", bool)())


def _is_number(point: Any) -> bool:
    return isinstance(point, Real) and not isinstance(point, bool)


def _refuse_sampled_state(point: float, signal: Item, early: bool) -> None:
    """What has a motion of its own must not be read at plain numbers: lines between them would hide that motion."""
    # Through a reference the variable belongs to another component.
    component = parent_of(item_at(signal, point)) or signal.component
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
                f"'{signal.name}' is indexed by '{subset.name}', along which it moves in a way that plain numbers do "
                f"not tell. Give '{subset.name}' itself as the set of points, not a list of its members."
            )
