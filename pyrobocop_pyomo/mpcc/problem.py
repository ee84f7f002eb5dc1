"""A complementarity problem as numbers: a nonlinear program, and which of its variables are complementary.

A branch says which side of each pair is held at zero. With one choice per pair a nonlinear program remains.
"""

from __future__ import annotations

import contextlib
import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, beside
from pyrobocop_pyomo.programs.wrapped_programs import WrappedProgram

if TYPE_CHECKING:
    from scipy.sparse import csr_array


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


@dataclass(frozen=True, eq=False)
class Branch:
    """Which sides are held at zero.

    Attributes
    ----------
    a_zero, b_zero : bool array, shape (k,)
        At least one of the two is true for each pair; both are where both sides have to be zero.
    """

    a_zero: BoolArray
    b_zero: BoolArray

    def key(self) -> bytes:
        """What tells branches apart in a set."""
        return np.packbits(np.concatenate([self.a_zero, self.b_zero])).tobytes()


def nearest_branch(program: ComplementarityProgram, x: FloatArray) -> Branch:
    """Hold the smaller side of each pair at zero; a side that is a positive number cannot be the one."""
    a, b = program.a.values(x), program.b.values(x)
    return branch_with(program, a <= b)


def branch_with(program: ComplementarityProgram, a_zero: BoolArray) -> Branch:
    """Hold a at zero where asked for and b elsewhere, but never a side that is a number and not zero.

    Where one side is the number zero the pair is met and its other side stays free.
    """
    a_zero = np.where(program.a.constant & (program.a.offset != 0.0), False, a_zero)
    a_zero = np.where(program.b.constant & (program.b.offset != 0.0), True, a_zero)
    b_zero = ~a_zero
    a_is_zero = program.a.constant & (program.a.offset == 0.0)
    b_is_zero = program.b.constant & (program.b.offset == 0.0)
    return Branch((a_zero & ~b_is_zero) | a_is_zero, (b_zero & ~a_is_zero) | b_is_zero)


def restricted(program: ComplementarityProgram, branch: Branch) -> WrappedProgram:
    """The nonlinear program of a branch: its zero sides are fixed by their bounds."""
    lower, upper = program.nlp.x_lower.copy(), program.nlp.x_upper.copy()
    for sides, zero in ((program.a, branch.a_zero), (program.b, branch.b_zero)):
        fixed = zero & ~sides.constant
        lower[sides.index[fixed]] = upper[sides.index[fixed]] = sides.offset[fixed]
    return WrappedProgram(program.nlp, lower, upper)


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
