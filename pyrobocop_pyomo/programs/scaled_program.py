"""A nonlinear program in variables, rows and an objective of size one."""

from __future__ import annotations

from .compiled_run import CompiledRun, compiled_run_of
from .nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint
from .scales import Scales


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

    def compiled_run(self, scales: Scales | None = None) -> CompiledRun | None:
        """The functions for Ipopt without Python, in these units; see `CompiledRun`."""
        return compiled_run_of(self.nlp, self.scales) if scales is None else None
