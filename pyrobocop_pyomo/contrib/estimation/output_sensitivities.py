"""`OutputSensitivities`: how measured outputs move with what is estimated, on the branch that the model is on."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.PyomoModel import ConcreteModel

from pyrobocop_pyomo.complementarity import SidePart, active_sources, canonical_form, side_values, sides_at_zero
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.mpcc.problem import Linearisation
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

LARGEST_SOLUTION = 1e13  # of a system that is not singular, relative to its right side


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
        relations = [constraint.expr for constraint in model.component_data_objects(Constraint, active=True)]
        for relation in (*relations, *(relation for form in self._forms for relation in form.rows)):
            if any(True for _ in variables_in(relation, include_fixed=True)):
                row = self._scratch.rows.add(relation)
                self._equations += [row] if row.equality else []
        pairs = [pair for form in self._forms for pair in form.pairs]
        self._sides = {id(side): self._added(side) for pair in pairs for side in (pair.a, pair.b)}
        self._outputs = [self._added(output) for output in outputs]
        self._compiled: CompiledModel | None = None

    def _added(self, expression: Any) -> Any:
        """A row with the derivatives of an expression; None where that has no variables."""
        if not hasattr(expression, "is_potentially_variable") or not expression.is_potentially_variable():
            return None
        # No equation: one of fixed variables alone would contradict itself.
        return self._scratch.rows.add(expression <= 1e30)

    def at_current_values(self) -> tuple[Array, list[str]]:
        """Differentiate at the values that stand on the model.

        Returns
        -------
        matrix : array, shape (outputs, unknowns)
            With everything else moving as the equations, on this branch, ask for.
        biactive : list of str
            Pairs where the branch was chosen among several: one-sided derivatives there.

        Raises
        ------
        EvaluationError
            When outputs do not follow from what is estimated there: equations are too few, too many or dependent.
        """
        if self._compiled is None:
            self._compiled = CompiledModel(self._scratch, "vectorised")
        else:
            self._compiled.update()
        compiled = self._compiled
        jacobian = Linearisation.at(compiled.nlp, compiled.current_point()).jacobian
        zero = [self._sides[id(side)] for form in self._forms for _, side, _ in sides_at_zero(form)]
        stated = (pair for form in self._forms for pair in form.pairs if pair.a_part is SidePart.WHOLE)
        biactive = [pair.name for pair in stated if max(side_values(pair)) <= MET]
        row_of = compiled.row_of
        chosen = [row_of[row] for row in (*self._equations, *zero) if row is not None and row in row_of]
        place = {id(variable): i for i, variable in enumerate(compiled.variables)}
        columns = np.array([place.get(id(variable), -1) for variable in self._unknowns], dtype=int)
        in_use = np.flatnonzero(columns >= 0)
        others = np.setdiff1d(np.arange(compiled.nlp.n), columns[in_use])
        rows = jacobian[chosen]
        moved = _moved(rows[:, others], rows[:, columns[in_use]].toarray())
        has_row = np.array([row is not None and row in row_of for row in self._outputs], dtype=bool)
        of_outputs = jacobian[[row_of[row] for row in self._outputs if row is not None and row in row_of]]
        matrix = np.zeros((len(self._outputs), len(self._unknowns)))
        matrix[np.ix_(has_row, in_use)] = of_outputs[:, columns[in_use]].toarray() + of_outputs[:, others] @ moved
        return matrix, biactive


def _moved(others: Any, unknowns: Array) -> Array:
    """How the other variables move with the unknowns so that the rows, of which these are the columns, stay met."""
    rows, count = others.shape
    solved = np.full((count, unknowns.shape[1]), np.nan)
    if rows == count > 0:
        with contextlib.suppress(RuntimeError):  # SciPy's way to say: exactly singular
            factor = scipy.sparse.linalg.splu(scipy.sparse.csc_array(others))
            solved = factor.solve(unknowns)
            solved += factor.solve(unknowns - others @ solved)  # unstable motions cost digits: one refinement
    # What is singular but for rounding shows in the size of the solution.
    largest = LARGEST_SOLUTION * max(1.0, float(np.abs(unknowns).max(initial=0.0)))
    if not (np.abs(solved) <= largest).all():
        raise EvaluationError(
            f"the {rows} equations that hold there do not say how {count} other variables move with what is estimated. "
            "Fix controls at what was applied, estimate fewer parameters, and remove equations that repeat others or "
            "tie parameters to numbers."
        )
    return -solved
