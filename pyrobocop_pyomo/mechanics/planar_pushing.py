"""Quasi-static pushing in the plane: a slider on a table, one point contact, an ellipsoidal limit surface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pyomo.core.expr import cos, sin


@dataclass(frozen=True)
class SquareSlider:
    """A square slider that moves as slowly as it is pushed: inertia does not matter, friction with the table does.

    The limit surface, which bounds the friction wrench, is taken as an ellipsoid. The body twist is then linear
    in the contact wrench, ``(v_x, v_y, omega) = L w`` with ``L = diag(c, c, c / r^2)`` and ``c = 1 / (mu m g)^2``.

    Attributes
    ----------
    half_side : float
        Half the side, metres.
    mass : float
        Kilograms.
    table_friction : float
        Coefficient of friction with the table.
    gravity : float
        Metres per second squared.

    References
    ----------
    Lynch, Maekawa & Tanie, Manipulation and active sensing by pushing using tactile feedback, IROS 1992,
    doi:10.1109/IROS.1992.587370;
    Raghunathan, Jha & Romeres, ICRA 2022, sec. V-C, doi:10.1109/ICRA46639.2022.9812069
    """

    half_side: float = 0.045
    mass: float = 0.5
    table_friction: float = 0.5
    gravity: float = 9.81

    @property
    def mean_distance(self) -> float:
        """Mean distance of the square's points from its centre, metres: the lever arm of table friction."""
        return 2 * self.half_side / 6 * (math.sqrt(2) + math.asinh(1))

    def velocity(self, theta: Any, contact: tuple[Any, Any], force: tuple[Any, Any]) -> tuple[Any, Any, Any]:
        """World velocity of the slider under a contact force.

        Plain arithmetic: numbers give numbers, Pyomo variables give expressions.

        Parameters
        ----------
        theta : float or expression
            Rotation of the slider, radians.
        contact : (x, y)
            Contact point in the slider's frame, metres.
        force : (f_x, f_y)
            Contact force in the slider's frame, newtons.

        Returns
        -------
        (v_x, v_y, omega) : tuple
            Rates of the pose in the world frame.
        """
        f_x, f_y = force
        largest = self.table_friction * self.mass * self.gravity
        body_x, body_y = f_x / largest**2, f_y / largest**2
        omega = (contact[0] * f_y - contact[1] * f_x) / (largest * self.mean_distance) ** 2
        return cos(theta) * body_x - sin(theta) * body_y, sin(theta) * body_x + cos(theta) * body_y, omega
