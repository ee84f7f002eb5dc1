"""`OutputSensitivities`: how measured outputs move with what is estimated, on the branch that the model is on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.PyomoModel import ConcreteModel

from pyrobocop_pyomo.complementarity import SidePart, active_sources, canonical_form, pair_residuals
from pyrobocop_pyomo.errors import SensitivityError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.mpcc.linearisation import Linearisation
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

BIACTIVE = 1e-6  # both sides of a pair at most this large: the outputs have a kink there
_NEVER = 1e30
LARGEST_SOLUTION = 1e13  # of a system that is not singular, relative to its right side
LARGEST_DENSE = 2000  # variables, up to which a null space is computed by a dense factorisation


@dataclass(frozen=True, eq=False)
class OutputDerivatives:
    """Outputs and their derivatives at one point.

    Attributes
    ----------
    matrix : array, shape (outputs, unknowns)
        With everything else moving as the equations, on this branch, ask for.
    biactive : tuple of str
        Pairs where the branch was chosen among several: one-sided derivatives there.
    undetermined : int
        Further degrees of freedom that neither equations nor unknowns determine.
    """

    matrix: Array
    biactive: tuple[str, ...]
    undetermined: int


class OutputSensitivities:
    """Linearises a model again and again, after one compilation.

    Parameters
    ----------
    model : Block
        Not relaxed.
    outputs : sequence of Pyomo expressions
    unknowns : sequence of VarData
        Free ones.
    """

    def __init__(self, model: Any, outputs: Sequence[Any], unknowns: Sequence[Any]) -> None:
        self._model, self._unknowns = model, list(unknowns)
        self._scratch = ConcreteModel()
        self._scratch.rows = ConstraintList()
        self._equations: list[Any] = []
        self._forms = [canonical_form(source) for source in active_sources(model)]
        for constraint in model.component_data_objects(Constraint, active=True):
            row = self._added(constraint.expr)
            if row is not None and constraint.equality:
                self._equations.append(row)
        for form in self._forms:
            for relation in form.rows:
                row = self._added(relation)
                if row is not None and row.equality:
                    self._equations.append(row)
        self._sides = {
            id(pair): (self._added_side(pair.a), self._added_side(pair.b))
            for form in self._forms
            for pair in form.pairs
        }
        self._outputs = [self._added_side(output) for output in outputs]
        self._compiled: CompiledModel | None = None

    def _added(self, relation: Any) -> Any:
        if not any(True for _ in variables_in(relation, include_fixed=True)):
            return None
        return self._scratch.rows.add(relation)

    def _added_side(self, expression: Any) -> Any:
        if not hasattr(expression, "is_potentially_variable") or not expression.is_potentially_variable():
            return None
        # Only its derivatives count. No equation: one of fixed variables alone would contradict itself.
        return self._scratch.rows.add(expression <= _NEVER)

    def at_current_values(self) -> OutputDerivatives:
        """Differentiate at the values that stand on the model.

        Raises
        ------
        SensitivityError
            When the equations are dependent there, so that outputs do not follow from what is estimated.
        """
        if self._compiled is None:
            self._compiled = CompiledModel(self._scratch, "vectorised")
        else:
            self._compiled.update()
        compiled = self._compiled
        jacobian = Linearisation.at(compiled.nlp, compiled.current_point()).jacobian
        zero, biactive = self._zero_sides()
        row_of = compiled.row_of
        chosen = [row_of[row] for row in (*self._equations, *zero) if row in row_of]
        place = {id(variable): i for i, variable in enumerate(compiled.variables)}
        columns = np.array([place.get(id(variable), -1) for variable in self._unknowns], dtype=int)
        in_use = np.flatnonzero(columns >= 0)
        others = np.setdiff1d(np.arange(compiled.nlp.n), columns[in_use])
        rows = jacobian[chosen]
        output_rows = [row_of.get(row) if row is not None else None for row in self._outputs]
        measured = np.array([row is not None for row in output_rows], dtype=bool)
        of_outputs = jacobian[[row for row in output_rows if row is not None]]
        moved, undetermined = _moved(rows[:, others], rows[:, columns[in_use]], of_outputs[:, others])
        matrix = np.zeros((len(self._outputs), len(self._unknowns)))
        matrix[np.ix_(measured, in_use)] = of_outputs[:, columns[in_use]].toarray() + moved
        return OutputDerivatives(matrix, tuple(biactive), undetermined)

    def _zero_sides(self) -> tuple[list[Any], list[str]]:
        """The rows of the sides that are held at zero, each pair by its smaller one, and the pairs that have two."""
        zero: list[Any] = []
        biactive: list[str] = []
        for form in self._forms:
            pairs = list(form.pairs)
            values = dict(zip(map(id, pairs), pair_residuals(pairs), strict=True))
            stated = [pair for pair in pairs if pair.a_part is SidePart.WHOLE]
            first_is_zero = False
            held: list[Any] = []
            for pair in stated:
                sides = values[id(pair)]
                if max(sides.a, sides.b) <= BIACTIVE:
                    biactive.append(pair.name)
                if sides.a < sides.b:
                    zero.append(self._sides[id(pair)][0])
                    first_is_zero = True
                else:
                    held.append(pair)
            # The parts of a free side are zero together: one equation, and only where no bound of the range has one.
            parts = [pair for pair in held if pair.b_part is not SidePart.WHOLE]
            whole = [pair for pair in held if pair.b_part is SidePart.WHOLE]
            zero += [self._sides[id(pair)][1] for pair in (*whole, *([] if first_is_zero else parts[:1]))]
        return [row for row in zero if row is not None], biactive


def _moved(others: Any, unknowns: Any, outputs: Any) -> tuple[Array, int]:
    """Derivatives of the outputs by the unknowns through the other variables, which move so that the rows stay met.

    `others` and `unknowns` are the columns of the rows' Jacobian, `outputs` is the outputs' Jacobian by the other
    variables. The number is how many of the other variables the rows leave undetermined.
    """
    rows, count = others.shape
    if rows == count:
        target = unknowns.toarray()
        size = max(1.0, float(np.abs(target).max(initial=0.0)))
        try:
            factor = scipy.sparse.linalg.splu(scipy.sparse.csc_array(others))
            solved = factor.solve(target)
            solved += factor.solve(target - others @ solved)  # unstable motions cost digits: one refinement
        except RuntimeError:  # SciPy's way to say: exactly singular
            solved = np.full((count, unknowns.shape[1]), np.nan)
        # What is singular but for rounding shows in the size of the solution.
        if np.isfinite(solved).all() and np.abs(solved).max(initial=0.0) <= LARGEST_SOLUTION * size:
            return -(outputs @ solved), 0
    if count > LARGEST_DENSE:
        raise SensitivityError(
            f"{count} variables are not determined by the {rows} equations that hold there, and there are too many for "
            "a closer look. Fix controls at what was applied, and remove equations that repeat others."
        )
    return _moved_least(others.toarray(), unknowns.toarray(), outputs.toarray())


def _moved_least(others: Array, unknowns: Array, outputs: Array) -> tuple[Array, int]:
    """The same where rows repeat each other or leave variables open: those that stay open move least."""
    scale = np.maximum(np.abs(others).max(axis=1, initial=0.0), 1e-300)
    left, sizes, right = np.linalg.svd(others / scale[:, None], full_matrices=False)
    rank = int((sizes > 1e-10 * sizes.max(initial=1e-300)).sum())
    target = unknowns / scale[:, None]
    solved = right[:rank].T @ ((left[:, :rank].T @ target) / sizes[:rank, None])
    gap = np.abs((others / scale[:, None]) @ solved - target).max(initial=0.0)
    if gap > 1e-6 * max(1.0, np.abs(target).max(initial=0.0)):
        raise SensitivityError(
            "the equations do not let the parameters move: some of them tie parameters to each other or to numbers. "
            "Estimate fewer parameters, or remove the equation."
        )
    return -(outputs @ solved), others.shape[1] - rank
