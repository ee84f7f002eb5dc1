"""Start values of certificates, from exact distances at the current poses."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from .avoidance_record import AvoidanceRecord
from .broad_phase import farther_apart
from .certificate_rows import add_certificate, remove_certificate
from .formulations import PlacedSide
from .pieces import Piece
from .scene import Pair
from .side_choice import choose_normals, gap_along
from .snapshot import Snapshot

LOGGER = logging.getLogger(__name__)


def start_all(
    block: Any, snapshot: Snapshot, directions: Mapping[Pair, np.ndarray], seed: int
) -> dict[tuple[str, str], int]:
    """Start every certificate.

    Returns
    -------
    dict of pair of parts to int
        Number of pieces on which they overlap at the guess; pairs that nowhere do are left out.
    """
    record = snapshot.record
    generator = np.random.default_rng(seed)
    overlapping = {}
    for first, second in record.scene.pairs_of_parts():
        pieces = record.pieces_of(first.name, second.name)
        if not pieces:
            continue
        placed = [snapshot.sides(piece) for piece in pieces]
        wanted = directions.get((first.body, second.body))
        normals, gaps = choose_normals(placed, generator, wanted)
        for piece, sides, normal in zip(pieces, placed, normals, strict=True):
            _start(block, record, piece, sides, normal)
        if (gaps <= 0).any():
            overlapping[first.name, second.name] = int((gaps <= 0).sum())
    if overlapping:
        LOGGER.info(
            "%s: the guess overlaps for %s; sides chosen along time, ties broken with seed %d.",
            snapshot.what,
            ", ".join(f"'{a}' and '{b}' ({count} certificates)" for (a, b), count in overlapping.items()),
            seed,
        )
    return overlapping


def start_one(block: Any, snapshot: Snapshot, piece: Piece, normal: np.ndarray | None = None) -> None:
    """Start one certificate from the distance; from the normal given where shapes overlap."""
    sides = snapshot.sides(piece)
    usable = normal is not None and np.isfinite(normal).all() and np.linalg.norm(normal) > 0
    direction = normal / np.linalg.norm(normal) if usable and normal is not None else None
    normals, _ = choose_normals([sides], np.random.default_rng(0), direction)
    _start(block, snapshot.record, piece, sides, normals[0])


def _start(
    block: Any, record: AvoidanceRecord, piece: Piece, sides: tuple[PlacedSide, PlacedSide], normal: np.ndarray
) -> None:
    index = piece.index
    if record.soft:
        block.slack[index].set_value(0.0)
        proven = float(gap_along(normal[None, :], *sides)[0]) + sides[0].shape.radius + sides[1].shape.radius
        block.slack[index].set_value(max(0.0, value(block.required[index]) - proven))
    record.formulation.start(block, index, *sides, normal)


def apply_broad_phase(block: Any, snapshot: Snapshot) -> None:
    """Leave out what is far apart at the current poses, and bring back what is not any more."""
    record = snapshot.record
    for piece in list(record.pieces.values()):
        if piece.index not in record.pinned and is_far(snapshot, piece):
            remove_certificate(block, record, piece)
            record.pruned[piece.index] = piece
    for piece in list(record.pruned.values()):
        if not is_far(snapshot, piece):
            del record.pruned[piece.index]
            add_certificate(block, record, piece)


def is_far(snapshot: Snapshot, piece: Piece) -> bool:
    """True when the broad phase may leave a piece out at the current poses."""
    length = snapshot.record.broad_phase
    return length is not None and farther_apart(*snapshot.sides(piece), length)
