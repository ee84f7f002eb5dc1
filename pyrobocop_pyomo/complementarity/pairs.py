"""The canonical form of declared pairs, and the search for active ones.

How well the pairs are met, computed from the values on the model and not from the generated rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.enums import SortComponents
from pyomo.core.expr import EqualityExpression, RangedExpression
from pyomo.core.expr.numvalue import value
from pyomo.gdp import Disjunct
from pyomo.mpec import Complementarity as MpecComplementarity
from pyomo.util import check_units

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, is_inside, outermost_inactive
from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.modeling.row_violations import number_or_nan

from .component import Complementarity
from .forms import CanonicalForm, CanonicalPair, SidePart, form_of
from .sides import read_side

PAIR_TYPES = (Complementarity, MpecComplementarity)


def canonical_form(source: Any) -> CanonicalForm:
    """Bring one statement into canonical form.

    Parameters
    ----------
    source : component data
        A pair of this package's `Complementarity` or of `pyomo.mpec`.

    Raises
    ------
    ComplementarityError
        If its sides do not have two finite bounds together, or bounds that nothing can meet.
    """
    if source.ctype is Complementarity:
        first, second = source.args
        return form_of(source, first, second, source.bounds)
    # The sides of pyomo.mpec have no public name; its own standard form would change the block.
    sides = getattr(source, "_args", None)
    if sides is None:
        raise ComplementarityError(f"'{source.name}': has no sides. Give it complements(first, second).")
    first, second = sides
    return form_of(source, first, second, (_mpec_choice(first, second, source), _mpec_choice(second, first, source)))


def _mpec_choice(side: Any, other: Any, source: Any) -> str | None:
    """Which bounds of a plain variable count.

    In `pyomo.mpec` only those that are written out do. Where they suffice, a plain variable on the other side is
    free and its bounds do not take part; where they do not, `pyomo.mpec` would refuse, and its own ones are taken.
    """
    if is_plain_variable(side) and (
        other.__class__ is EqualityExpression
        or (other.__class__ is RangedExpression and read_side(other, None, source).bounds == 2)
    ):
        return "free"
    return None


def active_pairs(model: Any, targets: Iterable[Any] | None = None) -> list[CanonicalPair]:
    """Find every active pair of a model; a range gives two, an equality none.

    Parameters
    ----------
    model : Block
        Searched with all its active blocks and disjuncts.
    targets : iterable of components, optional
        Blocks, `Complementarity` components or single pairs of this model; only pairs in these are returned.

    Returns
    -------
    list of CanonicalPair
        In the order of declaration; with targets, in the order of the targets. No pair comes twice.

    Raises
    ------
    ComplementarityError
        If a target is no part of the model or cannot hold a pair, or if a pair has no canonical form.
    """
    return [pair for source in active_sources(model, targets) for pair in canonical_form(source).pairs]


def active_sources(model: Any, targets: Iterable[Any] | None = None) -> list[Any]:
    """Find the component data of every active pair; parameters as for `active_pairs`."""
    return active_parts(model, targets, PAIR_TYPES)


def active_parts(
    model: Any, targets: Any, kinds: tuple[type, ...], containers: tuple[type, ...] = BLOCK_TYPES
) -> list[Any]:
    """Find the active component data of some types in blocks of some types; targets as for `active_pairs`."""
    if targets is None:
        return list(_below(model, kinds, containers))
    parts: dict[int, Any] = {}
    for target in [targets] if hasattr(targets, "ctype") else targets:
        for data in _at(target, model, kinds, containers):
            parts[id(data)] = data
    return list(parts.values())


def block_of_rows(block: Any, model: Any) -> Any:
    """Where the rows are put: on the model, or on the disjunct of the pairs, so that they hold only if it is chosen."""
    while block is not model:
        if block.ctype is Disjunct:
            return block
        block = block.parent_block()
    return model


def _below(block: Any, kinds: tuple[type, ...], containers: tuple[type, ...]) -> Iterator[Any]:
    for part in block.block_data_objects(active=True, descend_into=containers, sort=SortComponents.deterministic):
        yield from part.component_data_objects(
            kinds, active=True, descend_into=False, sort=SortComponents.deterministic
        )


def _at(target: Any, model: Any, kinds: tuple[type, ...], containers: tuple[type, ...]) -> Iterator[Any]:
    kind = getattr(target, "ctype", None)
    name = getattr(target, "name", None) or repr(target)
    if kind not in kinds and kind not in containers:
        words = ", ".join(dict.fromkeys(known.__name__ for known in (Block, *kinds)))
        raise ComplementarityError(
            f"'{name}': a target is one of {words}, or a single part of one, not a {type(target).__name__}."
        )
    if target is not model and not is_inside(target, model):
        raise ComplementarityError(
            f"'{name}': is no part of '{model.name}'. Pass components of the model that is transformed."
        )
    if outermost_inactive(target, model) is not None:
        return
    for data in target.values() if target.is_indexed() else [target]:
        if not data.active:
            continue
        if kind in kinds:
            yield data
        else:
            yield from _below(data, kinds, containers)


def check_units_of_pair(data: Any) -> None:
    """Raise Pyomo's `UnitsError` where the parts of a side have units that do not fit together."""
    form = canonical_form(data)
    for pair in form.pairs:
        check_units.assert_units_consistent(pair.a)
        check_units.assert_units_consistent(pair.b)
    for row in form.rows:
        check_units.assert_units_equivalent(*row.args)


# The table by which Pyomo's check of units goes; it has none for pairs of any kind.
getattr(check_units, "_component_data_handlers", {}).setdefault(Complementarity, check_units_of_pair)


# ------------------------------------------------------------------------------------------------------------ residuals


@dataclass(frozen=True)
class PairResidual:
    """The values of one pair ``0 <= a ⟂ b >= 0``.

    Attributes
    ----------
    name : str
        Of the pair as declared; of a range with "(lower)" or "(upper)" behind it, one residual for either bound.
    a, b : float
        Values of the two sides. Of a range ``l <= F <= u ⟂ H``: the distance from the bound, and what H is beyond
        zero to the side that this bound answers, ``max(H, 0)`` for the lower and ``max(-H, 0)`` for the upper.
    """

    name: str
    a: float
    b: float

    @property
    def product(self) -> float:
        """``a * b``: what a relaxation bounds."""
        return self.a * self.b

    @property
    def natural(self) -> float:
        """``min(a, b)``: zero exactly where the pair is met, and the distance to that near it."""
        return min(self.a, self.b)


def pair_residuals(pairs: Iterable[CanonicalPair]) -> list[PairResidual]:
    """Evaluate pairs at the current values.

    Raises
    ------
    ComplementarityError
        If a variable of a side has no value.
    """
    return [PairResidual(pair.name, *side_values(pair)) for pair in pairs]


def side_values(pair: CanonicalPair, unknown: float | None = None) -> tuple[float, float]:
    """Return the values of both sides, of a part of a range the value of that part.

    Parameters
    ----------
    pair : CanonicalPair
    unknown : float, optional
        Returned for a side without a value; by default that is an error, as for `pair_residuals`.
    """
    a, b = (_number(pair, side, unknown) for side in (pair.a, pair.b))
    return float(part_of_side(a, pair.a_part)), float(part_of_side(b, pair.b_part))


def sides_at_zero(form: CanonicalForm) -> list[tuple[CanonicalPair, Any, str]]:
    """The sides that are held at zero, of each pair the one that is smaller now: the pair, its side, and which it is.

    The parts of a free side are zero together: one equation, and only where no bound of the range has one.
    """
    stated = [(pair, *side_values(pair)) for pair in form.pairs if pair.a_part is SidePart.WHOLE]
    first = [(pair, pair.a, "first") for pair, a, b in stated if a < b]
    second = [(pair, pair.b, "second") for pair, a, b in stated if not a < b]
    whole = [each for each in second if each[0].b_part is SidePart.WHOLE]
    parts = [each for each in second if each[0].b_part is not SidePart.WHOLE]
    return [*first, *whole, *([] if first else parts[:1])]


def part_of_side(values: Any, part: SidePart) -> Any:
    """What numbers of a side, or arrays of them, count for as a part of a range."""
    return values if part is SidePart.WHOLE else np.maximum(values if part is SidePart.POSITIVE else -values, 0.0)


def _number(pair: CanonicalPair, side: Any, unknown: float | None) -> float:
    if unknown is not None:
        number = number_or_nan(side)
        return unknown if math.isnan(number) else number
    number = value(side, exception=False)
    if number is None:
        raise ComplementarityError(
            f"'{pair.name}': the side '{side}' holds a variable without a value. Solve the model, or set the value."
        )
    return float(number)
