"""Relaxing the pairs of a model, questions about the generated parts, and the way back.

`RelaxComplementarity` is the same as a transformation of Pyomo: `pyrobocop.relax_complementarity`.

Building the generated block of a relaxed model: rows that bound products, rows of sides, and the penalty term.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

from pyomo.common.config import ConfigDict, ConfigValue
from pyomo.common.gc_manager import PauseGC
from pyomo.common.modeling import unique_component_name
from pyomo.core import Block, Constraint, Objective, Param, Var, minimize, quicksum
from pyomo.core.base import Transformation, TransformationFactory
from pyomo.core.base.set import NonNegativeIntegers, NonNegativeReals

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import deactivate, is_inside, outermost_inactive

from .forms import CanonicalForm, CanonicalPair
from .lifting import LiftedPair, SideVariable, relaxed_pairs, side_variable
from .pairs import PairResidual, active_sources, canonical_form, pair_residuals
from .preconditions import (
    only_objective,
    refuse_disjuncts,
    refuse_foreign_token,
    refuse_missing_pairs,
    refuse_second_delta,
    refuse_unusable,
    refuse_unusable_leaves,
)
from .record import (
    BLOCK_NAME,
    RelaxationRecord,
    RelaxedPair,
    RelaxedStatement,
    only_record,
    record_of,
    record_on,
    records_above,
    records_below,
)
from .relaxations import Grouping, ObjectiveTerm, Relaxation, as_grouping, as_relaxation

# -------------------------------------------------------------------------------------------------- the generated block


class Product(NamedTuple):
    """A product of a side of one pair and a side of another one; nearly always of the two sides of one pair."""

    a_pair: RelaxedPair
    b_pair: RelaxedPair

    @property
    def a(self) -> Any:
        """First factor."""
        return self.a_pair.a

    @property
    def b(self) -> Any:
        """Second factor."""
        return self.b_pair.b

    @property
    def weight(self) -> Any:
        """Weight of the pair; of two, the mean."""
        first, second = self.a_pair.pair.weight, self.b_pair.pair.weight
        return first if self.a_pair is self.b_pair else (first + second) / 2


def new_record(delta: float, relaxation: Any, grouping: Any, lift: bool, objective: Any) -> RelaxationRecord:
    """Make a generated block that is in no model yet, with delta on it, and return its record."""
    block = Block(concrete=True)
    # Zero is allowed: products bounded by zero are the pairs themselves, and some solvers can hold them.
    block.delta = Param(initialize=delta, mutable=True, domain=NonNegativeReals, doc="bound of the products")
    excess = getattr(relaxation, "excess_bound", None)
    if excess is not None:
        block.excess = Var(bounds=(0, excess), initialize=min(1.0, excess), doc="bound of the products, paid for")
    block.rows = Constraint(NonNegativeIntegers, doc="bound the products")
    block.sides = Constraint(NonNegativeIntegers, doc="keep the signs of the sides")
    block.lifted = Var(NonNegativeIntegers, dense=False, doc="stand for sides that are no variables")
    block.definitions = Constraint(NonNegativeIntegers, doc="define the lifted variables")
    record = record_of(block)
    record.main = block
    record.relaxation = relaxation
    # Asked once: a check of the protocols for each pair would be slow.
    is_penalty = isinstance(relaxation, ObjectiveTerm)
    record.penalises_products = is_penalty and excess is None
    record.shifts = not is_penalty and relaxation.shift(block.delta) is not None
    record.grouping = grouping
    record.lift = lift
    record.objective = objective
    return record


def state_rows(record: RelaxationRecord, model: Any, forms: Sequence[CanonicalForm]) -> None:
    """State the rows of the statements, or terms of the objective.

    All that can fail is done on a block that is no part of the model yet.
    """
    for form in forms:
        statement = record.statements[form.source] = RelaxedStatement(form)
        statement.pairs = relaxed_pairs(record, form)
    for pairs in _grouped(record, model, list(record.relaxed_pairs)):
        record.products += _products(record, pairs)
    if not record.penalises_products:
        for shared in record.products:
            _put_bounds(record, shared)
    if isinstance(record.relaxation, ObjectiveTerm):
        record.main.objective = _objective_with_penalty(record)
    model.add_component(unique_component_name(model, BLOCK_NAME), record.main)
    if record.objective is not None:
        record.objective.deactivate()


def _grouped(record: RelaxationRecord, model: Any, members: list[RelaxedPair]) -> Iterator[list[RelaxedPair]]:
    """Ask the grouping; yields the pairs of each group."""
    relaxed = {id(member.pair): member for member in members}
    groups = record.grouping.groups([member.pair for member in members])
    count = sum(len(pairs) for _, pairs in groups)
    named = {id(pair) for _, pairs in groups for pair in pairs}
    if count != len(members) or len(named) != count or not named <= relaxed.keys():
        raise ComplementarityError(
            f"'{model.name}': {record.grouping} put {count} pairs into groups, "
            f"of {len(members)} pairs. A grouping returns every pair once."
        )
    return ([relaxed[id(pair)] for pair in pairs] for _, pairs in groups)


def _products(record: RelaxationRecord, pairs: Sequence[RelaxedPair]) -> list[list[Product]]:
    """The products of a group, in lists that share one bound each."""
    formed = getattr(record.grouping, "products", None)
    if formed is None:
        return [[Product(pair, pair) for pair in pairs]]
    known = {id(pair.pair): pair for pair in pairs}
    try:
        return [[Product(known[id(a)], known[id(b)])] for a, b in formed([pair.pair for pair in pairs])]
    except KeyError:
        raise ComplementarityError(
            f"{record.grouping} formed a product of a pair that is not in the group. "
            "products(pairs) returns a list of (pair of the first factor, pair of the second), of its own pairs."
        ) from None


def _put_bounds(record: RelaxationRecord, shared: list[Product]) -> None:
    """State the rows that bound some products together."""
    relaxation, bound = record.relaxation, record.bound
    shift = relaxation.shift(bound)
    if shift is not None:
        # The shift is the bound of the row and not a term of its body. So the body stays a plain product, which is
        # quicker to write, and delta moves inside a solve by moving one bound.
        residuals = [relaxation.residual(product.a, product.b, 0) for product in shared]
        body = residuals[0] if len(residuals) == 1 else quicksum(residuals)
        record.bounds.append(record.put_row("rows", body <= shift, _sources(shared)))
        return
    # Residuals without a shift cannot be added up: each product is bounded by itself.
    for product in shared:
        row = relaxation.residual(product.a, product.b, bound) <= 0
        record.bounds.append(record.put_row("rows", row, _sources([product])))


def _sources(shared: list[Product]) -> list[Any]:
    """The statements that products came from, each once."""
    sources = [relaxed.pair.source for product in shared for relaxed in product]
    return list({id(source): source for source in sources}.values())


def _objective_with_penalty(record: RelaxationRecord) -> Objective:
    """The user's objective with the penalty term of all groups."""
    users, main = record.objective, record.main
    if record.penalises_products:
        # A factor of one is dropped by Pyomo itself.
        amount = quicksum([each.weight * (each.a * each.b) for shared in record.products for each in shared])
    else:
        amount = main.excess
    term = record.relaxation.coefficient(main.delta) * amount
    if users is None:
        return Objective(expr=term, sense=minimize)
    # The user's objective enters by name, so that later assignments are followed.
    return Objective(expr=users + term if users.is_minimizing() else users - term, sense=users.sense)


# ------------------------------------------------------------------------------------------------------------- relaxing


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
        refuse_missing_pairs(model, sources, targets)
        refuse_second_delta(model)
        objective = _penalised(model) if isinstance(chosen, ObjectiveTerm) else None
        forms = [canonical_form(source) for source in sources]
        refuse_disjuncts(model, sources)
        refuse_unusable_leaves(forms)
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
    """Return the generated rows of a pair: first the rows that relax its products, then the rows of its sides."""
    for record in records_above(source):
        statement = record.statements.get(source)
        if statement is None:
            continue
        return sorted(statement.rows, key=lambda row: row.parent_component().local_name != "rows")
    raise ComplementarityError(
        f"'{source.name}': is not relaxed. Apply pyrobocop.relax_complementarity to its model first."
    )


def sources_of(row: Any) -> list[Any]:
    """Return the pairs, as declared, that a generated row, side or objective came from; none for any other row."""
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
