"""Statements about families: both sides are indexed components, and each index has its member of either."""

from __future__ import annotations

from typing import Any

from pyrobocop_pyomo.errors import ComplementarityError

from .side_checks import is_indexed_component


def is_family_pair(first: Any, second: Any) -> bool:
    """True when both sides are indexed components, such as two indexed variables."""
    return is_indexed_component(first) and is_indexed_component(second)


def check_families(first: Any, second: Any, component: Any) -> None:
    """Refuse sides that are indexed otherwise than the component.

    Raises
    ------
    ComplementarityError
        If a side lacks an index of the component, or has one that the component lacks.
    """
    own = set(component.index_set())
    for side in (first, second):
        theirs = set(side.index_set())
        missing, spare = own - theirs, theirs - own
        if missing or spare:
            what, which = ("has no member", missing) if missing else ("has a member that no pair takes,", spare)
            raise ComplementarityError(
                f"'{component.name}': side '{side.name}' {what} for index {min(which, key=str)!r} "
                f"({len(theirs)} indices, of the component {len(own)}). Index both sides and the component over the "
                "same set, or pass a rule."
            )


def member(side: Any, index: Any, pair: Any) -> Any:
    """Return the member of a side at an index.

    Raises
    ------
    ComplementarityError
        If there is none.
    """
    try:
        return side[index]
    except KeyError:
        raise ComplementarityError(
            f"'{pair.name}': side '{side.name}' has no member at this index. Index both over the same set."
        ) from None
