"""The structure of every phase, point by point: what `check` refuses, and what it accepts although it is doubtful."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import values_restored, within_bounds
from pyrobocop_pyomo.phases.structure import HIGHER_INDEX_REMEDY, PointStructure, describe_higher_index

from .findings import Finding, Severity, Subject
from .linearised_rows import gradient

SINGULAR = 1e-8
POINTS_LOOKED_AT = 5


def structural_findings(phase: Any) -> Iterator[Finding]:
    """What the statements and the structure of one instant say, the first point at which it shows."""
    refused = None
    try:
        phase.check()
    except ModelError as error:
        refused = str(error)
    if refused is not None and "index is higher" not in refused:
        yield Finding(
            Severity.ERROR, Subject.STATEMENT, refused, (phase.name,), "rcp.solve refuses this phase until then."
        )
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
    yield from _singular(phase, structures)


def _doubts(phase: Any, structures: list[PointStructure]) -> Iterator[Finding]:
    for point in structures:
        if point.leftover_rows:
            yield Finding(
                Severity.WARNING,
                Subject.INDEX,
                f"phase '{phase.name}': at t = {point.time:g} {_quoted(point.leftover_rows)} can determine "
                "controls only.",
                _names(phase, point.leftover_rows),
                "Declare as Algebraic what an equation determines, or state the equation as a 'constraint'.",
                point.time,
            )
            break
    # Without rows and helpers there is nothing to look at: a structure that is square by rows alone is fine.
    for point in structures:
        if point.of_rows.unmatched_columns and point.undetermined:
            yield Finding(
                Severity.WARNING,
                Subject.UNDETERMINED,
                f"phase '{phase.name}': at t = {point.time:g} no equation and no pair is left to determine "
                f"{_quoted(point.undetermined)}.",
                _names(phase, point.undetermined),
                "Add an equation or a pair that holds it, or declare it as Control: the optimiser chooses it.",
                point.time,
            )
            break


def _singular(phase: Any, structures: list[PointStructure]) -> Iterator[Finding]:
    chosen = np.unique(np.linspace(0, len(structures) - 1, POINTS_LOOKED_AT).astype(int))
    for point in (structures[i] for i in chosen):
        if not point.rows or point.leftover_rows:
            continue
        dependent = dependent_rows(_jacobian(point))
        if not dependent:
            continue
        names = [list(point.rows)[row] for row in dependent]
        everywhere = _singular_around(point)
        yield Finding(
            Severity.ERROR if everywhere else Severity.WARNING,
            Subject.DEPENDENT,
            f"phase '{phase.name}': at t = {point.time:g} the equations {_quoted(names)} do not determine "
            f"{_quoted(list(point.unknowns))}: their Jacobian is singular "
            f"{'at the initial guess and around it' if everywhere else 'at the initial guess, though not around it'}.",
            _names(phase, names),
            "One of them follows from the others: replace it." if everywhere else "Start from another initial guess.",
            point.time,
        )
        return


def _jacobian(structure: PointStructure) -> np.ndarray:
    column = {id(variable): j for j, variable in enumerate(structure.unknowns.values())}
    matrix = np.zeros((len(structure.rows), len(column)))
    for i, row in enumerate(structure.rows.values()):
        own = [v for v in variables_in(row.body, include_fixed=True) if id(v) in column]
        for variable, entry in gradient(row.body, own):
            matrix[i, column[id(variable)]] = entry
    return matrix


def dependent_rows(matrix: np.ndarray) -> list[int]:
    """Rows of which one is a combination of the others, or zero; empty when all are independent or one is no number."""
    if not np.isfinite(matrix).all():
        return []
    size = np.abs(matrix).max(axis=1, keepdims=True, initial=0.0)
    scaled = matrix / np.where(size > 0, size, 1.0)
    width = np.abs(scaled).max(axis=0, keepdims=True, initial=0.0)
    left, values, _ = np.linalg.svd(scaled / np.where(width > 0, width, 1.0))
    rank = int((values > SINGULAR * max(values.max(initial=0.0), SINGULAR)).sum())
    if rank == len(matrix):
        return []
    weights = np.abs(left[:, rank:]).max(axis=1)
    return [int(i) for i in np.flatnonzero(weights > 0.1 * weights.max())]


def _singular_around(structure: PointStructure) -> bool:
    """Is the Jacobian singular at other values, too? The model keeps its own."""
    variables = {id(v): v for row in structure.rows.values() for v in variables_in(row.body, include_fixed=True)}
    random = np.random.default_rng(0)
    with values_restored(variables.values()) as values:
        for _ in range(3):
            for variable, before in zip(values.variables, values.taken, strict=True):
                centre = before or 0.0
                moved = centre + 0.2 * (1 + abs(centre)) * float(random.uniform(-1, 1))
                variable.set_value(within_bounds(moved, variable), skip_validation=True)
            if not dependent_rows(_jacobian(structure)):
                return False
    return True


def _quoted(names: list[str]) -> str:
    return ", ".join(map(repr, names))


def _names(phase: Any, names: list[str]) -> tuple[str, ...]:
    """Names of components in the model: 'derivative of v' is about the variable of v."""
    return tuple(f"{phase.name}.{name.rsplit(' ', 1)[-1]}" for name in names)
