"""Walls that keep a distance from becoming negative, and dry friction along a line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import copysign
from typing import Any, ClassVar

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases.declarations import UNBOUNDED
from pyrobocop_pyomo.phases.equations import add_expression
from pyrobocop_pyomo.phases.record import Statement
from pyrobocop_pyomo.templates.template import Template

from .signal_laws import NONNEGATIVE, Moment, Quantity, Rule, SignalLaw, Unknown, part_name


@dataclass(frozen=True)
class HardWall(SignalLaw):
    """A wall that does not give way: ``0 <= force _|_ gap >= 0``.

    With implicit Euler an impact is inelastic: the force of the element in which the gap closes takes the speed away.

    Attributes
    ----------
    gap : rule
        Distance from the wall, positive where free, metres.

    References
    ----------
    Stewart, Rigid-Body Dynamics with Friction and Impact, SIAM Review 42 (2000), doi:10.1137/S0036144599360110
    """

    gap: Rule

    def unknowns(self) -> Mapping[str, Unknown]:
        """The force, newtons."""
        return {"": Unknown(NONNEGATIVE, lambda at: 1.0)}

    def pairs(self, at: Moment) -> Any:
        """Force only where the gap is closed."""
        return complements(at.ask("gap") >= 0, at.signal >= 0)


@dataclass(frozen=True)
class SoftWall(SignalLaw):
    """A wall that gives way like a spring: ``0 <= force _|_ gap + force / stiffness >= 0``.

    So the force is ``max(0, -stiffness gap)``: none at a distance, and proportional to the penetration. A damper beside
    the spring acts like the gap ``gap + damping / stiffness rate``: give that rule, and the force is
    ``max(0, -stiffness gap - damping rate)``, which resists the way in, and never pulls on the way out.

    Attributes
    ----------
    gap : rule
        Distance from the undeformed wall, negative where it is pressed in, metres.
    stiffness : number, rule, or parameter of the phase
        Newtons per metre.

    Raises
    ------
    ModelError
        When the stiffness is not positive.

    References
    ----------
    Aydinoglu, Preciado & Posa, Contact-Aware Controller Design for Complementarity Systems, ICRA 2020,
    doi:10.1109/ICRA40945.2020.9197568
    """

    positive: ClassVar = ("stiffness",)

    gap: Rule
    stiffness: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The force, newtons."""
        return {"": Unknown(NONNEGATIVE, lambda at: at.ask("stiffness") * at.ask("gap"))}

    def pairs(self, at: Moment) -> Any:
        """Force only as far as the wall is pressed in."""
        return complements(at.ask("gap") + at.signal / at.ask("stiffness") >= 0, at.signal >= 0)

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """The force of the spring."""
        return {"": max(0.0, -asked("stiffness") * asked("gap"))}


@dataclass(frozen=True)
class CoulombFriction(SignalLaw):
    """Friction that holds what it can, and opposes slip with all it has: ``F = -coefficient normal sign(slip)``.

    With ``slip = forward - backward`` and the strength ``L = coefficient normal``::

        0 <= forward   _|_  L + F >= 0
        0 <= backward  _|_  L - F >= 0

    While it sticks, F is whatever keeps the slip at zero, within ``-L <= F <= L``.

    Attributes
    ----------
    slip : rule
        Speed of what the force acts on relative to what it rubs on, metres per second.
    normal : number or rule
        Normal force, newtons; it must not be negative.
    coefficient : number, rule, or parameter of the phase
        Coulomb's coefficient.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.slide = b = rcp.PhaseBlock(duration=1.0, elements=10, scheme="implicit_euler")
    >>> b.v = rcp.State(initial=2.0)
    >>> b.floor = rcp.mechanics.CoulombFriction(lambda b, t: b.v[t], normal=9.81, coefficient=0.5)
    >>> @b.ode
    ... def newton(b, t):
    ...     return {b.v: b.floor[t]}

    References
    ----------
    Stewart, Rigid-Body Dynamics with Friction and Impact, SIAM Review 42 (2000), doi:10.1137/S0036144599360110
    """

    positive: ClassVar = ("coefficient",)
    nonnegative: ClassVar = ("normal",)

    slip: Quantity
    normal: Quantity
    coefficient: Quantity

    def unknowns(self) -> Mapping[str, Unknown]:
        """The force, and the parts of the slip: ``<name>_forward``, ``<name>_backward``."""
        part = Unknown(NONNEGATIVE, lambda at: at.ask("slip"))
        return {"": Unknown(UNBOUNDED, _strength), "forward": part, "backward": part}

    def equations(self, at: Moment) -> Any:
        """The parts make up the slip."""
        return at.ask("slip") == at["forward"] - at["backward"]

    def pairs(self, at: Moment) -> Any:
        """Slip only at full strength, and against the force."""
        return {
            "forward": complements(at["forward"] >= 0, _strength(at) + at.signal >= 0),
            "backward": complements(at["backward"] >= 0, _strength(at) - at.signal >= 0),
        }

    def start(self, asked: Callable[[str], float]) -> Mapping[str, float]:
        """Full strength against the slip."""
        slip = asked("slip")
        force = -copysign(asked("coefficient") * asked("normal"), slip) if slip else 0.0
        return {"": force, "forward": max(slip, 0.0), "backward": max(-slip, 0.0)}


@dataclass(frozen=True)
class CoulombSlip(SignalLaw):
    """Coulomb's law read the other way: the force is chosen, and slip follows where it is at the edge of its cone.

    The signal is the speed of slip, the expression ``<name>_forward - <name>_backward``::

        0 <= forward   _|_  coefficient normal - tangential >= 0
        0 <= backward  _|_  coefficient normal + tangential >= 0

    A finger that pushes with ``(normal, tangential)`` slips, relative to what it pushes, in the direction of its own
    tangential force, and only at the edge of the cone. Both distances from the edges are nonnegative: the force stays
    within its cone.

    Attributes
    ----------
    normal, tangential : rule
        Force that the sliding body exerts on the surface, newtons: the normal part, which must not be negative, and the
        part in the direction of positive slip.
    coefficient : number, rule, or parameter of the phase
        Coulomb's coefficient.
    fastest : float or None
        Largest speed of slip, in the units of the slip; None where there is no bound.

    References
    ----------
    Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
    ICRA 2022, sec. V-C, doi:10.1109/ICRA46639.2022.9812069
    """

    positive: ClassVar = ("coefficient", "fastest")
    nonnegative: ClassVar = ("normal",)

    normal: Quantity
    tangential: Quantity
    coefficient: Quantity
    fastest: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fastest is not None and not isinstance(self.fastest, (int, float)):
            raise ModelError(f"{self._what}: fastest = {self.fastest!r}; it is a bound, and has to be a number.")

    def unknowns(self) -> Mapping[str, Unknown]:
        """The parts of the slip: ``<name>_forward``, ``<name>_backward``."""
        part = Unknown((0.0, self.fastest), lambda at: 1.0 if self.units is None else self.units)
        return {"forward": part, "backward": part}

    def state(self, phase: Any, name: str) -> None:
        """State the law, and the slip as an expression: a variable of its own would only be a row more."""
        super().state(phase, name)
        forward, backward = part_name(name, "forward"), part_name(name, "backward")
        slip = Template(lambda phase, time: getattr(phase, forward)[time] - getattr(phase, backward)[time])
        add_expression(phase, Statement("expression", name, slip))

    def pairs(self, at: Moment) -> Any:
        """Slip only at the edge of the cone."""
        tangential = at.ask("tangential")
        return {
            "forward": complements(_strength(at) - tangential >= 0, at["forward"] >= 0),
            "backward": complements(_strength(at) + tangential >= 0, at["backward"] >= 0),
        }


def _strength(at: Moment) -> Any:
    return at.ask("coefficient") * at.ask("normal")
