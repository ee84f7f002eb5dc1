"""What a simulation has to find, beside the states."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pyrobocop_pyomo.complementarity import Complementarity
from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.rule_results import variables_read
from pyrobocop_pyomo.transcription import InitialGuess

from .declarations import Algebraic, Control
from .record import PhaseRecord

LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class Unknowns:
    """What the equations at a collocation point determine.

    Attributes
    ----------
    implicit : tuple of str
        States whose derivatives stand in residual equations.
    algebraics : tuple of str
        Algebraics to find.
    order : tuple of str
        All algebraics and controls in the order of a trajectory.
    contact : bool
        Whether pairs determine some of it.
    """

    implicit: tuple[str, ...]
    algebraics: tuple[str, ...]
    order: tuple[str, ...]
    contact: bool = False


def find_unknowns(
    block: Any, record: PhaseRecord, given: Mapping[str, InitialGuess], asked: Sequence[str] | None = None
) -> Unknowns:
    """Tell what is to be found from what is given.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    given : mapping of name to values
        Only the names count.
    asked : sequence of str, optional
        Algebraics and controls that are to be found; by default what equations and pairs suffice for: the algebraics
        that are not given and, where pairs then outnumber the unknowns, the controls that stand in pairs as well.

    Raises
    ------
    InitialGuessError
        When a name is unknown, or equations and unknowns do not match.
    """
    algebraics, controls = record.names(Algebraic), record.names(Control)
    for name in (*given, *(asked or ())):
        if name not in algebraics + controls:
            raise InitialGuessError(
                f"phase '{block.name}': '{name}' is given to a simulation, but it is neither control nor algebraic; "
                f"these are {', '.join(controls + algebraics) or 'none'}."
            )
    implicit = tuple(name for name in record.names_of_states if name not in record.equation_of)
    order = (*algebraics, *controls)
    equations, pairs = record.residuals_per_point - len(implicit), _pairs_per_point(block)
    if asked is not None:
        twice = [name for name in asked if name in given]
        if twice:
            raise InitialGuessError(f"phase '{block.name}': '{twice[0]}' is both given and to be found.")
        return Unknowns(implicit, tuple(asked), order, contact=pairs > 0)
    free = tuple(name for name in algebraics if name not in given)
    in_pairs = tuple(name for name in _controls_in_pairs(block, record, controls) if name not in given)
    for found in (free, (*free, *in_pairs)):
        if pairs and equations + pairs == len(found):
            return Unknowns(implicit, found, order, contact=True)
    if equations in (0, len(free)):  # without any, pairs alone would have to determine them: they keep their guess
        if pairs:
            LOGGER.info("phase '%s': the simulation looks at no pairs; they determine nothing in it.", block.name)
        return Unknowns(implicit, free if equations else (), order)
    raise InitialGuessError(
        f"phase '{block.name}': a simulation has {record.residuals_per_point} residual equations and {pairs} pairs per "
        f"point for {len(implicit) + len(free)} unknowns: {', '.join((*implicit, *free)) or 'none'}. Give in "
        "controls={...} what neither determines, or say by unknown=[...] what is to be found."
    )


def _pairs_per_point(block: Any) -> int:
    """How many pairs are stated at a collocation point."""
    counts = Counter(
        index[0] if isinstance(index, tuple) else index
        for component in block.component_objects(Complementarity, active=True, descend_into=False)
        for index, data in component.items()
        if data.active
    )
    return max(counts.values(), default=0)


def _controls_in_pairs(block: Any, record: PhaseRecord, controls: Sequence[str]) -> list[str]:
    """Controls that stand in a pair as they are, in the order of their declaration."""
    of = {id(variable): name for name in controls for variable in record.nodes(name).variables(block)}
    found = {
        of[id(variable)]
        for component in block.component_objects(Complementarity, active=True, descend_into=False)
        for data in component.values()
        if data.active
        for side in data.args
        for variable in variables_read(side)
        if id(variable) in of
    }
    return [name for name in controls if name in found]
