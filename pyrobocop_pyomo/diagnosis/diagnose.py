"""`diagnose`: what is wrong with a model, before it is solved."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ContradictionError, ModelError
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.structure import HIGHER_INDEX_REMEDY, PointStructure, describe_higher_index

from .determinacy import (
    dependence_findings,
    excess_findings,
    freedom_findings,
    joining_findings,
    stated_pairs,
)
from .findings import Diagnosis, Finding, Severity, error_about, quoted, warning_about
from .linearised_rows import Equations
from .statements import (
    foreign_findings,
    form_findings,
    free_controls,
    misplaced_findings,
    objective_findings,
    scaled_pair_findings,
    statement_findings,
    unfinished_findings,
    unit_findings,
    without_objective,
)
from .values import (
    bound_findings,
    boundary_findings,
    decided_findings,
    discretised_start_findings,
    undefined_findings,
)


def diagnose(model: Any) -> Diagnosis:
    """Look at a model before a solve: structure, numbers at the initial guess, units and scaling.

    Nothing is solved and nothing is changed. The Jacobian of the equations is evaluated row by row with Pyomo's
    expressions, which takes some seconds for ten thousand rows; `rcp.solve` makes the cheap part of it each time.

    Parameters
    ----------
    model : ConcreteModel, Block or PhaseBlock
        Looked at with all its active blocks.

    Returns
    -------
    Diagnosis
        Counts, and findings with names and remedies.

    Raises
    ------
    ModelError
        When it is given several blocks at once, or no block.
    """
    if not isinstance(model, BlockData):
        raise ModelError(
            f"'{model}' is no model and no single phase. Diagnose the model, or one phase after the other."
        )
    phases = phases_of(model)
    remarks: list[str] = []
    equations = Equations(model)
    findings = [*shared_findings(model), *start_findings(model, remarks), *statement_findings(model)]
    if model is model.model():  # what solves a part of it may have its objective elsewhere
        findings += objective_findings(model)
        if without := without_objective(model):
            findings += freedom_findings(model, equations, without)
    findings += [*form_findings(model), *(finding for phase in phases for finding in structural_findings(phase))]
    variables = model.component_data_objects(Var, active=True, descend_into=Block)
    missing = sorted({data.parent_component().name for data in variables if data.value is None})
    if missing:
        remarks.append(f"rows that hold a variable without a value: {', '.join(missing)}")
    findings += [*undefined_findings(model), *decided_findings(model)]
    findings += [*excess_findings(model, equations)] or [*dependence_findings(model, equations)]
    findings += unit_findings(model)
    counted = phases if len(phases) == 1 and phases[0] is model else [*phases, model]
    findings.sort(key=lambda finding: list(Severity).index(finding.severity))
    return Diagnosis(model.name, tuple(findings), tuple(map(counts_of, counted)), tuple(remarks))


def shared_findings(model: Any, rows_of_each: int | None = None) -> Iterator[Finding]:
    """What both a solve and a diagnosis look at, beside given values.

    Parameters
    ----------
    model : Block
    rows_of_each : int, optional
        How many rows of each component are looked at for variables of another model; all by default.
    """
    yield from misplaced_findings(model)
    yield from scaled_pair_findings(model)
    yield from unfinished_findings(model)
    yield from foreign_findings(model, rows_of_each)
    if not is_renamed(model):
        yield from joining_findings(model)


def start_findings(model: Any, remarks: list[str]) -> Iterator[Finding]:
    """Values given at starts and ends that contradict what is stated; `remarks` gets what cannot be checked."""
    yield from discretised_start_findings(model)
    for phase in () if is_renamed(model) else phases_of(model):
        yield from boundary_findings(phase, remarks)


def is_renamed(model: Any) -> bool:
    """Whether a transformation has renamed variables of phases, as scaling does: the records are of another model."""
    return any(phase.component(name) is None for phase in phases_of(model) for name in phase.record.declarations)


def doubts_before_solve(model: Any) -> tuple[Finding, ...]:
    """Refuse a model that has no solution or cannot mean what it says; give what is doubtful about another one.

    The costs of its checks are small beside those of a solve.

    Parameters
    ----------
    model : Block

    Returns
    -------
    tuple of Finding
        For the first lines of the result.

    Raises
    ------
    ContradictionError
        When values that are given contradict what is stated.
    ModelError
        When the model says something that nothing is done with.
    """
    # One row tells of most components; a variable that is met elsewhere is refused when the model is compiled.
    contradictions = [*bound_findings(model), *start_findings(model, [])]
    findings = [*shared_findings(model, rows_of_each=1)]
    for phase in phases_of(model):
        # Where some variables have no units, units are no more than labels.
        declarations = phase.record.declarations.values()
        if declarations and all(declaration.units is not None for declaration in declarations):
            findings += unit_findings(phase, rows_of_each=1)
    if not is_renamed(model):
        findings += objective_findings(model)
        if without := without_objective(model):
            equations = Equations(model)
            findings += [*freedom_findings(model, equations, without), *excess_findings(model, equations, without)]
    errors = [finding for finding in findings if finding.severity is Severity.ERROR]
    if contradictions or errors:
        said = " ".join(f"{finding.message} {finding.remedy}" for finding in (*contradictions, *errors))
        if not errors:
            raise ContradictionError(f"'{model.name}' has no solution. {said}")
        raise ModelError(f"'{model.name}': {said}")
    return tuple(finding for finding in findings if finding.severity is Severity.WARNING)


def structural_findings(phase: Any) -> Iterator[Finding]:
    """What the statements and the structure of one instant say, the first point at which it shows."""
    try:
        phase.check()
    except ModelError as error:
        if "index is higher" not in str(error):
            yield error_about(str(error), (phase.name,), "rcp.solve refuses this phase until then.")
            return
    structures = [PointStructure(phase, time) for time in phase.record.grid.points]
    higher = next((point for point in structures if point.has_higher_index), None)
    if higher is not None:
        allowed = phase.record.allow_higher_index
        yield Finding(
            Severity.WARNING if allowed else Severity.ERROR,
            f"phase '{phase.name}': {describe_higher_index(higher)}",
            _names(phase, [*higher.leftover_rows, *higher.undetermined]),
            "It was allowed; expect less accurate algebraics." if allowed else HIGHER_INDEX_REMEDY,
        )
        return
    # Without rows and helpers there is nothing to look at: a structure that is square by rows alone is fine.
    short = next((point for point in structures if point.of_rows.unmatched_columns and point.undetermined), None)
    if short is not None:
        yield warning_about(
            f"phase '{phase.name}': at t = {short.time:g} no equation and no pair is left to determine "
            f"{quoted(short.undetermined)}.",
            _names(phase, short.undetermined),
            "Add an equation or a pair that holds it, or declare it as Control: the optimiser chooses it.",
        )


def _names(phase: Any, names: list[str]) -> tuple[str, ...]:
    """Names of components in the model: 'derivative of v' is about the variable of v."""
    return tuple(f"{phase.name}.{name.rsplit(' ', 1)[-1]}" for name in names)


def counts_of(block: Any) -> str:
    """Counts of a block with all its active blocks, in words: variables, rows, pairs, and what is left to choose."""
    # By identity: a zero-order hold is the same variable under two names.
    variables = {id(data): data for data in block.component_data_objects(Var, active=True, descend_into=Block)}
    rows = list(block.component_data_objects(Constraint, active=True, descend_into=Block))
    fixed, equalities = sum(data.fixed for data in variables.values()), sum(row.equality for row in rows)
    controls = set[int]().union(*free_controls(block).values())
    return (
        f"{block.name}: {len(variables)} variables ({fixed} fixed), {equalities} equalities, "
        f"{len(rows) - equalities} inequalities, {len(stated_pairs(block))} pairs: "
        f"{len(variables) - fixed - equalities} degrees of freedom ({len(controls)} in controls)"
    )
