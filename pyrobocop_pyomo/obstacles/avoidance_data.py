"""`ObstacleAvoidanceBlockData`: what one avoidance block holds and what can be asked of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.expression import Expression
from pyomo.core.base.param import Param
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.set import Set
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.motion.clearance_proof import verify_clearance
from pyrobocop_pyomo.motion.safety_report import SafetyReport

from .avoidance_options import AvoidanceOptions
from .building import set_of_points
from .certificate_rows import add_certificate, add_poses, update_softness
from .certificates import proven_gap
from .initial_checks import check_fixed_poses, check_poses, has_values, warn_about_quaternions
from .pieces import PlaneIndex, pieces_of_motion
from .refining import RefinedBetweenSolves
from .scene import Pair
from .snapshot import Snapshot
from .starting import apply_broad_phase, is_far, start_all


class ObstacleAvoidanceBlockData(RefinedBetweenSolves):
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

    def build(self, points: Any, **options: Any) -> None:
        """State everything; for rules of indexed blocks, with the arguments of the class.

        Raises
        ------
        ObstacleError
            When the arguments contradict themselves; nothing is then left on the block.
        """
        self._build_once(points, **options)

    def _build(self, points: Any, **options: Any) -> None:
        points = set_of_points(self, points)
        self._record = record = AvoidanceOptions(**options).record(self._what, points)
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
            Where to pass wherever the guess overlaps: ``{("car", "wall"): (0, 1)}`` has the car above the wall. By
            default what was given last, which `solve` goes by too; ``{}`` forgets it.
        seed : int
            Of the random numbers that break ties where both sides are equally good.

        Raises
        ------
        ObstacleError
            When a pose has no value or is no rotation, when fixed poses are closer than the clearance (with the
            clearance that is available), or when `sides` names what is no pair.
        """
        record, snapshot = self.record, Snapshot(self.record, self._what)
        sides = dict(record.sides if sides is None else sides)
        directions = record.scene.directions(self._what, sides)
        check_poses(snapshot)
        check_fixed_poses(snapshot, self.clearance)
        warn_about_quaternions(snapshot, self.model())
        record.sides = sides
        with PauseGC():
            apply_broad_phase(self, snapshot)
            update_softness(self, record)
            overlapping = start_all(self, snapshot, directions, seed)
            if record.formulation.norms:
                chosen = ("ball" if overlapping else "sphere") if record.norm == "auto" else record.norm
                self.set_norm("sphere" if record.soft else chosen)

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
