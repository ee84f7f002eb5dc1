"""What an avoidance block remembers beside its Pyomo components: its scene, its pieces of motion, its poses."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

from pyrobocop_pyomo.geometry import Pose

from .formulations import Formulation
from .pieces import Piece, PlaneIndex
from .scene import Pair, Scene


@dataclass
class AvoidanceRecord:
    """The facts behind an avoidance block; they survive clones and pickles.

    Attributes
    ----------
    scene : Scene
    points : Set
        The times that the user gave.
    formulation : Formulation
    norm : str
        ``"auto"``, ``"ball"`` or ``"sphere"``, as given.
    per_interval : bool
        True where one certificate covers an interval.
    broad_phase : float or None
    pieces : dict of index to Piece
    pruned : dict of index to Piece
        What the broad phase left out.
    pinned : set of index
        What was brought back or refined, and is not left out again.
    sides : dict of pair to direction
        Where to pass, as the user said last.
    poses : dict of (body, time) to Pose
        Expressions of the poses, made once for all pairs; with the time None for what stands still.
    norm_now : str
        The norm that rows have.
    soft : bool
        True while slack may be used.
    """

    scene: Scene
    points: Any
    formulation: Formulation
    norm: str
    per_interval: bool
    broad_phase: float | None
    pieces: dict[PlaneIndex, Piece] = field(default_factory=dict)
    pruned: dict[PlaneIndex, Piece] = field(default_factory=dict)
    pinned: set[PlaneIndex] = field(default_factory=set)
    sides: dict[Pair, Any] = field(default_factory=dict)
    poses: dict[tuple[str, Hashable], Pose] = field(default_factory=dict)
    norm_now: str = "ball"
    soft: bool = False

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return next(iter(self.scene.parts.values())).shape.dimension

    def pieces_of(self, first: str, second: str) -> list[Piece]:
        """Pieces of a pair of parts, along time."""
        found = [piece for piece in self.pieces.values() if (piece.first, piece.second) == (first, second)]
        return sorted(found, key=lambda piece: (piece.interval, piece.fractions[0])) if self.per_interval else found

    def concerns(self, piece: Piece, pair: Pair, interval: Hashable) -> bool:
        """True when a piece is one of a pair of bodies, in an interval (or at a time, for a certificate of one)."""
        bodies = (self.scene.parts[piece.first].body, self.scene.parts[piece.second].body)
        return bodies == pair and interval == (piece.interval if self.per_interval else piece.times[0])
