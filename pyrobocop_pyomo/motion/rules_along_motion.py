"""What the rule of a pose or of a clearance says along a motion: expressions, numbers and bounds of one template.

What a template reads at ``t`` are signals, which a motion makes polynomials of.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.base.block import BlockData
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import NumericValue, native_numeric_types, value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import UnknownFunction
from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.modeling.rule_slips import block_as_number, forgotten_index, slips_explained
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.interval_arithmetic import TAYLOR_FUNCTIONS, TaylorForm
from pyrobocop_pyomo.numerics.polynomials import bernstein_from_samples, evaluation_matrix
from pyrobocop_pyomo.numerics.tables import tables_continued
from pyrobocop_pyomo.phases.bounds_between_points import PiecewisePolynomial
from pyrobocop_pyomo.templates.slots import Always, Clock, Item, NamedItem, Place, Slot, Time
from pyrobocop_pyomo.templates.template import templated

# Functions that can be followed between nodes, of which bounds of derivatives are known.
FOLLOWED = ("sin", "cos", "tan", "atan", "exp", "log", "sqrt")


def _call(output: Any, *arguments: Any) -> Any:
    """An output of a `Function`: of numbers any, of arrays and Taylor forms one that knows its bounds."""
    if all(isinstance(argument, float) for argument in arguments):
        return output.evaluate(arguments)
    if not hasattr(output.function, "taylor_form"):
        raise ObstacleError(
            f"'{output.name}' is a function in Python, of which nobody knows how it curves between nodes. Write the "
            "formula of the pose, or make what it computes a state."
        )
    moves = any(isinstance(argument, TaylorForm) for argument in arguments)
    return (TAYLOR_FUNCTIONS if moves else ARRAY_FUNCTIONS)["call"](output, *arguments)


def _square_root(argument: Any) -> Any:
    """Of a form that may be negative nothing is known: the pose may have no value there."""
    return argument.sqrt() if isinstance(argument, TaylorForm) else float(np.sqrt(argument))


_ARRAYS: dict[str, Callable[..., Any]] = {**{name: ARRAY_FUNCTIONS[name] for name in FOLLOWED}, "call": _call}
_TAYLOR_FORMS: dict[str, Callable[..., Any]] = {
    **{name: TAYLOR_FUNCTIONS[name] for name in FOLLOWED}, "sqrt": _square_root, "call": _call
}  # fmt: skip


# ------------------------------------------------------------------------------------------- at nodes, in expressions


@dataclass(frozen=True, eq=False)
class RuleAlongMotion:
    """The rule of a pose or of a clearance along a motion.

    Attributes
    ----------
    motion : Motion
    rule : callable
        ``rule(block, t)``.
    label : str
        What it is about, in messages: "the pose of 'car'".
    checked : callable
        ``checked(result, where)`` returns what the rule returned, or raises `ObstacleError` where that is of another
        kind; ``where`` is " at t = 0.5", or nothing for all times.
    """

    motion: Any
    rule: Any
    label: str
    checked: Callable[[Any, str], Any]

    def at_node(self, t: Any) -> Any:
        """What the rule says at a point of the set, or at a node of an interval; typical mistakes in it are explained.

        Raises
        ------
        ObstacleError
            Naming the rule and the time, when it has no result there, or one of another kind.
        """
        time, phase = float(t) if isinstance(t, Real) else None, self.motion.phase
        try:
            with slips_explained(self.rule, self.label, self.motion.block, ("b", "t"), ObstacleError, time):
                index = t if phase is None else phase.record.index_for_rule(phase, t, self.label)
                return self.checked(self.rule(self.motion.block, index), f" at t = {t!r}")
        except KeyError as error:
            raise ObstacleError(
                f"{self.label} has no value at t = {t!r} ({error}). It is evaluated at every point and at both ends of "
                "every interval, where states have values, but controls and algebraics may have none."
            ) from error

    @cached_property
    def formulas(self) -> Any:
        """What the rule says for all times.

        Raises
        ------
        ObstacleError
            When it has to know the time as a number.
        """
        formulas = templated(self.rule).formulas(self.motion.block)
        if formulas is None:
            self.at_node(self.motion.intervals[0][0])  # a mistake in the rule is named before its kind
            raise ObstacleError(
                f"{self.label} cannot be asked between the nodes: its rule goes by a number that t or a variable has "
                "at the moment, as by pyo.value(t), math.cos(t) or an 'if'. Compute with t and with the variables "
                "themselves, by Pyomo's functions: pyo.cos(t)."
            )
        self.checked(formulas.depending(lambda slot: False), "")
        return formulas

    def followed(self, *, early: bool = False) -> Any:
        """What the rule says for all times, where all that it reads has a motion.

        Parameters
        ----------
        early : bool
            True while the model is still being stated: what ties two durations may come later.

        Raises
        ------
        ObstacleError
            When it reads what has no motion between the nodes.
        """
        with errors_naming(self.label):
            for slot in self.formulas.slots:
                if isinstance(slot, Item):
                    self.motion.refuse(slot, early)
                elif isinstance(slot, Clock):
                    self.motion.check_time_of(slot.component)
                elif not isinstance(slot, (Always, Time)):
                    raise ObstacleError(
                        f"a rule reads '{slot.component.name}' by {type(slot).__name__.lower()}, which has no answer "
                        "between the nodes."
                    )
        return self.formulas

    @cached_property
    def _checked_formulas(self) -> Any:
        """As `followed`: once for many instants."""
        return self.followed()

    def at(self, interval: int, fraction: float) -> Any:
        """What the rule says at a local fraction of an interval, in expressions of the variables at the nodes.

        Raises
        ------
        ObstacleError
            When it reads what has no value between the nodes.
        """
        motion = self.motion
        index = motion.index_at(interval, fraction)
        if index in motion.intervals[interval]:
            return self.at_node(index)

        def read(slot: Slot) -> Any:
            if isinstance(slot, NamedItem):
                return slot.formulas(ObstacleError).at(read)
            if isinstance(slot, Time):
                return motion.time_at(index)
            if not isinstance(slot, Item):
                return slot.on_model(Place(motion.block, index))
            fractions, leaves = motion.polynomial(slot, interval)
            weights = evaluation_matrix(fractions, fraction)[0].tolist()
            if all(map(is_plain_variable, leaves)):
                return LinearExpression(linear_vars=leaves, linear_coefs=weights)
            return sum(weight * leaf for weight, leaf in zip(weights, leaves, strict=True))

        with errors_naming(self.label):
            return self._checked_formulas.at(read)


def pose_along(motion: Any, rule: Any, name: str) -> RuleAlongMotion:
    """The pose rule of a body along a motion."""
    checked = partial(checked_pose, block=motion.block, name=name)
    return RuleAlongMotion(motion, rule, f"the pose of '{name}'", checked)


def clearance_along(motion: Any, rule: Any, pair: tuple[str, str]) -> RuleAlongMotion:
    """The rule for the clearance of a body pair along a motion."""
    text = clearance_text(pair)

    def checked(length: Any, where: str) -> Any:
        if not isinstance(length, (Real, NumericValue)) or isinstance(length, bool):
            raise ObstacleError(f"{text}{where} is {length!r}; its rule must return a length.")
        return length

    return RuleAlongMotion(motion, rule, text, checked)


def is_clearance_rule(clearance: Any) -> bool:
    """Whether a clearance is ``rule(block, t)``; Pyomo's parameters and expressions can be called too."""
    return callable(clearance) and not isinstance(clearance, NumericValue)


def clearance_text(pair: tuple[str, str]) -> str:
    """How messages call the clearance of a body pair."""
    return f"the clearance between '{pair[0]}' and '{pair[1]}'"


def clearance_value(clearance: Any, label: str) -> float:
    """A clearance as a number.

    Raises
    ------
    ObstacleError
        Where it has no value, or is no number.
    """
    try:
        number = value(clearance, exception=False)
        number = math.nan if number is None else float(number)
    except (TypeError, ValueError):
        raise ObstacleError(
            f"{label} is {clearance!r}; expected a length: a number, a Param, a Var or an expression of the model, or "
            "a rule(block, t)."
        ) from None
    if not math.isfinite(number):
        raise ObstacleError(
            f"{label} is '{clearance}', which has no finite value. Give its parameters and variables values first."
        )
    return number


def checked_pose(pose: Any, where: str, *, block: Any, name: str) -> Pose:
    """What a pose rule returned, which has to be a pose; typical mistakes in it are explained.

    Parameters
    ----------
    pose : object
    where : str
        At which time, in words, or nothing.
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
            f"the pose rule of '{name}' returned {given}{where}; expected a Pose: {remedy}return "
            "planar_pose(x, y, theta) in the plane, spatial_pose((x, y, z), ...) in space."
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
class Signal(PiecewisePolynomial):
    """Something that a rule reads along a motion, as a number.

    Attributes
    ----------
    at_nodes : mapping of node to float
        Its values at the nodes of the motion.
    component : Var or None
        What it is read from; None for the time.
    """

    at_nodes: Mapping[Any, float]
    component: Any = None


class SignalFormulas:
    """What a rule says along a motion, evaluated at many instants or subintervals at once.

    Parameters
    ----------
    rule : RuleAlongMotion
        Along a motion with intervals.

    Attributes
    ----------
    signals : dict of Slot to Signal
        Time among them.

    Raises
    ------
    ObstacleError
        Naming the rule, when it reads a signal that is not continuous, or has a function that cannot be followed.
    """

    def __init__(self, rule: RuleAlongMotion) -> None:
        self._formulas, self._motion = rule.followed(), rule.motion
        nodes = self._nodes = rule.motion.nodes
        self._named: dict[NamedItem, Any] = {}
        self.signals: dict[Slot, Signal] = {}
        with errors_naming(rule.label):
            for slot in self._formulas.slots:
                if isinstance(slot, Always):
                    _number(slot.component, slot.component.name)
                elif isinstance(slot, Item):
                    self.signals[slot] = self._signal(slot)
                else:  # the time
                    self.signals[slot] = self._linear(self._motion.node_times())
            with np.errstate(all="ignore"):
                entries = self._at_nodes(nodes)
                self.taylor_forms(np.array([0]), np.array([0.0]), np.array([1.0]))
        if not np.isfinite(entries).all():
            worst = int(np.argmin(np.isfinite(entries).all(axis=1)))
            raise ObstacleError(f"{rule.label}: it has no finite value at t = {nodes[worst]:g}.")

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

    def mismatch(self, sizes: Callable[[Array], Array]) -> Array:
        """Largest difference of the entries at the nodes from those that the polynomials give there, by interval.

        Equations of the model couple nodes and polynomials: the continuity equation of an element's end, or the
        right-hand sides of a scheme that starts on a stage. Where the values violate these equations the motion jumps.

        Parameters
        ----------
        sizes : callable
            From differences (m, entries) to their sizes (m,).
        """
        intervals = self._motion.intervals
        interval = np.repeat(np.arange(len(intervals)), [len(nodes) for nodes in intervals])
        fraction = np.concatenate([self._motion.local_fractions(i) for i in range(len(intervals))])
        at_nodes = self._at_nodes([node for nodes in intervals for node in nodes])
        found = sizes(at_nodes - self.values(interval, fraction))
        largest = np.zeros(len(intervals))
        # Intervals without values have no path, and no proof either.
        np.maximum.at(largest, interval, np.where(np.isnan(found), 0.0, found))
        return largest

    def _at_nodes(self, nodes: list[Any]) -> Array:
        """Entries from the values at nodes, shape ``(len(nodes), entries)``."""
        signals = {slot: np.array([of.at_nodes[node] for node in nodes]) for slot, of in self.signals.items()}
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

        with tables_continued():  # where they are not to be read, their bounds are not known
            found = self._formulas.at(read, functions)
        return found.entries if isinstance(found, Pose) else [found]

    def _signal(self, item: Item) -> Signal:
        """The motion of the signal that is read at ``t``."""
        motion, name = self._motion, item.name  # the words take longer to make than all numbers to read
        at_nodes = {node: _number(item_at(item, node), name) for node in self._nodes}
        coefficients, of_values = [], dict[tuple[float, ...], Array]()
        for interval in range(len(motion.intervals)):
            fractions, leaves = motion.polynomial(item, interval)
            key = tuple(fractions)
            if key not in of_values:
                points, to_coefficients = bernstein_from_samples(len(leaves) - 1)
                of_values[key] = to_coefficients @ evaluation_matrix(fractions, points)
            coefficients.append(of_values[key] @ [_number(leaf, name) for leaf in leaves])
        component = parent_of(item_at(item, motion.intervals[0][0]))
        return Signal(np.array(coefficients), at_nodes, component)

    def _linear(self, at_nodes: Mapping[Any, float]) -> Signal:
        """What is linear on each interval, by its values at both ends."""
        ends = np.array([[at_nodes[nodes[0]], at_nodes[nodes[-1]]] for nodes in self._motion.intervals])
        return Signal(ends, at_nodes)


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
