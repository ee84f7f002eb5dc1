"""The transformation `pyrobocop.relax_complementarity`: pairs become rows that a nonlinear solver can hold."""

from __future__ import annotations

from typing import Any

from pyomo.common.config import ConfigDict, ConfigValue
from pyomo.core.base import Transformation, TransformationFactory

from .grouping import PerPair, as_grouping
from .relaxations import Scholtes, as_relaxation
from .relaxing import (
    FIRST_DELTA,
    RelaxationToken,
    crossed_pairs_of,
    delta_of,
    finite_positive,
    lifted_pairs_of,
    pairs_of,
    relax,
    relaxation_of,
    relaxation_rows_of,
    revert,
    rows_of,
    shifted_rows_of,
    sources_of,
)
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

    CONFIG = ConfigDict("pyrobocop.relax_complementarity")
    CONFIG.declare(
        "relaxation",
        ConfigValue(default=Scholtes(), domain=as_relaxation, description="How one product is bounded."),
    )
    CONFIG.declare(
        "grouping",
        ConfigValue(default=PerPair(), domain=as_grouping, description="Which products share a bound."),
    )
    CONFIG.declare(
        "delta",
        ConfigValue(default=FIRST_DELTA, domain=finite_positive, description="First bound of the products."),
    )
    CONFIG.declare(
        "lift",
        ConfigValue(
            default=False,
            domain=bool,
            description="Let a generated variable stand for each side that is no variable.",
        ),
    )
    CONFIG.declare(
        "targets",
        ConfigValue(default=None, description="Blocks, Complementarity components or pairs to take; default all."),
    )

    # What the functions of the same names do.
    revert = staticmethod(revert)
    delta_of = staticmethod(delta_of)
    relaxation_of = staticmethod(relaxation_of)
    pairs_of = staticmethod(pairs_of)
    lifted_pairs_of = staticmethod(lifted_pairs_of)
    crossed_pairs_of = staticmethod(crossed_pairs_of)
    rows_of = staticmethod(rows_of)
    relaxation_rows_of = staticmethod(relaxation_rows_of)
    shifted_rows_of = staticmethod(shifted_rows_of)
    sources_of = staticmethod(sources_of)

    def _apply_to(self, model: Any, **options: Any) -> RelaxationToken:
        config = self.CONFIG({**options.pop("options", {}), **options})
        return relax(model, **{name: config[name] for name in config})

    def residuals(self, model: Any) -> list[PairResidual]:
        """Evaluate all pairs, relaxed or still active, at the current values.

        Raises
        ------
        ComplementarityError
            If a variable of a pair has no value.
        """
        return pair_residuals(pairs_of(model))
