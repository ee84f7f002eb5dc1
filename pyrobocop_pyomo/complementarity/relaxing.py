"""Relaxing the pairs of a model, asking about what was generated, and the way back.

`RelaxComplementarity` is the same as a transformation of Pyomo: `pyrobocop.relax_complementarity`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pyomo.common.config import ConfigDict, ConfigValue
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base import Transformation, TransformationFactory

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import deactivate, is_inside, outermost_inactive

from .canonical import CanonicalPair
from .grouping import Grouping, as_grouping
from .lifting import LiftedPair, SideVariable, side_variable
from .pairs import active_sources, canonical_form
from .preconditions import (
    only_objective,
    refuse_disjuncts,
    refuse_foreign_token,
    refuse_leaves,
    refuse_nothing,
    refuse_second_delta,
    refuse_unusable,
)
from .record import (
    BLOCK_NAME,
    RelaxationRecord,
    only_record,
    record_of,
    record_on,
    records_above,
    records_below,
)
from .relaxations import ObjectiveTerm, Relaxation, as_relaxation
from .residuals import PairResidual, pair_residuals
from .rows import new_record, state_rows

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class RelaxationToken:
    """What `revert` needs to undo one application of `relax`.

    Attributes
    ----------
    model : Block
        The model that was relaxed.
    block : Block
        The generated block on it, with ``delta``, ``rows`` and ``sides``.
    """

    model: Any
    block: Any


def relax(
    model: Any,
    *,
    relaxation: str | Relaxation | ObjectiveTerm = "scholtes",
    grouping: str | Grouping = "pair",
    delta: float = 1e-2,
    lift: bool = False,
    targets: Iterable[Any] | None = None,
) -> RelaxationToken:
    """Replace the active pairs of a model by rows that a nonlinear solver can hold; see `RelaxComplementarity`.

    Parameters
    ----------
    model : Block
        Constructed.
    relaxation, grouping : str or object, optional
        How one product is bounded ("scholtes") and which products share a bound ("pair").
    delta : float, optional
        First value, 1e-2.
    lift : bool, optional
        Whether a generated variable stands for each side that is more than a variable with a sign and an offset;
        False.
    targets : iterable of components, optional
        Blocks, components or single pairs; all if not given.

    Returns
    -------
    RelaxationToken
        For `revert`.

    Raises
    ------
    ComplementarityError
        If there is no active pair, if a pair cannot be relaxed, or if the model is relaxed already.
    ValueError
        If an option has a value that does not exist.
    """
    chosen, groups = as_relaxation(relaxation), as_grouping(grouping)
    if not 0.0 < delta < math.inf:
        raise ValueError(f"'{model.name}': delta is {delta!r}; it has to be positive and finite.")
    refuse_unusable(model)
    with PauseGC():
        sources = active_sources(model, targets)
        refuse_nothing(model, sources, targets)
        refuse_second_delta(model)
        objective = _penalised(model) if isinstance(chosen, ObjectiveTerm) else None
        forms = [canonical_form(source) for source in sources]
        refuse_disjuncts(model, sources)
        refuse_leaves(forms)
        record = new_record(delta, chosen, groups, bool(lift), objective)
        state_rows(record, model, forms)
        deactivate(sources)
    logger.debug("'%s': relaxed %d complementarity statements", model.name, len(forms))
    return RelaxationToken(model, record.main)


def _penalised(model: Any) -> Any:
    """The objective of a model that a penalty is added to; None where there is none.

    Raises
    ------
    ComplementarityError
        When it is one of the model that this one is a part of.
    """
    objective = only_objective(model)
    above = only_objective(model.model()) if objective is None else None
    if above is not None:
        raise ComplementarityError(
            f"'{model.name}': a penalty is added to the objective, which is '{above.name}' of "
            f"'{model.model().name}'. Apply it to that model, with targets= the blocks that are meant."
        )
    return objective


def revert(model: Any, token: RelaxationToken | None = None) -> None:
    """Take a relaxation back.

    Parameters
    ----------
    model : Block
        The model that `relax` was called with.
    token : RelaxationToken, optional
        What `relax` returned; a clone has none, since a token belongs to the model that it was made for.

    Raises
    ------
    ComplementarityError
        If the model is not relaxed, or if the token is used up or belongs to another model.
    """
    record = record_on(model)
    refuse_foreign_token(model, token)
    if record is None or (token is not None and record.main is not token.block):
        raise ComplementarityError(f"'{model.name}': nothing to revert; it is not relaxed, or was reverted before.")
    with PauseGC():
        model.del_component(record.main)
        if record.objective is not None:
            record.objective.activate()
        for source in record.statements:
            source.activate()


def pairs_of(model: Any) -> list[CanonicalPair]:
    """Return all pairs of a model in canonical form: the relaxed ones, then those still active."""
    known: dict[int, tuple[CanonicalPair, ...]] = {}
    for record in (*records_below(model), *records_above(model)):
        known.update(
            (id(source), statement.form.pairs)
            for source, statement in record.statements.items()
            if is_inside(source, model)
        )
    for source in active_sources(model):
        if id(source) not in known:
            known[id(source)] = canonical_form(source).pairs
    return [pair for pairs in known.values() for pair in pairs]


def lifted_pairs_of(model: Any) -> list[LiftedPair]:
    """Return the pairs that were relaxed with ``lift``, with the variables that stand for their sides."""
    return [
        LiftedPair(relaxed.pair, _as_variable(relaxed.a), _as_variable(relaxed.b))
        for record in records_below(model)
        if record.lift
        for relaxed in record.relaxed_pairs
    ]


def crossed_pairs_of(model: Any) -> list[tuple[CanonicalPair, CanonicalPair]]:
    """Return the couples of different pairs that the grouping crosses: a of the first with b of the second.

    Where one of the two sides has to be zero as well, a branch of the pairs as stated does not see to it.
    """
    return [
        (product.a_pair.pair, product.b_pair.pair)
        for record in records_below(model)
        for shared in record.products
        for product in shared
        if product.a_pair is not product.b_pair
    ]


def delta_of(model: Any) -> Any:
    """Return the mutable parameter delta of a relaxed model."""
    return only_record(model).main.delta


def has_penalty(model: Any) -> bool:
    """Whether the objective of a relaxed model has a penalty term."""
    return only_record(model).main.component("objective") is not None


@contextmanager
def without_penalty(model: Any) -> Iterator[None]:
    """Put the user's objective back for a moment; without one of the user, none is active."""
    record = only_record(model)
    generated = record.main.component("objective")
    generated.deactivate()
    if record.objective is not None:
        record.objective.activate()
    try:
        yield
    finally:
        if record.objective is not None:
            record.objective.deactivate()
        generated.activate()


def rows_of(source: Any) -> list[Any]:
    """Return the generated rows of a pair: those that relax its products, then those of its sides."""
    for record in records_above(source):
        statement = record.statements.get(source)
        if statement is None:
            continue
        return sorted(statement.rows, key=lambda row: row.parent_component().local_name != "rows")
    raise ComplementarityError(
        f"'{source.name}': is not relaxed. Apply pyrobocop.relax_complementarity to its model first."
    )


def sources_of(row: Any) -> list[Any]:
    """Return the pairs, as declared, that a generated row, side or objective came from."""
    sources = generating_pairs(row)
    if not sources:
        raise ComplementarityError(f"'{row.name}': was not generated by pyrobocop.relax_complementarity.")
    return sources


def generating_pairs(row: Any) -> list[Any]:
    """As `sources_of`, but empty for a row that no pair was the reason for."""
    record = _record_of_row(row)
    if record is not None and row is record.main.component("objective"):
        return list(record.statements)
    return [] if record is None else list(record.origins.get((row.parent_component().local_name, row.index()), ()))


def relaxation_rows_of(model: Any) -> list[Any]:
    """Return the active rows that relax products, and not those that keep or define sides."""
    return [row for record in records_below(model) for row in _rows_seen(record, model)]


def shifted_rows_of(model: Any) -> list[Any]:
    """Return the active rows ``... <= shift(delta)`` whose bound may move while a solver runs."""
    return [row for record in records_below(model) if record.shifts for row in _rows_seen(record, model)]


def _as_variable(side: Any) -> SideVariable:
    found = side_variable(side)
    assert found is not None, "whatever is no variable was lifted"
    return found


def _rows_seen(record: RelaxationRecord, model: Any) -> Iterator[Any]:
    """The active rows of products, where a solver sees their generated block."""
    seen = model.active and outermost_inactive(record.main, model) is None
    return (row for row in record.bounds if seen and row.active)


def _record_of_row(row: Any) -> RelaxationRecord | None:
    if not row.parent_block().local_name.startswith(BLOCK_NAME):
        return None  # no private data appear on blocks of the user
    record = record_of(row.parent_block())
    return None if record.main is None else record


@TransformationFactory.register(
    "pyrobocop.relax_complementarity", doc="Bound (or penalise) the products of complementarity pairs, reversibly."
)
class RelaxComplementarity(Transformation):
    """Replace complementarity pairs by rows ``a * b <= delta`` that any nonlinear solver can hold.

    Pairs of this package and of `pyomo.mpec` are taken. They are deactivated and never changed. What is
    generated sits on one block with the mutable parameter ``delta``. Pairs inside a `Disjunct` are refused: its rows
    would hold whether or not it is chosen.

    Options of ``apply_to`` and ``create_using``: ``relaxation`` (a name such as "scholtes" or "penalty", or an
    object), ``grouping`` ("pair", "element" or an object), ``delta`` (first value, 1e-2), ``lift`` (False) and
    ``targets`` (blocks, components or single pairs; default all). With ``lift``, a generated variable ``s >= 0``
    with the row ``s == side`` stands for each side that is more than a variable with a sign and an offset, so that
    products are bilinear; it starts at the value of the side. A model is relaxed once, with all its targets. A
    block that is deactivated afterwards takes its own constraints out of the model but not the generated rows of its
    pairs: revert before, or deactivate first.
    """

    CONFIG = ConfigDict("pyrobocop.relax_complementarity")
    CONFIG.declare("relaxation", ConfigValue("scholtes", as_relaxation, "How one product is bounded."))
    CONFIG.declare("grouping", ConfigValue("pair", as_grouping, "Which products share a bound."))
    CONFIG.declare("delta", ConfigValue(1e-2, float, "First bound of the products."))
    CONFIG.declare("lift", ConfigValue(False, bool, "Let a generated variable stand for each side that is none."))
    CONFIG.declare("targets", ConfigValue(None, description="Blocks, components or pairs to take; default all."))

    # What the functions of the same names do.
    revert = staticmethod(revert)
    delta_of = staticmethod(delta_of)
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
