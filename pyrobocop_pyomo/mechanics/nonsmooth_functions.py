"""Functions with a kink or a jump, as complementarity: exact at every solution, without smoothing.

Each is assigned to a name of a phase: ``b.size = AbsoluteValue(lambda b, t: b.x[t])`` makes ``b.size[t]`` a variable
that equals ``|x|``. The first side of each pair is the one that is continuous in time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity import complements

from .signal_laws import NONNEGATIVE, Moment, Quantity, SignalLaw, Unknown


@dataclass(frozen=True)
class AbsoluteValue(SignalLaw):
    """``|s|``: the v with ``0 <= v - s _|_ v + s >= 0``.

    With it, ``max(a, b)`` is ``(a + b + |a - b|) / 2``, ``min(a, b)`` is ``(a + b - |a - b|) / 2``, and s cut off at l
    and u is ``(l + u + |s - l| - |s - u|) / 2``.

    Attributes
    ----------
    of : rule
        ``s``.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.phase = b = rcp.PhaseBlock(duration=1.0, elements=2)
    >>> b.x = rcp.Control(initial_guess=-3)
    >>> b.size = rcp.mechanics.AbsoluteValue(lambda b, t: b.x[t])
    >>> b.size[1.0].value
    3.0
    """

    of: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The value."""
        return {"": Unknown(NONNEGATIVE, lambda at: at.ask("of"))}

    def pairs(self, at: Moment) -> Any:
        """The value is one of the two."""
        return complements(at.signal - at.ask("of") >= 0, at.signal + at.ask("of") >= 0)

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """The absolute value."""
        return {"": abs(asked("of"))}


@dataclass(frozen=True)
class Step(SignalLaw):
    """The Heaviside step: 1 where s is positive, 0 where it is negative, anything between where it is zero.

    With ``s = above - below``, ``0 <= above _|_ 1 - v >= 0`` and ``0 <= below _|_ v >= 0``. At zero the motion decides,
    by Filippov's convention: a motion that is driven onto the surface from both sides slides along it. The sign of s
    is ``2 v - 1``.

    Attributes
    ----------
    of : rule
        ``s``.

    References
    ----------
    Nurkanović, Frey, Pozharskiy & Diehl, Finite Elements with Switch Detection for Direct Optimal Control of Nonsmooth
    Systems with Set-Valued Step Functions (2023), doi:10.48550/arXiv.2303.18066
    """

    of: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The value, and the parts of the quantity: ``<name>_above``, ``<name>_below``."""
        part = Unknown(NONNEGATIVE, lambda at: at.ask("of"))
        return {"": Unknown((0.0, 1.0), lambda at: 1.0), "above": part, "below": part}

    def equations(self, at: Moment) -> Any:
        """The parts make up the quantity."""
        return at.ask("of") == at["above"] - at["below"]

    def pairs(self, at: Moment) -> Any:
        """At one end wherever the quantity is not zero."""
        return {
            "on": complements(at["above"] >= 0, 1 - at.signal >= 0),
            "off": complements(at["below"] >= 0, at.signal >= 0),
        }

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """One end, or the middle at zero."""
        s = asked("of")
        value = 1.0 if s > 0 else 0.0 if s < 0 else 0.5
        return {"": value, "above": max(s, 0.0), "below": max(-s, 0.0)}
