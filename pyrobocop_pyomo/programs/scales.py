"""Sizes that a program is divided by, and points in both units."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint


@dataclass(frozen=True, eq=False)
class Scales:
    r"""Sizes that variables, rows and the objective are divided by.

    With :math:`x = S \hat x`, :math:`g = R \hat g` and :math:`f = \varphi \hat f`, the multipliers of the rows are
    :math:`\lambda = \varphi R^{-1} \hat\lambda`, those of bounds :math:`z = \varphi S^{-1} \hat z`.

    Attributes
    ----------
    x : float array, shape (n,)
    g : float array, shape (m,)
    objective : float
    """

    x: FloatArray
    g: FloatArray
    objective: float

    def scaled(self, point: PrimalDualPoint) -> PrimalDualPoint:
        """A point of the program as one of the scaled program."""
        rows, lower, upper = point.g_multipliers, point.lower_multipliers, point.upper_multipliers
        return PrimalDualPoint(
            point.x / self.x,
            None if rows is None else rows * (self.g / self.objective),
            None if lower is None else lower * (self.x / self.objective),
            None if upper is None else upper * (self.x / self.objective),
        )

    def unscaled(self, point: PrimalDualPoint, nlp: NonlinearProgram) -> PrimalDualPoint:
        """A point of the scaled program as one of the program `nlp`, within its bounds.

        What is on a bound stays there, and what Ipopt lets pass it, by parts of a size, is put there: a bound at zero
        has no size in the units of the user.
        """
        x = np.clip(self.x * point.x, nlp.x_lower, nlp.x_upper)
        for bound in (nlp.x_lower, nlp.x_upper):
            held = np.isfinite(bound) & (np.abs(x - bound) <= 4 * np.finfo(float).eps * np.abs(x))
            x = np.where(held, bound, x)
        rows, lower, upper = point.g_multipliers, point.lower_multipliers, point.upper_multipliers
        return replace(
            point,
            x=x,
            g_multipliers=None if rows is None else rows * (self.objective / self.g),
            lower_multipliers=None if lower is None else lower * (self.objective / self.x),
            upper_multipliers=None if upper is None else upper * (self.objective / self.x),
        )
