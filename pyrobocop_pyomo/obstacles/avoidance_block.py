"""`ObstacleAvoidanceBlock`: bodies that keep clear of obstacles and of each other, as an ordinary Pyomo block.

Start values of separations from exact distances at the current poses.

Where shapes overlap, a normal of the deepest overlap may flip from one segment to the next. There, dynamic programming
chooses normals that are cheap and consistent along time.
"""

from __future__ import annotations

import logging
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.component import ModelComponentFactory
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.param import Param
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.set import Set
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Polytope, separating_directions
from pyrobocop_pyomo.modeling.blocks import Rule, blocks_of_kind
from pyrobocop_pyomo.motion.safety_report import SafetyReport
from pyrobocop_pyomo.numerics import Array, BoolArray

from .avoidance_record import MotionSegment, Snapshot, gap_along, make_record, proven_gap, segments_of_motion
from .block_arguments import MotionBlock, MotionBlockData
from .broad_phase import (
    BUILT_WITHOUT_GUESS,
    apply_broad_phase,
    has_broad_phase,
    near_segments,
    restore_separations,
    segments_by_place,
    swept_distances,
)
from .impossible_gaps import check_gaps
from .initial_checks import check_fixed_poses, check_poses, check_rules, doubtful_clock, has_values
from .scene import BodyPair, SeparationIndex
from .separation_rows import (
    add_poses,
    add_separation,
    norm_relation,
    normal_of,
    remove_separations,
    start_plane,
    unit_normal_of,
)

# --------------------------------------------------------------------------------------------------------- start values


LOGGER = logging.getLogger(__name__)

# Relative to the size of the shapes: weight of a random preference for a direction, and tilt of the normals.
PREFERENCE = 1e-3


def set_start_values(
    block: Any,
    snapshot: Snapshot,
    segments: Sequence[MotionSegment],
    directions: Mapping[BodyPair, Array],
) -> dict[BodyPair, int]:
    """Set start values of separations; others beside them in time have some, and are left alone.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    snapshot : Snapshot
    segments : sequence of MotionSegment
        Of the separations.
    directions : mapping of body pair to unit vector (d,)
        Used wherever shapes overlap.

    Returns
    -------
    dict of pair of parts to int
        Number of segments on which they overlap at the initial guess; pairs without overlap are left out.
    """
    record, generator = snapshot.record, np.random.default_rng(0)
    gaps, nearest = swept_distances(snapshot, segments)
    known = {segment.index: k for k, segment in enumerate(segments)}
    by_pair = record.by_part_pair()
    overlapping: dict[BodyPair, int] = {}
    for pair in dict.fromkeys((segment.first, segment.second) for segment in segments):
        along = by_pair[pair]
        bodies = record.body_pair(along[0])
        for run in _runs(np.array([segment.index in known for segment in along])):
            beside = [along[k : k + 1] if k >= 0 else [] for k in (run.start - 1, run.stop)]
            ends = [unit_normal_of(block, of[0].index) if of else None for of in beside]
            rows = [known[segment.index] for segment in along[run]]
            normals = choose_normals(
                snapshot, along[run], gaps[rows], nearest[rows], generator, directions.get(bodies), (ends[0], ends[1])
            )
            for segment, normal in zip(along[run], normals, strict=True):
                start_plane(block, segment.index, *snapshot.placed_pair(segment), normal)
            count = int((gaps[rows] <= 0).sum())
            if count:
                overlapping[pair] = overlapping.get(pair, 0) + count
    if overlapping:
        LOGGER.info(
            "%s: the initial guess overlaps for %s; normals are chosen along time.",
            snapshot.what,
            ", ".join(f"'{a}' and '{b}' ({count} separations)" for (a, b), count in overlapping.items()),
        )
    return overlapping


# --------------------------------------------------------------------------------------------------- choice of normals


def choose_normals(
    snapshot: Snapshot,
    segments: Sequence[MotionSegment],
    gaps: Array,
    nearest: Array,
    generator: np.random.Generator,
    direction: Array | None = None,
    beside: tuple[Array | None, Array | None] = (None, None),
) -> Array:
    """Unit normals for the segments of one pair of parts, along time, shape ``(k, d)``.

    Where the swept shapes are apart, the normal of their distance. Where they overlap, normals with the least sum of
    overlap depths and turns, between the normals of the segments before and after.

    Parameters
    ----------
    snapshot : Snapshot
    segments : sequence of MotionSegment
    gaps : (k,)
        Signed distances of the swept shapes, negative where they overlap.
    nearest : (k, d)
        Their normals.
    generator : numpy.random.Generator
        Breaks ties where opposite directions are equally good.
    direction : (d,), optional
        Unit vector to be used wherever shapes overlap.
    beside : pair of (d,) or None
        Normals of the segments before and after all of these.

    Raises
    ------
    ObstacleError
        When both are unbounded, and no direction separates them.
    """
    if np.isneginf(gaps).any():
        segment = segments[int(gaps.argmin())]
        raise ObstacleError(
            f"'{segment.first}' and '{segment.second}' overlap without end: no plane separates them anywhere. Bound "
            "one of them."
        )
    normals = nearest.copy()
    for run in _runs(gaps <= 0):
        if direction is not None:
            normals[run] = direction
            continue
        before = normals[run.start - 1] if run.start > 0 else beside[0]
        after = normals[run.stop] if run.stop < len(segments) else beside[1]
        extra = [normal for normal in (before, after) if normal is not None]
        pairs = [snapshot.placed_pair(segment) for segment in segments[run]]
        candidates = [_candidates(*pair, [normal, *extra]) for pair, normal in zip(pairs, normals[run], strict=True)]
        preferred = np.array(generator.standard_normal(normals.shape[1]))
        preferred = preferred / np.linalg.norm(preferred)
        chosen = _cheapest_path(candidates, pairs, before, after, preferred)
        tilted = chosen + PREFERENCE * generator.standard_normal(chosen.shape)
        normals[run] = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    return normals


def _runs(overlapping: BoolArray) -> list[slice]:
    """Runs of consecutive segments that overlap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], overlapping.astype(int), [0]])))
    return [slice(int(start), int(stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _candidates(first: Polytope, second: Polytope, extra: list[Array]) -> Array:
    """Directions (k, d) in which to leave an overlap: facets of the Minkowski difference, axes, and given ones.

    The axes are included because shapes without an interior, such as points, have no facets.
    """
    axes = np.vstack([np.eye(first.dimension), -np.eye(first.dimension)])
    facets = separating_directions(first.covering, second.covering, first.rays, second.rays)
    directions = np.vstack([facets, axes, *extra])
    blocked = ((second.rays @ directions.T) > 1e-9).any(axis=0) | ((first.rays @ directions.T) < -1e-9).any(axis=0)
    return directions[~blocked] if not blocked.all() else directions[-1:]


def _cheapest_path(
    candidates: list[Array],
    pairs: Sequence[tuple[Polytope, Polytope]],
    before: Array | None,
    after: Array | None,
    preferred: Array,
) -> Array:
    """Normals (k, d) of least cost: mean depth over size, plus the squared angles between consecutive normals."""
    depths = []
    for directions, (first, second) in zip(candidates, pairs, strict=True):
        depth = -gap_along(directions, first, second)
        size = max(sum(float(np.ptp(shape.bounding_box, axis=0).max()) for shape in (first, second)), 1e-12)
        depths.append((depth / size - PREFERENCE * directions @ preferred) / len(pairs))
    cost = depths[0] if before is None else depths[0] + _turning(before[None, :], candidates[0])[0]
    origins = []
    for k in range(1, len(pairs)):
        total = cost[:, None] + _turning(candidates[k - 1], candidates[k])
        origins.append(total.argmin(axis=0))
        cost = total.min(axis=0) + depths[k]
    if after is not None:
        cost = cost + _turning(candidates[-1], after[None, :])[:, 0]
    choice = [int(cost.argmin())]
    for origin in reversed(origins):
        choice.append(int(origin[choice[-1]]))
    return np.array([directions[k] for directions, k in zip(candidates, reversed(choice), strict=True)])


def _turning(before: Array, after: Array) -> Array:
    """Squared angles (k, l) between unit vectors (k, d) and (l, d); squares favour two small turns over a flip."""
    return np.arccos(np.clip(before @ after.T, -1.0, 1.0)) ** 2


# ------------------------------------------------------------------------------------------------------ avoidance block


# Bounds of 1 would be active for normals along an axis, where the norm is active too: multipliers are then not unique,
# and solvers take three times as many iterations.
WIDER_THAN_ONE = (-1.5, 1.5)


class ObstacleAvoidanceBlockData(MotionBlockData):
    """One avoidance block; see `ObstacleAvoidanceBlock` for how to make one.

    Attributes
    ----------
    separations : Set
        Indices ``(first, second, start)``: names of two convex parts, and where their segment of motion starts.
    normal : Var or Expression
        ``normal[first, second, start, axis]``, which points from the second to the first.
    required : Expression
        Gap that each separation has to prove: clearance, radii and margin.
    clearance : Param
        By body pair, of those whose clearance is a number; mutable.
    margin : Param
        Added to the clearance, by separation; mutable.
    equations : bool
        Whether the motion that the equations make of the plan's controls has to keep clear as well.
    """

    _kind = "obstacle avoidance"

    @property
    def axes(self) -> range:
        """0, 1 in the plane and 0, 1, 2 in space."""
        return range(self.record.dimension)

    def _summary(self) -> str:
        if not self.is_built:
            return super()._summary()
        bodies = self.record.scene.bodies.values()
        return f"{super()._summary()}: {len(bodies)} bodies, of which {sum(body.moves for body in bodies)} move"

    def _state(self, points: Any, **options: Any) -> None:
        self._record = record = make_record(self._what, points, **options)
        numbers = {pair: clearance for pair, clearance in record.clearances.items() if isinstance(clearance, float)}
        self.clearance = Param(
            list(numbers), initialize=numbers, mutable=True, doc="clearance of each body pair that has a number"
        )
        record.clearances.update((pair, self.clearance[pair]) for pair in numbers)
        self.separations = Set(dimen=3, doc="first, second, start of a segment of motion")
        self.margin = Param(self.separations, mutable=True, default=0.0, doc="added to the clearance")
        self.required = Expression(AnyIndex, doc="gap that a separation has to prove")
        bounds = WIDER_THAN_ONE
        self.normal = Var(self.separations, list(self.axes), bounds=bounds, dense=False, doc="normals of planes")
        self.offset = Var(self.separations, dense=False, doc="offsets of planes")
        self.rotated_normal = Expression(AnyIndex, doc="normals in the frame of a body that turns")
        self.level = Expression(AnyIndex, doc="height of a body's origin over the plane")
        self.first_shape = Constraint(AnyIndex, doc="corners of the first shape: beyond the plane by what is required")
        self.second_shape = Constraint(AnyIndex, doc="corners of the second shape: behind the plane")
        self.unit = Constraint(AnyIndex, doc="length of the normal")
        check_rules(self._what, self.motion, record.scene.bodies)
        self._separate()

    def _separate(self, *, starts_next: bool = False) -> None:
        """Add the separations of the whole motion, before any refinement; where it starts next, that chooses them."""
        record, motion = self.record, self.motion
        part_pairs = [(first.name, second.name) for first, second in record.scene.part_pairs()]
        segments = segments_of_motion(part_pairs, motion, record.per_interval)
        add_poses(record, motion, segments)
        record.update_estimates()
        snapshot = Snapshot(record, self._what)
        record.pruned = {segment.index: segment for segment in segments}
        # Without an initial guess no shapes are known to be far apart; initialize() applies the broad phase again.
        kept = np.ones(len(segments), dtype=bool)
        if has_broad_phase(record) and has_values(record):
            kept = ~kept if starts_next else near_segments(snapshot, segments)
        elif has_broad_phase(record) and len(segments) > BUILT_WITHOUT_GUESS:
            kept[:] = False
        with PauseGC():
            restore_separations(self, record, [segments[k] for k in np.flatnonzero(kept).tolist()])

    # ---------------------------------------------------------------- another mesh below

    def follow_times(self) -> None:
        """Separate the shapes anew over the times that there are now; margins and splits start again.

        Raises
        ------
        ObstacleError
            As `initialize`, which sets the start values.
        """
        record = self.record
        remove_separations(self, record, list(record.segments.values()))
        record.pruned, record.pinned, record.poses, record.lengths = {}, set(), {}, {}
        self._separate(starts_next=True)
        if has_values(record):
            self.initialize()

    # ---------------------------------------------------------------- start values

    def initialize(self, directions: Mapping[BodyPair, Any] | None = None) -> None:
        """Set start values of the separations from exact distances at the current poses.

        Parameters
        ----------
        directions : mapping of body pair to direction, optional
            Where to pass wherever the initial guess overlaps: ``{("car", "wall"): (0, 1)}`` has the car above the wall.
            By default the directions that were given last, which `solve` uses too; ``{}`` forgets them.

        Raises
        ------
        ObstacleError
            When a pose has no value or is no rotation, when fixed poses are closer than the clearance (with the
            clearance that is available), or when `directions` names what is no body pair.
        """
        record, snapshot = self.record, Snapshot(self.record, self._what)
        given = dict(record.directions if directions is None else directions)
        units = record.scene.unit_directions(self._what, given)
        check_poses(snapshot, self.motion)
        check_fixed_poses(snapshot)
        check_gaps(snapshot)
        record.update_estimates()
        record.directions = given
        with PauseGC():
            apply_broad_phase(self, snapshot)
            record.overlapping = set_start_values(self, snapshot, list(record.segments.values()), units)
            # The ball is easier for solvers, the sphere pushes shapes apart.
            self.set_norm("ball" if record.overlapping else "sphere")

    # ---------------------------------------------------------------- checks

    def separation_gaps(self) -> dict[SeparationIndex, float]:
        """Gap that each separation proves at the current values, recomputed from its normal alone.

        Returns
        -------
        dict of index to float
            Never more than the signed distance of the shapes at any of the times covered, whatever a solver returned;
            ``-inf`` where the normal is zero.
        """
        snapshot = Snapshot(self.record, self._what)
        segments = self.record.segments
        return {
            index: proven_gap(*snapshot.placed_pair(segment), normal_of(self, index))
            for index, segment in segments.items()
        }

    def verify(self, tolerance: float | None = None, *, equations: bool = True) -> SafetyReport:
        """Check the motion that the current values describe: all body pairs, at all times between the points.

        Parameters
        ----------
        tolerance : float, optional
            How much of a clearance may be missing; 1 % by default.
        equations : bool
            Whether the motion that the equations make of the plan's controls is proven as well, unless the block says
            that it need not be.
        """
        report = self._proven(tolerance, equations)
        clock = doubtful_clock(self)
        pairs = (replace(pair, not_replayed=pair.not_replayed or clock) for pair in report.body_pairs)
        return replace(report, body_pairs=tuple(pairs))

    # ---------------------------------------------------------------- changes between solves

    def split(self, first: str, second: str, start: Hashable) -> tuple[SeparationIndex, SeparationIndex]:
        """Replace a separation by two, for the halves of its segment of motion, and set their start values.

        Returns
        -------
        tuple of indices
            Of the two new separations. They inherit the margin.

        Raises
        ------
        ObstacleError
            When there is no such separation, or it is for one time only.
        """
        segment = self._segment(first, second, start)
        if segment.interval is None:
            raise ObstacleError(
                f"{self._what}: the separation {segment.index} is for one time only; there is nothing to split. "
                'Use between="plane".'
            )
        record, motion = self.record, self.motion
        left, right = segment.halves(motion)
        with PauseGC():
            add_poses(record, motion, (left, right))
            margin, normal = value(self.margin[segment.index]), unit_normal_of(self, segment.index)
            remove_separations(self, record, [segment])
            for half in (left, right):
                add_separation(self, record, half)
                record.pinned.add(half.index)
                self.margin[half.index] = margin
            known = {} if normal is None else {record.body_pair(segment): normal}
            set_start_values(self, Snapshot(record, self._what), (left, right), known)
        return left.index, right.index

    def restore(self, missed: Iterable[tuple[str, str, Hashable]]) -> list[SeparationIndex]:
        """Add separations that the broad phase left out and that were missed; they are never left out again.

        Parameters
        ----------
        missed : iterable of (first, second, interval)
            Names of two convex parts, and the position of an interval; with ``between=None`` the time.

        Returns
        -------
        list of indices
            Of the separations added; empty where none of the missed ones were left out.
        """
        record, left_out = self.record, segments_by_place(self.record.pruned.values())
        added = [segment for place in dict.fromkeys(missed) for segment in left_out.get(place, ())]
        record.pinned.update(segment.index for segment in added)
        if added:
            units = record.scene.unit_directions(self._what, record.directions)
            with PauseGC():
                restore_separations(self, record, added)
                set_start_values(self, Snapshot(record, self._what), added, units)
        return [segment.index for segment in added]

    def set_margin(self, first: str, second: str, start: Hashable, margin: float) -> None:
        """Add a margin to the clearance of one separation, for the motion between its poses."""
        if not (np.isfinite(margin) and margin >= 0):
            raise ObstacleError(f"{self._what}: the margin of {(first, second, start)} is {margin!r}; it must be >= 0.")
        self.margin[self._segment(first, second, start).index] = float(margin)

    def set_norm(self, norm: str) -> None:
        """Bound the lengths of all normals by 1 ("ball"), or fix them at 1 ("sphere")."""
        record = self.record
        if norm not in ("ball", "sphere"):
            raise ObstacleError(f"{self._what}: norm is {norm!r}; it is 'ball' or 'sphere'.")
        if norm != record.norm_now:
            for index in record.segments:
                self.unit[index].set_value(norm_relation([self.normal[(*index, axis)] for axis in self.axes], norm))
        record.norm_now = norm

    def _segment(self, first: str, second: str, start: Hashable) -> MotionSegment:
        index = (first, second, start)
        if index not in self.record.segments:
            raise ObstacleError(
                f"{self._what}: there is no separation {index}. Its separations are in '{self.name}.separations'."
            )
        return self.record.segments[index]


def avoidance_blocks(model: Any) -> list[ObstacleAvoidanceBlockData]:
    """The active avoidance blocks of a model, wherever they are."""
    return blocks_of_kind(model, ObstacleAvoidanceBlockData)


@ModelComponentFactory.register("Bodies that keep clear of obstacles and of each other.")
class ObstacleAvoidanceBlock(MotionBlock, data=ObstacleAvoidanceBlockData):
    """Bodies that keep clear of obstacles and of each other, over a set of times.

    Parameters
    ----------
    points : Set, ContinuousSet or sequence of numbers
        When: ``phase.time`` or ``phase.points`` of a `PhaseBlock`, a discretised ContinuousSet, ordered numbers. With
        `rule`, index sets take its place.
    bodies : mapping of name to Body
        Bodies that the plan moves.
    obstacles : mapping of name to Polytope, list of Polytope or Body; or a sequence of such
        Bodies that it does not move. A list of polytopes is one obstacle, their union; a `Body` moves by itself.
    clearance : number, Param, Var, expression or callable; or mapping of body pair to such
        Distance to be kept, > 0. A rule is called as ``rule(block, t)``, like that of a pose: ``lambda b, t: 0.1 + 0.2
        * b.v[t]``. A variable with a lower bound > 0 is chosen by the optimiser.
    body, pose : Polytope and callable, optional
        Short for ``bodies={"body": Body(body, pose=pose)}``.
    body_pairs : networkx.Graph or iterable of (str, str), optional
        Which bodies keep clear of which; by default every body of every obstacle and of every other body.
    exclude : iterable of (str, str)
        Body pairs to leave out, such as adjacent links of an arm.
    between : str or None
        ``"plane"``: one plane per interval, which separates the shapes at all poses of it; None separates them at each
        point on its own.
    broad_phase : float, "auto" or None
        Body pairs that are farther apart than this at the initial guess are left out, interval by interval. `verify`
        checks all, and `solve` brings back what the plan comes too near to. By default the length follows from the
        scene; scenes with few separations keep all. None leaves nothing out.
    equations : bool
        Whether the motion that the equations make of the plan's controls keeps clear as well, on a finer mesh where
        `solve` has to. False for robots whose controller tracks the polynomials of the plan: it is proven clear, and
        since nothing else is looked at ``safe`` is None.
    rule : callable, optional
        ``rule(block, *index)`` calls ``block.build(points, bodies=..., ...)``; for indexed blocks.

    Raises
    ------
    ObstacleError
        When the scene contradicts itself, naming the body; the block is then not added to the model.

    Notes
    -----
    For each body pair and segment of motion the rows hold a *separation*: a direction ``n`` and a number ``c`` with
    ``n.q <= c`` for all points q of the second shape, ``n.p >= c + clearance`` for all p of the first, and
    ``|n| <= 1``. Whatever a solver returns, the gap of a separation never exceeds the true distance.

    References
    ----------
    Zhang, Liniger & Borrelli, Optimization-Based Collision Avoidance, arXiv:1711.03449

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.move = rcp.PhaseBlock(duration=1.0, elements=10)
    >>> m.move.x, m.move.y = rcp.State(initial=0, final=4), rcp.State(initial=0, final=0)
    >>> m.move.avoid = rcp.ObstacleAvoidanceBlock(
    ...     m.move.time,
    ...     body=rcp.Polytope.box(0.5, 0.5),
    ...     pose=lambda b, t: rcp.planar_pose(b.x[t], b.y[t]),
    ...     obstacles={"wall": rcp.Polytope.box(1, 2, center=(2, 0))},
    ...     clearance=0.05,
    ... )
    >>> m.move.initialize_straight_lines()  # through the wall: an initial guess may overlap
    >>> m.move.avoid.initialize()
    >>> len(m.move.avoid.separations)  # one per interval
    10
    """

    def __init__(
        self,
        *points: Any,
        bodies: Any = None,
        obstacles: Any = None,
        clearance: Any = None,
        body: Any = None,
        pose: Rule | None = None,
        body_pairs: Any = None,
        exclude: Any = (),
        between: str | None = "plane",
        broad_phase: float | str | None = "auto",
        equations: bool = True,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        options = {
            "bodies": bodies,
            "obstacles": obstacles,
            "clearance": clearance,
            "body": body,
            "pose": pose,
            "body_pairs": body_pairs,
            "exclude": exclude,
            "between": between,
            "broad_phase": broad_phase,
            "equations": equations,
        }
        super().__init__("an ObstacleAvoidanceBlock", *points, options=options, rule=rule, **block_options)
