"""Nonlinear programs seen differently: without some of their rows, or with other bounds. Nothing is evaluated twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, WrappedProgram


class WithoutRows(WrappedProgram):
    """A nonlinear program without some of its rows.

    Parameters
    ----------
    nlp : NonlinearProgram
    rows : int array
        Numbers of the rows to leave out.
    """

    def __init__(self, nlp: NonlinearProgram, rows: ArrayLike) -> None:
        super().__init__(nlp)
        kept = np.ones(nlp.m, dtype=bool)
        kept[np.asarray(rows, dtype=np.intp)] = False
        self.rows = np.flatnonzero(kept)
        self.m = self.rows.size
        self.g_lower, self.g_upper = nlp.g_lower[kept], nlp.g_upper[kept]
        self.g_multipliers_start = None if nlp.g_multipliers_start is None else nlp.g_multipliers_start[kept]
        structure = nlp.jacobian_structure
        self._entries = np.flatnonzero(kept[structure[0]])
        numbers = np.cumsum(kept, dtype=np.int32) - 1
        self.jacobian_structure = (
            numbers[structure[0][self._entries]].astype(np.int32),
            structure[1][self._entries].astype(np.int32),
        )

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of the rows that are left, shape (m,)."""
        return self.nlp.constraints(x)[self.rows]

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Values of their Jacobian in the order of `jacobian_structure`."""
        return self.nlp.jacobian(x)[self._entries]

    def hessian(self, x: FloatArray, objective_factor: float, multipliers: FloatArray) -> FloatArray:
        """Values of the Hessian of objective_factor * f + multipliers @ g."""
        every = np.zeros(self.nlp.m)
        every[self.rows] = multipliers
        return self.nlp.hessian(x, objective_factor, every)


class WithBounds(WrappedProgram):
    """A nonlinear program with other bounds of its variables.

    Parameters
    ----------
    nlp : NonlinearProgram
    x_lower, x_upper : float array, shape (n,)
    """

    def __init__(self, nlp: NonlinearProgram, x_lower: FloatArray, x_upper: FloatArray) -> None:
        super().__init__(nlp)
        self.x_lower, self.x_upper = x_lower, x_upper
        self.constraints, self.jacobian, self.hessian = nlp.constraints, nlp.jacobian, nlp.hessian
