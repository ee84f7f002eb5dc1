"""A nonlinear program in variables, rows and an objective of size one, and the way between both."""

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
        """A point of the scaled program as one of the program `nlp`; what is on a bound stays there."""
        x = self.x * point.x
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


class ScaledProgram:
    """See `NonlinearProgram`: another one, in the units of `scales`.

    Parameters
    ----------
    nlp : NonlinearProgram
        May change between evaluations, as `ShiftedRows` does.
    scales : Scales
    """

    def __init__(self, nlp: NonlinearProgram, scales: Scales) -> None:
        self.nlp, self.scales = nlp, scales
        self.derivatives = nlp.derivatives
        self.n, self.m = nlp.n, nlp.m
        self.x_lower, self.x_upper = nlp.x_lower / scales.x, nlp.x_upper / scales.x
        self.g_lower, self.g_upper = nlp.g_lower / scales.g, nlp.g_upper / scales.g
        start = scales.scaled(PrimalDualPoint(nlp.x_start, nlp.g_multipliers_start))
        self.x_start, self.g_multipliers_start = start.x, start.g_multipliers
        self.jacobian_structure, self.hessian_structure = nlp.jacobian_structure, nlp.hessian_structure
        rows, columns = nlp.jacobian_structure
        self._jacobian_factors = scales.x[columns] / scales.g[rows]
        rows, columns = nlp.hessian_structure
        self._hessian_factors = scales.x[rows] * scales.x[columns]

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return self.nlp.objective(self.scales.x * x) / self.scales.objective

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f, shape (n,)."""
        return self.nlp.gradient(self.scales.x * x) * (self.scales.x / self.scales.objective)

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g, shape (m,)."""
        return self.nlp.constraints(self.scales.x * x) / self.scales.g

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of the Jacobian of g in the order of `jacobian_structure`."""
        return self.nlp.jacobian(self.scales.x * x) * self._jacobian_factors

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of the Lagrangian in the order of `hessian_structure`."""
        values = self.nlp.hessian(
            self.scales.x * x, objective_factor / self.scales.objective, multipliers / self.scales.g
        )
        return values * self._hessian_factors
