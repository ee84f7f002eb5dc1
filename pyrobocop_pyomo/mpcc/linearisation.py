"""First derivatives of a nonlinear program at a point, as sparse arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Linearisation:
    """What a nonlinear program looks like from one point.

    Attributes
    ----------
    nlp : NonlinearProgram
    x : float array, shape (n,)
    gradient : float array, shape (n,)
        Of the objective.
    rows : float array, shape (m,)
        Values of the constraints.
    jacobian : sparse array, shape (m, n)
    """

    nlp: NonlinearProgram
    x: FloatArray
    gradient: FloatArray
    rows: FloatArray
    jacobian: csr_array

    @classmethod
    def at(cls, nlp: NonlinearProgram, x: FloatArray) -> Linearisation:
        """Evaluate everything at a point."""
        structure = nlp.jacobian_structure
        # Entries that are given twice add up, as Ipopt reads them.
        jacobian = scipy.sparse.csr_array((nlp.jacobian(x), structure), shape=(nlp.m, nlp.n))
        return cls(nlp, x, np.array(nlp.gradient(x)), np.array(nlp.constraints(x)), jacobian)

    def lagrangian_gradient(self, g_multipliers: FloatArray) -> FloatArray:
        """Gradient of f + g_multipliers @ g, shape (n,): what the bounds and the pairs have to balance."""
        return self.gradient + self.jacobian.T @ g_multipliers
