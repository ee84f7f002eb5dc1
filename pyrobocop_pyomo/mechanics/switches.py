"""Functions that jump: the Heaviside step and the sign, as complementarity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pyrobocop_pyomo.complementarity import complements

from .signal_laws import NONNEGATIVE, Moment, Quantity, SignalLaw, Unknown


@dataclass(frozen=True)
class _Switch(SignalLaw):
    """A signal that jumps between two values where a quantity passes zero."""

    low: ClassVar[float]

    of: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The value, and the parts of the quantity: ``<name>_above``, ``<name>_below``."""
        part = Unknown(NONNEGATIVE, lambda at: at.ask("of"))
        return {"": Unknown((self.low, 1.0), lambda at: 1.0), "above": part, "below": part}

    def equations(self, at: Moment) -> Any:
        """The parts make up the quantity."""
        return at.ask("of") == at["above"] - at["below"]

    def pairs(self, at: Moment) -> Any:
        """At one end wherever the quantity is not zero."""
        return {
            "on": complements(at["above"] >= 0, 1 - at.signal >= 0),
            "off": complements(at["below"] >= 0, at.signal - self.low >= 0),
        }

    def start(self, asked: Callable[[str], Any]) -> Mapping[str, float]:
        """One end, or the middle at zero."""
        s = asked("of")
        value = 1.0 if s > 0 else self.low if s < 0 else (1.0 + self.low) / 2
        return {"": value, "above": max(s, 0.0), "below": max(-s, 0.0)}


class Step(_Switch):
    """The Heaviside step: 1 where s is positive, 0 where it is negative, anything between where it is zero.

    With ``s = above - below``, ``0 <= above _|_ 1 - v >= 0`` and ``0 <= below _|_ v >= 0``. At zero the motion decides,
    by Filippov's convention: a motion that is driven onto the surface from both sides slides along it.

    Attributes
    ----------
    of : rule
        ``s``.

    References
    ----------
    Nurkanović, Frey, Pozharskiy & Diehl, Finite Elements with Switch Detection for Direct Optimal Control of Nonsmooth
    Systems with Set-Valued Step Functions (2023), doi:10.48550/arXiv.2303.18066
    """

    low: ClassVar[float] = 0.0


class Sign(_Switch):
    """The sign of s: 1, -1, or anything between where it is zero; twice the `Step` less one.

    Attributes
    ----------
    of : rule
        ``s``.
    """

    low: ClassVar[float] = -1.0
