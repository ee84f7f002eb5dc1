"""What a rule says of a pose or a length for all times: before anything has a value, and along a motion.

Both are the rule's template. What it reads at ``t`` are signals, which an interpolation makes polynomials of.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.visitor import identify_mutable_parameters

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS, NUMPY_NAMES
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps, UnknownFunction
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.bernstein import (
    bernstein_from_samples,
    bernstein_matrix,
    derivative_coefficients,
    restrict,
)
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial
from pyrobocop_pyomo.rules.rule_template import templated
from pyrobocop_pyomo.rules.slots import Always, Clock, Item, NamedItem, Slot, Time, is_on_indices

from .interpolation import Interpolation, item_at, parent_of
from .motion import Motion, refuse_between_nodes
from .pose_rules import asked_pose
from .table_functions import TableFunction

# Functions that can be followed between nodes, of which bounds of derivatives are known.
FOLLOWED = ("sin", "cos", "tan", "atan", "exp", "log", "sqrt")
# Value of everything that is read, where only dependence counts.
_SOMEWHERE = 0.39


def _call(output: Any, *arguments: Any) -> Any:
    """An output of a `Function`: of numbers any, of arrays and Taylor forms one that knows its bounds."""
    if all(isinstance(argument, float) for argument in arguments):
        return output.evaluate(arguments)
    function = output.function
    if not isinstance(function, TableFunction):
        raise ObstacleError(
            f"'{output.name}' is a function in Python, of which nobody knows how it curves between nodes. Write the "
            "formula of the pose, or make what it computes a state."
        )
    return _of_table(function, output.index, *arguments)


def _of_table(table: TableFunction, column: int, argument: Any) -> Any:
    if isinstance(argument, TaylorForm):
        return table.taylor_form(argument, column)
    return table.values(np.asarray(argument, dtype=float)[:, None])[:, column]


def _of_form(name: str) -> Callable[[Any], Any]:
    method, of_number = getattr(TaylorForm, NUMPY_NAMES[name]), ARRAY_FUNCTIONS[name]
    return lambda argument: method(argument) if isinstance(argument, TaylorForm) else float(of_number(argument))


_ARRAYS: dict[str, Callable[..., Any]] = {**{name: ARRAY_FUNCTIONS[name] for name in FOLLOWED}, "call": _call}
_TAYLOR_FORMS: dict[str, Callable[..., Any]] = {**{name: _of_form(name) for name in FOLLOWED}, "call": _call}


# ---------------------------------------------------------------------------------------------- before there are values


class PoseReading:
    """What the pose of a body is a formula of.

    Parameters
    ----------
    motion : Motion
        With intervals.
    rule : callable
        ``rule(block, t)``, as for a `Body`.
    name : str
        Name of the body in messages.

    Attributes
    ----------
    signals : tuple of Item
        What is read at ``t``.
    reads_index, reads_time : bool
        Whether the pose depends on ``t`` as a number, or on the time that it stands for.
    variables, parameters : list
        Of the model, read without ``t``; parameters that can change.
    turns : bool
        Whether the rotation changes in time.

    Raises
    ------
    ObstacleError
        Naming the body, when the rule has to know the time as a number, or reads between the nodes what has no motion
        between plain numbers.
    """

    def __init__(self, motion: Motion, rule: Callable[..., Any], name: str) -> None:
        assert motion.interpolation is not None
        self._formulas = _pose_formulas(motion, rule, name)
        slots, by_index = self._formulas.slots, not is_on_indices(motion.block)
        self.signals = tuple(slot for slot in slots if isinstance(slot, Item))
        for signal in self.signals:
            motion.interpolation.check_early(signal)
        for slot in slots:
            if isinstance(slot, Clock):
                motion.interpolation.check_time_of(slot.component)
        self.reads_index = by_index and any(isinstance(slot, Time) for slot in slots)
        self.reads_time = any(isinstance(slot, Clock if by_index else (Clock, Time)) for slot in slots)
        without_time = [slot.component for slot in slots if isinstance(slot, Always)]
        self.variables = list(variables_in_any(without_time).values())
        self.parameters = [of for component in without_time for of in identify_mutable_parameters(component)]
        moves = self._formulas.depending(lambda slot: not isinstance(slot, Always))
        rests = self._formulas.depending(lambda slot: False)
        self.turns = moves.rotation != rests.rotation

    @property
    def stands_still(self) -> bool:
        """Whether nothing can move the body: neither a variable, nor a parameter, nor time."""
        return not (self.signals or self.variables or self.parameters or self.reads_index or self.reads_time)

    def values(self, index: float, replaced: Mapping[int, float]) -> Array:
        """Entries at an index, with other values of some variables, by identity; NaN where they have none."""
        leaves = {id(variable): _SOMEWHERE for variable in self.variables} | dict(replaced)

        def read(slot: Slot) -> Any:
            if isinstance(slot, Always):
                return np.float64(ExpressionSteps([slot.component]).evaluate_at(leaves)[0])
            return np.float64(index if isinstance(slot, Time) else _SOMEWHERE)

        try:
            with np.errstate(all="ignore"):
                return np.array(self._formulas.at(read, _ARRAYS).entries, dtype=float)
        except (ObstacleError, ValueError, ArithmeticError):  # a function that cannot be followed, a value that misses
            return np.full(1, np.nan)


# ----------------------------------------------------------------------------------------------------- along a motion


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """A signal: one polynomial on each interval.

    Attributes
    ----------
    at_node : callable
        Its value at a node of the motion.
    coefficients : three arrays, shapes (intervals, degree + 1), (intervals, degree) and (intervals, degree - 1)
        Bernstein coefficients of the polynomials and of their first two derivatives.
    component : Var or None
        What the signal is read from; None for time.
    """

    at_node: Callable[[Any], float]
    coefficients: tuple[Array, Array, Array]
    component: Any = None

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Values at local fractions of intervals, shape ``(m,)``."""
        coefficients = self.coefficients[0]
        basis = bernstein_matrix(coefficients.shape[1] - 1, fraction)
        return np.asarray((basis * coefficients[interval]).sum(axis=1), dtype=np.float64)

    def taylor_form(self, interval: Indices, start: Array, end: Array) -> TaylorForm:
        """Bounds on subintervals; derivatives are with respect to the local fraction."""
        value, first, second = (restrict(order[interval], start, end) for order in self.coefficients)
        return taylor_form_of_polynomial((value, first, second))


class SignalFormulas:
    """Formulas in signals: what a rule says along a motion, evaluated at many instants or subintervals at once.

    Parameters
    ----------
    motion : Motion
    formulas : object
        What the rule says for all times, which is a pose or a length.
    name : str
        What the rule is about, in messages: "the pose of 'car'".
    times : mapping of node to float, optional
        `node_times` of the motion, where they are known already.

    Attributes
    ----------
    signals : dict of Slot to PiecewisePolynomial
        Time among them.
    parameters : tuple of str
        Names of the parameters over time that are joined by lines, which is assumed.

    Raises
    ------
    ObstacleError
        Naming the rule, when it reads a signal that is not continuous, or has a function that cannot be followed.
    """

    def __init__(self, motion: Motion, formulas: Any, name: str, times: Mapping[float, float] | None = None) -> None:
        assert motion.interpolation is not None
        self.name, self._formulas, self._motion = name, formulas, motion
        self._interpolation, self._times = motion.interpolation, times
        self.signals: dict[Slot, PiecewisePolynomial] = {}
        self._lines: dict[Slot, TableFunction] = {}
        self._named: dict[NamedItem, Any] = {}
        self._index = self._joined(float)
        try:
            for slot in formulas.slots:
                self._add(slot)
            nodes = motion.nodes
            with np.errstate(all="ignore"):
                entries = self._at_nodes(nodes)
                self.taylor_forms(np.array([0]), np.array([0.0]), np.array([1.0]))
        except UnknownFunction as error:
            raise ObstacleError(
                f"{name}: {error} Between nodes a pose can be followed when it is made of sums, products, quotients, "
                f"powers, and the functions {', '.join(FOLLOWED)}."
            ) from None
        except ObstacleError as error:
            raise error if name in str(error) else ObstacleError(f"{name}: {error}") from error
        if not np.isfinite(entries).all():
            worst = int(np.argmin(np.isfinite(entries).all(axis=1)))
            raise ObstacleError(f"{name}: it has no finite value at t = {nodes[worst]:g}.")
        self.parameters = tuple(line.name for line in self._lines.values())

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Entries at local fractions of intervals, shape ``(m, entries)``."""
        signals = {slot: of.values(interval, fraction) for slot, of in self.signals.items()}
        return self.evaluated(signals, interval, fraction)

    def taylor_forms(self, interval: Indices, start: Array, end: Array) -> list[TaylorForm]:
        """Bounds of the entries and their derivatives on subintervals."""
        forms = {slot: of.taylor_form(interval, start, end) for slot, of in self.signals.items()}
        index = self._index.taylor_form(interval, start, end) if self._lines else None
        return [
            form if isinstance(form, TaylorForm) else TaylorForm.constant(form, len(interval))
            for form in self._entries(forms, index, _TAYLOR_FORMS)
        ]

    def evaluated(self, signals: Mapping[Slot, Array], interval: Indices, fraction: Array) -> Array:
        """Entries at local fractions of intervals for given values of the signals there, shape ``(m, entries)``."""
        index = self._index.values(interval, fraction) if self._lines else None
        return _columns(self._entries(signals, index, _ARRAYS), len(interval))

    def mismatch(self, motion: Motion) -> tuple[Indices, Array]:
        """Differences of the entries at the nodes of each interval from those that its polynomials give there.

        Equations of the model couple nodes and polynomials: the continuity equation of an element's end, or the
        right-hand sides of a scheme that starts on a stage. Where the values violate these equations the motion jumps.

        Returns
        -------
        interval : array, shape (m,)
        difference : array, shape (m, entries)
            NaN where a polynomial has no value.
        """
        counts = [len(nodes) for nodes in motion.intervals]
        interval = np.repeat(np.arange(len(counts)), counts)
        fraction = np.concatenate([motion.local_fractions(i) for i in range(len(counts))])
        at_nodes = self._at_nodes([node for nodes in motion.intervals for node in nodes])
        return interval, at_nodes - self.values(interval, fraction)

    def _at_nodes(self, nodes: list[Any]) -> Array:
        """Entries from the values at nodes, shape ``(len(nodes), entries)``."""
        signals = {slot: np.array([of.at_node(node) for node in nodes]) for slot, of in self.signals.items()}
        return _columns(self._entries(signals, np.array(nodes, dtype=float), _ARRAYS), len(nodes))

    def _entries(
        self, signals: Mapping[Slot, Any], index: Any, functions: Mapping[str, Callable[..., Any]]
    ) -> list[Any]:
        """Entries of a pose row by row, its rotation first; of a length the one."""

        def read(slot: Slot) -> Any:
            if slot in signals:
                return signals[slot]
            if slot in self._lines:
                return _of_table(self._lines[slot], 0, index)
            if isinstance(slot, NamedItem):
                if slot not in self._named:
                    self._named[slot] = slot.formulas(ObstacleError)
                return self._named[slot].at(read, functions)
            return self._constant(slot)

        found = self._formulas.at(read, functions)
        return found.entries if isinstance(found, Pose) else [found]

    # ---------------------------------------------------------------- what is read

    def _add(self, slot: Slot) -> None:
        """Make a signal of what is read."""
        if isinstance(slot, Always):
            self._constant(slot)  # which has to have a value
        elif isinstance(slot, Time) and not is_on_indices(self._motion.block):
            self.signals[slot] = self._index
        elif isinstance(slot, (Time, Clock)):
            if isinstance(slot, Clock):
                self._interpolation.check_time_of(slot.component)
            times = node_times(self._motion) if self._times is None else self._times
            self.signals[slot] = self._joined(times.__getitem__)
        elif not isinstance(slot, Item):
            refuse_between_nodes(slot)
        elif self._interpolation.joins_lines(slot):
            nodes = self._motion.nodes
            values = np.array([[_number(item_at(slot, node), slot)] for node in nodes])
            self._lines[slot] = TableFunction(slot.name, np.array(nodes, dtype=float), values, [slot.name])
        else:
            self._interpolation.check(slot)
            component = parent_of(item_at(slot, self._motion.intervals[0][0]))
            self.signals[slot] = self._polynomial(
                lambda node: _number(item_at(slot, node), slot), _coefficients(self._interpolation, slot), component
            )

    @staticmethod
    def _constant(slot: Slot) -> float:
        number = value(slot.component, exception=False)
        if number is None:
            name = slot.component.name
            raise ObstacleError(f"'{name}' has no value. Solve the model first, or give it an initial guess.")
        return float(number)

    def _joined(self, at_node: Callable[[Any], float]) -> PiecewisePolynomial:
        """What is linear on each interval, by its values at both ends."""
        ends = np.array([[at_node(nodes[0]), at_node(nodes[-1])] for nodes in self._motion.intervals])
        return self._polynomial(at_node, ends)

    @staticmethod
    def _polynomial(at_node: Callable[[Any], float], coefficients: Array, component: Any = None) -> PiecewisePolynomial:
        slope = derivative_coefficients(coefficients)
        return PiecewisePolynomial(at_node, (coefficients, slope, derivative_coefficients(slope)), component)


def _columns(entries: list[Any], count: int) -> Array:
    return np.array([np.broadcast_to(entry, count) for entry in entries], dtype=float).T


def template_of(
    motion: Motion, rule: Callable[..., Any], name: str, dimension: int, times: Mapping[float, float] | None = None
) -> SignalFormulas:
    """What a pose rule says along a motion.

    Parameters
    ----------
    motion : Motion
    rule : callable
        ``rule(block, t)``, as for a `Body`.
    name : str
        Name of the body in messages.
    dimension : int
    times : mapping of node to float, optional
        `node_times` of the motion, where they are known already.

    Raises
    ------
    ObstacleError
        Naming the body, as `SignalFormulas`; also when the rule is no template, or does not return a pose of the body's
        dimension.
    """
    what, formulas = f"the pose of '{name}'", _pose_formulas(motion, rule, name)
    pose = formulas.depending(lambda slot: False)
    if pose.dimension != dimension:
        raise ObstacleError(
            f"{what}: its rule returned {pose!r}; expected a Pose in {dimension} dimensions, by "
            f"{'planar_pose' if dimension == 2 else 'spatial_pose'}."
        )
    if getattr(templated(rule).rule, "skips_points", False):  # a table says nothing beyond its ends
        for node in motion.nodes:
            motion.pose_at_node(rule, node, name=name)
    return SignalFormulas(motion, formulas, what, times)


def _pose_formulas(motion: Motion, rule: Callable[..., Any], name: str) -> Any:
    """What a pose rule says for all times, which is a pose."""
    formulas = motion.formulas_between_nodes(
        rule, f"the pose of '{name}'", partial(motion.pose_at_node, rule, name=name)
    )
    asked_pose(lambda: formulas.depending(lambda slot: False), rule, motion.block, name)
    return formulas


def node_times(motion: Motion) -> dict[float, float]:
    """The time of every node, as a number."""
    # Between the boundaries of an element time is linear in the index.
    times: dict[float, float] = {}
    for interval, nodes in enumerate(motion.intervals):
        start, end = (float(value(motion.time_at(node))) for node in (nodes[0], nodes[-1]))
        for node, fraction in zip(nodes, motion.local_fractions(interval), strict=True):
            times[node] = start + fraction * (end - start)
    return times


def _coefficients(interpolation: Interpolation, item: Item) -> Array:
    """Bernstein coefficients of a signal on all intervals, shape ``(intervals, degree + 1)``."""
    rows = []
    for interval in range(len(interpolation.intervals)):
        leaves = [_number(leaf, item) for leaf in interpolation.leaves(item, interval)]
        points, to_coefficients = bernstein_from_samples(len(leaves) - 1)
        rows.append(to_coefficients @ (interpolation.weights(item, interval, points) @ leaves))
    return np.array(rows)


def _number(leaf: Any, item: Item) -> float:
    number = value(leaf, exception=False)
    if number is None:
        raise ObstacleError(
            f"'{item.name}' has no value everywhere. Solve the model first, or give it an initial guess."
        )
    return float(number)
