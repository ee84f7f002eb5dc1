"""The transformation `pyrobocop.relax_complementarity`: pairs become rows that a nonlinear solver can hold."""

from __future__ import annotations

from typing import Any

from pyomo.core.base import Transformation, TransformationFactory

from . import relaxing
from .residuals import PairResidual, pair_residuals


@TransformationFactory.register(
    "pyrobocop.relax_complementarity", doc="Bound (or penalise) the products of complementarity pairs, reversibly."
)
class RelaxComplementarity(Transformation):
    """Replace complementarity pairs by rows ``a * b <= delta`` that any nonlinear solver can hold.

    Pairs of this package and of `pyomo.mpec` are taken. They are deactivated and never changed. What is
    generated sits on one block with the mutable parameter ``delta``; only the rows of pairs inside a
    `Disjunct` sit on a block in that disjunct, so that they hold only where it is chosen.

    Options of ``apply_to`` and ``create_using``: ``relaxation`` (a name such as "scholtes" or "penalty", or an
    object), ``grouping`` ("pair", "element" or an object), ``delta`` (first value, 1e-2), ``lift`` (False) and
    ``targets`` (blocks, components or single pairs; default all). With ``lift``, a generated variable ``s >= 0``
    with the row ``s == side`` stands for each side that is more than a variable with a sign and an offset, so that
    products are bilinear; it starts at the value of the side. A model is relaxed once, with all its targets. A
    block that is deactivated afterwards takes its own constraints out of the model but not the generated rows of its
    pairs: revert before, or deactivate first.
    """

    # What the functions of the same names do.
    revert = staticmethod(relaxing.revert)
    delta_of = staticmethod(relaxing.delta_of)
    relaxation_of = staticmethod(relaxing.relaxation_of)
    pairs_of = staticmethod(relaxing.pairs_of)
    lifted_pairs_of = staticmethod(relaxing.lifted_pairs_of)
    crossed_pairs_of = staticmethod(relaxing.crossed_pairs_of)
    rows_of = staticmethod(relaxing.rows_of)
    relaxation_rows_of = staticmethod(relaxing.relaxation_rows_of)
    shifted_rows_of = staticmethod(relaxing.shifted_rows_of)
    sources_of = staticmethod(relaxing.sources_of)

    def _apply_to(self, model: Any, **options: Any) -> relaxing.RelaxationToken:
        return relaxing.relax(model, **options)

    def residuals(self, model: Any) -> list[PairResidual]:
        """Evaluate all pairs, relaxed or still active, at the current values.

        Raises
        ------
        ComplementarityError
            If a variable of a pair has no value.
        """
        return pair_residuals(relaxing.pairs_of(model))
