"""Contact of a round robot with a body in the plane or in space: its law, its wrench and its slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.expression import Expression

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.geometry.poses import dot
from pyrobocop_pyomo.phases import Algebraic, Control

from .bodies import (
    PhaseNumbers,
    check_free,
    check_has,
    check_no_overlap,
    check_positive,
    entries_at,
)
from .rotations import Matrix, Vector, cross_product, rotation_rows, tangents_across
from .shapes import Disc, Gap, PlanarShape, SpatialShape, Sphere

# A small positive start: at zero, a pair's product has no slope.
_FIRST_FORCE = 0.01


@dataclass(frozen=True)
class RobotContact:
    """Contact between a body and a disc or sphere robot, by complementarity, for one step of impulse mechanics.

    The unknowns on the robot's phase are mean forces over each element, newtons, and a speed: ``c`` along the normal,
    ``alpha_plus`` and ``alpha_minus`` along the tangent (the normal turned left) and against it, in space ``alpha_1``
    to ``alpha_4`` along the first and the second tangent and against them, and ``slip``, the speed of slipping, metres
    per second. With ``w``, the velocity of the robot relative to the body at the contact point, its normal part
    ``w_n`` and its part ``w_j`` in the direction of ``alpha_j``, all kinematics at the end of the element::

        0 <= c        _|_  gap >= 0
        0 <= alpha_j  _|_  slip + w_j >= 0
        0 <= slip     _|_  friction c - sum_j alpha_j >= 0
        -tolerance <= c w_n <= tolerance

    In space the cone of friction is a pyramid whose four edges are the tangents: along an edge friction is at most
    ``friction c``, between two edges less, by a factor down to 0.71.

    The last row allows no force in an element in which the contact breaks. With the gap at the end of the element it
    asks more than the pairs leave free whenever the body turns; that is why it is a row with a tolerance.

    Attributes
    ----------
    body : Disc, Sphere, Capsule or RoundedBox
        Shape of the body.
    robot : Disc or Sphere
        Shape of the robot.
    friction : float
        Coulomb's coefficient between them.
    force_limit : float
        Largest normal force, newtons.
    tolerance : float
        Of the last row, newton metres per second.
    never_normal : (x, y, z)
        In space the one direction that the normal must stay away from, because the tangents turn without end around
        it: straight up by default, where a robot would stand on top of the body.

    References
    ----------
    Stewart & Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and Coulomb
    friction, Int. J. Numerical Methods in Engineering 39 (1996),
    doi:10.1002/(SICI)1097-0207(19960815)39:15<2673::AID-NME972>3.0.CO;2-I;
    Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful
    Multi-Robot Collaboration, 2024, arXiv:2410.23283
    """

    body: PlanarShape | SpatialShape
    robot: Disc | Sphere
    friction: float
    force_limit: float = 60.0
    tolerance: float = 0.01
    never_normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_positive(self, "friction", "force_limit", "tolerance")
        length = float(np.linalg.norm(self.never_normal))
        if len(self.never_normal) != 3 or not abs(length - 1) < 1e-9:
            raise ModelError(f"contact: never_normal = {self.never_normal!r}; expected a direction of length one.")

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
        names = self.body.names
        kept = self._lifted
        rows = ("contact_kinematics", "contact_wrench", "contact", "no_separation")
        check_free(phase, "c", *names.tangential, "slip", *kept, *rows)
        check_has(phase, phase, *names.axes, *self._speeds)
        check_has(body, phase, *self._pose, *names.twist)
        check_has(push, phase, *names.wrench)
        check_no_overlap(phase, body, self._pose, self._gap_formulas)

        phase.c = Control(bounds=(0, self.force_limit), initial_guess=_FIRST_FORCE)
        for name in (*names.tangential, "slip"):
            phase.declare(name, Control(bounds=(0, None), initial_guess=_FIRST_FORCE))
        # The lifted variables start where the formulas lead from the values of the poses.
        numbers = PhaseNumbers(phase), PhaseNumbers(body)
        start = [self._formulas(*numbers, t) for t in phase.points]
        for name, guess in zip(kept, zip(*start, strict=True), strict=True):
            phase.declare(name, Algebraic(initial_guess=guess))

        @phase.residual
        def contact_kinematics(b: Any, t: float) -> dict[str, Any]:
            formulas = self._formulas(b, body, t)
            return {name: getattr(b, name)[t] == formula for name, formula in zip(kept, formulas, strict=True)}

        self._set_wrench(phase, push)

        @phase.complementarity
        def contact(b: Any, t: float) -> list[Any]:
            at, alphas = self._lifted_gap(b, t), entries_at(b, names.tangential, t)
            slips = self._velocity_at(b, body, t, at)[1:]
            return [
                complements(b.c[t] >= 0, at.gap >= 0),
                *(complements(a >= 0, b.slip[t] + w >= 0) for a, w in zip(alphas, slips, strict=False)),
                *(complements(a >= 0, b.slip[t] - w >= 0) for a, w in zip(alphas[len(slips) :], slips, strict=True)),
                complements(b.slip[t] >= 0, self.friction * b.c[t] - sum(alphas) >= 0),
            ]

        @phase.constraint
        def no_separation(b: Any, t: float) -> tuple[float, Any, float]:
            return -self.tolerance, b.c[t] * self._velocity_at(b, body, t, self._lifted_gap(b, t))[0], self.tolerance

    def gap(self, centre: Vector, position: Vector, rotation: Matrix | None = None) -> Gap:
        """How the robot, with its centre at a place, stands to the body at a pose; see `RoundedShape.gap_to_ball`."""
        return self.body.gap_to_ball(self.robot.radius, centre, position, rotation)

    def tangents(self, at: Gap) -> list[Vector]:
        """Tangents at a contact: in the plane the normal turned left, in space the first and the second."""
        if len(at.normal) == 2:
            return [[-at.normal[1], at.normal[0]]]
        return tangents_across(at.normal, self.never_normal)

    def wrench_on_body(self, at: Gap, normal: Any, tangential: Vector) -> list[Any]:
        """What the body gets: the force on the robot turned around, and its moment about the body's origin.

        Parameters
        ----------
        at : Gap
        normal : number, array or expression
            Force on the robot along the normal, newtons.
        tangential : numbers, arrays or expressions
            Force on the robot along each tangent, newtons.
        """
        force = [-normal * n for n in at.normal]
        for tangent, share in zip(self.tangents(at), tangential, strict=True):
            force = [f - share * entry for f, entry in zip(force, tangent, strict=True)]
        return [*force, *cross_product(at.point, force)]

    def velocity(self, at: Gap, robot: Vector, twist: Vector) -> list[Any]:
        """Of the robot relative to the body at the contact point: along the normal, and along each tangent."""
        carried = cross_product(twist[len(robot) :], at.point)
        apart = [v - (u + w) for v, u, w in zip(robot, twist, carried, strict=False)]
        return [dot(axis, apart) for axis in (at.normal, *self.tangents(at))]

    @property
    def _speeds(self) -> list[str]:
        return [f"v{axis}" for axis in self.body.names.axes]

    @property
    def _lifted(self) -> list[str]:
        """Names of the entries of a gap that are variables: the contact point of a round body follows its normal."""
        vectors = ("normal",) if self.body.is_round else ("normal", "point")
        return ["gap", *(f"{vector}_{axis}" for vector in vectors for axis in self.body.names.axes)]

    @property
    def _pose(self) -> tuple[str, ...]:
        """Names of what the gap reads of the body."""
        return self.body.names.position + (() if self.body.is_round else self.body.names.orientation)

    def _gap_formulas(self, phase: Any, body: Any, t: float) -> Gap:
        names = self.body.names
        rotation = None if self.body.is_round else rotation_rows(entries_at(body, names.orientation, t))
        return self.gap(entries_at(phase, names.axes, t), entries_at(body, names.position, t), rotation)

    def _lifted_gap(self, phase: Any, t: float) -> Gap:
        """The gap in its variables."""
        gap, *others = entries_at(phase, self._lifted, t)
        normal = others[: len(self.body.names.axes)]
        return Gap(gap, normal, others[len(normal) :] or [self.body.radius * n for n in normal])

    def _velocity_at(self, phase: Any, body: Any, t: float, at: Gap) -> list[Any]:
        return self.velocity(at, entries_at(phase, self._speeds, t), entries_at(body, self.body.names.twist, t))

    def _formulas(self, phase: Any, body: Any, t: float) -> list[Any]:
        """Of the lifted variables."""
        at = self._gap_formulas(phase, body, t)
        return [at.gap, *at.normal, *at.point][: len(self._lifted)]

    def _set_wrench(self, phase: Any, push: Any) -> None:
        names = self.body.names
        axes = len(names.axes)

        def wrench_on_body(b: Any, t: float) -> list[Any]:
            alphas = entries_at(b, names.tangential, t)
            along = [forward - back for forward, back in zip(alphas[: axes - 1], alphas[axes - 1 :], strict=True)]
            return self.wrench_on_body(self._lifted_gap(b, t), b.c[t], along)

        if push.fx.ctype is Expression:
            for t in phase.points:
                for name, formula in zip(names.wrench, wrench_on_body(phase, t), strict=True):
                    getattr(push, name)[t].set_value(formula)
            return

        # A constraint, because what it determines belongs to another phase.
        @phase.constraint
        def contact_wrench(b: Any, t: float) -> dict[str, Any]:
            # The moment of the wrench's own force is shorter than the moment of its formula.
            moment = cross_product(self._lifted_gap(b, t).point, entries_at(push, names.wrench[:axes], t))
            formulas = [*wrench_on_body(b, t)[:axes], *moment]
            return {name: getattr(push, name)[t] == f for name, f in zip(names.wrench, formulas, strict=True)}
