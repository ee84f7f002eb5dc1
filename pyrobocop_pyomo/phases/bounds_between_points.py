"""Bounds and path constraints are rows at the points of the mesh; how far do the polynomials between pass them?"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.lagrange import differentiation_matrix
from pyrobocop_pyomo.trajectories import Trajectory

from .companions import indices_of
from .declarations import UNBOUNDED, Control, State
from .instants_inside import InstantsInside
from .nodes import StageNodes, StateNodes
from .record import PhaseRecord, Statement
from .rule_formulas import RuleFormulas

# Instants per element at which polynomials are evaluated, and the excess worth a sentence, in sizes of the signal.
SAMPLES, WORTH_A_SENTENCE = 24, 1e-3


class BoundPassed(NamedTuple):
    """By how much a polynomial passes a bound at most, when, which bound that is, and of what size of which signal.

    `is_control` is true of what controls or algebraics can meet; `of_elements` has the excess in each element.
    """

    excess: float
    time: float
    bound: float
    size: float
    is_control: bool
    of_elements: Array


def bounds_passed(record: PhaseRecord, trajectory: Trajectory) -> dict[str, BoundPassed]:
    """States and controls whose polynomials pass their declared bounds between the points of the mesh; and rates.

    What moves by step maps is left out. At the points themselves bounds are rows of the model: what is violated there
    as well counts between them only for what is more.

    Parameters
    ----------
    record : PhaseRecord
    trajectory : Trajectory

    Returns
    -------
    dict of name to BoundPassed
        Sampled at 24 instants per element, so that an excess is found to about one percent of itself.
    """
    instants = _between_and_at_points(record, trajectory)
    scheme, widths = trajectory.grid.scheme, np.array(trajectory.grid.mesh.widths)
    found: dict[str, BoundPassed] = {}
    for name in [*record.names(State), *record.names(Control)]:
        declaration: Any = record.declarations[name]
        is_control = name in trajectory.signals
        if declaration.bounds != UNBOUNDED and name not in record.discrete_states:
            sides = [(at.values[name], at.bound(name, 0), at.bound(name, 1)) for at in instants]
            found |= _passed(name, instants[0].clock, sides, is_control)
        rates = declaration.rate_bounds if is_control else declaration.derivative_bounds
        # From knot to knot a rate is what its rows say.
        if rates is not None and isinstance(record.nodes(name), (StageNodes, StateNodes)):
            lower, upper = (none if of is None else of for of, none in zip(rates, (-np.inf, np.inf), strict=True))
            slopes = [at.slopes.get(name) for at in instants]
            if is_control:
                at_stages = trajectory.element_signals(name).T / widths
                inside, at_points = (differentiation_matrix(scheme.c, at.fractions) @ at_stages for at in instants)
                slopes = [inside, np.clip(at_points, lower, upper)]  # at the points its rows are about differences
            found |= _passed(f"rate of {name}", instants[0].clock, [(of, lower, upper) for of in slopes], True)
    return found


def rows_passed(
    block: Any, record: PhaseRecord, trajectory: Trajectory, statement: Statement
) -> dict[str, BoundPassed]:
    """The inequalities of a path constraint that are passed between the points, as `bounds_passed`.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    trajectory : Trajectory
    statement : Statement

    Raises
    ------
    TrajectoryError
        When the rule gives no formula that holds at all times, or one without a value at some instant.
    """
    formulas = RuleFormulas(block, record, indices_of(record, trajectory.grid), trajectory.grid)
    labels = dict.fromkeys(index[1] if isinstance(index, tuple) else None for index in block.component(statement.name))
    said = sides_stated(formulas, statement)
    rows = {label: said[label] for label in labels if label in said}
    signals = {id(formulas.at_instant[name]) for name in trajectory.signals}
    instants = _between_and_at_points(record, trajectory, formulas)
    found: dict[str, BoundPassed] = {}
    with np.errstate(all="ignore"):
        for label, row in rows.items():
            sides = [at.evaluated(row, at.values) for at in instants]
            if any(np.isnan(side).any() for at in sides for side in at):
                raise TrajectoryError("It has no value at some instant between the points.")
            if not np.array_equal(sides[0][1], sides[0][2]):
                name = statement.name if label is None else f"{statement.name}[{label}]"
                met = not signals.isdisjoint(variables_in_any(row))
                found |= _passed(name, instants[0].clock, sides, met)
    return found


def _between_and_at_points(
    record: PhaseRecord, trajectory: Trajectory, formulas: RuleFormulas | None = None
) -> list[InstantsInside]:
    scheme, indices = trajectory.grid.scheme, indices_of(record, trajectory.grid)
    rates = {name: trajectory.element_rates(name).T for name in trajectory.rates if scheme.starts_on_a_stage}
    # Dense at the ends, where a polynomial through stages alone goes farthest.
    inside = (1.0 - np.cos(np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES)) / 2.0
    return [InstantsInside(record, trajectory, indices, at, formulas, rates) for at in (inside, scheme.c)]


def _passed(name: str, times: Array, sides: Any, is_control: bool) -> dict[str, BoundPassed]:
    """What passes a bound: `sides` are the body and both bounds, between the points and at them."""
    between, points = sides
    size = max(1e-3, float(np.abs(points[0]).max(initial=0.0)))
    found: dict[str, BoundPassed] = {}
    for side, sign in ((1, -1.0), (2, 1.0)):
        there = max(0.0, float((sign * (points[0] - points[side])).max(initial=0.0)))
        beyond = sign * (between[0] - between[side]) - there
        worst = int(beyond.argmax())
        excess = float(beyond.flat[worst])
        if excess > max(1e-9 * size, found[name].excess if found else 0.0):
            bound = float(np.broadcast_to(between[side], times.shape).flat[worst])
            of_elements = np.maximum(beyond, 0.0).max(axis=0)
            found[name] = BoundPassed(excess, float(times.flat[worst]), bound, size, is_control, of_elements)
    return found


def sentence_on_bounds(passed: Mapping[str, BoundPassed]) -> str:
    """Which bounds are passed by more than a thousandth of the signal's size, and what to do; empty where none is."""
    worth = {name: one for name, one in passed.items() if one.excess > WORTH_A_SENTENCE * one.size}
    if not worth:
        return ""
    ordered = sorted(worth, key=lambda name: -worth[name].excess / worth[name].size)
    shown = [
        f"'{name}' passes its bound {worth[name].bound:g} by {worth[name].excess:.2g} at t = {worth[name].time:.3g}"
        for name in ordered[:3]
    ]
    more = f" (and {len(ordered) - 3} more)" if len(ordered) > 3 else ""
    # Where a control jumps, its polynomial passes the bound on any mesh.
    some_states = not all(one.is_control for one in worth.values())
    remedies = [*(["more elements"] if some_states else []), "a bound with a margin"]
    if any(one.is_control for one in worth.values()):
        remedies.append("parametrization='piecewise_constant' for a control")
    return f"Between the points of the mesh {', '.join(shown)}{more}. What helps: {', or '.join(remedies)}."


def sides_stated(formulas: RuleFormulas, statement: Statement) -> dict[Hashable, tuple[Any, Any, Any]]:
    """Body and bounds of the rows that a statement makes at any time, by label.

    Raises
    ------
    TrajectoryError
        When it gives no formulas.
    """
    return formulas.formulas_of(
        statement, lambda result: {label: sides_of_row(row) for label, row in statement.rows(result).items()}
    )


def sides_of_row(row: Any) -> tuple[Any, Any, Any]:
    """Body and bounds of a row that a rule returned, in the orientation that Pyomo gives it."""
    if row is Constraint.Skip or row is Constraint.Feasible:
        return 0.0, -np.inf, np.inf
    row = row if isinstance(row, (tuple, RelationalExpression)) else (row, 0.0)  # an expression which is zero
    parts = row if isinstance(row, tuple) else row.args
    # Of two bounds both may change with the time, which a constraint refuses.
    lower, body, upper = parts if len(parts) == 3 else ConstraintData(row).to_bounded_expression()
    return body, -np.inf if lower is None else lower, np.inf if upper is None else upper
