"""The canonical form of declared pairs, and the search for active ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.enums import SortComponents
from pyomo.core.expr import EqualityExpression, RangedExpression
from pyomo.gdp import Disjunct
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.modeling.activity import BLOCK_TYPES, is_inside, outermost_inactive
from pyrobocop_pyomo.modeling.expressions import is_plain_variable

from .component import Complementarity
from .forms import CanonicalForm, CanonicalPair, form_of
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
    found: dict[int, Any] = {}
    for target in [targets] if hasattr(targets, "ctype") else targets:
        for data in _at(target, model, kinds, containers):
            found[id(data)] = data
    return list(found.values())


def home_of(block: Any, model: Any) -> Any:
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
