"""`SignalFormulas`: a pose or a length as formulas in signals, evaluated at many instants or subintervals at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.modeling.rule_proxies import Signal, Signals, rule_result
from pyrobocop_pyomo.modeling.rule_slips import slips_explained
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.bernstein import (
    bernstein_from_samples,
    bernstein_matrix,
    derivative_coefficients,
    restrict,
)
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.numerics.taylor_forms import TaylorForm, taylor_form_of_polynomial

from .expression_values import ExpressionValues
from .interpolation import Interpolation, parent_of
from .motion import Motion
from .pose_rules import asked_pose
from .table_functions import TableFunction


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """A signal: one polynomial on each interval.

    Attributes
    ----------
    placeholder : Var
        Stands for the signal in the formulas.
    at_node : callable
        Its value at a node of the motion.
    coefficients : three arrays, shapes (intervals, degree + 1), (intervals, degree) and (intervals, degree - 1)
        Bernstein coefficients of the polynomials and of their first two derivatives.
    component : Var or None
        What the signal is read from; None for time.
    """

    placeholder: Any
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


@dataclass(frozen=True, eq=False)
class SignalFormulas:
    """Formulas in signals: what a rule says for all instants at once.

    Attributes
    ----------
    name : str
        What the rule is about, in messages: "the pose of 'car'".
    entries : list
        Expressions in placeholders, or numbers. Of a pose: the rotation row by row, then the translation.
    signals : tuple of PiecewisePolynomial
    parameters : tuple of str
        Names of the parameters over time that are joined by lines, which is assumed.
    """

    name: str
    entries: list[Any]
    signals: tuple[PiecewisePolynomial, ...]
    parameters: tuple[str, ...]
    _owner: Any  # Pyomo holds parents by weak references: keeps the placeholders' owner alive

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Entries at local fractions of intervals, shape ``(m, entries)``."""
        leaves = {id(signal.placeholder): signal.values(interval, fraction) for signal in self.signals}
        return self.evaluated(leaves, len(interval))

    def taylor_forms(self, interval: Indices, start: Array, end: Array) -> list[TaylorForm]:
        """Bounds of the entries and their derivatives on subintervals."""
        leaves = {id(signal.placeholder): signal.taylor_form(interval, start, end) for signal in self.signals}
        known = ExpressionValues(leaves)
        forms = [known.of(entry) for entry in self.entries]
        return [form if isinstance(form, TaylorForm) else TaylorForm.constant(form, len(interval)) for form in forms]

    def evaluated(self, leaves: dict[int, Array], count: int) -> Array:
        """Entries for other values of the placeholders, by their identities, shape ``(count, entries)``."""
        known = ExpressionValues(leaves)
        return np.array([np.broadcast_to(known.of(entry), count) for entry in self.entries], dtype=float).T

    def _at_nodes(self, nodes: list[Any]) -> Array:
        """Entries from the values at nodes, shape ``(len(nodes), entries)``."""
        leaves = {
            id(signal.placeholder): np.array([signal.at_node(node) for node in nodes], dtype=float)
            for signal in self.signals
        }
        return self.evaluated(leaves, len(nodes))

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

    def check(self, nodes: list[Any], expected: Array) -> None:
        """Compare with what the rule says at nodes, shape ``(len(nodes), entries)``.

        Raises
        ------
        ObstacleError
            Naming the rule and the node where they differ.
        """
        differences = np.abs(self._at_nodes(nodes) - expected).max(axis=1)
        worst = int(np.argmax(np.where(np.isnan(differences), np.inf, differences)))
        if not differences[worst] <= NEGLIGIBLE * max(1.0, float(np.abs(expected).max())):
            raise ObstacleError(
                f"{self.name}: at t = {nodes[worst]:g} the rule differs by {differences[worst]:.3g} from "
                "the formula that it gives for all t. A motion between the nodes is known only where the rule is one "
                "formula in t and in what it reads at t through its first argument."
            )


def template_of(
    motion: Motion, rule: Callable[..., Any], name: str, dimension: int, times: Mapping[float, float] | None = None
) -> SignalFormulas:
    """Evaluate a pose rule for all instants at once, and check the result at the nodes.

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
        Naming the body, when the rule reads a signal that is not continuous, cannot be evaluated with placeholders, or
        does not return a pose of the body's dimension.
    """
    what = f"the pose of '{name}'"
    placeholders = _SignalPlaceholders(motion, times)
    pose = asked_pose(lambda: rule_result(rule, motion.block, placeholders, what), rule, motion.block, name)
    if pose.dimension != dimension:
        raise ObstacleError(
            f"{what}: its rule returned {pose!r}; expected a Pose in {dimension} dimensions, by "
            f"{'planar_pose' if dimension == 2 else 'spatial_pose'}."
        )

    def at_node(node: Any) -> list[float]:
        return entry_values(motion.pose_at_node(rule, node, name=name).entries)

    return _checked_formulas(motion, SignalFormulas(what, pose.entries, *placeholders.known), at_node)


def length_formulas_of(
    motion: Motion, rule: Callable[..., Any], label: str, times: Mapping[float, float] | None = None
) -> SignalFormulas:
    """Evaluate a rule for a length, such as a clearance, as `template_of` does; there is one entry.

    Parameters
    ----------
    motion : Motion
    rule : callable
        ``rule(block, t)`` returns a number or an expression.
    label : str
        What the rule is about, in messages.
    times : mapping of node to float, optional

    Raises
    ------
    ObstacleError
        Naming what the rule is about, as `template_of`.
    """
    placeholders = _SignalPlaceholders(motion, times)
    with slips_explained(rule, label, motion.block, ("b", "t"), ObstacleError):
        length = rule_result(rule, motion.block, placeholders, label)
    formulas = SignalFormulas(label, [length], *placeholders.known)
    return _checked_formulas(motion, formulas, lambda node: entry_values([rule(motion.block, node)]))


def _checked_formulas(
    motion: Motion, formulas: SignalFormulas, at_node: Callable[[Any], list[float]]
) -> SignalFormulas:
    """The formulas, after they were compared with the rule at all nodes."""
    try:
        with np.errstate(all="ignore"):  # values that are not finite fail the check
            nodes = sorted({node for interval in motion.intervals for node in interval})
            formulas.check(nodes, np.array([at_node(node) for node in nodes]))
    except ObstacleError as error:
        raise error if formulas.name in str(error) else ObstacleError(f"{formulas.name}: {error}") from error
    return formulas


class _SignalPlaceholders(Signals):
    """Replaces signals by placeholders, and remembers the signal of each placeholder."""

    def __init__(self, motion: Motion, times: Mapping[float, float] | None) -> None:
        assert motion.interpolation is not None
        self.owner = ConcreteModel()
        self.signals: dict[Any, PiecewisePolynomial] = {}
        self.lines: dict[Any, Any] = {}
        self._motion = motion
        self._interpolation = motion.interpolation
        self._times = times
        ends = np.array([[nodes[0], nodes[-1]] for nodes in motion.intervals], dtype=float)
        self._add("index", "t", float, ends)
        self.index = self.signals["index"].placeholder

    @property
    def known(self) -> tuple[tuple[PiecewisePolynomial, ...], tuple[str, ...], Any]:
        """Signals and parameters that were read, and what keeps their placeholders alive."""
        names = tuple(dict.fromkeys(expression._fcn.function.name for expression in self.lines.values()))
        return tuple(self.signals.values()), names, self.owner

    def _add(
        self, key: Any, name: str, at_node: Callable[[Any], float], coefficients: Array, component: Any = None
    ) -> None:
        placeholder = Var(initialize=0.0)  # Pyomo evaluates indices
        # Messages quote formulas: the placeholder has the user's name of the signal.
        self.owner.add_component(unique_component_name(self.owner, name), placeholder)
        slope = derivative_coefficients(coefficients)
        derivatives = (coefficients, slope, derivative_coefficients(slope))
        self.signals[key] = PiecewisePolynomial(placeholder, at_node, derivatives, component)

    def value_of(self, signal: Signal) -> Any:
        if self._interpolation.joins_lines(signal):
            return self._line(signal)
        if signal.identity not in self.signals:
            self._interpolation.check(signal)
            coefficients = _coefficients(self._interpolation, signal)
            component = parent_of(signal.at(self._motion.intervals[0][0]))
            self._add(
                signal.identity, signal.name, lambda node: _number(signal.at(node), signal), coefficients, component
            )
        return self.signals[signal.identity].placeholder

    def _line(self, signal: Signal) -> Any:
        """A parameter over time: lines between its values, as a function of the index."""
        self._interpolation.check(signal)
        if signal.identity not in self.lines:
            nodes = sorted({node for interval in self._motion.intervals for node in interval})
            values = np.array([[_number(signal.at(node), signal)] for node in nodes])
            lines = TableFunction(signal.name, np.array(nodes, dtype=float), values, [signal.name])
            self.lines[signal.identity] = lines(self.index)[0]
        return self.lines[signal.identity]

    def time_at(self, block: Any) -> Any:
        if not self._interpolation.is_time_of(block):
            raise ObstacleError(f"time_at(t) is read from '{block.name}', whose time is not that of the set of points.")
        if "time" not in self.signals:
            times = node_times(self._motion) if self._times is None else self._times
            ends = np.array([[times[nodes[0]], times[nodes[-1]]] for nodes in self._motion.intervals])
            self._add("time", "time_at(t)", times.__getitem__, ends)
        return self.signals["time"].placeholder


def node_times(motion: Motion) -> dict[float, float]:
    """The time of every node, as a number."""
    # Between the boundaries of an element time is linear in the index.
    times: dict[float, float] = {}
    for interval, nodes in enumerate(motion.intervals):
        start, end = (float(value(motion.time_at(node))) for node in (nodes[0], nodes[-1]))
        for node, fraction in zip(nodes, motion.local_fractions(interval), strict=True):
            times[node] = start + fraction * (end - start)
    return times


def _coefficients(interpolation: Interpolation, signal: Signal) -> Array:
    """Bernstein coefficients of a signal on all intervals, shape ``(intervals, degree + 1)``."""
    rows = []
    for interval in range(len(interpolation.intervals)):
        leaves = [_number(leaf, signal) for leaf in interpolation.leaves(signal, interval)]
        points, to_coefficients = bernstein_from_samples(len(leaves) - 1)
        rows.append(to_coefficients @ (interpolation.weights(signal, interval, points) @ leaves))
    return np.array(rows)


def _number(leaf: Any, signal: Signal) -> float:
    number = value(leaf, exception=False)
    if number is None:
        raise ObstacleError(
            f"'{signal.name}' has no value everywhere. Solve the model first, or give it an initial guess."
        )
    return float(number)


def entry_values(entries: list[Any]) -> list[float]:
    """Entries at the current values."""
    known = ExpressionValues({})  # evaluates sines and cosines that several entries share once
    return [known.of(entry) for entry in entries]
