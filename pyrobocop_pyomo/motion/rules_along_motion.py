"""What the rule of a pose or of a clearance says along a motion: expressions, numbers and bounds of one template.

What a template reads at ``t`` are signals, which a motion makes polynomials of.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.block import BlockData
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import UnknownFunction
from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.modeling.rule_slips import block_as_number, forgotten_index, slips_explained
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.bernstein import bernstein_from_samples
from pyrobocop_pyomo.numerics.lagrange import evaluation_matrix
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm
from pyrobocop_pyomo.numerics.taylor_functions import TAYLOR_FUNCTIONS
from pyrobocop_pyomo.phases.bounds_between_points import PiecewisePolynomial
from pyrobocop_pyomo.templates.slots import Always, Clock, Item, NamedItem, Place, Slot, Time, is_on_indices
from pyrobocop_pyomo.templates.template import templated

from .table_functions import TableFunction

# Functions that can be followed between nodes, of which bounds of derivatives are known.
FOLLOWED = ("sin", "cos", "tan", "atan", "exp", "log", "sqrt")


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
    if isinstance(arguments[0], TaylorForm):
        return function.taylor_form(arguments[0], output.index)
    return function.values(np.asarray(arguments[0], dtype=float)[:, None])[:, output.index]


def _square_root(argument: Any) -> Any:
    """Of a form that may be negative nothing is known: the pose may have no value there."""
    return argument.sqrt() if isinstance(argument, TaylorForm) else float(np.sqrt(argument))


_ARRAYS: dict[str, Callable[..., Any]] = {**{name: ARRAY_FUNCTIONS[name] for name in FOLLOWED}, "call": _call}
_TAYLOR_FORMS: dict[str, Callable[..., Any]] = {
    **{name: TAYLOR_FUNCTIONS[name] for name in FOLLOWED}, "sqrt": _square_root, "call": _call
}  # fmt: skip


# ------------------------------------------------------------------------------------------- at nodes, in expressions


@contextmanager
def rule_at_node(motion: Any, rule: Any, label: str, t: Any) -> Iterator[None]:
    """Context in which a rule is called at a node: typical mistakes in it are explained.

    Raises
    ------
    ObstacleError
        Where a rule has no value there, among others.
    """
    time = float(t) if isinstance(t, Real) else None
    try:
        with slips_explained(rule, label, motion.block, ("b", "t"), ObstacleError, time):
            yield
    except KeyError as error:
        raise ObstacleError(
            f"{label} has no value at t = {t!r} ({error}). It is evaluated at every point and at both ends of every "
            "interval, where states have values, but controls and algebraics may have none."
        ) from error


def checked_pose(pose: Any, block: Any, name: str) -> Pose:
    """What a pose rule returned, which has to be a pose; typical mistakes in it are explained.

    Parameters
    ----------
    pose : object
    block : Block
        The block that the rule is for.
    name : str
        Name of the body in messages.

    Raises
    ------
    ObstacleError
        Naming the body.
    """
    if not isinstance(pose, Pose):
        given = repr(pose)
        if isinstance(pose, (tuple, list)):
            given = f"a {type(pose).__name__}, ({', '.join(map(str, pose))})"
        remedy = "Is the return statement missing? " if pose is None else ""
        raise ObstacleError(
            f"the pose rule of '{name}' returned {given}; expected a Pose: {remedy}return planar_pose(x, y, theta) in "
            "the plane, spatial_pose((x, y, z), ...) in space."
        )
    for entry in pose.entries:
        if entry.__class__ in native_numeric_types:
            continue
        if isinstance(entry, BlockData):
            raise ObstacleError(f"the pose of '{name}': {block_as_number(block, ('b', 't'))}")
        is_family = getattr(entry, "is_indexed", bool)()
        if entry is NotImplemented or not getattr(entry, "is_numeric_type", bool)() or is_family:
            component = f"b.{entry.local_name}" if hasattr(entry, "local_name") else "b.x"
            raise ObstacleError(f"the pose of '{name}': {forgotten_index('t', component)}")
    return pose


def formulas_between(motion: Any, rule: Any, label: str, ask: Callable[[Any], Any]) -> Any:
    """What a rule says for all times.

    Parameters
    ----------
    motion : Motion
        With intervals.
    rule : callable
    label : str
        What it is about, in messages: "the pose of 'car'".
    ask : callable
        Asks it at a node, and names a mistake in it.

    Raises
    ------
    ObstacleError
        When it has to know the time as a number.
    """
    formulas = templated(rule).formulas(motion.block)
    if formulas is None:
        ask(motion.intervals[0][0])
        raise ObstacleError(
            f"{label} cannot be asked between the nodes: its rule goes by a number that t or a variable has at the "
            "moment, as by pyo.value(t), math.cos(t) or an 'if'. Compute with t and with the variables themselves, "
            "by Pyomo's functions: pyo.cos(t)."
        )
    return formulas


def pose_formulas(motion: Any, rule: Any, name: str) -> Any:
    """What a pose rule says for all times, which is a pose."""
    ask = partial(motion.pose_at_node, rule, name=name)
    formulas = formulas_between(motion, rule, f"the pose of '{name}'", ask)
    checked_pose(formulas.depending(lambda slot: False), motion.block, name)
    return formulas


def expressions_between(motion: Any, formulas: Any, interval: int, fraction: float, label: str) -> Any:
    """What formulas are at a local fraction of an interval, in expressions of the variables at the nodes.

    Raises
    ------
    ObstacleError
        When they read what has no value between the nodes.
    """
    index = motion.index_at(interval, fraction)

    def read(slot: Slot) -> Any:
        if isinstance(slot, NamedItem):
            return slot.formulas(ObstacleError).at(read)
        if isinstance(slot, (Always, Time, Clock)):
            return slot.on_model(Place(motion.block, index))
        item = _item(slot)
        motion.check(item)
        fractions, leaves = motion.polynomial_around(item, interval, fraction)
        weights = evaluation_matrix(fractions, fraction)[0].tolist()
        if all(map(is_plain_variable, leaves)):
            return LinearExpression(linear_vars=leaves, linear_coefs=weights)
        return sum(weight * leaf for weight, leaf in zip(weights, leaves, strict=True))

    with errors_naming(label):
        return formulas.at(read)


def _item(slot: Slot) -> Item:
    """A slot that has a motion between the nodes; a delayed value, a derivative or a rate is refused."""
    if not isinstance(slot, Item):
        raise ObstacleError(
            f"a rule reads '{slot.component.name}' by {type(slot).__name__.lower()}, which has no answer between the "
            "nodes."
        )
    return slot


@contextmanager
def errors_naming(label: str) -> Iterator[None]:
    """Context whose errors say which rule they are about."""
    try:
        yield
    except UnknownFunction as error:
        raise ObstacleError(
            f"{label}: {error} Between nodes a pose can be followed when it is made of sums, products, quotients, "
            f"powers, and the functions {', '.join(FOLLOWED)}."
        ) from None
    except ObstacleError as error:
        raise error if label in str(error) else ObstacleError(f"{label}: {error}") from error


# ----------------------------------------------------------------------------------------------- in numbers and bounds


@dataclass(frozen=True, eq=False)
class Signal:
    """Something that a rule reads along a motion, as a number.

    Attributes
    ----------
    at_node : callable
        Its value at a node of the motion.
    polynomial : PiecewisePolynomial
    component : Var or None
        What it is read from; None for the time.
    lines : TableFunction, optional
        What it is of the polynomial, where its values at the nodes are joined by lines.
    """

    at_node: Callable[[Any], float]
    polynomial: PiecewisePolynomial
    component: Any = None
    lines: TableFunction | None = None

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Values at local fractions of intervals, shape ``(m,)``."""
        found = self.polynomial.values(interval, fraction)
        return found if self.lines is None else self.lines.values(found[:, None])[:, 0]

    def taylor_form(self, interval: Indices, start: Array, end: Array) -> TaylorForm:
        """Bounds on subintervals; derivatives are with respect to the local fraction."""
        form = self.polynomial.taylor_form(interval, start, end)
        return form if self.lines is None else self.lines.taylor_form(form, 0)


class SignalFormulas:
    """What a rule says along a motion, evaluated at many instants or subintervals at once.

    Parameters
    ----------
    motion : Motion
        With intervals.
    formulas : object
        What the rule says for all times, which is a pose or a length.
    label : str
        What the rule is about, in messages: "the pose of 'car'".

    Attributes
    ----------
    signals : dict of Slot to Signal
        Time among them.

    Raises
    ------
    ObstacleError
        Naming the rule, when it reads a signal that is not continuous, or has a function that cannot be followed.
    """

    def __init__(self, motion: Any, formulas: Any, label: str) -> None:
        self._formulas, self._motion = formulas, motion
        self._named: dict[NamedItem, Any] = {}
        self.signals: dict[Slot, Signal] = {}
        with errors_naming(label):
            for slot in formulas.slots:
                if isinstance(slot, Always):
                    _number(slot.component, slot.component.name)
                else:
                    self.signals[slot] = self._signal(slot)
            nodes = motion.nodes
            with np.errstate(all="ignore"):
                entries = self._at_nodes(nodes)
                self.taylor_forms(np.array([0]), np.array([0.0]), np.array([1.0]))
        if not np.isfinite(entries).all():
            worst = int(np.argmin(np.isfinite(entries).all(axis=1)))
            raise ObstacleError(f"{label}: it has no finite value at t = {nodes[worst]:g}.")

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters over time that are joined by lines, which is assumed."""
        return [signal.lines.name for signal in self.signals.values() if signal.lines is not None]

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Entries at local fractions of intervals, shape ``(m, entries)``."""
        signals = {slot: signal.values(interval, fraction) for slot, signal in self.signals.items()}
        return self.evaluated(signals, len(interval))

    def evaluated(self, signals: Mapping[Slot, Array], count: int) -> Array:
        """Entries for given values of the signals at ``count`` instants, shape ``(count, entries)``."""
        entries = self._entries(signals, _ARRAYS)
        return np.array([np.broadcast_to(entry, count) for entry in entries], dtype=float).T

    def taylor_forms(self, interval: Indices, start: Array, end: Array) -> list[TaylorForm]:
        """Bounds of the entries and their derivatives on subintervals."""
        forms = {slot: signal.taylor_form(interval, start, end) for slot, signal in self.signals.items()}
        return [
            form if isinstance(form, TaylorForm) else TaylorForm.constant(form, len(interval))
            for form in self._entries(forms, _TAYLOR_FORMS)
        ]

    def mismatch(self) -> tuple[Indices, Array]:
        """Differences of the entries at the nodes of each interval from those that its polynomials give there.

        Equations of the model couple nodes and polynomials: the continuity equation of an element's end, or the
        right-hand sides of a scheme that starts on a stage. Where the values violate these equations the motion jumps.

        Returns
        -------
        interval : array, shape (m,)
        difference : array, shape (m, entries)
            NaN where a polynomial has no value.
        """
        intervals = self._motion.intervals
        interval = np.repeat(np.arange(len(intervals)), [len(nodes) for nodes in intervals])
        fraction = np.concatenate([self._motion.local_fractions(i) for i in range(len(intervals))])
        return interval, self._at_nodes([node for nodes in intervals for node in nodes]) - self.values(
            interval, fraction
        )

    def _at_nodes(self, nodes: list[Any]) -> Array:
        """Entries from the values at nodes, shape ``(len(nodes), entries)``."""
        signals = {slot: np.array([of.at_node(node) for node in nodes]) for slot, of in self.signals.items()}
        return self.evaluated(signals, len(nodes))

    def _entries(self, signals: Mapping[Slot, Any], functions: Mapping[str, Callable[..., Any]]) -> list[Any]:
        """Entries of a pose row by row, its rotation first; of a length the one."""

        def read(slot: Slot) -> Any:
            if slot in signals:
                return signals[slot]
            if isinstance(slot, NamedItem):
                if slot not in self._named:
                    self._named[slot] = slot.formulas(ObstacleError)
                return self._named[slot].at(read, functions)
            return _number(slot.component, slot.component.name)

        found = self._formulas.at(read, functions)
        return found.entries if isinstance(found, Pose) else [found]

    def _signal(self, slot: Slot) -> Signal:
        """The motion of what is read at ``t``."""
        motion = self._motion
        if isinstance(slot, Time) and not is_on_indices(motion.block):
            return self._linear(float)
        if isinstance(slot, (Time, Clock)):
            if isinstance(slot, Clock):
                motion.check_time_of(slot.component)
            return self._linear(motion.node_times().__getitem__)
        item = _item(slot)

        def at_node(node: Any) -> float:
            return _number(item_at(item, node), item.name)

        if motion.joins_lines(item):
            nodes = motion.nodes
            values = np.array([[at_node(node)] for node in nodes])
            lines = TableFunction(item.name, np.array(nodes, dtype=float), values, [item.name])
            return Signal(at_node, self._linear(float).polynomial, lines=lines)
        motion.check(item)
        coefficients = []
        for interval in range(len(motion.intervals)):
            fractions, leaves = motion.polynomial(item, interval)
            points, to_coefficients = bernstein_from_samples(len(leaves) - 1)
            numbers = [_number(leaf, item.name) for leaf in leaves]
            coefficients.append(to_coefficients @ (evaluation_matrix(fractions, points) @ numbers))
        component = parent_of(item_at(item, motion.intervals[0][0]))
        return Signal(at_node, PiecewisePolynomial(np.array(coefficients)), component)

    def _linear(self, at_node: Callable[[Any], float]) -> Signal:
        """What is linear on each interval, by its values at both ends."""
        ends = np.array([[at_node(nodes[0]), at_node(nodes[-1])] for nodes in self._motion.intervals])
        return Signal(at_node, PiecewisePolynomial(ends))


def _number(leaf: Any, name: str) -> float:
    number = value(leaf, exception=False)
    if number is None:
        raise ObstacleError(f"'{name}' has no value everywhere. Solve the model first, or give it an initial guess.")
    return float(number)


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
