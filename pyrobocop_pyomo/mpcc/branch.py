"""A branch: which side of each pair is held at zero. With one choice per pair a nonlinear program remains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .problem import ComplementarityProgram
from .wrapped_programs import WithBounds


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

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Branch)
            and np.array_equal(self.a_zero, other.a_zero)
            and np.array_equal(self.b_zero, other.b_zero)
        )

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


def restricted(program: ComplementarityProgram, branch: Branch) -> WithBounds:
    """The nonlinear program of a branch: its zero sides are fixed by their bounds."""
    lower, upper = program.nlp.x_lower.copy(), program.nlp.x_upper.copy()
    for sides, zero in ((program.a, branch.a_zero), (program.b, branch.b_zero)):
        fixed = zero & ~sides.constant
        lower[sides.index[fixed]] = upper[sides.index[fixed]] = sides.offset[fixed]
    return WithBounds(program.nlp, lower, upper)
