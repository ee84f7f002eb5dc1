"""The structure of every phase, point by point: what `check` refuses, and what it accepts although it is doubtful."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases.structure import HIGHER_INDEX_REMEDY, PointStructure, describe_higher_index

from .findings import Finding, Severity, Subject, error_about, quoted, warning_about


def structural_findings(phase: Any) -> Iterator[Finding]:
    """What the statements and the structure of one instant say, the first point at which it shows."""
    refused = None
    try:
        phase.check()
    except ModelError as error:
        refused = str(error)
    if refused is not None and "index is higher" not in refused:
        yield error_about(Subject.STATEMENT, refused, (phase.name,), "rcp.solve refuses this phase until then.")
        return
    structures = [PointStructure(phase, phase.record, time) for time in phase.record.grid.points]
    higher = next((point for point in structures if point.has_higher_index), None)
    if higher is not None:
        allowed = phase.record.allow_higher_index
        yield Finding(
            Severity.WARNING if allowed else Severity.ERROR,
            Subject.INDEX,
            f"phase '{phase.name}': {describe_higher_index(higher)}",
            _names(phase, [*higher.leftover_rows, *higher.undetermined]),
            "It was allowed; expect less accurate algebraics." if allowed else HIGHER_INDEX_REMEDY,
            higher.time,
        )
        return
    yield from _doubts(phase, structures)


def _doubts(phase: Any, structures: list[PointStructure]) -> Iterator[Finding]:
    for point in structures:
        if point.leftover_rows:
            yield warning_about(
                Subject.INDEX,
                f"phase '{phase.name}': at t = {point.time:g} {quoted(point.leftover_rows)} can determine "
                "controls only.",
                _names(phase, point.leftover_rows),
                "Declare as Algebraic what an equation determines, or state the equation as a 'constraint'.",
                point.time,
            )
            break
    # Without rows and helpers there is nothing to look at: a structure that is square by rows alone is fine.
    for point in structures:
        if point.of_rows.unmatched_columns and point.undetermined:
            yield warning_about(
                Subject.UNDETERMINED,
                f"phase '{phase.name}': at t = {point.time:g} no equation and no pair is left to determine "
                f"{quoted(point.undetermined)}.",
                _names(phase, point.undetermined),
                "Add an equation or a pair that holds it, or declare it as Control: the optimiser chooses it.",
                point.time,
            )
            break


def _names(phase: Any, names: list[str]) -> tuple[str, ...]:
    """Names of components in the model: 'derivative of v' is about the variable of v."""
    return tuple(f"{phase.name}.{name.rsplit(' ', 1)[-1]}" for name in names)
