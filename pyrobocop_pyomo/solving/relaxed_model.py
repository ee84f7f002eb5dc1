"""A model with its pairs relaxed for the time of a few solves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo.complementarity import (
    CanonicalPair,
    LiftedPair,
    active_sources,
    crossed_pairs_of,
    delta_of,
    has_penalty,
    lifted_pairs_of,
    pairs_of,
    relax,
    relaxation_rows_of,
    revert,
    shifted_rows_of,
    side_values,
    without_penalty,
)

from .presolve import Decision, fixed_at_zero, presolve


@dataclass(eq=False)
class RelaxedModel:
    """What was generated for the pairs of a model.

    Attributes
    ----------
    model : Block
    block : Block or None
        The generated block; None for a model without pairs.
    pairs : list of CanonicalPair
    lifted : list of LiftedPair
        Empty where the user has relaxed the model without lifting.
    crossed : list of (int, int)
        Numbers of two different pairs: of the first one's a and the second one's b, one has to be zero as well.
    shifted_rows : list of ConstraintData
        Those that a shift of delta moves.
    relaxing_rows : list of ConstraintData
        All that relax; the rest of the model says everything but "one of both is zero".
    decisions : list of Decision
        What the presolve found.
    """

    model: Any
    block: Any = None
    pairs: list[CanonicalPair] = field(default_factory=list)
    lifted: list[LiftedPair] = field(default_factory=list)
    crossed: list[tuple[int, int]] = field(default_factory=list)
    shifted_rows: list[Any] = field(default_factory=list)
    relaxing_rows: list[Any] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)

    @classmethod
    def of(cls, model: Any) -> RelaxedModel:
        """Read a model that is relaxed."""
        lifted = lifted_pairs_of(model)
        numbers = {id(pair.pair): number for number, pair in enumerate(lifted)}
        crossed = crossed_pairs_of(model) if lifted else []
        return cls(
            model,
            delta_of(model).parent_block(),
            pairs_of(model),
            lifted,
            [(numbers[id(first)], numbers[id(second)]) for first, second in crossed],
            shifted_rows_of(model),
            relaxation_rows_of(model),
        )

    @property
    def delta(self) -> Any:
        """The mutable parameter, or None."""
        return None if self.block is None else self.block.delta

    @property
    def has_penalty(self) -> bool:
        """Whether the objective has a penalty term."""
        return self.block is not None and has_penalty(self.model)

    @contextmanager
    def without_penalty(self) -> Iterator[None]:
        """Put the user's objective back for a moment."""
        with without_penalty(self.model):
            yield

    def start_lifted(self) -> None:
        """Give generated variables the values of what they stand for."""
        for lifted in self.lifted:
            sides = (lifted.a, lifted.b)
            if not any(side.variable.parent_block() is self.block for side in sides):
                continue
            for side, number in zip(sides, side_values(lifted.pair, unknown=0.0), strict=True):
                if side.variable.parent_block() is self.block:
                    side.variable.set_value(max(number, 0.0), skip_validation=True)


@contextmanager
def relaxed_model(model: Any, relaxation: Any, grouping: Any, delta: float) -> Iterator[RelaxedModel]:
    """Relax what is not relaxed yet and decide what bounds decide; afterwards the model is as it was.

    A relaxation that the user has applied is used and kept.
    """
    if active_sources(model):
        token = relax(model, relaxation=relaxation or "scholtes", grouping=grouping or "pair", delta=delta, lift=True)
        try:
            relaxed = RelaxedModel.of(model)
            relaxed.decisions = presolve(relaxed.lifted)
            with fixed_at_zero(relaxed.decisions):
                yield relaxed
        finally:
            revert(model, token)
    elif pairs_of(model):
        own = delta_of(model)
        before = own.value
        try:
            yield RelaxedModel.of(model)
        finally:
            own.set_value(before)
    else:
        yield RelaxedModel(model)


def forget_removed(model: Any) -> None:
    """Take out of the user's suffixes what is no part of the model any more: rows that were generated and removed."""
    for suffix in model.component_objects(Suffix, active=True):
        for component in [key for key in suffix if key is not None and not _is_part_of(model, key)]:
            del suffix[component]


def _is_part_of(model: Any, component: Any) -> bool:
    # What was removed does not hold on to what it was in: that may be gone already.
    return component.parent_component() is not None and component.model() is model.model()
