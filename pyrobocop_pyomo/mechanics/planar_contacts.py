"""Contact of a disc robot with a body in the plane: its law, its wrench and its slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .contacts import RobotContact
from .planar_bodies import POSE, TWIST, WRENCH, entries_at
from .planar_shapes import Disc, PlanarGap, PlanarShape


@dataclass(frozen=True)
class PlanarContact(RobotContact):
    """Contact between a body and a disc robot, by complementarity, for one step of impulse mechanics.

    The unknowns on the robot's phase are mean forces over each element, newtons, and a speed: ``c`` along the normal,
    ``alpha_plus`` and ``alpha_minus`` along the tangent (the normal turned left) and against it, and ``slip``, the
    speed of slipping, metres per second. With ``w``, the velocity of the robot relative to the body at the contact,
    its normal part ``w_n`` and its tangential part ``w_t``, all kinematics at the end of the element::

        0 <= c            _|_  gap >= 0
        0 <= alpha_plus   _|_  slip + w_t >= 0
        0 <= alpha_minus  _|_  slip - w_t >= 0
        0 <= slip         _|_  friction c - alpha_plus - alpha_minus >= 0
        -tolerance <= c w_n <= tolerance

    The last row allows no force in an element in which the contact breaks. With the gap at the end of the element it
    asks more than the pairs leave free whenever the body turns; that is why it is a row with a tolerance.

    Attributes
    ----------
    body : Disc, Capsule or RoundedBox
        Shape of the body.
    robot : Disc
        Shape of the robot.
    friction : float
        Coulomb's coefficient between them.
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

    _AXES = ("x", "y")
    _TANGENTIAL = ("alpha_plus", "alpha_minus")
    _WRENCH = WRENCH
    _TWIST = TWIST
    _lifted = PlanarGap._fields
    _pose = POSE

    def gap(self, x: Any, y: Any, pose: tuple[Any, Any, Any]) -> PlanarGap:
        """How the robot, with its centre at (x, y), stands to the body at a pose; see `gap_to_disc` of shapes."""
        return self.body.gap_to_disc(self.robot.radius, x, y, pose)

    def _gap(self, phase: Any, body: Any, t: float) -> PlanarGap:
        q_x, q_y, theta = entries_at(body, POSE, t)
        return self.gap(phase.x[t], phase.y[t], (q_x, q_y, theta))

    def _lifted_gap(self, phase: Any, t: float) -> PlanarGap:
        return PlanarGap(*entries_at(phase, self._lifted, t))

    def _slip(self, phase: Any, body: Any, t: float, at: PlanarGap) -> tuple[Any, list[Any]]:
        w_n, w_t = slip_velocity(at, (phase.vx[t], phase.vy[t]), tuple(entries_at(body, TWIST, t)))
        return w_n, [w_t]

    def _wrench(self, at: PlanarGap, normal: Any, tangential: list[Any]) -> list[Any]:
        return list(contact_wrench_on_body(at, normal, tangential[0]))

    def _moment(self, at: PlanarGap, force: list[Any]) -> list[Any]:
        return [at.point_x * force[1] - at.point_y * force[0]]


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
