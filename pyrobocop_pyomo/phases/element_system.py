"""The rows and the pairs of one element after the other, as a phase holds them: what a step by rows solves.

A row belongs to the element that has the last of the phase's variables in it. So whatever a rule reads, the row that
was made of it is solved where everything in it is known or to be found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.calculus.derivatives import Modes, differentiate
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.relational_expr import EqualityExpression
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.complementarity import CanonicalForm, Complementarity, canonical_form
from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.mixed_complementarity import ComplementarityValues, MixedComplementarity

from .nodes import IntervalNodes
from .record import PhaseRecord
from .simulated_unknowns import Unknowns


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


@dataclass(frozen=True, eq=False)
class ElementSystem:
    """Everything that one element asks.

    Attributes
    ----------
    unknowns : list of VarData
    rows : list of pairs of name and expression
        Equations, as expressions that are zero.
    statements : list of PairStatement
    """

    unknowns: list[Any]
    rows: list[tuple[str, Any]]
    statements: list[PairStatement]

    def name_of(self, residual: int) -> str:
        """What a residual belongs to."""
        if residual < len(self.rows):
            return f"the row '{self.rows[residual][0]}'"
        return f"the pair '{self.statements[residual - len(self.rows)].name}'"

    def problem(self, statements: Sequence[PairStatement] | None = None) -> MixedComplementarity:
        """The system as numbers; the values of all other variables are those on the model now.

        Parameters
        ----------
        statements : sequence of PairStatement, optional
            In place of those of the element.
        """
        stated = self.statements if statements is None else statements
        position = {id(variable): k for k, variable in enumerate(self.unknowns)}
        rows = _Functions([expression for _, expression in self.rows], self.unknowns, position)
        bodies = _Functions([statement.body for statement in stated], self.unknowns, position)
        others = _Functions([statement.other for statement in stated], self.unknowns, position)

        def evaluate(point: Array) -> ComplementarityValues:
            for variable, number in zip(self.unknowns, point.tolist(), strict=True):
                variable.set_value(number, skip_validation=True)
            (row, by_row), (body, by_body), (other, by_other) = (of(point) for of in (rows, bodies, others))
            return ComplementarityValues(row, body, other, by_row, by_body, by_other)

        return MixedComplementarity(
            evaluate,
            np.array([statement.lower for statement in stated], dtype=float),
            np.array([statement.upper for statement in stated], dtype=float),
            np.array([statement.either for statement in stated], dtype=bool),
        )


class _Functions:
    """Expressions as functions of the unknowns: linear ones as coefficients, others evaluated by Pyomo."""

    def __init__(self, expressions: Iterable[Any], unknowns: list[Any], position: dict[int, int]) -> None:
        self._position = position
        expressions = list(expressions)
        self._linear = np.zeros((len(expressions), len(unknowns)))
        self._constant = np.zeros(len(expressions))
        self._others: list[tuple[int, Any, list[Any]]] = []
        for k, expression in enumerate(expressions):
            repn = generate_standard_repn(expression, compute_values=True, quadratic=False)
            self._constant[k] = value(repn.constant)
            for coefficient, variable in zip(repn.linear_coefs, repn.linear_vars, strict=True):
                if id(variable) in position:
                    self._linear[k, position[id(variable)]] += value(coefficient)
                else:
                    self._constant[k] += value(coefficient) * value(variable)
            if repn.nonlinear_expr is not None:
                variables = variables_in(repn.nonlinear_expr, include_fixed=True)
                inner = [variable for variable in variables if id(variable) in position]
                self._others.append((k, repn.nonlinear_expr, inner))

    def __call__(self, point: Array) -> tuple[Array, Array]:
        values, jacobian = self._linear @ point + self._constant, self._linear
        if self._others:
            jacobian = jacobian.copy()
        for k, expression, variables in self._others:
            values[k] += value(expression)
            if variables:
                slopes = differentiate(expression, wrt_list=variables, mode=Modes.reverse_numeric)
                for variable, slope in zip(variables, slopes, strict=True):
                    jacobian[k, self._position[id(variable)]] += slope
        return values, jacobian


def element_systems(block: Any, record: PhaseRecord, unknown: Unknowns) -> list[ElementSystem]:
    """The systems of all elements.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    unknown : Unknowns

    Raises
    ------
    InitialGuessError
        When an element has more or fewer equations than unknowns.
    """
    systems = [ElementSystem([], [], []) for _ in range(record.grid.mesh.elements)]
    element_of: dict[int, int] = {}
    for i, variable in _variables(block, record, unknown.algebraics):
        if id(variable) not in element_of:
            element_of[id(variable)] = i
            if i >= 0:
                systems[i].unknowns.append(variable)

    def element(*expressions: Any) -> int:
        found = (variables_in(each, include_fixed=True) for each in expressions if hasattr(each, "args"))
        plain = [each for each in expressions if id(each) in element_of]
        read = [variable for variables in found for variable in variables] + plain
        return max((element_of.get(id(variable), -1) for variable in read), default=-1)

    for name in _names_of_equations(block, record):
        for row in block.component(name).values():
            if row.active and row.equality:
                i = element(row.body)
                if i >= 0:
                    systems[i].rows.append((row.name, row.body - row.upper))
    for component in block.component_objects(Complementarity, active=True, descend_into=False):
        for index, data in component.items() if unknown.contact else ():
            if data.active:
                labels = index[1:] if isinstance(index, tuple) else ()
                label = f"{component.local_name}[{', '.join(map(str, labels))}]" if labels else component.local_name
                rows, statements = statements_of(label, canonical_form(data))
                i = element(*(side for each in statements for side in (each.body, each.other)), *rows)
                if i >= 0:
                    systems[i].rows.extend((data.name, row) for row in rows)
                    systems[i].statements.extend(statements)
    _check_counts(block, record, systems, unknown.algebraics)
    return systems


def _variables(block: Any, record: PhaseRecord, unknown: Sequence[str]) -> Iterator[tuple[int, Any]]:
    """Everything that is to be found, with its element; what is known from the start is of element -1."""
    grid = record.grid
    for name in record.names_of_states:
        state = block.component(name)
        yield -1, state[grid.times[0]]
        for i, times in enumerate(grid.node_times):
            for time in (*times[1:], grid.mesh.boundaries[i + 1]):
                yield i, state[time]
    at_stages = [block.component(f"{name}_derivative") for name in sorted(record.kept_derivatives)]
    for name in unknown:
        nodes = record.nodes(name)
        if isinstance(nodes, IntervalNodes):
            variables = nodes.variables(block)
            yield from ((i, variables[k]) for i, k in enumerate(nodes.of_elements.tolist()))
        else:
            at_stages.append(block.component(name))
    for component in at_stages:
        yield from ((i, component[time]) for i, times in enumerate(grid.stage_times) for time in times)


def _names_of_equations(block: Any, record: PhaseRecord) -> list[str]:
    residuals = [statement.name for statement in record.statements_of("residual")]
    return [
        name
        for name in [*sorted(record.generated_rows), *residuals]
        if block.component(name) is not None and block.component(name).ctype is Constraint
    ]


def statements_of(label: str, form: CanonicalForm) -> tuple[list[Any], list[PairStatement]]:
    """Equations, as expressions that are zero, and statements of one declared pair."""
    rows = [row.args[0] - row.args[1] for row in form.rows if isinstance(row, EqualityExpression)]
    if not form.pairs:
        return rows, []
    pair = form.pairs[0]
    if form.between is not None:
        lower, body, upper = form.between
        return rows, [PairStatement(label, body, pair.b, float(value(lower)), float(value(upper)), False)]
    return rows, [PairStatement(label, pair.a, pair.b, 0.0, np.inf, len(form.pairs) == 3)]


def _check_counts(block: Any, record: PhaseRecord, systems: list[ElementSystem], unknown: Sequence[str]) -> None:
    for i, system in enumerate(systems):
        equations = len(system.rows) + len(system.statements)
        if equations != len(system.unknowns):
            raise InitialGuessError(
                f"phase '{block.name}': element {i} (t = {record.grid.mesh.boundaries[i]:g}) has {len(system.rows)} "
                f"equations and {len(system.statements)} pairs for {len(system.unknowns)} unknowns, with "
                f"{', '.join(unknown) or 'nothing'} to find beside the states. A simulation needs as many, "
                "and none that reads later elements. Say what is to be found by unknown=[...], and give the rest in "
                "controls={...}."
            )
