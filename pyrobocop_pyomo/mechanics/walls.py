"""Walls, which keep a distance from becoming negative, at once or by compliance; and a point that touches one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases import Law

from .friction import CoulombFriction
from .signal_laws import NONNEGATIVE, Moment, Quantity, Rule, SignalLaw, SignalReader, Unknown


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

    So the force is ``max(0, -stiffness gap)``: none at a distance, and proportional to the penetration. With damping it
    is ``max(0, -stiffness gap - damping rate)``: it resists the way in, and never pulls on the way out.

    Attributes
    ----------
    gap : rule
        Distance from the undeformed wall, negative where it is pressed in, metres.
    stiffness : number, rule, or parameter of the phase
        Newtons per metre.
    damping : number, rule, or parameter of the phase
        Newton seconds per metre; needs the rate.
    rate : rule or None
        Rate of change of the gap, metres per second.

    Raises
    ------
    ModelError
        When the stiffness is not positive, the damping negative, or one of damping and rate is given alone.

    References
    ----------
    Aydinoglu, Preciado & Posa, Contact-Aware Controller Design for Complementarity Systems, ICRA 2020,
    doi:10.1109/ICRA40945.2020.9197568
    """

    positive: ClassVar = ("stiffness",)
    nonnegative: ClassVar = ("damping",)

    gap: Rule
    stiffness: Quantity
    damping: Quantity | None = None
    rate: Rule | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.damping is None) != (self.rate is None):
            raise ModelError(
                f"{self._what}: damping = {self.damping!r} and rate = {self.rate!r}; damping acts on the rate of the "
                "gap: give both, or neither."
            )

    def unknowns(self) -> Mapping[str, Unknown]:
        """The force, newtons."""
        return {"": Unknown(NONNEGATIVE, lambda at: at.ask("stiffness") * at.ask("gap"))}

    def pairs(self, at: Moment) -> Any:
        """Force only as far as the wall is pressed in."""
        return complements(self._pressing(at.ask) + at.signal / at.ask("stiffness") >= 0, at.signal >= 0)

    def start(self, asked: Callable[[str], Any]) -> Mapping[str, float]:
        """The force of spring and damper."""
        return {"": max(0.0, -asked("stiffness") * self._pressing(asked))}

    def _pressing(self, asked: Callable[[str], Any]) -> Any:
        """The gap at which the spring alone would be as strong as spring and damper."""
        if self.damping is None:
            return asked("gap")
        return asked("gap") + asked("damping") / asked("stiffness") * asked("rate")


@dataclass(frozen=True)
class PointContact(Law):
    """A point that touches a surface: a wall along the normal, Coulomb friction along the surface.

    ``b.foot = PointContact(...)`` makes the normal force ``b.foot[t]`` and the friction on the point
    ``b.foot_tangential[t]``; a `HardWall` or, with a stiffness, a `SoftWall`, and a `CoulombFriction` whose normal
    force is that of the wall.

    Attributes
    ----------
    gap : rule
        Distance from the surface, positive where free, metres.
    slip : rule
        Speed of the point along the surface, metres per second.
    coefficient : number, rule, or parameter of the phase
        Coulomb's coefficient.
    stiffness : number, rule, parameter of the phase, or None
        Of a soft surface, newtons per metre; None for a hard one.

    References
    ----------
    Posa, Cantu & Tedrake, A direct method for trajectory optimization of rigid bodies through contact, Int. J.
    Robotics Research 33 (2014), doi:10.1177/0278364913506757
    """

    gap: Rule
    slip: Rule
    coefficient: Quantity
    stiffness: Quantity | None = None

    def __post_init__(self) -> None:
        self._laws("contact")  # what is wrong with a constant is said here, where it was given

    def state(self, phase: Any, name: str) -> None:
        """State both laws; see `Law.state`.

        Raises
        ------
        ModelError
            When a name is taken, or a rule gives no number and no expression.
        """
        for law_name, law in self._laws(name).items():
            phase.declare(law_name, law)

    def _laws(self, name: str) -> dict[str, Law]:
        where = self.declared_at
        wall: Law = HardWall(self.gap, declared_at=where)
        if self.stiffness is not None:
            wall = SoftWall(self.gap, self.stiffness, declared_at=where)
        friction = CoulombFriction(self.slip, SignalReader(name), self.coefficient, declared_at=where)
        return {name: wall, f"{name}_tangential": friction}
