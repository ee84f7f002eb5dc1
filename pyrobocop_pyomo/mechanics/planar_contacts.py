"""Contact of a disc robot with a body in the plane: touching, friction, restitution, and the wrench that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pyomo.core.base.expression import Expression

from pyrobocop_pyomo.complementarity import complements
from pyrobocop_pyomo.errors import DeclarationError
from pyrobocop_pyomo.phases import Algebraic, Control

from .planar_bodies import POSE, TWIST, WRENCH, PhaseNumbers, check_free, check_has, check_no_overlap, check_positive
from .planar_shapes import Disc, PlanarGap, PlanarShape

UNKNOWNS = ("c", "alpha_plus", "alpha_minus", "slip")
# A small positive start: at zero, a pair's product has no slope.
_FIRST_FORCE = 0.01


@dataclass(frozen=True)
class PlanarContact:
    """Contact between a body and a disc robot, by complementarity, for one step of impulse mechanics.

    The unknowns on the robot's phase are mean forces over each element, newtons, and a speed: ``c`` along the normal,
    ``alpha_plus`` and ``alpha_minus`` along the tangent (the normal turned left) and against it, and ``slip``, the
    speed of slipping, metres per second. With ``w``, the velocity of the robot relative to the body at the contact,
    its normal part ``w_n`` and its tangential part ``w_t``, all kinematics at the end of the element::

        0 <= c            _|_  gap >= 0
        0 <= alpha_plus   _|_  slip + w_t >= 0
        0 <= alpha_minus  _|_  slip - w_t >= 0
        0 <= slip         _|_  friction c - alpha_plus - alpha_minus >= 0
        -tolerance <= c (w_n + restitution w_n_before) <= tolerance

    The last row allows no force in an element in which the contact breaks. With the gap at the end of the element it
    asks more than the pairs leave free whenever the body turns; that is why it is a row with a tolerance.

    With restitution, the force is paired with the gap at the *start* of the element, because a robot that touches at
    the end and separates would have had to overlap before; the gap itself stays nonnegative.

    Attributes
    ----------
    body : Disc, Capsule or RoundedBox
        Shape of the body.
    robot : Disc
        Shape of the robot.
    friction : float
        Coulomb's coefficient between them.
    restitution : float
        From 0 (they stay together) to 1.
    force_limit : float
        Largest normal force, newtons.
    tolerance : float
        Of the last row, newton metres per second.

    References
    ----------
    Stewart & Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and Coulomb
    friction, Int. J. Numerical Methods in Engineering 39 (1996),
    doi:10.1002/(SICI)1097-0207(19960815)39:15<2673::AID-NME972>3.0.CO;2-I;
    Shorinwa, Devlin, Hawkes & Schwager, DisCo: Distributed Contact-Rich Trajectory Optimization for Forceful
    Multi-Robot Collaboration, 2024, arXiv:2410.23283
    """

    body: PlanarShape
    robot: Disc
    friction: float
    restitution: float = 0.0
    force_limit: float = 60.0
    tolerance: float = 0.01

    def __post_init__(self) -> None:
        check_positive(self, "friction", "force_limit", "tolerance")
        if not 0 <= self.restitution <= 1:
            raise DeclarationError(f"PlanarContact: restitution = {self.restitution!r}; expected from 0 to 1.")

    def gap(self, x: Any, y: Any, pose: tuple[Any, Any, Any]) -> PlanarGap:
        """How the robot, with its centre at (x, y), stands to the body at a pose; see `gap_to_disc` of shapes."""
        return self.body.gap_to_disc(self.robot.radius, x, y, pose)

    def state(
        self,
        phase: Any,
        body: Any,
        push: Any,
        *,
        lifted: bool = True,
        velocity_at_start: Sequence[float] = (0.0, 0.0, 0.0),
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
            Keep gap, normal and contact point as algebraic variables ``gap``, ``normal_x``, ``normal_y``,
            ``point_x``, ``point_y``: five variables more per element, and half the time per evaluation.
        velocity_at_start : (u_x, u_y, omega)
            Of the body when the phase starts; read only with restitution, and where the body is a copy.

        Raises
        ------
        DeclarationError
            When a name is taken, a phase lacks a component, grids differ, or the robot starts more than a centimetre
            inside the body.
        """
        rows = ("contact_kinematics", "contact_wrench", "contact", "no_separation", "no_overlap_at_end")
        check_free(phase, *UNKNOWNS, *(PlanarGap._fields if lifted else ()), *rows)
        check_has(phase, phase, "x", "y", "vx", "vy")
        check_has(body, phase, *POSE, *TWIST)
        check_has(push, phase, *WRENCH)
        check_no_overlap(phase, body, POSE, self._gap)

        phase.c = Control(bounds=(0, self.force_limit), initial_guess=_FIRST_FORCE)
        for name in UNKNOWNS[1:]:
            phase.declare(name, Control(bounds=(0, None), initial_guess=_FIRST_FORCE))
        if lifted:
            self._lift_kinematics(phase, body)

        def kinematics(b: Any, t: float) -> tuple[PlanarGap, Any, Any]:
            """Gap, and normal and tangential velocity of the robot relative to the body."""
            at = PlanarGap(*(getattr(b, name)[t] for name in PlanarGap._fields)) if lifted else self._gap(b, body, t)
            return at, *slip_velocity(at, (b.vx[t], b.vy[t]), tuple(getattr(body, name)[t] for name in TWIST))

        def before(b: Any, t: float) -> tuple[Any, Any]:
            """Gap and normal velocity at the start of the element."""
            boundaries = phase.grid.mesh.boundaries
            start = boundaries[phase.grid.element_of[t]]
            at = self._gap(b, body, start)
            moving = start > boundaries[0] or body.ux.index_set() is body.time
            twist = tuple(getattr(body, name)[start] for name in TWIST) if moving else tuple(velocity_at_start)
            return at.gap, slip_velocity(at, (b.vx[start], b.vy[start]), twist)[0]

        self._set_wrench(phase, push, kinematics)

        @phase.complementarity
        def contact(b: Any, t: float) -> list[Any]:
            at, _, w_t = kinematics(b, t)
            gap = before(b, t)[0] if self.restitution else at.gap
            left = self.friction * b.c[t] - b.alpha_plus[t] - b.alpha_minus[t]
            return [
                complements(b.c[t] >= 0, gap >= 0),
                complements(b.alpha_plus[t] >= 0, b.slip[t] + w_t >= 0),
                complements(b.alpha_minus[t] >= 0, b.slip[t] - w_t >= 0),
                complements(b.slip[t] >= 0, left >= 0),
            ]

        @phase.constraint
        def no_separation(b: Any, t: float) -> tuple[float, Any, float]:
            w_n = kinematics(b, t)[1]
            if self.restitution:
                w_n = w_n + self.restitution * before(b, t)[1]
            return -self.tolerance, b.c[t] * w_n, self.tolerance

        if self.restitution:

            @phase.constraint
            def no_overlap_at_end(b: Any, t: float) -> Any:
                return kinematics(b, t)[0].gap >= 0

    def _gap(self, phase: Any, body: Any, t: float) -> PlanarGap:
        return self.gap(phase.x[t], phase.y[t], tuple(getattr(body, name)[t] for name in POSE))

    def _lift_kinematics(self, phase: Any, body: Any) -> None:
        # The lifted variables start where the formulas lead from the values of the poses.
        numbers = PhaseNumbers(phase), PhaseNumbers(body)
        start = [self._gap(*numbers, t) for t in phase.points]
        for name, guess in zip(PlanarGap._fields, zip(*start, strict=True), strict=True):
            phase.declare(name, Algebraic(initial_guess=guess))

        @phase.residual
        def contact_kinematics(b: Any, t: float) -> dict[str, Any]:
            formulas = self._gap(b, body, t)._asdict()
            return {name: getattr(b, name)[t] == formula for name, formula in formulas.items()}

    def _set_wrench(self, phase: Any, push: Any, kinematics: Any) -> None:
        def wrench_on_body(b: Any, t: float) -> tuple[Any, Any, Any]:
            at, _, _ = kinematics(b, t)
            along = b.alpha_plus[t] - b.alpha_minus[t]
            return contact_wrench_on_body(at, b.c[t], along)

        if push.fx.ctype is Expression:
            for t in phase.points:
                for name, formula in zip(WRENCH, wrench_on_body(phase, t), strict=True):
                    getattr(push, name)[t].set_value(formula)
            return

        # A constraint, because what it determines belongs to another phase.
        @phase.constraint
        def contact_wrench(b: Any, t: float) -> list[Any]:
            f_x, f_y, _ = wrench_on_body(b, t)
            at, _, _ = kinematics(b, t)
            # The moment of the wrench's own force is shorter than that of its formula.
            moment = at.point_x * push.fy[t] - at.point_y * push.fx[t]
            return [push.fx[t] == f_x, push.fy[t] == f_y, push.mz[t] == moment]


def contact_wrench_on_body(at: PlanarGap, normal: Any, tangential: Any) -> tuple[Any, Any, Any]:
    """What the body gets: the force on the robot turned around, and its moment about the body's origin.

    Parameters
    ----------
    at : PlanarGap
    normal, tangential : number, array or expression
        Force on the robot along the normal and along the normal turned left, newtons.

    Returns
    -------
    (f_x, f_y, m_z) : tuple
        Newtons, newton metres.
    """
    f_x = tangential * at.normal_y - normal * at.normal_x
    f_y = -(tangential * at.normal_x + normal * at.normal_y)
    return f_x, f_y, at.point_x * f_y - at.point_y * f_x


def slip_velocity(at: PlanarGap, robot: tuple[Any, Any], body: tuple[Any, ...]) -> tuple[Any, Any]:
    """Normal and tangential velocity of the robot relative to the body at the contact point."""
    w_x = robot[0] - (body[0] - body[2] * at.point_y)
    w_y = robot[1] - (body[1] + body[2] * at.point_x)
    return at.normal_x * w_x + at.normal_y * w_y, at.normal_x * w_y - at.normal_y * w_x
