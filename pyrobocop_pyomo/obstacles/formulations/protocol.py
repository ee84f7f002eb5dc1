"""What a formulation of "these two shapes are apart" has to be able to do."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pyrobocop_pyomo.geometry import Polytope, Pose

Index = tuple[str, str, Hashable]


@dataclass(frozen=True)
class Side:
    """One of the two shapes of a certificate, with the poses that the certificate covers.

    Attributes
    ----------
    shape : Polytope
    poses : tuple of (float, Pose)
        One entry per time; a single one, with a constant pose, where the shape stands still.
    """

    shape: Polytope
    poses: tuple[tuple[Hashable, Pose], ...]


@dataclass(frozen=True, eq=False)
class PlacedSide:
    """A side at the current values.

    Attributes
    ----------
    shape : Polytope
    vertices : (k, d)
        In the world, at all its times.
    rays : (k, d)
        In the world; k may be 0.
    rotation : (d, d)
        At the first of its times.
    translation : (d,)
        At the first of its times.
    """

    shape: Polytope
    vertices: np.ndarray
    rays: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


class Formulation(Protocol):
    """Adds the variables and rows of one certificate to an avoidance block, and starts them.

    The block offers ``required[index]``, an Expression of the separation to be proven (clearance, radii, margin and,
    where softened, the slack), and has for every formulation ``normal[index, axis]``, a variable or an expression.
    """

    @property
    def name(self) -> str:
        """As the user writes it."""

    @property
    def covers_intervals(self) -> bool:
        """Whether one certificate may cover several poses."""

    @property
    def signed(self) -> bool:
        """Whether it also measures how deep shapes overlap, where norms can be chosen with "sphere"."""

    @property
    def norms(self) -> tuple[str, ...]:
        """The norms that may be chosen; empty where the formulation has one of its own."""

    @property
    def halfspaces(self) -> tuple[bool, bool]:
        """Whether the first and the second shape are needed as half-spaces, which flat shapes do not have."""

    @property
    def rays(self) -> tuple[bool, bool]:
        """Whether the first and the second shape may be unbounded."""

    def declare(self, block: Any, axes: range) -> None:
        """Add the components, still empty."""

    def add(self, block: Any, index: Index, first: Side, second: Side) -> None:
        """Add the variables and rows of one certificate."""

    def start(self, block: Any, index: Index, first: PlacedSide, second: PlacedSide, normal: np.ndarray) -> None:
        """Set start values from a unit normal that points from the second shape to the first."""

    def set_norm(self, block: Any, index: Index, norm: str) -> None:
        """Choose between ``n'n <= 1`` ("ball") and ``n'n = 1`` ("sphere")."""
