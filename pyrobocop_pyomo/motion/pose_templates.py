"""`PoseTemplate`: a pose as formulas in signals, evaluated at many instants, or enclosed over stretches, at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.rule_proxies import Series, ask
from pyrobocop_pyomo.numerics.bernstein import (
    bernstein_from_samples,
    bernstein_matrix,
    derivative_coefficients,
    restrict,
)

from .expression_values import ExpressionValues
from .interpolation import Interpolation
from .jets import Jet, polynomial_jet
from .motion import Motion

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# How far the template and the rule may differ at a node, relative to the size of the pose.
_AGREEMENT = 1e-9


@dataclass(frozen=True, eq=False)
class Signal:
    """One polynomial on each interval.

    Attributes
    ----------
    placeholder : Var
        Stands for it in the formulas.
    at_node : callable
        Its value at a node of the motion.
    coefficients : three arrays, shape (intervals, degree + 1) and less
        Bernstein coefficients of the polynomials and of their first and second derivatives.
    """

    placeholder: Any
    at_node: Callable[[Any], float]
    coefficients: tuple[Array, Array, Array]

    def values(self, interval: Indices, fraction: Array) -> Array:
        """At local fractions of intervals, shape ``(m,)``."""
        coefficients = self.coefficients[0]
        basis = bernstein_matrix(coefficients.shape[1] - 1, fraction)
        return np.asarray((basis * coefficients[interval]).sum(axis=1), dtype=np.float64)

    def jets(self, interval: Indices, start: Array, end: Array) -> Jet:
        """Enclosures over stretches of intervals, derivatives with respect to the local fraction."""
        first, second, third = (restrict(each[interval], start, end) for each in self.coefficients)
        return polynomial_jet((first, second, third))


@dataclass(frozen=True, eq=False)
class PoseTemplate:
    """What a rule for a pose says at any instant; `template_of` makes it.

    Attributes
    ----------
    name : str
        The body, for messages.
    pose : Pose
        Of expressions in placeholders.
    signals : tuple of Signal
    """

    name: str
    pose: Pose
    signals: tuple[Signal, ...]
    _owner: Any  # Pyomo holds parents by weak references: keeps the placeholders' owner alive

    @property
    def entries(self) -> list[Any]:
        """The rotation row by row, then the translation: ``d * d + d`` expressions or numbers."""
        return _entries(self.pose)

    def values(self, interval: Indices, fraction: Array) -> Array:
        """Entries at local fractions of intervals, shape ``(m, d * d + d)``."""
        leaves = {id(each.placeholder): each.values(interval, fraction) for each in self.signals}
        return self._evaluated(leaves, len(interval))

    def jets(self, interval: Indices, start: Array, end: Array) -> list[Jet]:
        """Enclosures of the entries over stretches of intervals."""
        known = ExpressionValues({id(each.placeholder): each.jets(interval, start, end) for each in self.signals})
        found = [known.of(entry) for entry in self.entries]
        return [each if isinstance(each, Jet) else Jet.constant(each, len(interval)) for each in found]

    def _evaluated(self, leaves: dict[int, Array], count: int) -> Array:
        known = ExpressionValues(leaves)
        return np.array([np.broadcast_to(known.of(entry), count) for entry in self.entries], dtype=float).T

    def strays(self, motion: Motion) -> tuple[Indices, Array]:
        """By how much entries at the nodes of each interval differ from those that its polynomials give there.

        Equations of the model tie nodes and polynomials together: the row of an element's end, or the right-hand sides
        of a scheme that starts on a stage. Values that do not fulfil them jump.

        Returns
        -------
        interval : array, shape (m,)
        difference : array, shape (m, d * d + d)
            NaN where a polynomial has no value.
        """
        counts = [len(nodes) for nodes in motion.intervals]
        interval = np.repeat(np.arange(len(counts)), counts)
        fraction = np.concatenate([motion.local_fractions(i) for i in range(len(counts))])
        leaves = {
            id(each.placeholder): np.array([each.at_node(node) for nodes in motion.intervals for node in nodes])
            for each in self.signals
        }
        return interval, self._evaluated(leaves, len(interval)) - self.values(interval, fraction)

    def check(self, motion: Motion, rule: Callable[..., Any]) -> None:
        """Compare with the rule, asked at all nodes.

        Raises
        ------
        ObstacleError
            Naming the body and the node where they differ.
        """
        nodes = sorted({node for interval in motion.intervals for node in interval})
        leaves = {
            id(each.placeholder): np.array([each.at_node(node) for node in nodes], dtype=float) for each in self.signals
        }
        found = self._evaluated(leaves, len(nodes))
        wanted = np.array([_numbers(motion.pose_at_node(rule, node, name=self.name)) for node in nodes])
        gaps = np.abs(found - wanted).max(axis=1)
        worst = int(np.argmax(np.where(np.isnan(gaps), np.inf, gaps)))
        if not gaps[worst] <= _AGREEMENT * max(1.0, float(np.abs(wanted).max())):
            raise ObstacleError(
                f"the pose of '{self.name}': at t = {nodes[worst]:g} the rule differs by {gaps[worst]:.3g} from the "
                "formula that it gives for all t. What is between the nodes can only be judged when the rule is one "
                "formula in t and in what it reads at t through its first argument."
            )


def template_of(
    motion: Motion, rule: Callable[..., Any], name: str, dimension: int, clocks: Mapping[float, float] | None = None
) -> PoseTemplate:
    """Ask a rule for the pose at all instants at once, and check the answer at the nodes.

    Parameters
    ----------
    motion : Motion
    rule : callable
        ``rule(block, t)``, as for a `Body`.
    name : str
        What messages call the body.
    dimension : int
    clocks : mapping of node to float, optional
        `clocks_of` the motion, for those who ask for many bodies.

    Raises
    ------
    ObstacleError
        Naming the body, when the rule reads what does not move continuously, cannot be asked with stand-ins, or its
        answer is no pose of the body's dimension.
    """
    assert motion.interpolation is not None
    reader = _TemplateReader(motion, motion.interpolation, clocks)
    pose = ask(rule, motion.block, reader, name)
    if not isinstance(pose, Pose) or pose.dimension != dimension:
        raise ObstacleError(
            f"the pose of '{name}': its rule returned {pose!r}; expected a Pose in {dimension} dimensions, by "
            f"{'planar_pose' if dimension == 2 else 'spatial_pose'}."
        )
    template = PoseTemplate(name, pose, tuple(reader.signals.values()), reader.owner)
    try:
        with np.errstate(all="ignore"):  # a value that is not finite is none
            template.check(motion, rule)
    except ObstacleError as error:
        raise error if f"'{name}'" in str(error) else ObstacleError(f"the pose of '{name}': {error}") from error
    return template


class _TemplateReader:
    """Answers with placeholders, and remembers what each stands for."""

    def __init__(self, motion: Motion, interpolation: Interpolation, clocks: Mapping[float, float] | None) -> None:
        self.owner = ConcreteModel()
        self.signals: dict[Any, Signal] = {}
        self._motion = motion
        self._interpolation = interpolation
        self._clocks = clocks
        ends = np.array([[nodes[0], nodes[-1]] for nodes in motion.intervals], dtype=float)
        self._add("index", "t", float, ends)
        self.index = self.signals["index"].placeholder

    def _add(self, key: Any, name: str, at_node: Callable[[Any], float], coefficients: Array) -> None:
        placeholder = Var(initialize=0.0)  # Pyomo evaluates what it is indexed with
        # Messages quote formulas: the name is the user's word.
        self.owner.add_component(unique_component_name(self.owner, name), placeholder)
        slope = derivative_coefficients(coefficients)
        self.signals[key] = Signal(placeholder, at_node, (coefficients, slope, derivative_coefficients(slope)))

    def is_index(self, key: Any) -> bool:
        return key is self.index

    def read(self, series: Series) -> Any:
        if series.identity not in self.signals:
            self._interpolation.check(series)
            coefficients = _coefficients(self._interpolation, series)
            self._add(series.identity, series.name, lambda node: _number(series.at(node), series), coefficients)
        return self.signals[series.identity].placeholder

    def clock(self, block: Any) -> Any:
        if not self._interpolation.is_clock_of(block):
            raise ObstacleError(f"clock(t) is asked of '{block.name}', whose time is not that of the set of points.")
        if "clock" not in self.signals:
            clocks = clocks_of(self._motion) if self._clocks is None else self._clocks
            ends = np.array([[clocks[nodes[0]], clocks[nodes[-1]]] for nodes in self._motion.intervals])
            self._add("clock", "clock(t)", clocks.__getitem__, ends)
        return self.signals["clock"].placeholder


def clocks_of(motion: Motion) -> dict[float, float]:
    """The time of every node, in the user's time."""
    # Between the boundaries of an element the clock is linear.
    times: dict[float, float] = {}
    for interval, nodes in enumerate(motion.intervals):
        start, end = (float(value(motion.clock(each))) for each in (nodes[0], nodes[-1]))
        for node, fraction in zip(nodes, motion.local_fractions(interval), strict=True):
            times[node] = start + fraction * (end - start)
    return times


def _coefficients(interpolation: Interpolation, series: Series) -> Array:
    """Bernstein coefficients of a series on all intervals, shape ``(intervals, degree + 1)``."""
    rows = []
    for i in range(len(interpolation.intervals)):
        leaves = [_number(leaf, series) for leaf in interpolation.leaves(series, i)]
        points, to_coefficients = bernstein_from_samples(len(leaves) - 1)
        rows.append(to_coefficients @ (interpolation.weights(series, i, points) @ leaves))
    return np.array(rows)


def _number(leaf: Any, series: Series) -> float:
    number = value(leaf, exception=False)
    if number is None:
        raise ObstacleError(f"'{series.name}' has no value everywhere. Solve the model first, or give it a guess.")
    return float(number)


def _numbers(pose: Pose) -> list[float]:
    known = ExpressionValues({})  # sines and cosines are in several entries: evaluated once
    return [known.of(entry) for entry in _entries(pose)]


def _entries(pose: Pose) -> list[Any]:
    return [*(entry for row in pose.rotation for entry in row), *pose.translation]
