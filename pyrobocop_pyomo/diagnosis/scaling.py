"""Advice on scaling: which rows and variables are of another size than the rest, and by which factors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pyrobocop_pyomo.modeling.row_violations import number_or_nan

from .findings import Finding, Severity, Subject
from .linearised_rows import LinearisedRows, Row, equilibrate

# Ipopt scales gradients above 100 down by itself: what is off by less than three orders of magnitude hardly matters.
ORDERS = 3


def scaling_advice(linearised: LinearisedRows, phases: list[Any]) -> tuple[list[Finding], dict[str, float]]:
    """Findings, and powers of ten by which components could be multiplied."""
    rows = [row for row in linearised.rows if row.gradient and row.is_finite]
    if not rows:
        return [], {}
    jacobian = linearised.jacobian(rows)
    row_factors, column_factors = equilibrate(_of_rates(jacobian, rows, linearised, phases))
    used = np.flatnonzero(np.diff(jacobian.tocsc().indptr))
    by_component = _by_component((row.data for row in rows), row_factors)
    # A variable of typical size 1000 is multiplied by 0.001: the inverse of its column's factor.
    by_component |= _by_component((linearised.variables[j] for j in used), 1.0 / column_factors[used])
    factors = {name: 10.0**order for name, order in by_component.items() if abs(order) >= ORDERS}
    if not factors:
        return [], {}
    largest = abs(jacobian).max(axis=1).toarray().ravel()
    worst, least = rows[int(largest.argmax())], rows[int(largest.argmin())]
    named = sorted(factors, key=lambda name: -abs(math.log10(factors[name])))
    shown = ", ".join(f"'{name}' by {factors[name]:.0e}" for name in named[:6])
    shown += f" and {len(named) - 6} more" if len(named) > 6 else ""
    finding = Finding(
        Severity.ADVICE,
        Subject.SCALING,
        f"the largest derivative in a row ranges from {largest.min():.1e} in '{least.data.name}' to "
        f"{largest.max():.1e} in '{worst.data.name}'. Multiply {shown}.",
        tuple(named),
        "rcp.solve scales a model without pairs and obstacles by itself, unless scaling=False: print(result) says by "
        "what. For others choose units in which values are of size one, or call write_scaling(model) and set Ipopt's "
        "nlp_scaling_method to 'user-scaling'.",
    )
    return [finding], factors


def _of_rates(jacobian: Any, rows: list[Row], linearised: LinearisedRows, phases: list[Any]) -> Any:
    """The Jacobian with right-hand sides not multiplied by the width of an element.

    ``D x - h f = 0`` holds the controls with a factor ``h``: a fine mesh would look like a badly scaled control.
    """
    width_of: dict[int, tuple[float, set[int]]] = {}
    for phase in phases:
        width = number_or_nan(phase.duration) / phase.grid.mesh.elements
        for name in phase.record.names_of_states if width > 0 else ():
            collocation = phase.component(f"{name}_collocation")
            own = {id(data) for data in phase.component(name).values()}
            width_of.update((id(row), (width, own)) for row in (collocation or {}).values())
    changed = jacobian.tocoo()
    for entry, (i, j) in enumerate(zip(changed.row.tolist(), changed.col.tolist(), strict=True)):
        width, own = width_of.get(id(rows[i].data), (1.0, set()))
        if id(linearised.variables[j]) not in own:
            changed.data[entry] /= width
    return changed.tocsr()


def _by_component(data: Any, factors: np.ndarray) -> dict[str, int]:
    """Mean order of magnitude per component."""
    collected: dict[str, list[float]] = {}
    for part, factor in zip(data, factors.tolist(), strict=True):
        collected.setdefault(part.parent_component().name, []).append(math.log10(factor))
    return {name: round(sum(orders) / len(orders)) for name, orders in collected.items()}
