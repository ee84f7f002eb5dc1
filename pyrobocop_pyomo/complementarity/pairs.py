"""The canonical form of a pair, and where the active pairs of a model are found."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.enums import SortComponents
from pyomo.gdp import Disjunct
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.errors import ComplementarityError

from .component import Complementarity
from .sides import canonical_side

PAIR_TYPES = (Complementarity, MpecComplementarity)
BLOCK_TYPES = (Block, Disjunct)


class Part(Enum):
    """How much of the expression ``b`` a pair is about."""

    WHOLE = "b itself, which is nonnegative"
    POSITIVE = "max(b, 0)"
    NEGATIVE = "max(-b, 0)"


@dataclass(frozen=True, eq=False)
class CanonicalPair:
    """One pair as ``0 <= a ⟂ b >= 0``.

    Attributes
    ----------
    source : component data
        The pair as declared, of this package or of `pyomo.mpec`; never changed but for its activity.
    a, b : Pyomo expression
        Nonnegative where the sides hold; a bare variable where its bound is zero.
    a_row, b_row : relational expression or None
        What has to be a constraint for the side to hold; None where a variable's own bound does it.
    group : hashable or None
        Label of the group that the pair belongs to.
    weight : number or Pyomo expression
        Measure of the pair in a penalty.
    b_part : Part
        Of which part of ``b`` the pair speaks: of a range ``l <= F <= u ⟂ H``, the first pair couples F - l with
        the positive part of H, the second u - F with the negative one. ``b`` is H in both.
    role : {"", "lower", "upper"}
        What tells two pairs of one source apart.
    """

    source: Any
    a: Any
    b: Any
    a_row: Any
    b_row: Any
    group: Hashable
    weight: Any
    b_part: Part = Part.WHOLE
    role: str = ""

    @property
    def name(self) -> str:
        """Name of the pair, as the user finds it in the model; where there are two, with the role."""
        # Asked for when needed: a full name costs about as much as the rest of the canonical form.
        return f"{self.source.name} ({self.role})" if self.role else self.source.name


@dataclass(frozen=True, eq=False)
class CanonicalForm:
    """All that one statement says.

    Attributes
    ----------
    source : component data
        The statement as declared.
    pairs : tuple of CanonicalPair
        One; two for a range against a free side; none for an equality against a free side.
    rows : tuple of relational expressions
        What has to be a constraint beyond the ``a_row`` and ``b_row`` of the pairs.
    """

    source: Any
    pairs: tuple[CanonicalPair, ...]
    rows: tuple[Any, ...]


def canonical_pair(source: Any) -> CanonicalPair:
    """Bring one pair into canonical form.

    Parameters
    ----------
    source : component data
        A pair of this package's `Complementarity` or of `pyomo.mpec`.

    Raises
    ------
    ComplementarityError
        If a side cannot be brought into the form ``expression >= 0``.
    """
    if source.ctype is Complementarity:
        first, second = source.args
        first_bound, second_bound = source.bounds
        group, weight = source.group, source.weight
    else:
        # The sides of pyomo.mpec have no public name; its own standard form would change the block.
        sides = getattr(source, "_args", None)
        if sides is None:
            raise ComplementarityError(f"'{source.name}': has no sides. Give it complements(first, second).")
        first, second = sides
        first_bound = second_bound = group = None
        weight = 1
    a, a_row = canonical_side(first, first_bound, source)
    b, b_row = canonical_side(second, second_bound, source)
    return CanonicalPair(source, a, b, a_row, b_row, group, weight)


def canonical_form(source: Any) -> CanonicalForm:
    """Bring one statement into canonical form; parameters and errors as for `canonical_pair`."""
    return CanonicalForm(source, (canonical_pair(source),), ())


def active_pairs(model: Any, targets: Iterable[Any] | None = None) -> list[CanonicalPair]:
    """Find every active pair of a model.

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
    return [canonical_pair(source) for source in active_sources(model, targets)]


def active_sources(model: Any, targets: Iterable[Any] | None = None) -> list[Any]:
    """Find the component data of every active pair; parameters as for `active_pairs`."""
    if targets is None:
        return list(_below(model))
    if hasattr(targets, "ctype"):
        targets = [targets]
    found: dict[int, Any] = {}
    for target in targets:
        for source in _at(target, model):
            found[id(source)] = source
    return list(found.values())


def _below(block: Any) -> Iterator[Any]:
    for part in block.block_data_objects(active=True, descend_into=BLOCK_TYPES, sort=SortComponents.deterministic):
        yield from part.component_data_objects(
            PAIR_TYPES, active=True, descend_into=False, sort=SortComponents.deterministic
        )


def _at(target: Any, model: Any) -> Iterator[Any]:
    kind = getattr(target, "ctype", None)
    name = getattr(target, "name", repr(target))
    if kind not in PAIR_TYPES and kind not in BLOCK_TYPES:
        raise ComplementarityError(
            f"'{name}': a target is a Block, a Complementarity or one of its pairs, not a {type(target).__name__}."
        )
    if not _all_active_up_to(target, model):
        return
    for data in target.values() if target.is_indexed() else [target]:
        if not data.active:
            continue
        if kind in PAIR_TYPES:
            yield data
        else:
            yield from _below(data)


def _all_active_up_to(target: Any, model: Any) -> bool:
    """Whether all blocks between the target and the model are active; the target must lie in the model."""
    active = True
    part = target
    while part is not None and part is not model:
        active = active and part.active
        part = part.parent_block()
    if part is None:
        raise ComplementarityError(
            f"'{target.name}': is no part of '{model.name}'. Pass components of the model that is transformed."
        )
    return active
