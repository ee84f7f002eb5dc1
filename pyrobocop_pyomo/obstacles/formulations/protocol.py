"""`Formulation`: the interface of formulations, and the shapes that they separate."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pyrobocop_pyomo.geometry import Polytope, Pose

SeparationIndex = tuple[str, str, Hashable]


@dataclass(frozen=True)
class PosedShape:
    """One of the two shapes of a separation, with the poses that the separation covers.

    Attributes
    ----------
    shape : Polytope
    poses : tuple of (float, Pose)
        One entry per time; a single one, with a constant pose, for a shape that rests.
    rises : tuple
        How much more than ``required[index]`` is requested at each of these times; empty where it is the same at all.
        Only formulations that cover several poses meet any, at one of the two shapes.
    local_times : tuple of float
        Where these times are within the segment of motion, from 0 to 1; empty for a single one.
    """

    shape: Polytope
    poses: tuple[tuple[Hashable, Pose], ...]
    rises: tuple[Any, ...] = ()
    local_times: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PlacedShape:
    """One of the two shapes of a separation, at the current values.

    Attributes
    ----------
    shape : Polytope
    vertices : (k, d)
        In the world, at all times covered.
    rays : (k, d)
        In the world; k may be 0.
    rotation : (d, d)
        At the first of these times.
    translation : (d,)
        At the first of these times.
    """

    shape: Polytope
    vertices: np.ndarray
    rays: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


class Formulation(Protocol):
    """Adds the variables and rows of separations to an avoidance block, and sets their start values.

    The block has ``required[index]``, an Expression of the gap to be proven: clearance, radii, margin, less the slack.
    Every formulation gives it ``normal[index, axis]``, a variable or an expression.
    """

    @property
    def name(self) -> str:
        """As the user writes it."""

    @property
    def covers_intervals(self) -> bool:
        """Whether one separation may cover several poses."""

    @property
    def signed(self) -> bool:
        """Whether it measures the depth of an overlap too, with the norm "sphere" where norms can be chosen."""

    @property
    def norms(self) -> tuple[str, ...]:
        """The norms that may be chosen; empty for a formulation with a norm of its own."""

    @property
    def halfspaces(self) -> tuple[bool, bool]:
        """Whether the first and the second shape need half-spaces, which flat shapes do not have."""

    @property
    def rays(self) -> tuple[bool, bool]:
        """Whether the first and the second shape may be unbounded."""

    def declare(self, block: Any, axes: range) -> None:
        """Add the components, still empty."""

    def add(self, block: Any, index: SeparationIndex, first: PosedShape, second: PosedShape) -> None:
        """Add the variables and rows of one separation."""

    def start(
        self, block: Any, index: SeparationIndex, first: PlacedShape, second: PlacedShape, normal: np.ndarray
    ) -> None:
        """Set start values from a unit normal that points from the second shape to the first."""

    def set_norm(self, block: Any, index: SeparationIndex, norm: str) -> None:
        """Choose between ``n'n <= 1`` ("ball") and ``n'n = 1`` ("sphere")."""
