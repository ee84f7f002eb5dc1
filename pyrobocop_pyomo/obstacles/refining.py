"""What may be changed on an avoidance block between two solves."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ObstacleError

from .avoidance_core import AvoidanceCore
from .certificate_rows import add_certificate, add_poses, harden, remove_certificate, soften, update_softness
from .pieces import Piece, PlaneIndex, halves
from .snapshot import Snapshot
from .starting import start_one


class RefinedBetweenSolves(AvoidanceCore):
    """Methods of an avoidance block that add, take away and adjust certificates."""

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
                record.pinned.add(half.index)
                self.margin[half.index] = margin
                start_one(self, Snapshot(record, self._what), half, normal)
            update_softness(self, record)
        return left.index, right.index

    def restore(self, first: str, second: str, interval: Hashable) -> list[PlaneIndex]:
        """Bring back what the broad phase left out, start it, and never leave it out again.

        Parameters
        ----------
        first, second : str
            Names of bodies, in either order.
        interval : int or float
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
                record.pinned.add(piece.index)
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
        if norm == "ball" and record.soft:
            raise ObstacleError(f"{self._what}: softened certificates need normals of length 1. Harden it first.")
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

        The lengths of normals are fixed at 1 meanwhile: shorter ones would make any overlap look harmless.

        Parameters
        ----------
        weight : float
            Cost of a unit of slack.
        """
        if not (np.isfinite(weight) and weight > 0):
            raise ObstacleError(f"{self._what}: the weight of the slack is {weight!r}; it must be > 0.")
        if not self.record.formulation.signed:
            raise ObstacleError(
                f"{self._what}: the formulation '{self.record.formulation.name}' does not measure how deep shapes "
                'overlap, so that a slack says nothing. Use formulation="plane".'
            )
        self.softness_weight.set_value(float(weight))
        if not self.record.soft:
            soften(self, self.record)
            if self.record.formulation.norms:
                self.set_norm("sphere")

    def harden(self) -> None:
        """Take the slack away again; `initialize` chooses the norm anew."""
        if self.record.soft:
            harden(self, self.record)

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
