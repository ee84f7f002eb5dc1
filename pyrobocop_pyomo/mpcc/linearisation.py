"""First derivatives of a nonlinear program at a point, as sparse arrays."""

from __future__ import annotations

import contextlib
import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram
from pyrobocop_pyomo.programs.stationarity import beside

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

    @functools.cached_property
    def slope(self) -> float:
        """What tolerances of derivatives are relative to: the objective's largest one, here, beside or at the start.

        Here and beside it may be zero, as at the minimum of a sum of squares; to one side alone it may be large, as
        that of a barrier. It is 1 without any.
        """
        slopes = [np.abs(self.gradient).max(initial=0.0)]
        with contextlib.suppress(EvaluationError):
            slopes.append(np.abs(self.nlp.gradient(self.nlp.x_start)).max(initial=0.0))
        there = beside(self.nlp, self.x, np.abs(self.x))
        mirrored = np.clip(2.0 * self.x - there, self.nlp.x_lower, self.nlp.x_upper)
        with contextlib.suppress(EvaluationError):
            slopes.append(min(np.abs(self.nlp.gradient(x)).max(initial=0.0) for x in (there, mirrored)))
        return float(np.max(slopes, initial=0.0, where=np.isfinite(slopes))) or 1.0

    def lagrangian_gradient(self, g_multipliers: FloatArray) -> FloatArray:
        """Gradient of f + g_multipliers @ g, shape (n,): what the bounds and the pairs have to balance."""
        return self.gradient + self.jacobian.T @ g_multipliers
