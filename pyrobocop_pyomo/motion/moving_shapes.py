"""Corners of shapes and required clearances along a motion, with bounds on subintervals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import PathBounds, PointSets, Polytope
from pyrobocop_pyomo.numerics import Array, Indices
from pyrobocop_pyomo.numerics.interval_arithmetic import Interval

from .bodies import Body
from .motion import Motion
from .rules_along_motion import (
    SignalFormulas,
    clearance_along,
    clearance_text,
    clearance_value,
    is_clearance_rule,
    pose_along,
)

_EPS = float(np.finfo(float).eps)
# Instants of an interval at which shapes are measured, where they are to be searched or may be distorted.
SAMPLES = 17


@dataclass(frozen=True, eq=False)
class MovingShape:
    """A convex shape and the formulas of its pose.

    Attributes
    ----------
    name : str
    shape : Polytope
        In the body's frame.
    template : SignalFormulas or None
        None for a shape that rests.
    """

    name: str
    shape: Polytope
    template: SignalFormulas | None

    def poses(self, interval: Indices, fraction: Array) -> tuple[Array, Array]:
        """Rotations (m, d, d) and translations (m, d) of a shape that moves, at local fractions of intervals."""
        assert self.template is not None
        count, d = len(interval), self.shape.dimension
        entries = self.template.values(interval, fraction)
        return entries[:, : d * d].reshape(count, d, d), entries[:, d * d :]

    def places(self, interval: Indices, fraction: Array) -> PointSets:
        """Its corners in the world at local fractions of m intervals."""
        shape, count = self.shape, len(interval)
        if self.template is None:
            return PointSets.of([shape]).subset(np.zeros(count, dtype=int))
        return PointSets.at(shape, *self.poses(interval, fraction))

    def displacements(self, difference: Array) -> Array:
        """How far differences (m, entries) of its pose move the shape, shape ``(m,)``: infinitely where a ray turns."""
        d = self.shape.dimension
        rotation = difference[:, : d * d].reshape(-1, d, d)
        moved = PointSets.at(self.shape, rotation, difference[:, d * d :]).lengths
        turns = (np.abs(rotation) > 1e-12).any(axis=(1, 2)) & (not self.shape.is_bounded)
        return np.where(turns, np.inf, moved.max(axis=1))

    @cached_property
    def mismatch(self) -> Array | float:
        """Largest error of a corner's position in the formulas, by interval, shape ``(intervals,)``.

        The error is the distance from where the nodes place the corner, see `SignalFormulas.mismatch`, plus the
        distance from where a rigid body would have it: a quaternion of length one at the nodes is shorter between them,
        so that the body shrinks.
        """
        if self.template is None:
            return 0.0
        with np.errstate(all="ignore"):
            largest = self.template.mismatch(self.displacements)
            return largest + self._distortion(len(largest))

    def _distortion(self, intervals: int) -> Array:
        """Largest distance of a corner from its place on a rigid body, at samples of each interval."""
        interval = np.repeat(np.arange(intervals), SAMPLES)
        rotation, _ = self.poses(interval, np.tile(np.linspace(0.0, 1.0, SAMPLES), intervals))
        # The nearest rotation has singular values of one. The proof deals with values that are not finite.
        finite = np.isfinite(rotation).all(axis=(1, 2))
        stretched = np.abs(np.linalg.svd(rotation[finite], compute_uv=False) - 1.0).max(axis=1, initial=0.0)
        largest = np.zeros(intervals)
        np.maximum.at(largest, interval[finite], stretched)
        return np.asarray(largest * self.shape.lever, dtype=np.float64)

    def path_bounds(self, interval: Indices, start: Array, end: Array) -> PathBounds:
        """Bounds on the corners' paths over subintervals ``[start, end]`` of intervals."""
        count, d = len(interval), self.shape.dimension
        if self.template is None:
            resting = np.concatenate([np.eye(d).ravel(), np.zeros(d)])
            value = Interval.of(np.tile(resting, (count, 1)))
            curvature = Interval.of(np.zeros((count, d * d + d)))
        else:
            forms = self.template.taylor_forms(interval, start, end)
            value = _stacked([form.value for form in forms])
            curvature = _stacked([form.second for form in forms])
        return PathBounds(
            self.shape, start, end, self.places(interval, start), self.places(interval, end), value, curvature
        )


def moving_shapes(motion: Motion, bodies: dict[str, Body]) -> dict[str, list[MovingShape]]:
    """The convex parts of every body with its formulas, by the name of the body.

    Raises
    ------
    ObstacleError
        Naming the body whose pose cannot be followed between the nodes.
    """
    shapes = {}
    for name, body in bodies.items():
        template = None if body.pose is None else template_of(motion, body.pose, name, body.dimension)
        shapes[name] = [MovingShape(label, part, template) for label, part in body.named_parts(name)]
    return shapes


def template_of(motion: Motion, rule: Any, name: str, dimension: int) -> SignalFormulas:
    """What a pose rule says along a motion.

    Raises
    ------
    ObstacleError
        Naming the body, as `SignalFormulas`; also when the rule is no template, or does not return a pose of the body's
        dimension.
    """
    along = pose_along(motion, rule, name)
    pose = along.formulas.depending(lambda slot: False)
    if pose.dimension != dimension:
        raise ObstacleError(
            f"{along.label}: its rule returned {pose!r}; expected a Pose in {dimension} dimensions, by "
            f"{'planar_pose' if dimension == 2 else 'spatial_pose'}."
        )
    return SignalFormulas(along)


def _stacked(entries: list[Interval]) -> Interval:
    return Interval(
        np.stack([entry.low for entry in entries], axis=1), np.stack([entry.high for entry in entries], axis=1)
    )


# ------------------------------------------------------------------------------------------------ required clearances


@dataclass(frozen=True, eq=False)
class RequiredBounds:
    """The required clearance on ``m`` subintervals.

    Attributes
    ----------
    at_start, at_end : array, shape (m,)
    highest : array, shape (m,)
        Nowhere on the subinterval is more required.
    lowest_curvature : array, shape (m,)
        Lower bound of the second derivative with respect to the local fraction.
    """

    at_start: Array
    at_end: Array
    highest: Array
    lowest_curvature: Array

    def subset(self, chosen: Any) -> RequiredBounds:
        """Bounds on some of the subintervals."""
        return RequiredBounds(*(of[chosen] for of in vars(self).values()))


@dataclass(frozen=True, eq=False)
class RequiredClearance:
    """The distance that a body pair has to keep along a motion; made by `required_clearance`.

    Attributes
    ----------
    name : str
        What messages call it.
    least : float
        The least of its values at the nodes.
    template : SignalFormulas or None
        None where the same distance is required at all times.
    """

    name: str
    least: float
    template: SignalFormulas | None = None

    def displacements(self, difference: Array) -> Array:
        """By how much differences (m, 1) of its formula change it, shape ``(m,)``."""
        return np.abs(difference[:, 0])

    @cached_property
    def mismatch(self) -> Array | float:
        """Largest difference of the formulas from the rule at the nodes of each interval, where signals jump."""
        return 0.0 if self.template is None else self.template.mismatch(self.displacements)

    def values(self, interval: Indices, fraction: Array) -> Array:
        """The required clearance at local fractions of intervals, shape ``(m,)``."""
        if self.template is None:
            return np.full(len(interval), self.least)
        return self.template.values(interval, fraction)[:, 0]

    def bounds(self, interval: Indices, start: Array, end: Array) -> RequiredBounds:
        """Bounds on subintervals ``[start, end]`` of intervals."""
        if self.template is None:
            constant = np.full(len(interval), self.least)
            return RequiredBounds(constant, constant, constant, np.zeros(len(interval)))
        (form,) = self.template.taylor_forms(interval, start, end)
        at_start, at_end = self.values(interval, start), self.values(interval, end)
        # Where the graph is convex, it is nowhere above its ends.
        low = form.second.low
        above = np.maximum(at_start, at_end) + (end - start) ** 2 / 8.0 * np.maximum(-low, 0.0)
        rounding = 64 * _EPS * (np.abs(at_start) + np.abs(at_end))
        # fmin: a bound that is not known does not remove the other.
        return RequiredBounds(at_start, at_end, np.fmin(above + rounding, form.value.high), low)


def required_clearance(motion: Motion, clearance: Any, pair: tuple[str, str]) -> RequiredClearance:
    """The clearance of a body pair at the current values of the model.

    Parameters
    ----------
    motion : Motion
        With intervals.
    clearance : number, Param, Var, expression or callable
        A rule is called as ``rule(block, t)``, like a pose rule.
    pair : (str, str)
        Names of the two bodies, for messages.

    Raises
    ------
    ObstacleError
        Naming the body pair, where the clearance has no value or cannot be followed between the nodes.
    """
    text = clearance_text(pair)
    if not is_clearance_rule(clearance):
        return RequiredClearance(text, clearance_value(clearance, text))
    rule = clearance_along(motion, clearance, pair)
    least = min(clearance_value(rule.at_node(node), f"{text} at t = {node:g}") for node in motion.nodes)
    return RequiredClearance(text, least, SignalFormulas(rule))
