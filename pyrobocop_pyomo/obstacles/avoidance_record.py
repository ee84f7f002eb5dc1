"""The facts behind an avoidance block that are no Pyomo components: segments of motion, record, checked options."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.motion.bodies import Body
from pyrobocop_pyomo.motion.motion import Motion

from .clearances import ClearanceRule, asked_clearances
from .scene import BodyPair, Scene, SeparationIndex, make_scene


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


def segments_of_motion(
    label: str, part_pairs: list[tuple[str, str]], motion: Motion, per_interval: bool
) -> list[MotionSegment]:
    """The segments before any refinement: one per interval, or one per point.

    Raises
    ------
    ObstacleError
        When there are no intervals, or the points are neither numbers nor names.
    """
    if not per_interval:
        for time in motion.points:
            if isinstance(time, tuple):
                raise ObstacleError(f"{label}: the points are tuples such as {time}; give a set of single indices.")
        return [MotionSegment(*pair, None, (time,)) for pair in part_pairs for time in motion.points]
    if not motion.intervals:
        raise ObstacleError(
            f"{label}: one plane per interval was asked for, but nothing is known about the motion between the points "
            "given. Give the times of a phase, a discretised ContinuousSet or ordered numbers; or between=None, which "
            "separates the shapes at the points only."
        )
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
    reach : float
        Up to which distance a broad phase that is on by itself has looked so far.
    overlapping : dict of pair of parts to int
        Number of segments on which they overlapped when start values were set last.
    asked : dict of body pair to clearance
        Floats, expressions or `ClearanceRule`.
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
    reach: float = 0.0
    overlapping: dict[tuple[str, str], int] = field(default_factory=dict)
    asked: dict[BodyPair, Any] = field(default_factory=dict)
    lengths: dict[tuple[str, str, Hashable], Any] = field(default_factory=dict)

    @property
    def depends_on_what_is_far(self) -> bool:
        """Whether distances beyond the clearance count: where the optimiser chooses how much it is."""
        chosen = (asked for asked in self.asked.values() if not isinstance(asked, (float, ClearanceRule)))
        return any(True for asked in chosen for _ in variables_in(asked, include_fixed=False))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return next(iter(self.scene.parts.values())).shape.dimension

    def by_part_pair(self) -> dict[tuple[str, str], list[MotionSegment]]:
        """Segments of every pair of convex parts that has some, along time."""
        found: dict[tuple[str, str], list[MotionSegment]] = {}
        for segment in self.segments.values():
            found.setdefault((segment.first, segment.second), []).append(segment)
        for segments in found.values() if self.per_interval else ():
            segments.sort(key=lambda one: (one.interval, one.fractions[0]))
        return found


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
    asked = asked_clearances(label, scene.clearances, scene.bodies, clearance)
    if between not in ("plane", None):
        raise ObstacleError(f'{label}: between is {between!r}; it is "plane" or None.')
    if not (broad_phase is None or (isinstance(broad_phase, str) and broad_phase == "auto")):
        if not isinstance(broad_phase, Real) or isinstance(broad_phase, bool) or not math.isfinite(broad_phase):
            raise ObstacleError(f'{label}: broad_phase is {broad_phase!r}; it is "auto", a length, or None.')
        largest = max((number for number in asked.values() if isinstance(number, float)), default=0.0)
        if broad_phase <= largest:
            raise ObstacleError(
                f"{label}: broad_phase {broad_phase:g} leaves out body pairs that are nearer than the clearance "
                f"{largest:g}. Take several times the clearance."
            )
    return AvoidanceRecord(scene, points, between is not None, broad_phase, asked=asked)
