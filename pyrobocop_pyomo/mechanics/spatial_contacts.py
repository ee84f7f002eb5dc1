"""Contact of a sphere robot with a body in space: its law, its wrench and its slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError

from .contacts import RobotContact
from .planar_bodies import entries_at
from .rotations import Matrix, Vector, cross_product, inner_product, tangents_across
from .spatial_bodies import POSITION, ROTATION, SPATIAL_WRENCH, SPIN, VELOCITY, rotation_at
from .spatial_shapes import SpatialGap, SpatialShape, Sphere

TANGENTIAL = ("alpha_1", "alpha_2", "alpha_3", "alpha_4")


@dataclass(frozen=True)
class SpatialContact(RobotContact):
    """Contact between a body and a sphere robot, by complementarity, for one step of impulse mechanics.

    The unknowns on the robot's phase are mean forces over each element, newtons, and a speed: ``c`` along the normal,
    ``alpha_1`` to ``alpha_4`` along the first and the second tangent and against them, and ``slip``, the speed of
    slipping, metres per second. With the slip velocity ``w`` of the robot relative to the body at the contact point,
    its normal part ``w_n`` and its parts ``w_1``, ``w_2`` along the tangents and ``w_3 = -w_1``, ``w_4 = -w_2``, all
    kinematics at the end of the element::

        0 <= c        _|_  gap >= 0
        0 <= alpha_j  _|_  slip + w_j >= 0                          j = 1, ..., 4
        0 <= slip     _|_  friction c - sum_j alpha_j >= 0
        -tolerance <= c w_n <= tolerance

    The cone of friction is a pyramid whose four edges are the tangents: along an edge friction is at most
    ``friction c``, between two edges less, by a factor down to 0.71.

    The last row allows no force in an element in which the contact breaks. With the gap at the end of the element it
    asks more than the pairs leave free whenever the body turns; that is why it is a row with a tolerance.

    Attributes
    ----------
    body : Sphere, SpatialCapsule or SpatialBox
        Shape of the body.
    robot : Sphere
        Shape of the robot.
    friction : float
        Coulomb's coefficient between them.
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
    never_normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    _AXES = ("x", "y", "z")
    _TANGENTIAL = TANGENTIAL
    _WRENCH = SPATIAL_WRENCH
    _TWIST = (*VELOCITY, *SPIN)
    _SLIPS = ("slip_1", "slip_2")

    def __post_init__(self) -> None:
        super().__post_init__()
        length = float(np.linalg.norm(self.never_normal))
        if len(self.never_normal) != 3 or not abs(length - 1) < 1e-9:
            raise ModelError(
                f"SpatialContact: never_normal = {self.never_normal!r}; expected a direction of length one."
            )

    def gap(self, centre: Vector, position: Vector, rotation: Matrix = None) -> SpatialGap:
        """How the robot, with its centre at a place, stands to the body at a pose; see `gap_to_sphere` of shapes."""
        return self.body.gap_to_sphere(self.robot.radius, centre, position, rotation)

    def tangents(self, at: SpatialGap) -> list[Vector]:
        """First and second tangent at a contact."""
        return tangents_across(at.normal, self.never_normal)

    @property
    def _lifted(self) -> tuple[str, ...]:
        return SpatialGap._fields[:4] if self.body.is_round else SpatialGap._fields

    @property
    def _pose(self) -> tuple[str, ...]:
        return POSITION if self.body.is_round else (*POSITION, *ROTATION)

    def _gap(self, phase: Any, body: Any, t: float) -> SpatialGap:
        rotation = None if self.body.is_round else rotation_at(body, t)
        return self.gap(entries_at(phase, self._AXES, t), entries_at(body, POSITION, t), rotation)

    def _lifted_gap(self, phase: Any, t: float) -> SpatialGap:
        gap, *others = entries_at(phase, self._lifted, t)
        if self.body.is_round:
            others += [self.body.radius * n for n in others]
        return SpatialGap(gap, *others)

    def _slip(self, phase: Any, body: Any, t: float, at: SpatialGap) -> tuple[Any, list[Any]]:
        slip = slip_vector(at, entries_at(phase, ("vx", "vy", "vz"), t), entries_at(body, self._TWIST, t))
        return inner_product(at.normal, slip), [inner_product(tangent, slip) for tangent in self.tangents(at)]

    def _wrench(self, at: SpatialGap, normal: Any, tangential: list[Any]) -> list[Any]:
        return spatial_wrench_on_body(at, self.tangents(at), normal, tangential)

    def _moment(self, at: SpatialGap, force: list[Any]) -> list[Any]:
        return cross_product(at.point, force)


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
