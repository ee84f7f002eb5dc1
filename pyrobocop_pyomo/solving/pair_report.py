"""What became of each pair: its sides, which of them is zero, and what that costs."""

from __future__ import annotations

import enum
import re
from collections.abc import Sequence
from dataclasses import dataclass

from pyrobocop_pyomo.complementarity import PairResidual
from pyrobocop_pyomo.complementarity.forms import PAIR_ROLES
from pyrobocop_pyomo.mpcc.stationarity import Multipliers, Stationarity
from pyrobocop_pyomo.numerics.rounding import MET

_NAME = rf"(.*?)(?:\[([^[]*)\])?( \((?:{'|'.join(PAIR_ROLES)})\))?"


class ActiveSide(enum.Enum):
    """Which side of a pair is zero; the value is the word in tables."""

    FIRST = "first"
    SECOND = "second"
    BIACTIVE = "biactive"
    NEITHER = "neither"


@dataclass(frozen=True)
class PairReport:
    """One pair ``0 <= first ⟂ second >= 0`` at the returned point.

    Attributes
    ----------
    name : str
        Of the pair as declared; where one statement gives two pairs, with "(lower)" or "(upper)".
    first, second : float
        Values of the two sides.
    first_multiplier, second_multiplier : float or None
        By how much the objective gets worse per unit where the side is held at a small positive number instead of
        zero: the minimised objective grows, the maximised one falls. So the signs mean the same in both senses, and
        at a biactive pair two nonnegative ones say that neither side wants to leave zero. Zero for a side that is not
        held; None where the result is not certified, or the point not stationary.
    """

    name: str
    first: float
    second: float
    first_multiplier: float | None = None
    second_multiplier: float | None = None

    @property
    def component(self) -> str:
        """Name of the component that the pair belongs to."""
        return split_name(self.name)[0]

    @property
    def index(self) -> str:
        """Index of the pair in its component as text, empty for a scalar one."""
        return split_name(self.name)[1]

    @property
    def product(self) -> float:
        """``first * second``."""
        return self.first * self.second

    @property
    def natural(self) -> float:
        """``min(first, second)``: zero exactly where the pair is met."""
        return min(self.first, self.second)

    @property
    def active(self) -> ActiveSide:
        """Which side is zero, up to 1e-6."""
        if abs(self.natural) > MET:
            return ActiveSide.NEITHER
        if max(self.first, self.second) <= MET:
            return ActiveSide.BIACTIVE
        return ActiveSide.FIRST if self.first < self.second else ActiveSide.SECOND


def pair_reports(residuals: Sequence[PairResidual], multipliers: Multipliers | None) -> list[PairReport]:
    """Join residuals with the multipliers of the same pairs."""
    if multipliers is None or multipliers.kind is Stationarity.NONE:
        return [PairReport(residual.name, residual.a, residual.b) for residual in residuals]
    return [
        PairReport(residual.name, residual.a, residual.b, nu, xi)
        for residual, nu, xi in zip(residuals, multipliers.nu.tolist(), multipliers.xi.tolist(), strict=True)
    ]


def split_name(name: str) -> tuple[str, str]:
    """Split ``block.pair[1,a] (lower)`` into ``block.pair (lower)`` and ``1,a``; names of blocks keep their indices."""
    stem, index, role = re.fullmatch(_NAME, name, re.DOTALL).groups(default="")  # type: ignore[union-attr]
    return stem + role, index
