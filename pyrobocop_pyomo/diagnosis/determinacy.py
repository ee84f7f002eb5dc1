"""Variables that nothing determines, and equations of the whole model that contradict or repeat each other."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.complementarity.record import records_above, records_below
from pyrobocop_pyomo.modeling.activity import is_inside
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics import Array, Matching
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases import Algebraic, phases_of
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, Severity, error_about, quoted, warning_about
from .linearised_rows import Equations, equilibrate

FREE_AN_END = "Remove an equation, or free an initial or final value."


def appearance_findings(block: Any) -> Iterator[Finding]:
    """Variables in no row, pair or objective, beside controls and algebraics, which `PhaseBlock.check` looks for."""
    kinds = (Constraint, Objective, *PAIR_TYPES)
    rows = block.model().component_data_objects(kinds, active=True, descend_into=Block)
    seen = variables_in_any(chain.from_iterable(map(sides_of, rows)))
    signals = (
        (phase, phase.record.nodes(name)) for phase in phases_of(block) for name in phase.record.names_of_signals
    )
    checked = {id(phase.component(nodes.component)) for phase, nodes in signals}
    lost = [
        data
        for data in block.component_data_objects(Var, active=True, descend_into=Block)
        if not (id(data) in seen or data.fixed or id(data.parent_component()) in checked)
    ]
    if lost:
        yield warning_about(
            f"{len(lost)} variables are in no active row, pair or objective, for example '{lost[0].name}': their "
            "values come back as they are.",
            (data.parent_component().name for data in lost),
            "Use them, fix them or remove them.",
        )


def freedom_findings(block: Any, equations: Equations, without: str) -> Iterator[Finding]:
    """Variables that no equation and no pair is left for, in a model without an objective that could choose them.

    What a phase declares to be chosen is not counted: controls, parameters and its horizon; nor the planes that keep
    shapes apart.

    Parameters
    ----------
    block : Block
    equations : Equations
        Of the block.
    without : str
        Words that say that there is no objective.
    """
    left = _undetermined(block, equations)
    if left:
        yield warning_about(
            f"{without}, and {len(left)} variable{'s are' if len(left) > 1 else ' is'} left that no equation "
            f"determines, for example {quoted(data.name for data in left)}: the point is one of many that meet all "
            "constraints.",
            (data.parent_component().name for data in left),
            "Give them values, such as initial conditions, add the equations that are missing, or state an objective.",
        )


def excess_findings(block: Any, equations: Equations, without: str = "") -> Iterator[Finding]:
    """More equations than variables somewhere: a doubt of a model that is said to be without an objective.

    Such a model is meant to be square, and its equations may hold all the same.
    """
    over, columns = Matching(equations.incidence, range(len(equations.variables))).overdetermined
    if over:
        names = _components(equations.rows[i] for i in over)
        yield Finding(
            Severity.WARNING if without else Severity.ERROR,
            f"{without}{', and ' if without else ''}{len(over)} equations hold only {len(columns)} variables that may "
            f"move: {quoted(names)}.{_fixed_ends(block)}",
            names,
            FREE_AN_END,
        )


def _undetermined(block: Any, equations: Equations) -> list[Any]:
    """Variables that a maximum matching with equations and pairs leaves over."""
    chosen = {id(component) for component in _chosen(block)}
    # In the order of declaration. Rows take the last first, so that of a chain in time the start is left.
    variables = {
        id(data): data
        for component in block.component_objects(Var, active=True, descend_into=Block)
        if id(component) not in chosen
        for data in component.values()
        if not data.fixed
    }
    held = [[id(equations.variables[j]) for j in own] for own in equations.incidence]
    held += [list(variables_in_any(sides_of(source))) for source in stated_pairs(block)]
    read = set(chain.from_iterable(held))
    return [variables[key] for key in Matching(held, reversed(variables)).unmatched_columns[::-1] if key in read]


def stated_pairs(block: Any) -> list[Any]:
    """The component data of pairs, relaxed or not."""
    records = (*records_below(block), *records_above(block))
    relaxed = (source for record in records for source in record.statements if is_inside(source, block))
    return list({id(source): source for source in (*active_sources(block), *relaxed)}.values())


def _chosen(block: Any) -> Iterator[Any]:
    """Components whose values are there to be chosen."""
    for phase in phases_of(block):
        record = phase.record
        determined = {*record.names_of_states, *record.names(Algebraic)}
        determined |= {f"{name}_derivative" for name in record.kept_derivatives}
        yield from (var for name, var in phase.component_map(Var).items() if name not in determined)
    for avoidance in blocks_of_kind(block, (ObstacleAvoidanceBlockData, ContainmentData)):
        yield from avoidance.component_objects(Var, descend_into=True)


def dependence_findings(block: Any, equations: Equations) -> Iterator[Finding]:
    """Equations of which one follows from the others, where none is too many."""
    jacobian, residuals = equations.jacobian, equations.residuals
    if not equations.rows or not (np.isfinite(jacobian.data).all() and np.isfinite(residuals).all()):
        return
    row_factors, column_factors = equilibrate(jacobian)
    weights = left_null_vector(scipy.sparse.diags(row_factors) @ jacobian @ scipy.sparse.diags(column_factors))
    if weights is None:
        return
    heavy = np.abs(weights) > 1e-3 * np.abs(weights).max()
    concerned = [row for row, counts in zip(equations.rows, heavy, strict=True) if counts]
    residuals = row_factors * residuals
    names = _components(concerned)
    gap, largest = abs(weights @ residuals), float(np.abs(residuals).max())
    is_linear = all(row.body.polynomial_degree() in (0, 1) for row in concerned)
    if is_linear and gap > 1e-8 * max(1.0, largest):
        said = f"the equations {quoted(names)} contradict each other.{_fixed_ends(block)}"
        yield error_about(said, names, FREE_AN_END)
    else:
        said = f"at the initial guess one of the equations {quoted(names)} follows from the others."
        remedy = "Remove one of them, free an initial or final value, or start from another initial guess."
        yield warning_about(f"{said}{_fixed_ends(block)}", names, remedy)


def left_null_vector(matrix: Any) -> Array | None:
    """Unit vector ``y`` with ``y @ matrix`` as good as zero, or None where the rows are independent.

    Such a vector is the lower part of the eigenvector of an augmented matrix whose eigenvalue is zero.
    """
    count, columns = matrix.shape
    augmented = scipy.sparse.bmat([[scipy.sparse.identity(columns), matrix.T], [matrix, None]], format="csc")
    start = np.random.default_rng(0).standard_normal(count + columns)
    try:
        _, vectors = scipy.sparse.linalg.eigsh(augmented, k=1, sigma=-1e-14, v0=start)
    except RuntimeError:  # exactly singular, as the shift was lost in rounding; or no eigenvalue is near zero
        return None
    vector = vectors[columns:, 0]
    size = np.linalg.norm(vector)
    # Well above rounding, well below what a long horizon or an unstable motion leaves of independent equations.
    return vector / size if np.linalg.norm(matrix.T @ vector) < 1e-9 * size else None


def _components(rows: Any) -> tuple[str, ...]:
    return tuple(dict.fromkeys(row.parent_component().name for row in rows))


def _fixed_ends(block: Any) -> str:
    """Which states are fixed at both ends: the usual suspects."""
    found = [
        f"'{phase.name}.{name}'"
        for phase in phases_of(block)
        for name in phase.record.names_of_states
        if phase.component(name)[phase.initial_time].fixed and phase.component(name)[phase.final_time].fixed
    ]
    return f" Fixed at both ends: {', '.join(found)}." if found else ""
