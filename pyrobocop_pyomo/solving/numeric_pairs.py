"""The lifted pairs of a model as index arrays of its nonlinear program."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import LiftedPair, SideVariable
from pyrobocop_pyomo.mpcc.multipliers import Multipliers
from pyrobocop_pyomo.mpcc.problem import ComplementarityProgram, Sides
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import Scales
from pyrobocop_pyomo.programs.wrapped_programs import ScaledProgram, WrappedProgram


def numeric_pairs(
    compiled: CompiledModel,
    pairs: Sequence[LiftedPair],
    left_out: Iterable[Any],
    crossed: Sequence[tuple[int, int]] = (),
    *,
    objective: float = 1.0,
) -> tuple[ComplementarityProgram, np.ndarray]:
    """Say which variables of a nonlinear program are complementary.

    Parameters
    ----------
    compiled : CompiledModel
        Of the relaxed model.
    pairs : list of LiftedPair
    left_out : iterable of ConstraintData
        The rows that relax the pairs: in the program they have no bounds.
    crossed : sequence of (int, int)
        Numbers of pairs: the a of the first and the b of the second are complementary as well.
    objective : float
        What the objective is divided by.

    Returns
    -------
    ComplementarityProgram
        Its pairs are those that were given, then the crossed ones.
    int array
        Numbers of the rows that are left out: they are without bounds, and have no multipliers.
    """
    rows, nlp = compiled.numbers_of(left_out), compiled.nlp
    if objective != 1.0:
        nlp = ScaledProgram(nlp, Scales(np.ones(nlp.n), np.ones(nlp.m), objective))
    positions = {id(variable): position for position, variable in enumerate(compiled.variables)}
    a = _sides([*(pair.a for pair in pairs), *(pairs[first].a for first, _ in crossed)], positions)
    b = _sides([*(pair.b for pair in pairs), *(pairs[second].b for _, second in crossed)], positions)
    lower, upper = nlp.x_lower.copy(), nlp.x_upper.copy()
    for sides in (a, b):
        # Some relaxations let a side fall a little below zero; here it may not.
        rising, falling = ~sides.constant & (sides.sign > 0), ~sides.constant & (sides.sign < 0)
        np.maximum.at(lower, sides.index[rising], sides.offset[rising])
        np.minimum.at(upper, sides.index[falling], sides.offset[falling])
    program = WrappedProgram(nlp, lower, upper)
    program.g_lower, program.g_upper = nlp.g_lower.copy(), nlp.g_upper.copy()
    program.g_lower[rows], program.g_upper[rows] = -np.inf, np.inf
    return ComplementarityProgram(program, a, b), rows


def without_crossed(multipliers: Multipliers, crossed: Sequence[tuple[int, int]]) -> Multipliers:
    """The multipliers of the pairs alone: multipliers of a side in crossed pairs are added to its own."""
    if not crossed:
        return multipliers
    count = multipliers.nu.size - len(crossed)
    nu, xi = multipliers.nu[:count].copy(), multipliers.xi[:count].copy()
    np.add.at(nu, [first for first, _ in crossed], multipliers.nu[count:])
    np.add.at(xi, [second for _, second in crossed], multipliers.xi[count:])
    return replace(multipliers, nu=nu, xi=xi)


def _sides(sides: Sequence[SideVariable], positions: dict[int, int]) -> Sides:
    index = np.array([positions.get(id(side.variable), -1) for side in sides], dtype=np.intp)
    sign = np.array([side.sign for side in sides], dtype=float)
    offset = np.array([value(side.offset) for side in sides], dtype=float)
    # A variable that is fixed is no variable of the program: its side is a number.
    for k in np.flatnonzero(index < 0).tolist():
        offset[k] = sign[k] * (value(sides[k].variable) - offset[k])
    return Sides(index, sign, offset)
