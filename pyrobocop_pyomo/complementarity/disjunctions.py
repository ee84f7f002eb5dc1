"""The transformation `pyrobocop.complementarity_to_disjunctions`: pairs become choices of `pyomo.gdp`, reversibly."""

from __future__ import annotations

from typing import Any

from pyomo.core import Any as AnyIndex
from pyomo.core import ConstraintList, NonNegativeIntegers
from pyomo.core.base import TransformationFactory
from pyomo.gdp import Disjunct, Disjunction

from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES

from .canonical import CanonicalForm
from .pairs import PAIR_TYPES, canonical_form
from .preconditions import refuse_leaves, refuse_nothing
from .replaced_rows import RowReplacement, rows_of_block
from .residuals import PairResidual, pair_residuals


@TransformationFactory.register(
    "pyrobocop.complementarity_to_disjunctions", doc="Turn complementarity pairs into disjunctions, reversibly."
)
class ComplementarityToDisjunctions(RowReplacement):
    """Replace complementarity pairs by choices ``[a == 0] v [b == 0]`` for mixed-integer solvers.

    Nothing is relaxed: with linear sides and a convex objective the answer is global. A range ``l <= F <= u ⟂ H``
    becomes ``[F == l, H >= 0] v [F == u, H <= 0] v [H == 0]``. Apply ``gdp.bigm`` or ``gdp.hull`` afterwards: they take
    bounds of the sides from those of the variables. Discrete variables are welcome in a side.

    Option of ``apply_to`` and ``create_using``: ``targets`` (blocks, components or single pairs; default all). The
    pairs are deactivated and never changed. Revert before a reformulation such as ``gdp.bigm``, which has no way back,
    or apply that to a copy.
    """

    kinds = PAIR_TYPES
    containers = BLOCK_TYPES
    block_name = "complementarity_disjunctions"
    generated = "disjunctions of pairs"

    def _rows(self, model: Any, targets: Any) -> list[Any]:
        sources = super()._rows(model, targets)
        refuse_nothing(model, sources, targets)
        return sources

    def _fill(self, block: Any, rows: list[Any]) -> list[tuple[Any, Any]]:
        forms = [canonical_form(source) for source in rows]
        refuse_leaves(forms, discrete_allowed=True)
        block.rows = ConstraintList()
        block.disjuncts = Disjunct(AnyIndex)
        block.choices = Disjunction(NonNegativeIntegers)
        for form in forms:
            sides = [row for pair in form.pairs for row in (pair.a_row, pair.b_row) if row is not None]
            for row in (*form.rows, *sides):
                block.rows.add(row)
        for position, form in enumerate(form for form in forms if form.pairs):
            chosen = []
            for branch, stated in _branches(form).items():
                disjunct = block.disjuncts[position, branch]
                disjunct.rows = ConstraintList()
                for row in stated:
                    disjunct.rows.add(row)
                chosen.append(disjunct)
            block.choices[position] = chosen
        return [(source, None) for source in rows]

    def residuals(self, model: Any) -> list[PairResidual]:
        """Evaluate the pairs that are disjunctions at the current values, by their own sides.

        Raises
        ------
        ComplementarityError
            If a variable of a pair has no value.
        """
        sources = [source for block in self._generated_on(model) for source, _ in rows_of_block(block) or ()]
        return pair_residuals(pair for source in sources for pair in canonical_form(source).pairs)


def _branches(form: CanonicalForm) -> dict[str, list[Any]]:
    pair = form.pairs[0]  # the parts of a free side are zero together
    if form.between is None:
        return {"first": [pair.a == 0], "second": [pair.b == 0]}
    lower, body, upper = form.between
    return {
        "lower": [body == lower, pair.b >= 0],
        "upper": [body == upper, pair.b <= 0],
        "between": [pair.b == 0],
    }
