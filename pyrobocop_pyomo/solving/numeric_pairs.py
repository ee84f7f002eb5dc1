"""The lifted pairs of a model as index arrays of its nonlinear program."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import LiftedPair, SideVariable
from pyrobocop_pyomo.mpcc.problem import ComplementarityProgram, Sides
from pyrobocop_pyomo.mpcc.wrapped_programs import WithoutRows
from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram
from pyrobocop_pyomo.programs.written_model import WrittenModel


def numeric_pairs(
    written: WrittenModel, pairs: Sequence[LiftedPair], left_out: Iterable[Any]
) -> ComplementarityProgram:
    """Say which variables of a nonlinear program are complementary.

    Parameters
    ----------
    written : WrittenModel
        Of the relaxed model.
    pairs : list of LiftedPair
    left_out : iterable of ConstraintData
        The rows that relax the pairs: the program is without them.
    """
    rows = _rows(written, left_out)
    nlp: NonlinearProgram = WithoutRows(written.nlp, rows) if rows.size else written.nlp
    positions = {id(variable): position for position, variable in enumerate(written.variables)}
    return ComplementarityProgram(
        nlp,
        _sides([pair.a for pair in pairs], positions),
        _sides([pair.b for pair in pairs], positions),
    )


def _rows(written: WrittenModel, rows: Iterable[Any]) -> np.ndarray:
    """Numbers of the rows that are in the program; one without free variables is not."""
    found = [written.row_of[row] for row in rows if row in written.row_of]
    return np.array(sorted(found), dtype=np.intp)


def _sides(sides: Sequence[SideVariable], positions: dict[int, int]) -> Sides:
    index = np.array([positions.get(id(side.variable), -1) for side in sides], dtype=np.intp)
    sign = np.array([side.sign for side in sides], dtype=float)
    offset = np.array([value(side.offset) for side in sides], dtype=float)
    # A variable that is fixed is no variable of the program: its side is a number.
    for k in np.flatnonzero(index < 0).tolist():
        offset[k] = sign[k] * (value(sides[k].variable) - offset[k])
    return Sides(index, sign, offset)
