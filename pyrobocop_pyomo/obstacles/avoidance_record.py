"""The facts behind an avoidance block that are no Pyomo components: segments of motion, record, checked options.

A `Snapshot` has poses and corners at the current values of the variables.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, Pose
from pyrobocop_pyomo.modeling.shared_nodes import variables_in, variables_in_any
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.motion import Motion
from pyrobocop_pyomo.motion.rules_along_motion import is_clearance_rule
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import scipy

from .scene import BodyPair, Scene, SeparationIndex, make_scene, required_clearances


@dataclass(frozen=True)
class MotionSegment:
    """The part of the motion that one separation covers: an interval, a part of an interval, or a single time.

    Attributes
    ----------
    first, second : str
        Names of the convex parts that are kept apart.
    interval : int or None
        Position of the interval; None where the separation is for one time.
    times : tuple
        Time indices at which the poses are evaluated, start and end included.
    fractions : tuple of float
        Their positions within the interval, from 0 to 1; empty where the separation is for one time.
    """

    first: str
    second: str
    interval: int | None
    times: tuple[Any, ...]
    fractions: tuple[float, ...] = ()

    def __deepcopy__(self, memo: dict[int, Any]) -> MotionSegment:
        return self  # names and numbers, of which a scene has tens of thousands

    @property
    def index(self) -> SeparationIndex:
        """Index of the separation in all components."""
        return (self.first, self.second, self.times[0])

    def halves(self, motion: Motion) -> tuple[MotionSegment, MotionSegment]:
        """The two halves; they share the time in the middle, which is added where it is not one of the times."""
        assert self.interval is not None
        middle = (self.fractions[0] + self.fractions[-1]) / 2
        at = dict(zip(self.fractions, self.times, strict=True))
        at.setdefault(middle, motion.index_at(self.interval, middle))
        fractions = sorted(at)
        cuts = [f for f in fractions if f <= middle], [f for f in fractions if f >= middle]
        left, right = (
            MotionSegment(self.first, self.second, self.interval, tuple(at[f] for f in cut), tuple(cut)) for cut in cuts
        )
        return left, right


def segments_of_motion(part_pairs: list[tuple[str, str]], motion: Motion, per_interval: bool) -> list[MotionSegment]:
    """The segments before any refinement: one per interval, or one per point."""
    if not per_interval:
        return [MotionSegment(*pair, None, (time,)) for pair in part_pairs for time in motion.points]
    intervals = [(k, times, motion.local_fractions(k)) for k, times in enumerate(motion.intervals)]
    return [MotionSegment(*pair, k, times, fractions) for pair in part_pairs for k, times, fractions in intervals]


@dataclass
class AvoidanceRecord:
    """The facts behind an avoidance block; they survive clones and pickles.

    Attributes
    ----------
    scene : Scene
    points : Set
        The times that the user gave.
    per_interval : bool
        True where one separation covers an interval.
    broad_phase : float, "auto" or None
    segments : dict of index to MotionSegment
        Those that have a separation.
    pruned : dict of index to MotionSegment
        Those that the broad phase left out.
    pinned : set of index
        Those that were brought back or split, and are not left out again.
    directions : dict of body pair to direction
        Where to pass, as the user said last.
    poses : dict of (body, time) to Pose
        Expressions of the poses, shared by all body pairs; the time is None for a body that rests.
    norm_now : str
        The norm that the rows have.
    overlapping : dict of pair of parts to int
        Number of segments on which they overlapped when start values were set last.
    clearances : dict of body pair to clearance
        Parameters and expressions, or rules that are templates.
    lengths : dict of (body, body, time) to expression
        What the rules of clearances ask for at the times of the poses.
    """

    scene: Scene
    points: Any
    per_interval: bool
    broad_phase: float | str | None
    segments: dict[SeparationIndex, MotionSegment] = field(default_factory=dict)
    pruned: dict[SeparationIndex, MotionSegment] = field(default_factory=dict)
    pinned: set[SeparationIndex] = field(default_factory=set)
    directions: dict[BodyPair, Any] = field(default_factory=dict)
    poses: dict[tuple[str, Hashable], Pose] = field(default_factory=dict)
    norm_now: str = "ball"
    overlapping: dict[tuple[str, str], int] = field(default_factory=dict)
    clearances: dict[BodyPair, Any] = field(default_factory=dict)
    lengths: dict[tuple[str, str, Hashable], Any] = field(default_factory=dict)

    def body_pair(self, segment: MotionSegment) -> BodyPair:
        """Names of the two bodies of a segment."""
        return self.scene.parts[segment.first].body, self.scene.parts[segment.second].body

    def clearance_at(self, pair: BodyPair, time: Hashable) -> Any:
        """The clearance of a body pair at a time with a pose, as an expression."""
        clearance = self.clearances[pair]
        return self.lengths[(*pair, time)] if is_clearance_rule(clearance) else clearance

    def clearance_values(self, pair: BodyPair) -> list[float]:
        """The clearance of a body pair at all times with a pose, at the current values; NaN where there are none."""
        is_rule = is_clearance_rule(self.clearances[pair])
        times = [key[2] for key in self.lengths if key[:2] == pair] if is_rule else [None]
        numbers = [value(self.clearance_at(pair, time), exception=False) for time in times]
        return [math.nan if number is None else float(number) for number in numbers]

    def update_estimates(self) -> None:
        """Note the largest clearance of each body pair as a number, for what needs to know how far away is enough."""
        for pair in self.clearances:
            self.scene.clearances[pair] = max(filter(math.isfinite, self.clearance_values(pair)), default=0.0)

    @property
    def rules(self) -> list[Any]:
        """The rules of poses, and of clearances that change in time."""
        poses = [body.pose for body in self.scene.bodies.values() if body.pose is not None]
        return [*poses, *(clearance for clearance in self.clearances.values() if is_clearance_rule(clearance))]

    @property
    def depends_on_what_is_far(self) -> bool:
        """Whether distances beyond the clearance count: where the optimiser chooses how much it is."""
        chosen = (clearance for clearance in self.clearances.values() if not is_clearance_rule(clearance))
        return any(True for clearance in chosen for _ in variables_in(clearance, include_fixed=False))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return next(iter(self.scene.parts.values())).shape.dimension

    def by_part_pair(self) -> dict[tuple[str, str], list[MotionSegment]]:
        """Segments of every pair of convex parts that has some, along time."""
        segments_of: dict[tuple[str, str], list[MotionSegment]] = {}
        for segment in self.segments.values():
            segments_of.setdefault((segment.first, segment.second), []).append(segment)
        for segments in segments_of.values() if self.per_interval else ():
            segments.sort(key=lambda one: (one.interval, one.fractions[0]))
        return segments_of


def make_record(
    label: str,
    points: Any,
    *,
    bodies: Any = None,
    obstacles: Any = None,
    clearance: Any = None,
    body: Any = None,
    pose: Callable[..., Any] | None = None,
    body_pairs: Any = None,
    exclude: Any = (),
    between: str | None = "plane",
    broad_phase: Any = "auto",
) -> AvoidanceRecord:
    """The record of a new block, from the arguments of `ObstacleAvoidanceBlock`.

    Raises
    ------
    ObstacleError
        When the scene or the options contradict themselves.
    """
    if clearance is None:
        raise ObstacleError(f"{label}: clearance= is missing: the distance to be kept, a length > 0.")
    if body is None and pose is not None:
        raise ObstacleError(f"{label}: pose= goes with body=; with bodies=, give Body(shape, pose=rule).")
    if body is not None and bodies is not None:
        raise ObstacleError(f"{label}: give bodies= or body=, not both.")
    if body is not None and pose is None:
        raise ObstacleError(f"{label}: body= needs pose=rule, which says where it is: rule(block, t) -> Pose.")
    named = bodies if body is None else {"body": Body(body, pose)}
    scene = make_scene(label, bodies=named, obstacles=obstacles, body_pairs=body_pairs, exclude=exclude)
    clearances = required_clearances(label, scene.clearances, scene.bodies, clearance)
    if between not in ("plane", None):
        raise ObstacleError(f'{label}: between is {between!r}; it is "plane" or None.')
    if not (broad_phase is None or (isinstance(broad_phase, str) and broad_phase == "auto")):
        if not isinstance(broad_phase, Real) or isinstance(broad_phase, bool) or not math.isfinite(broad_phase):
            raise ObstacleError(f'{label}: broad_phase is {broad_phase!r}; it is "auto", a length, or None.')
        largest = max((number for number in clearances.values() if isinstance(number, float)), default=0.0)
        if broad_phase <= largest:
            raise ObstacleError(
                f"{label}: broad_phase {broad_phase:g} leaves out body pairs that are nearer than the clearance "
                f"{largest:g}. Take several times the clearance."
            )
    return AvoidanceRecord(scene, points, between is not None, broad_phase, clearances=clearances)


# ---------------------------------------------------------------------------------------------- at the current values


Numbers = tuple[np.ndarray, np.ndarray]


class Snapshot:
    """Poses and corners at the current values; each pose is evaluated once.

    Parameters
    ----------
    record : AvoidanceRecord
    what : str
        Name of the block in messages.
    """

    def __init__(self, record: AvoidanceRecord, label: str) -> None:
        self.record = record
        self.what = label
        self._poses: dict[tuple[str, Hashable], Numbers] = {}
        self._shapes: dict[tuple[str, Hashable], Polytope] = {}

    def pose(self, body: str, time: Hashable) -> Numbers:
        """Rotation (d, d) and translation (d,) of a body.

        Raises
        ------
        ObstacleError
            When the pose reads a variable that has no value, or is not finite.
        """
        key = (body, None if self.record.scene.is_static(body) else time)
        if key not in self._poses:
            try:
                self._poses[key] = self.record.poses[key].numbers()
            except ObstacleError as error:
                raise ObstacleError(f"{self.what}: the pose of '{body}' at {time}: {error}") from None
            if not all(np.isfinite(entries).all() for entries in self._poses[key]):
                raise ObstacleError(f"{self.what}: the pose of '{body}' at {time} is not finite at the current values.")
        return self._poses[key]

    def placed_pair(self, segment: MotionSegment) -> tuple[Polytope, Polytope]:
        """What both shapes of a segment of motion sweep: their corners and rays at all times that it covers."""
        return self._placed(segment.first, segment.times), self._placed(segment.second, segment.times)

    def _placed(self, name: str, times: tuple[Any, ...]) -> Polytope:
        part = self.record.scene.parts[name]
        if self.record.scene.is_static(part.body):
            return part.shape
        if (name, times) not in self._shapes:
            self._shapes[name, times] = part.shape.swept([self.pose(part.body, time) for time in times])
        return self._shapes[name, times]


def variables_of(pose: Any) -> list[Any]:
    """Variables that a pose reads, the fixed ones included."""
    return list(variables_in_any(pose.entries).values())


def fixed_times(poses: Mapping[tuple[str, Hashable], Any], body: str) -> dict[Any, None]:
    """Times at which all that the pose of a moving body reads is fixed."""
    return {
        time: None
        for (name, time), pose in poses.items()
        if name == body and all(variable.fixed for variable in variables_of(pose))
    }


def gap_along(normals: np.ndarray, first: Polytope, second: Polytope) -> np.ndarray:
    """Gaps (k,) between two shapes along each of the unit normals (k, d), radii included."""
    return first.lowest(normals) - second.highest(normals)


def proven_gap(first: Polytope, second: Polytope, normal: np.ndarray) -> float:
    """Distance that a normal of any length proves; never more than the signed distance of the swept shapes.

    A normal of zero proves nothing, which is ``-inf``. Where shapes are unbounded, the normal is first projected onto
    the directions along which both are bounded.
    """
    rays = np.vstack([second.rays, -first.rays])
    if len(rays):
        # The residual of the projection onto the cone of the rays makes no acute angle with any of them.
        normal = normal - rays.T @ scipy.optimize.nnls(rays.T, normal)[0]
    length = float(np.linalg.norm(normal))
    if not length > NEGLIGIBLE:
        return -float("inf")
    return float(gap_along((normal / length)[None, :], first, second)[0])
