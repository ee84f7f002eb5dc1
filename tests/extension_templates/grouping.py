"""Template of a grouping: which pairs share a row."""

from collections.abc import Sequence
from dataclasses import dataclass

from pyrobocop_pyomo.complementarity import CanonicalPair


@dataclass(frozen=True)
class PerComponent:
    """All pairs of one Complementarity component share a row."""

    def groups(self, pairs: Sequence[CanonicalPair]) -> list[tuple[str, list[CanonicalPair]]]:
        """Split the pairs: every pair comes once, and equal pairs always get the same name."""
        found: dict[str, list[CanonicalPair]] = {}
        for pair in pairs:
            found.setdefault(pair.source.parent_component().name, []).append(pair)
        return list(found.items())
