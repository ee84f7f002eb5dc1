"""Contact of a round robot with a body: touching, friction and the wrench, the same in the plane and in space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from pyomo.core.base.expression import Expression

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.phases import Algebraic, Control

from .planar_bodies import PhaseNumbers, check_free, check_has, check_no_overlap, check_positive, entries_at

# A small positive start: at zero, a pair's product has no slope.
_FIRST_FORCE = 0.01


@dataclass(frozen=True)
class RobotContact(ABC):
    """What `PlanarContact` and `SpatialContact` state; they say how vectors are written.

    Attributes
    ----------
    body, robot : shapes
    friction : float
        Coulomb's coefficient between them.
    force_limit : float
        Largest normal force, newtons.
    tolerance : float
        Of the row that allows no force in an element in which the contact breaks, newton metres per second.
    """

    body: Any
    robot: Any
    friction: float
    force_limit: float = 60.0
    tolerance: float = 0.01

    # Coordinates and speeds of the robot, its forces along the tangents and against them, wrench and twist of the body.
    _AXES: ClassVar[tuple[str, ...]]
    _TANGENTIAL: ClassVar[tuple[str, ...]]
    _WRENCH: ClassVar[tuple[str, ...]]
    _TWIST: ClassVar[tuple[str, ...]]
    # Speeds along the tangents that are variables of their own, where their formulas are long.
    _SLIPS: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        check_positive(self, "friction", "force_limit", "tolerance")

    def state(self, phase: Any, body: Any, push: Any) -> None:
        """State contact of a robot with a body, and the wrench of the robot on the body.

        Parameters
        ----------
        phase : PhaseBlock
            With the motion of the robot; gets the unknowns, pairs and rows, and gap, normal and contact point as
            algebraic variables: each formula is then evaluated once.
        body : PhaseBlock
            With the motion of the body, or a kinematic copy, on the same grid.
        push : PhaseBlock
            With the wrench, on the same grid; its variables get a row each, its expressions are set.

        Raises
        ------
        ModelError
            When a name is taken, a phase lacks a component, grids differ, or the robot starts more than a centimetre
            inside the body.
        """
        kept = (*self._lifted, *self._SLIPS)
        rows = ("contact_kinematics", "contact_wrench", "contact", "no_separation")
        check_free(phase, "c", *self._TANGENTIAL, "slip", *kept, *rows)
        check_has(phase, phase, *self._AXES, *(f"v{axis}" for axis in self._AXES))
        check_has(body, phase, *self._pose, *self._TWIST)
        check_has(push, phase, *self._WRENCH)
        check_no_overlap(phase, body, self._pose, self._gap)

        phase.c = Control(bounds=(0, self.force_limit), initial_guess=_FIRST_FORCE)
        for name in (*self._TANGENTIAL, "slip"):
            phase.declare(name, Control(bounds=(0, None), initial_guess=_FIRST_FORCE))
        # The lifted variables start where the formulas lead from the values of the poses.
        numbers = PhaseNumbers(phase), PhaseNumbers(body)
        start = [self._formulas(*numbers, t, self._gap(*numbers, t)) for t in phase.points]
        for name, guess in zip(kept, zip(*start, strict=True), strict=True):
            phase.declare(name, Algebraic(initial_guess=guess))

        @phase.residual
        def contact_kinematics(b: Any, t: float) -> dict[str, Any]:
            formulas = self._formulas(b, body, t, self._lifted_gap(b, t))
            return {name: getattr(b, name)[t] == formula for name, formula in zip(kept, formulas, strict=True)}

        self._set_wrench(phase, push)

        @phase.complementarity
        def contact(b: Any, t: float) -> list[Any]:
            at, alphas = self._lifted_gap(b, t), entries_at(b, self._TANGENTIAL, t)
            slips = entries_at(b, self._SLIPS, t) or self._slip(b, body, t, at)[1]
            return [
                complements(b.c[t] >= 0, at.gap >= 0),
                *(complements(a >= 0, b.slip[t] + w >= 0) for a, w in zip(alphas, slips, strict=False)),
                *(complements(a >= 0, b.slip[t] - w >= 0) for a, w in zip(alphas[len(slips) :], slips, strict=True)),
                complements(b.slip[t] >= 0, self.friction * b.c[t] - sum(alphas) >= 0),
            ]

        @phase.constraint
        def no_separation(b: Any, t: float) -> tuple[float, Any, float]:
            return -self.tolerance, b.c[t] * self._slip(b, body, t, self._lifted_gap(b, t))[0], self.tolerance

    def _formulas(self, phase: Any, body: Any, t: float, at: Any) -> list[Any]:
        """Of the lifted variables; slips at a gap whose entries may be variables."""
        formulas = list(self._gap(phase, body, t))[: len(self._lifted)]
        return formulas + (self._slip(phase, body, t, at)[1] if self._SLIPS else [])

    def _set_wrench(self, phase: Any, push: Any) -> None:
        def wrench_on_body(b: Any, t: float) -> list[Any]:
            alphas = entries_at(b, self._TANGENTIAL, t)
            half = len(alphas) // 2
            along = [forward - back for forward, back in zip(alphas[:half], alphas[half:], strict=True)]
            return self._wrench(self._lifted_gap(b, t), b.c[t], along)

        if push.fx.ctype is Expression:
            for t in phase.points:
                for name, formula in zip(self._WRENCH, wrench_on_body(phase, t), strict=True):
                    getattr(push, name)[t].set_value(formula)
            return

        # A constraint, because what it determines belongs to another phase.
        @phase.constraint
        def contact_wrench(b: Any, t: float) -> dict[str, Any]:
            axes = len(self._AXES)
            # The moment of the wrench's own force is shorter than that of its formula.
            moment = self._moment(self._lifted_gap(b, t), entries_at(push, self._WRENCH[:axes], t))
            formulas = [*wrench_on_body(b, t)[:axes], *moment]
            return {name: getattr(push, name)[t] == f for name, f in zip(self._WRENCH, formulas, strict=True)}

    @property
    @abstractmethod
    def _lifted(self) -> tuple[str, ...]:
        """Names of the entries of a gap that are variables."""

    @property
    @abstractmethod
    def _pose(self) -> tuple[str, ...]:
        """Names of what the gap reads of the body."""

    @abstractmethod
    def _gap(self, phase: Any, body: Any, t: float) -> Any:
        """The formulas of the gap."""

    @abstractmethod
    def _lifted_gap(self, phase: Any, t: float) -> Any:
        """The gap in its variables."""

    @abstractmethod
    def _slip(self, phase: Any, body: Any, t: float, at: Any) -> tuple[Any, list[Any]]:
        """Velocity of the robot relative to the body at the contact: along the normal, and along each tangent."""

    @abstractmethod
    def _wrench(self, at: Any, normal: Any, tangential: list[Any]) -> list[Any]:
        """What the body gets of forces on the robot along the normal and the tangents."""

    @abstractmethod
    def _moment(self, at: Any, force: list[Any]) -> list[Any]:
        """Of a force at the contact point, about the origin of the body."""
