"""Equations of the whole model that contradict or repeat each other, in structure and in numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.numerics import maximum_matching
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases import phases_of

from .findings import Finding, Severity, Subject
from .linearisation import Linearisation, Row, equilibrate

Array = NDArray[np.float64]

# Well above rounding, well below what a long horizon or an unstable motion leaves of independent equations.
DEPENDENT = 1e-10


def dependence_findings(block: Any, linearisation: Linearisation) -> Iterator[Finding]:
    """More equations than variables somewhere, else equations of which one follows from the others."""
    rows = linearisation.equalities
    matching = maximum_matching([sorted(row.gradient) for row in rows], len(linearisation.variables))
    over, columns = matching.overdetermined
    if over:
        yield Finding(
            Severity.ERROR,
            Subject.CONTRADICTION,
            f"{len(over)} equations hold only {len(columns)} variables that may move: "
            f"{_quoted(_components(rows[i] for i in over))}.{_fixed_ends(block)}",
            _components(rows[i] for i in over),
            "Remove an equation, or free an initial or final value.",
        )
    elif rows and all(row.is_finite for row in rows):
        yield from _dependent(block, linearisation, rows)


def _dependent(block: Any, linearisation: Linearisation, rows: list[Row]) -> Iterator[Finding]:
    jacobian = linearisation.jacobian(rows)
    row_factors, column_factors = equilibrate(jacobian)
    scaled = scipy.sparse.diags(row_factors) @ jacobian @ scipy.sparse.diags(column_factors)
    weights = left_null_vector(scaled)
    if weights is None:
        return
    concerned = [row for row, weight in zip(rows, weights, strict=True) if abs(weight) > 1e-3 * np.abs(weights).max()]
    residuals = row_factors * np.array([row.residual for row in rows])
    gap = abs(weights @ residuals)
    linear = all(row.data.body.polynomial_degree() in (0, 1) for row in concerned)
    names = _components(concerned)
    if linear and gap > 1e-8 * max(1.0, float(np.abs(residuals).max())):
        yield Finding(
            Severity.ERROR,
            Subject.CONTRADICTION,
            f"the equations {_quoted(names)} contradict each other.{_fixed_ends(block)}",
            names,
            "Remove an equation, or free an initial or final value.",
        )
    else:
        yield Finding(
            Severity.WARNING,
            Subject.DEPENDENT,
            f"at the guess one of the equations {_quoted(names)} follows from the others.{_fixed_ends(block)}",
            names,
            "Remove one of them, free an initial or final value, or start from another guess.",
        )


def left_null_vector(matrix: Any) -> Array | None:
    """Unit vector ``y`` with ``y @ matrix`` as good as zero, or None where the rows are independent.

    Inverse iteration on ``matrix @ matrix.T``, through one sparse factorisation of the augmented system.
    """
    count, columns = matrix.shape
    shift = 1e-14
    augmented = scipy.sparse.bmat(
        [[scipy.sparse.identity(columns), matrix.T], [matrix, -shift * scipy.sparse.identity(count)]], format="csc"
    )
    try:
        factorised = scipy.sparse.linalg.splu(augmented)
    except RuntimeError:  # exactly singular: the shift was lost in rounding
        return None
    vector = np.random.default_rng(0).standard_normal(count)
    for _ in range(4):
        vector = factorised.solve(np.concatenate([np.zeros(columns), vector]))[columns:]
        size = float(np.linalg.norm(vector))
        if not np.isfinite(size) or size == 0.0:
            return None
        vector = vector / size
    return vector if np.linalg.norm(matrix.T @ vector) < np.sqrt(DEPENDENT) * 1e-4 else None


def _components(rows: Any) -> tuple[str, ...]:
    return tuple(dict.fromkeys(row.data.parent_component().name for row in rows))


def _quoted(names: tuple[str, ...]) -> str:
    shown = ", ".join(map(repr, names[:6]))
    return shown if len(names) <= 6 else f"{shown} and {len(names) - 6} more"


def _fixed_ends(block: Any) -> str:
    """Which states are fixed at both ends: the usual suspects."""
    found = [
        f"'{phase.name}.{name}'"
        for phase in phases_of(block)
        for name in phase.record.names_of_states
        if phase.component(name)[phase.initial_time].fixed and phase.component(name)[phase.final_time].fixed
    ]
    return f" Fixed at both ends: {', '.join(found)}." if found else ""
