"""Contact of a sphere robot with a body in space: touching, friction, restitution, and the wrench that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.expression import Expression

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import DeclarationError
from pyrobocop_pyomo.phases import Algebraic, Control

from .planar_bodies import PhaseNumbers, check_free, check_has, check_no_overlap, check_positive
from .rotations import Matrix, Vector, cross_product, inner_product, tangents_across
from .spatial_bodies import POSITION, ROTATION, SPATIAL_WRENCH, SPIN, VELOCITY, entries_at, rotation_at
from .spatial_shapes import SpatialGap, SpatialShape, Sphere

TANGENTIAL = ("alpha_1", "alpha_2", "alpha_3", "alpha_4")
# A small positive start: at zero, a pair's product has no slope.
_FIRST_FORCE = 0.01


@dataclass(frozen=True)
class SpatialContact:
    """Contact between a body and a sphere robot, by complementarity, for one step of impulse mechanics.

    The unknowns on the robot's phase are mean forces over each element, newtons, and a speed: ``c`` along the normal,
    ``alpha_1`` to ``alpha_4`` along the first and the second tangent and against them, and ``slip``, the speed of
    slipping, metres per second. With the slip velocity ``w`` of the robot relative to the body at the contact point,
    its normal part ``w_n`` and its parts ``w_1``, ``w_2`` along the tangents and ``w_3 = -w_1``, ``w_4 = -w_2``, all
    kinematics at the end of the element::

        0 <= c        _|_  gap >= 0
        0 <= alpha_j  _|_  slip + w_j >= 0                          j = 1, ..., 4
        0 <= slip     _|_  friction c - sum_j alpha_j >= 0
        -tolerance <= c (w_n + restitution w_n_before) <= tolerance

    The cone of friction is a pyramid whose four edges are the tangents: along an edge friction is at most
    ``friction c``, between two edges less, by a factor down to 0.71.

    The last row allows no force in an element in which the contact breaks. With the gap at the end of the element it
    asks more than the pairs leave free whenever the body turns; that is why it is a row with a tolerance.

    With restitution, the force is paired with the gap at the *start* of the element, because a robot that touches at
    the end and separates would have had to overlap before; the gap itself stays nonnegative.

    Attributes
    ----------
    body : Sphere, SpatialCapsule or SpatialBox
        Shape of the body.
    robot : Sphere
        Shape of the robot.
    friction : float
        Coulomb's coefficient between them.
    restitution : float
        From 0 (they stay together) to 1.
    force_limit : float
        Largest normal force, newtons.
    tolerance : float
        Of the last row, newton metres per second.
    never_normal : (x, y, z)
        The one direction that the normal must stay away from, because the tangents turn without end around it: straight
        up by default, where a robot would stand on top of the body.

    References
    ----------
    Stewart & Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and Coulomb
    friction, Int. J. Numerical Methods in Engineering 39 (1996),
    doi:10.1002/(SICI)1097-0207(19960815)39:15<2673::AID-NME972>3.0.CO;2-I;
    Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful
    Multi-Robot Collaboration, 2024, arXiv:2410.23283
    """

    body: SpatialShape
    robot: Sphere
    friction: float
    restitution: float = 0.0
    force_limit: float = 60.0
    tolerance: float = 0.01
    never_normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_positive(self, "friction", "force_limit", "tolerance")
        if not 0 <= self.restitution <= 1:
            raise DeclarationError(f"SpatialContact: restitution = {self.restitution!r}; expected from 0 to 1.")
        length = float(np.linalg.norm(self.never_normal))
        if len(self.never_normal) != 3 or not abs(length - 1) < 1e-9:
            raise DeclarationError(
                f"SpatialContact: never_normal = {self.never_normal!r}; expected a direction of length one."
            )

    def gap(self, centre: Vector, position: Vector, rotation: Matrix = None) -> SpatialGap:
        """How the robot, with its centre at a place, stands to the body at a pose; see `gap_to_sphere` of shapes."""
        return self.body.gap_to_sphere(self.robot.radius, centre, position, rotation)

    def tangents(self, at: SpatialGap) -> list[Vector]:
        """First and second tangent at a contact."""
        return tangents_across(at.normal, self.never_normal)

    def state(
        self,
        phase: Any,
        body: Any,
        push: Any,
        *,
        lifted: bool = True,
        velocity_at_start: Sequence[float] = (0.0,) * 6,
    ) -> None:
        """State contact of a robot with a body, and the wrench of the robot on the body.

        Parameters
        ----------
        phase : PhaseBlock
            With the motion of the robot; gets the unknowns, pairs and rows.
        body : PhaseBlock
            With the motion of the body, or a kinematic copy, on the same grid.
        push : PhaseBlock
            With the wrench, on the same grid; its variables get a row each, its expressions are set.
        lifted : bool
            Keep gap, normal, contact point and the tangents' slip velocities as algebraic variables: ``gap``,
            ``normal_x`` to ``normal_z``, ``slip_1``, ``slip_2``, and ``point_x`` to ``point_z`` unless the body is
            round.
        velocity_at_start : (u_x, u_y, u_z, w_x, w_y, w_z)
            Of the body when the phase starts; read only with restitution, and where the body is a copy.

        Raises
        ------
        DeclarationError
            When a name is taken, a phase lacks a component, grids differ, or the robot starts more than a centimetre
            inside the body.
        """
        kept = self._lifted_names if lifted else ()
        rows = ("contact_kinematics", "contact_wrench", "contact", "no_separation", "no_overlap_at_end")
        check_free(phase, "c", *TANGENTIAL, "slip", *kept, *rows)
        check_has(phase, phase, "x", "y", "z", "vx", "vy", "vz")
        check_has(body, phase, *POSITION, *VELOCITY, *SPIN, *(() if self.body.is_round else ROTATION))
        check_has(push, phase, *SPATIAL_WRENCH)
        check_no_overlap(phase, body, POSITION if self.body.is_round else (*POSITION, *ROTATION), self._gap)

        phase.c = Control(bounds=(0, self.force_limit), initial_guess=_FIRST_FORCE)
        for name in (*TANGENTIAL, "slip"):
            phase.declare(name, Control(bounds=(0, None), initial_guess=_FIRST_FORCE))
        if lifted:
            self._lift_kinematics(phase, body)

        def gap(b: Any, t: float) -> SpatialGap:
            if not lifted:
                return self._gap(b, body, t)
            normal = entries_at(b, ("normal_x", "normal_y", "normal_z"), t)
            if self.body.is_round:
                return SpatialGap(b.gap[t], *normal, *(self.body.radius * n for n in normal))
            return SpatialGap(b.gap[t], *normal, *entries_at(b, ("point_x", "point_y", "point_z"), t))

        def slips(b: Any, t: float) -> list[Any]:
            return [b.slip_1[t], b.slip_2[t]] if lifted else self._tangential_slips(b, body, t, gap(b, t))

        def before(b: Any, t: float) -> tuple[Any, Any]:
            """Gap and normal velocity at the start of the element."""
            boundaries = phase.grid.mesh.boundaries
            start = boundaries[phase.grid.element_of[t]]
            at = self._gap(b, body, start)
            moving = start > boundaries[0] or body.ux.index_set() is body.time
            twist = entries_at(body, (*VELOCITY, *SPIN), start) if moving else list(velocity_at_start)
            return at.gap, inner_product(at.normal, slip_vector(at, entries_at(b, ("vx", "vy", "vz"), start), twist))

        self._set_wrench(phase, push, gap)

        @phase.complementarity
        def contact(b: Any, t: float) -> list[Any]:
            paired = before(b, t)[0] if self.restitution else gap(b, t).gap
            w_1, w_2 = slips(b, t)
            alphas = entries_at(b, TANGENTIAL, t)
            return [
                complements(b.c[t] >= 0, paired >= 0),
                *(complements(a >= 0, b.slip[t] + w >= 0) for a, w in zip(alphas, (w_1, w_2, -w_1, -w_2), strict=True)),
                complements(b.slip[t] >= 0, self.friction * b.c[t] - sum(alphas) >= 0),
            ]

        @phase.constraint
        def no_separation(b: Any, t: float) -> tuple[float, Any, float]:
            at = gap(b, t)
            w_n = inner_product(at.normal, self._slip(b, body, t, at))
            if self.restitution:
                w_n = w_n + self.restitution * before(b, t)[1]
            return -self.tolerance, b.c[t] * w_n, self.tolerance

        if self.restitution:

            @phase.constraint
            def no_overlap_at_end(b: Any, t: float) -> Any:
                return gap(b, t).gap >= 0

    @property
    def _lifted_names(self) -> tuple[str, ...]:
        names = SpatialGap._fields[:4] if self.body.is_round else SpatialGap._fields
        return (*names, "slip_1", "slip_2")

    def _gap(self, phase: Any, body: Any, t: float) -> SpatialGap:
        rotation = None if self.body.is_round else rotation_at(body, t)
        return self.gap(entries_at(phase, ("x", "y", "z"), t), entries_at(body, POSITION, t), rotation)

    @staticmethod
    def _slip(phase: Any, body: Any, t: float, at: SpatialGap) -> list[Any]:
        return slip_vector(at, entries_at(phase, ("vx", "vy", "vz"), t), entries_at(body, (*VELOCITY, *SPIN), t))

    def _tangential_slips(self, phase: Any, body: Any, t: float, at: SpatialGap) -> list[Any]:
        slip = self._slip(phase, body, t, at)
        return [inner_product(tangent, slip) for tangent in self.tangents(at)]

    def _lift_kinematics(self, phase: Any, body: Any) -> None:
        # The lifted variables start where the formulas lead from the values of the poses.
        names = self._lifted_names
        numbers = PhaseNumbers(phase), PhaseNumbers(body)
        start = []
        for t in phase.points:
            at = self._gap(*numbers, t)
            start.append([*at[: len(names) - 2], *self._tangential_slips(*numbers, t, at)])
        for name, guess in zip(names, zip(*start, strict=True), strict=True):
            phase.declare(name, Algebraic(initial_guess=guess))

        @phase.residual
        def contact_kinematics(b: Any, t: float) -> dict[str, Any]:
            formulas = list(self._gap(b, body, t))[: len(names) - 2]
            normal = entries_at(b, ("normal_x", "normal_y", "normal_z"), t)
            point = [self.body.radius * n for n in normal] if self.body.is_round else entries_at(b, names[4:7], t)
            formulas += self._tangential_slips(b, body, t, SpatialGap(b.gap[t], *normal, *point))
            return {name: getattr(b, name)[t] == formula for name, formula in zip(names, formulas, strict=True)}

    def _set_wrench(self, phase: Any, push: Any, gap: Any) -> None:
        def wrench_on_body(b: Any, t: float) -> tuple[SpatialGap, list[Any]]:
            at = gap(b, t)
            a_1, a_2, a_3, a_4 = entries_at(b, TANGENTIAL, t)
            return at, spatial_wrench_on_body(at, self.tangents(at), b.c[t], (a_1 - a_3, a_2 - a_4))

        if push.fx.ctype is Expression:
            for t in phase.points:
                for name, formula in zip(SPATIAL_WRENCH, wrench_on_body(phase, t)[1], strict=True):
                    getattr(push, name)[t].set_value(formula)
            return

        # A constraint, because what it determines belongs to another phase.
        @phase.constraint
        def contact_wrench(b: Any, t: float) -> dict[str, Any]:
            at, wrench = wrench_on_body(b, t)
            # The moment of the wrench's own force is shorter than that of its formula.
            moment = cross_product(at.point, entries_at(push, SPATIAL_WRENCH[:3], t))
            formulas = [*wrench[:3], *moment]
            return {name: getattr(push, name)[t] == f for name, f in zip(SPATIAL_WRENCH, formulas, strict=True)}


def spatial_wrench_on_body(at: SpatialGap, tangents: Sequence[Vector], normal: Any, tangential: Vector) -> list[Any]:
    """What the body gets: the force on the robot turned around, and its moment about the body's origin.

    Parameters
    ----------
    at : SpatialGap
    tangents : two directions
    normal : number, array or expression
        Force on the robot along the normal, newtons.
    tangential : two numbers, arrays or expressions
        Force on the robot along the tangents, newtons.

    Returns
    -------
    [f_x, f_y, f_z, m_x, m_y, m_z] : list
        Newtons, newton metres.
    """
    (t_1, t_2), (a_1, a_2) = tangents, tangential
    force = [-(normal * n + a_1 * p + a_2 * q) for n, p, q in zip(at.normal, t_1, t_2, strict=True)]
    return [*force, *cross_product(at.point, force)]


def slip_vector(at: SpatialGap, robot: Vector, body: Sequence[Any]) -> list[Any]:
    """Velocity of the robot relative to the body at the contact point, for the body's velocity and angular velocity."""
    carried = cross_product(body[3:], at.point)
    return [v - u - w for v, u, w in zip(robot, body[:3], carried, strict=True)]
