"""Problems of the textbook table stated a second time, as CasADi functions, where no source gives enough digits."""

from __future__ import annotations

from . import aloft, motions, oscillators, passages, plants, populations, processes, stated_before, switching

STATEMENTS = tuple(
    statement
    for family in (stated_before, motions, oscillators, passages, processes, aloft, plants, populations, switching)
    for statement in family.STATEMENTS
)
