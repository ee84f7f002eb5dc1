"""The equations of a phase that a step solves in states and unknowns: formulas of its rules, or its rows at points.

Rules that are templates give formulas, the same ones at all stages. What a rule says that has to know the time, or
reads other points of the mesh, stands in the rows at the points alone, and so does what was left out at some of them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.relational_expr import EqualityExpression

from pyrobocop_pyomo.complementarity import CanonicalForm, Complementarity, canonical_form
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.row_violations import sides_of_row
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.mixed_complementarity import ComplementarityValues, MixedComplementarity

from .record import PhaseRecord


@dataclass(frozen=True, eq=False)
class PairStatement:
    """One statement as ``lower <= body <= upper ⟂ other``.

    Attributes
    ----------
    name : str
        Without the time: ``contact`` or ``contact[left]``.
    body, other : expression
    lower, upper : float
    either : bool
        ``body >= lower`` and ``(body - lower) other = 0``, with `other` of any sign.
    """

    name: str
    body: Any
    other: Any
    lower: float
    upper: float
    either: bool


def statements_of(label: str, form: CanonicalForm) -> tuple[list[Any], list[PairStatement]]:
    """Equations, as expressions that are zero, and statements of one declared pair."""
    rows = [zero_of(row) for row in form.rows if isinstance(row, EqualityExpression)]
    if not form.pairs:
        return rows, []
    pair = form.pairs[0]
    if form.between is not None:
        lower, body, upper = form.between
        return rows, [PairStatement(label, body, pair.b, float(value(lower)), float(value(upper)), False)]
    return rows, [PairStatement(label, pair.a, pair.b, 0.0, np.inf, len(form.pairs) == 3)]


def zero_of(row: Any) -> Any:
    """What is zero where an equality holds, in all the ways that rules may write it."""
    body, lower, _ = sides_of_row(row)
    return body - lower


def as_tuple(label: Hashable) -> tuple[Any, ...]:
    """The label of a row as a tuple, which is empty where there is one row."""
    return label if isinstance(label, tuple) else () if label is None else (label,)


def labelled(name: str, label: Hashable) -> str:
    """The name of a row or a pair with its label: ``contact[left]``."""
    labels = as_tuple(label)
    return f"{name}[{', '.join(map(str, labels))}]" if labels else name


@dataclass(frozen=True, eq=False)
class StepEquations:
    """What is stated at a stage: as many rows and pairs as there are unknowns beside the states.

    Attributes
    ----------
    rates : list of expressions
        Derivatives of all states, in the order of declaration; of those that a step map leads the next values.
    unknowns : dict of name to VarData
        Algebraics and controls that are to be found, and derivatives as ``"d x"``.
    rows : list of expressions
        Zero where they hold.
    names_of_rows : list of str
    pairs : list of PairStatement
    """

    rates: list[Any]
    unknowns: Mapping[str, Any]
    rows: list[Any] = field(default_factory=list)
    names_of_rows: list[str] = field(default_factory=list)
    pairs: list[PairStatement] = field(default_factory=list)

    def add(self, name: str, rows: Iterable[Any], pairs: Iterable[PairStatement] = ()) -> None:
        """Add expressions that are zero, and pairs."""
        rows = list(rows)
        self.rows.extend(rows)
        self.names_of_rows.extend([name] * len(rows))
        self.pairs.extend(pairs)


def by_points(block: Any, unknown: Sequence[str], contact: bool) -> list[StepEquations]:
    """What stands at each point of the mesh, in the variables of the phase."""
    record: PhaseRecord = block.record
    kept, grid = sorted(record.kept_derivatives), record.grid
    derivatives = {name: block.component(f"{name}_derivative") for name in kept}
    names = record.names_of_states
    rates = {name: derivatives[name] if name in kept else record.rates[name] for name in names}
    signals = {name: dict(zip(grid.points, record.nodes(name).variables(block), strict=True)) for name in unknown}
    rows = [f"{name}_equation" for name in kept if name in record.equation_of]
    rows += [statement.name for statement in record.statements_of("residual")]
    found = {
        t: StepEquations(
            [of[t] for of in rates.values()],
            {f"d {name}": of[t] for name, of in derivatives.items()} | {name: of[t] for name, of in signals.items()},
        )
        for t in grid.points
    }
    for index, row in ((index, row) for name in rows for index, row in block.component(name).items() if row.active):
        found[index[0] if isinstance(index, tuple) else index].add(row.name, [row.body - row.upper])
    for index, data in pairs_on_model(block) if contact else ():
        t, *labels = as_tuple(index)
        if t in found:
            name = labelled(data.parent_component().local_name, tuple(labels))
            found[t].add(name, *statements_of(name, canonical_form(data)))
    return list(found.values())


def pairs_on_model(block: Any) -> list[tuple[Any, Any]]:
    """Index and data of all pairs of a phase that hold."""
    components = block.component_objects(Complementarity, active=True, descend_into=False)
    return [(index, data) for component in components for index, data in component.items() if data.active]


def values_by(expressions: Sequence[Any], variables: Sequence[Any]) -> Callable[[Array], Array]:
    """Expressions as functions of variables of the model; all others count with their values.

    Parameters
    ----------
    expressions : sequence of v expressions
    variables : sequence of w variables

    Returns
    -------
    callable
        From many points, shape ``(w, k)``, to values, shape ``(v, k)``.
    """
    steps, keys = ExpressionSteps(expressions, refuse=_not_known), list(map(id, variables))

    def evaluate(points: Array) -> Array:
        leaves = dict(zip(keys, points, strict=True))
        return stacked(steps.evaluate_at(leaves, ARRAY_FUNCTIONS), points.shape[1:])

    return evaluate


def _not_known(node: Any, reason: str) -> ValueError:
    return ValueError(f"'{node}' {reason}; a simulation knows no later value")


def differences(evaluate: Callable[[Array], Array], point: Array, sizes: float | Array) -> tuple[Array, Array]:
    """Values, shape ``(v, ..)``, and derivatives by differences, shape ``(v, w, ..)``.

    Parameters
    ----------
    evaluate : callable
        From variants of the point, shape ``(w, w + 1, ..)``, to values, shape ``(v, w + 1, ..)``.
    point : array, shape (w, ..)
    sizes : number or array
    """
    steps = 1e-7 * (sizes + np.abs(point))
    varied, each = np.repeat(point[:, None], len(point) + 1, axis=1), np.arange(len(point))
    varied[each, each + 1] += steps
    found = evaluate(varied)
    return found[:, 0], (found[:, 1:] - found[:, :1]) / steps


def stacked(values: Sequence[Any], shape: tuple[int, ...]) -> Array:
    """Numbers and arrays as one array, each of a shape."""
    found = np.empty((len(values), *shape))
    for row, of in zip(found, values, strict=True):
        row[...] = of
    return found


def problem_of_rows(rows: Sequence[Any], variables: Sequence[Any]) -> MixedComplementarity:
    """Find variables of the model at which as many expressions are zero."""
    evaluate, none = values_by(rows, variables), np.zeros(0)

    def at(point: Array) -> ComplementarityValues:
        values, slopes = differences(evaluate, point, 1.0)
        return ComplementarityValues(values, none, none, slopes, slopes[:0], slopes[:0])

    return MixedComplementarity(at, none, none, none.astype(bool))
