"""The transformation `pyrobocop.relax_complementarity`: pairs become rows that a nonlinear solver can hold."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pyomo.common.config import ConfigDict, ConfigValue, PositiveFloat
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base import Transformation, TransformationFactory

from pyrobocop_pyomo.errors import ComplementarityError

from .canonical import CanonicalPair
from .formulation import crossings
from .grouping import PerPair, as_grouping
from .lifting import LiftedPair, SideVariable, side_variable
from .pair_checks import refuse_leaves
from .pairs import active_sources, canonical_form, put_to_sleep
from .preconditions import (
    only_objective,
    refuse_nothing,
    refuse_other_options,
    refuse_second_delta,
    refuse_unusable,
)
from .record import Application, Group, Record, record_of, record_on, records_above, records_below
from .relaxations import ObjectiveTerm, Scholtes, as_relaxation
from .residuals import PairResidual, pair_residuals
from .rows import add_statements, new_record, remove_statements
from .updating import restart, update

logger = logging.getLogger(__name__)


def _finite_positive(number: Any) -> float:
    number = PositiveFloat(number)
    if not math.isfinite(number):
        raise ValueError(f"expected a finite number, found {number}")
    return number


@dataclass(frozen=True, eq=False)
class RelaxationToken:
    """What `RelaxComplementarity.revert` needs to undo one application.

    Attributes
    ----------
    model : Block
        The model that was transformed.
    block : Block
        The generated block on it, with ``delta``, ``rows`` and ``sides``.
    application : int
        Which application on this block the token stands for.
    """

    model: Any
    block: Any
    application: int


@TransformationFactory.register(
    "pyrobocop.relax_complementarity", doc="Bound (or charge) the products of complementarity pairs, reversibly."
)
class RelaxComplementarity(Transformation):
    """Replace complementarity pairs by rows ``a * b <= delta`` that any nonlinear solver can hold.

    Pairs of this package and of `pyomo.mpec` are taken. They are deactivated and never changed. What is
    generated sits on one block with the mutable parameter ``delta``; only the rows of pairs inside a
    `Disjunct` sit on a block in that disjunct, so that they hold only where it is chosen.

    Options of ``apply_to`` and ``create_using``: ``relaxation`` (a word such as "scholtes" or "penalty", or an
    object), ``grouping`` ("pair", "element" or an object), ``delta`` (first value, 1e-2), ``lift`` (False) and
    ``targets`` (blocks, components or single pairs; default all). With ``lift``, a generated variable ``s >= 0``
    with the row ``s == side`` stands for each side that is more than a variable with a sign and an offset, so that
    products are bilinear; it starts at the value of the side. An application to a model that is relaxed already
    adds what is new, under the same delta. A block that is deactivated afterwards takes its own constraints
    out of the model but not the generated rows of its pairs: revert before, or deactivate first.
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
        ConfigValue(default=1e-2, domain=_finite_positive, description="First bound of the products."),
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

    def _apply_to(self, model: Any, **options: Any) -> RelaxationToken:
        options = {**options.pop("options", {}), **options}
        config = self.CONFIG(options)
        refuse_unusable(model)
        with PauseGC():
            sources = active_sources(model, config.targets)
            record = record_on(model)
            if record is None:
                refuse_nothing(model, sources, config.targets)
                refuse_second_delta(model)
                objective = only_objective(model) if isinstance(config.relaxation, ObjectiveTerm) else None
                record = new_record(config.delta, config.relaxation, config.grouping, config.lift, objective)
            else:
                refuse_other_options(model, record, config, options)
            return self._relax(model, record, sources, config.delta if "delta" in options else None)

    def _relax(self, model: Any, record: Record, sources: list[Any], delta: float | None) -> RelaxationToken:
        # A pair that is known already was activated again by hand: it only has to go back to sleep.
        known = record.statements
        forms = [canonical_form(source) for source in sources if not known or source not in known]
        refuse_leaves(forms)
        if forms:
            add_statements(record, model, forms)
        previous = None
        if delta is not None and record.applications:
            previous = record.main.delta.value
            record.main.delta.set_value(delta)
        put_to_sleep(sources)
        application = record.next_application
        record.next_application += 1
        record.applications[application] = Application([form.source for form in forms], sources, previous)
        logger.debug("'%s': relaxed %d complementarity statements", model.name, len(forms))
        return RelaxationToken(model, record.main, application)

    def revert(self, model: Any, token: RelaxationToken | None = None) -> None:
        """Undo one application, or all of them.

        Parameters
        ----------
        model : Block
            The model that `apply_to` was called with.
        token : RelaxationToken, optional
            What `apply_to` returned. Without it everything on this model is undone, which also serves a
            clone: a token belongs to the model that it was made for.

        Raises
        ------
        ComplementarityError
            If the model is not relaxed, or if the token is used up or belongs to another model.
        """
        record = record_on(model)
        if token is not None and token.model is not model:
            raise ComplementarityError(
                f"'{model.name}': the token was made for another model, '{token.model.name}'. "
                "On a clone, call revert(model) without a token."
            )
        if record is None or (token is not None and record.main is not token.block):
            raise ComplementarityError(f"'{model.name}': nothing to revert; it is not relaxed, or was reverted before.")
        if token is None:
            wanted = list(record.applications)
        elif token.application in record.applications:
            wanted = [token.application]
        else:
            raise ComplementarityError(f"'{model.name}': this application was reverted before.")
        with PauseGC():
            for number in reversed(wanted):
                application = record.applications.pop(number)
                if application.previous_delta is not None:
                    record.main.delta.set_value(application.previous_delta)
                if application.sources:
                    remove_statements(record, application.sources)
                for source in application.deactivated:
                    source.activate()

    def get_source(self, row: Any) -> list[Any]:
        """Return the pairs, as declared, that a generated row, side or objective came from."""
        record = _record_of_row(row)
        if record is not None and row is record.main.component("objective"):
            return list(record.statements)
        sources = None if record is None else record.origins.get((row.parent_component().local_name, row.index()))
        if sources is None:
            raise ComplementarityError(f"'{row.name}': was not generated by pyrobocop.relax_complementarity.")
        return list(sources)

    def get_rows(self, source: Any) -> list[Any]:
        """Return the generated rows of a pair: those that relax its products, then those of its sides."""
        for record in records_above(source):
            statement = record.statements.get(source)
            if statement is None:
                continue
            rows = []
            for group in {id(pair.group): pair.group for pair in statement.pairs}.values():
                for row in (*group.rows, *group.budgets):
                    origin = record.origins[row.parent_component().local_name, row.index()]
                    if any(each is source for each in origin):
                        rows.append(row)
            return [*rows, *statement.rows]
        raise ComplementarityError(
            f"'{source.name}': is not relaxed. Apply pyrobocop.relax_complementarity to its model first."
        )

    def get_lifted_pairs(self, model: Any) -> list[LiftedPair]:
        """Return the pairs that were relaxed with ``lift``, with the variables that stand for their sides."""
        return [
            LiftedPair(relaxed.pair, _as_variable(relaxed.a), _as_variable(relaxed.b))
            for record in records_below(model)
            if record.lift
            for relaxed in record.relaxed_pairs
        ]

    def get_crossed_pairs(self, model: Any) -> list[tuple[CanonicalPair, CanonicalPair]]:
        """Return the couples of different pairs that the grouping crosses: a of the first with b of the second.

        Where one of the two sides has to be zero as well, a branch of the pairs as stated does not see to it.
        """
        return [
            (first.pair, second.pair)
            for record in records_below(model)
            for group in record.groups
            for first, second in crossings(record, group.pairs)
        ]

    def get_relaxation_rows(self, model: Any) -> list[Any]:
        """Return the active rows that relax products, and not those that keep or define sides."""
        return [
            row
            for record in records_below(model)
            for group in _groups_seen(record, model)
            for row in (*group.rows, *group.budgets)
            if row.active
        ]

    def advance(self, model: Any, delta: float, multipliers: Mapping[Any, float] | None = None) -> bool:
        """Go on to the next solve: set delta, and whatever else the relaxation updates between solves.

        Parameters
        ----------
        model : Block
            With the values of the last solve.
        delta : float
            For the next one; positive.
        multipliers : mapping, optional
            From generated rows to their multipliers, of either sign; asked by relaxations that decide from these.
            Default: the model's import suffix ``dual``.

        Returns
        -------
        bool
            Whether any number of the model changed.

        Raises
        ------
        ComplementarityError
            If the model holds no or several relaxations, a side has no value, or multipliers are needed and missing.
        """
        return update(self._only_record(model), _finite_positive(delta), multipliers)

    def restart(self, model: Any, delta: float) -> None:
        """Go back to the first solve: set delta, and whatever `advance` has updated to its first value."""
        restart(self._only_record(model), _finite_positive(delta))

    def get_delta(self, model: Any) -> Any:
        """Return the mutable parameter delta of a relaxed model."""
        return self._only_record(model).main.delta

    def get_relaxation(self, model: Any) -> Any:
        """Return the relaxation object of a relaxed model."""
        return self._only_record(model).relaxation

    def relaxed_rows(self, model: Any) -> list[Any]:
        """Return the active rows ``... <= shift(delta)`` whose bound may move while a solver runs."""
        return [
            row
            for record in records_below(model)
            if record.abilities.shifts
            for group in _groups_seen(record, model)
            for row in group.rows
            if row.active
        ]

    def get_pairs(self, model: Any) -> list[CanonicalPair]:
        """Return all pairs of a model in canonical form: the relaxed ones, then those still active."""
        known: dict[int, tuple[CanonicalPair, ...]] = {}
        for record in records_below(model):
            known.update((id(source), each.form.pairs) for source, each in record.statements.items())
        for record in records_above(model):
            known.update(
                (id(source), each.form.pairs) for source, each in record.statements.items() if _is_inside(source, model)
            )
        for source in active_sources(model):
            if id(source) not in known:
                known[id(source)] = canonical_form(source).pairs
        return [pair for pairs in known.values() for pair in pairs]

    def residuals(self, model: Any) -> list[PairResidual]:
        """Evaluate all pairs, relaxed or still active, at the current values.

        Raises
        ------
        ComplementarityError
            If a variable of a pair has no value.
        """
        return pair_residuals(self.get_pairs(model))

    def _only_record(self, model: Any) -> Record:
        records = list(records_below(model))
        if len(records) != 1:
            names = ", ".join(f"'{record.main.name}'" for record in records) or "none"
            raise ComplementarityError(f"'{model.name}': expected one relaxation in it, found {names}.")
        return records[0]


def _as_variable(side: Any) -> SideVariable:
    found = side_variable(side)
    assert found is not None, "whatever is no variable was lifted"
    return found


def _groups_seen(record: Record, model: Any) -> list[Group]:
    """The groups whose generated block a solver sees."""
    awake = {id(home) for home, block in record.blocks.items() if _seen_by_a_solver(block, model)}
    return [group for group in record.groups if id(group.home) in awake]


def _record_of_row(row: Any) -> Record | None:
    block = record_of(row.parent_block()).main
    return None if block is None else record_of(block)


def _seen_by_a_solver(block: Any, model: Any) -> bool:
    while block is not None:
        if not block.active:
            return False
        if block is model:
            return True
        block = block.parent_block()
    return True


def _is_inside(component: Any, block: Any) -> bool:
    parent = component.parent_block()
    while parent is not None and parent is not block:
        parent = parent.parent_block()
    return parent is block
