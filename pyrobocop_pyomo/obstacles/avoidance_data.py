"""`ObstacleAvoidanceBlockData`: what one avoidance block holds and what can be asked of it."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import BlockData
from pyomo.core.base.expression import Expression
from pyomo.core.base.param import Param
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.set import Set
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError

from .avoidance_options import AvoidanceOptions
from .avoidance_record import AvoidanceRecord
from .certificate_rows import add_certificate, add_poses, harden, remove_certificate, soften, update_softness
from .certificates import proven_gap
from .initial_checks import check_fixed_poses, check_poses, has_values, warn_about_quaternions
from .motion import Motion, motion_of
from .pieces import Piece, PlaneIndex, halves, pieces_of_motion
from .safety_report import SafetyReport
from .scene import Pair
from .snapshot import Snapshot
from .starting import apply_broad_phase, is_far, start_all, start_one
from .verification import verify_clearance


class ObstacleAvoidanceBlockData(BlockData):
    """One avoidance block; see `ObstacleAvoidanceBlock` for how to make one.

    Attributes
    ----------
    planes : Set
        Indices ``(first, second, start)`` of the certificates: names of two parts, and where their piece starts.
    normal : Var or Expression
        ``normal[first, second, start, axis]``, which points from the second to the first.
    required : Expression
        Separation that each certificate proves: clearance, radii and margin, less the slack.
    clearance : Param
        By pair of bodies; mutable.
    clearance_scale : Param
        Factor of all clearances, 1 at first; mutable.
    margin : Param
        What is added to the clearance, by certificate; mutable.
    slack : Var
        By certificate, once softened.
    softness : Expression
        Cost of the slack, for the objective; 0 unless softened.
    """

    def __init__(self, component: Any) -> None:
        super().__init__(component)
        self._record: AvoidanceRecord | None = None

    # ---------------------------------------------------------------- what it is made of

    @property
    def record(self) -> AvoidanceRecord:
        """Scene, pieces of motion and poses behind this block."""
        if self._record is None:
            raise ObstacleError(
                f"{self._what} is not built yet: add it to a ConcreteModel; a rule= has to call block.build(...)."
            )
        return self._record

    @property
    def motion(self) -> Motion:
        """What happens at the points and between them."""
        return motion_of(self.record.points, self.parent_block())

    @property
    def axes(self) -> range:
        """0, 1 in the plane and 0, 1, 2 in space."""
        return range(self.record.dimension)

    @property
    def _what(self) -> str:
        return f"obstacle avoidance '{self.name}'"

    def build(self, points: Any, **options: Any) -> None:
        """State everything; for rules of indexed blocks, with the arguments of `ObstacleAvoidanceBlock`.

        Raises
        ------
        ObstacleError
            When the scene or the options contradict themselves; nothing is then left on the block.
        """
        if self._record is not None:
            raise ObstacleError(f"{self._what} is built already.")
        before = set(self.component_map())
        try:
            with PauseGC():
                self._build(points, AvoidanceOptions(**options))
        except BaseException:
            for name in [name for name in self.component_map() if name not in before]:
                self.del_component(name)
            self._record = None
            raise

    def _build(self, points: Any, options: AvoidanceOptions) -> None:
        if not hasattr(points, "ctype"):
            self.points = Set(initialize=list(points), ordered=True, doc="times at which shapes are kept apart")
            points = self.points
        self._record = record = options.record(self._what, points)
        scene = record.scene
        self.clearance_scale = Param(initialize=1.0, mutable=True, doc="factor of all clearances")
        self.clearance = Param(scene.pairs, initialize=scene.clearances, mutable=True, doc="clearance of each pair")
        self.planes = Set(dimen=3, doc="first, second, start of a piece")
        self.margin = Param(self.planes, mutable=True, default=0.0, doc="added to the clearance")
        self.required = Expression(AnyIndex, doc="separation that a certificate proves")
        self.slack = Var(self.planes, bounds=(0, None), dense=False, doc="what is missing, once softened")
        self.softness_weight = Param(initialize=1.0, mutable=True, doc="cost of a unit of slack")
        self.softness = Expression(expr=0.0, doc="cost of the slack")
        record.formulation.declare(self, self.axes)
        motion = self.motion
        pairs = [(first.name, second.name) for first, second in scene.pairs_of_parts()]
        pieces = pieces_of_motion(self._what, pairs, motion, record.per_interval)
        add_poses(record, motion, pieces)
        snapshot = Snapshot(record, self._what)
        # Without a guess nothing is known to be far apart; initialize() asks again.
        if record.broad_phase is not None and has_values(record):
            record.pruned = {piece.index: piece for piece in pieces if is_far(snapshot, piece)}
        for piece in pieces:
            if piece.index not in record.pruned:
                add_certificate(self, record, piece)

    # ---------------------------------------------------------------- start values

    def initialize(self, sides: Mapping[Pair, Any] | None = None, seed: int = 0) -> None:
        """Start the certificates from exact distances at the current poses.

        Parameters
        ----------
        sides : mapping of pair to direction, optional
            Where to pass wherever the guess overlaps: ``{("car", "wall"): (0, 1)}`` has the car above the wall.
        seed : int
            Of the random numbers that break ties where both sides are equally good.

        Raises
        ------
        ObstacleError
            When a pose has no value or is no rotation, when fixed poses are closer than the clearance (with the
            clearance that is available), or when `sides` names what is no pair.
        """
        record, snapshot = self.record, Snapshot(self.record, self._what)
        directions = record.scene.directions(self._what, sides or {})
        check_poses(snapshot)
        check_fixed_poses(snapshot, self.clearance)
        warn_about_quaternions(snapshot, self.model())
        with PauseGC():
            apply_broad_phase(self, snapshot)
            update_softness(self, record)
            overlapping = start_all(self, snapshot, directions, seed)
            if record.formulation.norms:
                self.set_norm(("ball" if overlapping else "sphere") if record.norm == "auto" else record.norm)

    # ---------------------------------------------------------------- refinement

    def split(self, first: str, second: str, start: Hashable) -> tuple[PlaneIndex, PlaneIndex]:
        """Replace a certificate by two, for the halves of its piece of motion, and start them.

        Returns
        -------
        tuple of indices
            Of the two new certificates. They inherit the margin.

        Raises
        ------
        ObstacleError
            When there is no such certificate, or it is for one time only.
        """
        piece = self._piece(first, second, start)
        if piece.interval is None:
            raise ObstacleError(
                f"{self._what}: the certificate {piece.index} is for one time only; there is nothing to split. "
                'Use between="plane".'
            )
        record, motion = self.record, self.motion
        left, right = halves(motion, piece)
        with PauseGC():
            add_poses(record, motion, (left, right))
            margin, normal = value(self.margin[piece.index]), self._normal(piece.index)
            remove_certificate(self, record, piece)
            for half in (left, right):
                add_certificate(self, record, half)
                self.margin[half.index] = margin
                start_one(self, Snapshot(record, self._what), half, normal)
            update_softness(self, record)
        return left.index, right.index

    def restore(self, first: str, second: str, interval: Hashable) -> list[PlaneIndex]:
        """Bring back what the broad phase left out, and start it.

        Parameters
        ----------
        first, second : str
            Names of bodies, in either order.
        interval : int or time
            Position of the interval; with ``between=None`` the time.

        Returns
        -------
        list of indices
            Of the certificates added; empty where none were left out.
        """
        record, snapshot = self.record, Snapshot(self.record, self._what)
        pair = record.scene.pair(self._what, first, second)
        found = [piece for piece in record.pruned.values() if record.concerns(piece, pair, interval)]
        with PauseGC():
            for piece in found:
                del record.pruned[piece.index]
                add_certificate(self, record, piece)
                start_one(self, snapshot, piece)
            update_softness(self, record)
        return [piece.index for piece in found]

    def set_margin(self, first: str, second: str, start: Hashable, margin: float) -> None:
        """Ask more than the clearance of one certificate, for what the motion does between its poses."""
        if not (np.isfinite(margin) and margin >= 0):
            raise ObstacleError(f"{self._what}: the margin of {(first, second, start)} is {margin!r}; it must be >= 0.")
        self.margin[self._piece(first, second, start).index] = float(margin)

    def set_norm(self, norm: str) -> None:
        """Bound the lengths of all normals by 1 ("ball"), or fix them at 1 ("sphere")."""
        record = self.record
        if norm not in record.formulation.norms:
            raise ObstacleError(
                f"{self._what}: norm is {norm!r}; the formulation '{record.formulation.name}' has "
                f"{' and '.join(map(repr, record.formulation.norms)) or 'a norm of its own'}."
            )
        if norm != record.norm_now:
            for index in record.pieces:
                record.formulation.set_norm(self, index, norm)
        record.norm_now = norm

    def scale_clearance(self, factor: float) -> None:
        """Ask for a fraction of the clearances only, on the way to all of them."""
        if not (np.isfinite(factor) and factor > 0):
            raise ObstacleError(f"{self._what}: the clearances are scaled by {factor!r}; the factor must be > 0.")
        self.clearance_scale.set_value(float(factor))

    def soften(self, weight: float = 1.0) -> None:
        """Let every certificate miss its separation by a slack; add ``softness`` to the objective.

        Parameters
        ----------
        weight : float
            Cost of a unit of slack.
        """
        if not (np.isfinite(weight) and weight > 0):
            raise ObstacleError(f"{self._what}: the weight of the slack is {weight!r}; it must be > 0.")
        self.softness_weight.set_value(float(weight))
        if not self.record.soft:
            soften(self, self.record)

    def harden(self) -> None:
        """Take the slack away again."""
        if self.record.soft:
            harden(self, self.record)

    # ---------------------------------------------------------------- judgement

    def certificate_gaps(self) -> dict[PlaneIndex, float]:
        """Separation that each certificate proves at the current values, recomputed from its normal alone.

        Returns
        -------
        dict of index to float
            Never more than the signed distance of the shapes at any of the times covered, whatever a solver did;
            ``-inf`` where the normal is zero.
        """
        snapshot = Snapshot(self.record, self._what)
        pieces = self.record.pieces.values()
        return {piece.index: proven_gap(*snapshot.sides(piece), self._normal(piece.index)) for piece in pieces}

    def verify(self, tolerance: float | None = None) -> SafetyReport:
        """Judge the motion that the current values describe: all pairs, and all times between the points.

        Parameters
        ----------
        tolerance : float, optional
            What may be missing of a clearance; 1 % of it by default.
        """
        clearances = {pair: value(self.clearance[pair]) for pair in self.record.scene.pairs}
        return verify_clearance(self.motion, self.record.scene.bodies, clearances, tolerance=tolerance)

    def _normal(self, index: PlaneIndex) -> np.ndarray:
        entries = [value(self.normal[(*index, axis)], exception=False) for axis in self.axes]
        return np.array([np.nan if entry is None else entry for entry in entries], dtype=float)

    def _piece(self, first: str, second: str, start: Hashable) -> Piece:
        index = (first, second, start)
        if index not in self.record.pieces:
            raise ObstacleError(
                f"{self._what}: there is no certificate {index}. Its certificates are in '{self.name}.planes'."
            )
        return self.record.pieces[index]
