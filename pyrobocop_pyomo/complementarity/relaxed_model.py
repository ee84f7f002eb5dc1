"""A model with its pairs relaxed for the time of a few solves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from pyomo.core.base.suffix import Suffix
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.expressions import ExpressionBounds
from pyrobocop_pyomo.modeling.pyomo_internals import put_bounds, stored_bounds

from .forms import CanonicalPair, SidePart
from .lifting import LiftedPair, SideVariable
from .pairs import active_sources, side_values
from .relaxing import (
    crossed_pairs_of,
    delta_of,
    has_penalty,
    lifted_pairs_of,
    pairs_of,
    relax,
    relaxation_rows_of,
    revert,
    shifted_rows_of,
)

SIDES_HOLD = (
    "Both sides of a pair are >= 0 at all times: what acts only where a gap is closed is "
    "complements(gap >= 0, force >= 0)."
)


def presolve(pairs: Sequence[LiftedPair], tolerance: float = 1e-7) -> list[SideVariable]:
    """Find the pairs that bounds and fixed variables decide.

    Parameters
    ----------
    pairs : list of LiftedPair
    tolerance : float
        A side counts as positive from here on, and a fixed one as negative below ``-tolerance``.

    Returns
    -------
    list of SideVariable
        The sides to hold at zero, because the others cannot be; in the order of the pairs.

    Raises
    ------
    ComplementarityError
        Where a side has a fixed value and both are positive, or one of them cannot reach zero from below: the pair
        cannot be met.
    """
    intervals = ExpressionBounds()
    zero_sides = []
    for pair in pairs:
        least_a, most_a = _range(pair.a, pair.pair.a, pair.pair.a_part, intervals)
        least_b, most_b = _range(pair.b, pair.pair.b, pair.pair.b_part, intervals)
        for which, most in (("first", most_a), ("second", most_b)):
            if most < -tolerance:
                raise ComplementarityError(
                    f"'{pair.pair.name}': its {which} side is at most {most:g} by bounds and fixed variables, but must "
                    f"be >= 0. Check the bounds and what is fixed. {SIDES_HOLD}"
                )
        if least_a > tolerance and least_b > tolerance:
            if not (pair.a.variable.fixed or pair.b.variable.fixed):
                continue  # bounds alone: a problem without a solution, which the solve says
            raise ComplementarityError(
                f"'{pair.pair.name}': both sides are positive by bounds and fixed variables (at least {least_a:g} and "
                f"{least_b:g}), but one has to be zero. Check the bounds and what is fixed."
            )
        if least_a > tolerance:
            zero_sides.append(pair.b)
        elif least_b > tolerance:
            zero_sides.append(pair.a)
    return zero_sides


@contextmanager
def fixed_at_zero(sides: Sequence[SideVariable]) -> Iterator[None]:
    """Hold the decided sides at zero by the bounds of their variables; afterwards these are as they were."""
    # The stored bounds and not `variable.upper`, which cannot tell a bound of its own from one of the domain.
    before = [(side.variable, stored_bounds(side.variable)) for side in sides]
    try:
        for side in sides:
            variable, offset = side.variable, value(side.offset)
            # Intersected and not overwritten: a bound that excludes zero stays, and the solver sees it.
            if side.sign > 0 and not variable.fixed:
                variable.setub(offset if variable.ub is None else min(offset, variable.ub))
            elif not variable.fixed:
                variable.setlb(offset if variable.lb is None else max(offset, variable.lb))
        yield
    finally:
        for variable, bounds in reversed(before):
            put_bounds(variable, bounds)


def _range(side: SideVariable, expression: Any, part: SidePart, intervals: ExpressionBounds) -> tuple[float, float]:
    """Interval that a side lies in, by its variable and, where it was lifted, by its expression."""
    variable, offset = side.variable, value(side.offset)
    bounds = [variable.value] * 2 if variable.fixed else intervals.walk_expression(variable)
    least, most = sorted(side.sign * (bound - offset) for bound in bounds)
    if expression is not variable:
        below, above = intervals.walk_expression(expression)
        if part is SidePart.NEGATIVE:
            below, above = -above, -below
        if part is not SidePart.WHOLE:
            below, above = max(below, 0.0), max(above, 0.0)
        least, most = max(least, below), min(most, above)
    return least, most


@dataclass(eq=False)
class RelaxedModel:
    """The generated variables and rows for the pairs of a model.

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
    decided : list of SideVariable
        What the presolve found.
    """

    model: Any
    block: Any = None
    pairs: list[CanonicalPair] = field(default_factory=list)
    lifted: list[LiftedPair] = field(default_factory=list)
    crossed: list[tuple[int, int]] = field(default_factory=list)
    shifted_rows: list[Any] = field(default_factory=list)
    relaxing_rows: list[Any] = field(default_factory=list)
    decided: list[SideVariable] = field(default_factory=list)

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
    def has_pairs_alone(self) -> bool:
        """Whether there are pairs, and products of sides of different pairs say no more than these."""
        return bool(self.pairs) and not self.crossed

    @property
    def delta(self) -> Any:
        """The mutable parameter, or None."""
        return None if self.block is None else self.block.delta

    @property
    def has_penalty(self) -> bool:
        """Whether the objective has a penalty term."""
        return self.block is not None and has_penalty(self.model)

    def start_lifted(self) -> None:
        """Give generated variables the values of their sides."""
        for lifted in self.lifted:
            for side, number in zip((lifted.a, lifted.b), side_values(lifted.pair, unknown=0.0), strict=True):
                if side.variable.parent_block() is self.block:
                    side.variable.set_value(max(number, 0.0), skip_validation=True)


@contextmanager
def relaxed_model(model: Any, relaxation: Any, grouping: Any, delta: float) -> Iterator[RelaxedModel]:
    """Relax the pairs that are not relaxed yet, and decide pairs by bounds; afterwards the model is as it was.

    A relaxation that the user has applied is used and kept.
    """
    if active_sources(model):
        token = relax(model, relaxation=relaxation or "scholtes", grouping=grouping or "pair", delta=delta, lift=True)
        try:
            relaxed = RelaxedModel.of(model)
            relaxed.decided = presolve(relaxed.lifted)
            with fixed_at_zero(relaxed.decided):
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


def clean_suffixes(model: Any) -> None:
    """Take generated rows that were removed out of the user's suffixes."""
    for suffix in model.component_objects(Suffix, active=True):
        # What was removed does not hold on to what it was in: that may be gone already.
        keys = [key for key in suffix if key is not None]
        for key in [key for key in keys if key.parent_component() is None or key.model() is not model.model()]:
            del suffix[key]
