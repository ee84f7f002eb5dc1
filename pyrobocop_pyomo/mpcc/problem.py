"""A complementarity problem as numbers: a nonlinear program, and which of its variables are complementary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram


@dataclass(frozen=True, eq=False)
class Sides:
    """One side of each pair as a variable: ``side = sign * (x[index] - offset)``.

    Attributes
    ----------
    index : int array, shape (k,)
        Position of the variable; -1 where the side is a number (its variable is fixed), which is `offset` then.
    sign : float array, shape (k,)
        1 or -1.
    offset : float array, shape (k,)
        Value of the variable where the side is zero.
    """

    index: NDArray[np.intp]
    sign: FloatArray
    offset: FloatArray

    @property
    def constant(self) -> BoolArray:
        """Where the side is a number, shape (k,)."""
        return self.index < 0

    def values(self, x: FloatArray) -> FloatArray:
        """Values of the sides at a point, shape (k,)."""
        return np.where(self.constant, self.offset, self.sign * (x[self.index] - self.offset))

    def slopes(self, vector: FloatArray) -> FloatArray:
        """Derivative of the sides along a vector of shape (n,), or a multiplier that acts on them; shape (k,)."""
        return np.where(self.constant, 0.0, self.sign * vector[self.index])


@dataclass(frozen=True, eq=False)
class ComplementarityProgram:
    """Minimise f(x) over rows and bounds, and ``0 <= a(x) ⟂ b(x) >= 0`` for each pair.

    Attributes
    ----------
    nlp : NonlinearProgram
        Everything but "one of both is zero": the sides are nonnegative by its bounds and rows.
    a, b : Sides
        The two sides of the k pairs. One variable may be a side of several pairs.
    """

    nlp: NonlinearProgram
    a: Sides
    b: Sides

    @property
    def pairs(self) -> int:
        """Number of pairs."""
        return self.a.index.size

    def natural_residual(self, x: FloatArray) -> float:
        """Largest ``|min(a, b)|`` at a point."""
        return float(np.abs(np.minimum(self.a.values(x), self.b.values(x))).max(initial=0.0))


def violation(nlp: NonlinearProgram, x: FloatArray) -> float:
    """Largest violation of a row or a bound at a point; NaN counts as infinite."""
    rows = nlp.constraints(x)
    worst = max(
        float(np.max(np.maximum(lower - values, values - upper), initial=0.0))
        for lower, values, upper in ((nlp.g_lower, rows, nlp.g_upper), (nlp.x_lower, x, nlp.x_upper))
    )
    return worst if np.isfinite(rows).all() and np.isfinite(x).all() else np.inf
