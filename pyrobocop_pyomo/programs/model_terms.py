"""A Pyomo model as a linear part and groups of nonlinear terms of one shape, from one walk over its active rows.

Calls of Python functions become variables: one for each output that is used, and one for each argument that is no free
variable, which a row ties to its expression. `ProgramWithFunctions` adds the rows that tie outputs to arguments.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.external import PythonCallbackFunction
from pyomo.core.base.objective import ObjectiveData
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.var import Var, VarData
from pyomo.core.expr.numeric_expr import ExternalFunctionExpression
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.complementarity.preconditions import only_objective
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_nodes import CONSTANT, DIVISION, LEAF, NAMED, NEGATION, PRODUCT, SUMMATION
from pyrobocop_pyomo.modeling.functions import Function, FunctionOutput, is_function_call
from pyrobocop_pyomo.modeling.pyomo_internals import function_of_call, new_row, new_variable, put_part
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum, RowByRule, sum_by_rule, sums_of
from pyrobocop_pyomo.modeling.shared_nodes import NodesOnce, topmost_nodes

from .model_checks import check_variables, external_function_refused
from .nonlinear_program import IndexArray
from .term_groups import FACTORS, SCALED_SUM, Columns, NodeKinds, NonlinearTerm, TermGroups, not_vectorised, repetitions

# -------------------------------------------------------------------------------------------- calls of Python functions


@dataclass(eq=False)
class FunctionCall:
    """A function with its arguments at one place of a model.

    Attributes
    ----------
    function : Function
    arguments : tuple
    level : int
        0 where no argument holds another call; otherwise one more than the highest of these.
    outputs : dict of int to VarData
        Variables for those outputs that are used.
    ties : dict of int to ConstraintData
        Rows that tie the outputs to the function.
    inputs : list of VarData
        The arguments, or what stands for them.
    """

    function: Function
    arguments: tuple[Any, ...]
    level: int
    outputs: dict[int, VarData] = field(default_factory=dict)
    ties: dict[int, ConstraintData] = field(default_factory=dict)
    inputs: list[VarData] = field(default_factory=list)


class FunctionCalls(NodesOnce):
    """All different calls that a walk over a model has met; those with the same arguments are one.

    What is found at an expression is the level that a call of it has, in a tuple, which no number is.

    Attributes
    ----------
    calls : list of FunctionCall
    held : list of VarData
        What stands for arguments, in the order of the rows that tie them.
    """

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[FunctionCall] = []
        self.held: list[VarData] = []
        self._different: dict[tuple[Any, ...], FunctionCall] = {}

    def replacement(self, node: Any) -> VarData:
        """The variable that stands for a call."""
        self.of(node)
        call, output = self._different[_key(node)], function_of_call(node).index
        if output not in call.outputs:
            call.outputs[output] = self._new_variable(function_of_call(node).name)
            call.ties[output] = self.tie(call.outputs[output], node)
        return call.outputs[output]

    def new_input(self, call: FunctionCall) -> VarData:
        """A variable that is to stand for the next argument of a call."""
        self.held.append(self._new_variable(f"{call.function.name}: input {len(call.inputs)}"))
        return self.held[-1]

    def tie(self, variable: VarData, stated: Any) -> ConstraintData:
        """A row that ties one of the variables to what it stands for."""
        return new_row(self._components[1], variable.index(), variable - stated == 0.0)

    @cached_property
    def _components(self) -> tuple[Var, Constraint]:
        """What the variables and rows are of; on no model."""
        variables, rows = Var(AnyIndex, dense=False, name="calls"), Constraint(AnyIndex, name="ties of calls")
        variables.construct()
        rows.construct()
        return variables, rows

    def _new_variable(self, label: str) -> VarData:
        component = self._components[0]
        variable = new_variable(component, None, 0.0)
        # With a number that is taken for a time, so that all values of one kind are scaled alike.
        put_part(component, (label, -1.5 - len(component)), variable)
        return variable

    def by_level(self) -> list[FunctionCall]:
        """The calls, those of lower levels first."""
        return sorted(self.calls, key=attrgetter("level"))

    def of_leaf(self, leaf: Any) -> tuple[int]:
        """Level 0."""
        return (0,)

    def of_operation(self, node: Any, found: list[Any]) -> tuple[int]:
        """The highest level among the arguments, and one more for a call, which is known from then on."""
        highest: tuple[int] = max((each for each in found if each.__class__ is tuple), default=(0,))
        if not is_function_call(node):
            return highest
        key = _key(node)
        if key not in self._different:
            self._different[key] = new = FunctionCall(function_of_call(node).function, tuple(node.args), *highest)
            self.calls.append(new)
        return (highest[0] + 1,)


def _key(node: Any) -> tuple[Any, ...]:
    output: FunctionOutput = function_of_call(node)
    arguments = [a if a.__class__ in native_numeric_types else (id(a),) for a in node.args]
    return (id(output.function), *arguments)


# ---------------------------------------------------------------------------------------------------------- model terms


# A sum of up to so many nonlinear terms is one term, whose parts share what they have in common; a longer one, as
# an integral, is taken apart, so that its parts can be evaluated as repetitions of each other.
LONGEST_TERM = 16


class Terms:
    """What is known of a set of rows: ``constants + linear part + sum of the groups``.

    Add all rows first, then `group` the nonlinear terms.

    Parameters
    ----------
    columns : Columns
    calls : FunctionCalls
        Both are shared among the sets of rows of one model.

    Attributes
    ----------
    linear_rows, linear_columns, linear_coefficients : list
        Triplets; a column ``-1 - i`` is the parameter i.
    constants : dict of row to float
    groups : TermGroups
    named_expressions : dict of id to named expression
        Those that were met; what stands behind them may be changed.
    """

    def __init__(self, columns: Columns, calls: FunctionCalls | None = None) -> None:
        self.columns, self._calls = columns, FunctionCalls() if calls is None else calls
        self.linear_rows: list[int] = []
        self.linear_columns: list[int] = []
        self.linear_coefficients: list[float] = []
        self.constants: dict[int, float] = {}
        self.named_expressions: dict[int, Any] = {}
        self._kinds = NodeKinds()
        self.groups = TermGroups(columns, self._kinds, self._content)
        self._terms: list[tuple[NonlinearTerm, list[int], list[float], dict[int, list[int]]]] = []

    def add(self, row: int, expression: Any, scale: float = 1.0, keep_constant: bool = False) -> bool:
        """Add ``scale * expression`` to a row, in linear terms as far as possible.

        Returns
        -------
        bool
            False when the expression has no free variables; it is then not added, except with `keep_constant`.
        """
        columns: list[int] = []
        coefficients: list[float] = []
        by_rule: list[tuple[RepeatedSum, float]] = []
        constant, parts = self._split(expression, scale, columns, coefficients, by_rule)
        sums = []
        for repeated, factor in by_rule:
            self.columns.add_by_rows([repeated._replace(rows=list(range(len(repeated.rows))))])  # as a walk meets them
            scales = [factor * scale for scale in repeated.scales]
            sums.append((repeated._replace(scales=scales), self.columns.table(repeated)))
        variable = any(column >= 0 for column in columns) or any(map(self._has_variable, parts))
        variable = variable or any((table >= 0).any() for _, table in sums)
        if not (variable or keep_constant):
            return False
        for repeated, table in sums:
            self.add_repeated(repeated, table, row)
        if constant:
            self.constants[row] = self.constants.get(row, 0.0) + constant
        self.linear_rows += [row] * len(columns)
        self.linear_columns += columns
        self.linear_coefficients += coefficients
        self._terms += [(term, [row], [1.0], {}) for term in _joined(parts)]
        return variable

    def add_repeated(self, repeated: RepeatedSum, table: IndexArray, first: int = 0) -> None:
        """Add a sum to each of its rows, which are counted from a first one; `table` is from its columns."""
        for places, exchanged in repetitions(table):
            rows, scales = [first + repeated.rows[place] for place in places], [repeated.scales[i] for i in places]
            columns: list[int] = []
            coefficients: list[float] = []
            constant, parts = self._split(repeated.expression(places[0]), 1.0, columns, coefficients)
            for row, scale in zip(rows, scales, strict=True) if constant else ():
                self.constants[row] = self.constants.get(row, 0.0) + constant * scale
            for column, coefficient in zip(columns, coefficients, strict=True):
                self.linear_rows += rows
                self.linear_columns += exchanged.get(column, [column] * len(rows))
                self.linear_coefficients += [coefficient * scale for scale in scales]
            self._terms += [(term, rows, scales, exchanged) for term in _joined(parts)]

    def group(self) -> None:
        """Put the terms of all rows that were added into groups of one shape."""
        for term in self._terms:
            self.groups.put(*term)
        self._terms.clear()

    def linear_parts(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Rows, places and coefficients of the variables in linear terms, and of the parameters there."""
        rows, columns = np.array(self.linear_rows, dtype=np.intp), np.array(self.linear_columns, dtype=np.intp)
        coefficients, free = np.array(self.linear_coefficients, dtype=float), columns >= 0
        return (rows[free], columns[free], coefficients[free]), (rows[~free], -1 - columns[~free], coefficients[~free])

    def _has_variable(self, part: NonlinearTerm) -> bool:
        leaves = topmost_nodes(part.nodes, lambda node: not node.is_expression_type())
        return any(self.columns.of(leaf) >= 0 for leaf in leaves)

    def _split(
        self,
        expression: Any,
        scale: float,
        columns: list[int],
        coefficients: list[float],
        sums: list[tuple[RepeatedSum, float]] | None = None,
    ) -> tuple[float, list[NonlinearTerm]]:
        """Take linear terms out, and sums that follow a rule where asked for; return the constant and other terms."""
        kinds, column_of = self._kinds, self.columns.column_of
        constant = 0.0
        parts: list[NonlinearTerm] = []
        factors: tuple[Any, ...] = ()
        pending: list[tuple[Any, float, tuple[Any, ...]]] = [(expression, scale, factors)]
        while pending:
            node, scale, factors = pending.pop()
            kind = kinds[node.__class__]
            if kind == SUMMATION:
                for argument in reversed(node.args):
                    pending.append((argument, scale, factors))
            elif kind == LEAF and not factors:
                column = column_of.get(id(node))
                columns.append(self.columns.add(node) if column is None else column)
                coefficients.append(scale)
            elif kind == NEGATION:
                pending.append((node.args[0], -scale, factors))
            elif kind == PRODUCT:
                first, last = node.args
                if kinds[first.__class__] == CONSTANT:
                    pending.append((last, scale * float(first), factors))
                elif kinds[last.__class__] == CONSTANT:
                    pending.append((first, scale * float(last), factors))
                elif self._is_long_sum(last):
                    pending.append((last, scale, (*factors, first)))
                elif self._is_long_sum(first):
                    pending.append((first, scale, (*factors, last)))
                else:
                    parts.append(_product(factors, node, scale))
            elif kind == DIVISION and kinds[node.args[1].__class__] == CONSTANT and node.args[1]:
                pending.append((node.args[0], scale / float(node.args[1]), factors))
            elif kind == NAMED and sums is not None and not factors and (by_rule := sum_by_rule(node)) is not None:
                self.named_expressions[id(node)] = node
                sums.append((by_rule.repeated(), scale))
            elif kind == NAMED:
                pending.append((self._content(node), scale, factors))
            elif kind == CONSTANT and not factors:
                constant += scale * float(node)
            else:
                parts.append(_product(factors, node, scale))
        return constant, parts

    def _is_long_sum(self, node: Any) -> bool:
        """Whether a factor is worth being multiplied out: an integral over a free duration is such a product."""
        kinds = self._kinds
        while True:
            kind = kinds[node.__class__]
            if kind == NAMED:
                node = self._content(node)
            elif kind == PRODUCT and kinds[node.args[0].__class__] == CONSTANT:
                node = node.args[1]
            else:
                return kind == SUMMATION and node.nargs() > LONGEST_TERM

    def _content(self, named: Any) -> Any:
        """The expression behind a name, remembered so that a later change of it can be noticed.

        Behind a call of a Python function stands the variable of its output.
        """
        if isinstance(named, ExternalFunctionExpression):
            if not is_function_call(named):
                if isinstance(function_of_call(named), PythonCallbackFunction):
                    raise ModelError(f"an expression {external_function_refused(function_of_call(named).name)}")
                raise not_vectorised(type(named))
            return self._calls.replacement(named)
        self.named_expressions[id(named)] = named
        return named.args[0]


def _product(factors: tuple[Any, ...], node: Any, scale: float) -> NonlinearTerm:
    return NonlinearTerm((*factors, node), scale, FACTORS + 1 + len(factors) if factors else None)


def _joined(parts: list[NonlinearTerm]) -> list[NonlinearTerm]:
    """A short sum as one term, a long one as several."""
    if not 1 < len(parts) <= LONGEST_TERM or any(part.symbol is not None for part in parts):
        return parts
    # What the scales have in common stays outside, so that elements of other widths have the same numbers.
    common = parts[0].scale if len({abs(part.scale) for part in parts}) == 1 else 1.0
    scales = tuple(part.scale / common if common else 0.0 for part in parts)
    nodes = tuple(part.nodes[0] for part in parts)
    return [NonlinearTerm(nodes, common, SCALED_SUM + len(parts), scales)]


@dataclass(eq=False)
class ModelTerms:
    """What one walk over a model found.

    Attributes
    ----------
    model : Block
    columns : Columns
        Free variables and parameters.
    rows, cost : Terms
        Terms of the rows, and of the objective as a row 0; a maximised objective appears negated.
    calls : FunctionCalls
        Calls of Python functions, whose outputs are variables of the terms.
    objective : ObjectiveData or None
    sign : float
        1 for a minimised objective, -1 for a maximised one.
    constraints : list of ConstraintData
        In the order of the rows. Those without free variables or without bounds are absent.
    bounds : list of pairs
        Lower and upper bound of each row: numbers, expressions without variables, or None.
    constant_constraints : list of ConstraintData
        Those without free variables.
    """

    model: BlockData
    columns: Columns
    rows: Terms
    cost: Terms
    calls: FunctionCalls
    objective: ObjectiveData | None
    sign: float
    constraints: list[ConstraintData] = field(default_factory=list)
    bounds: list[tuple[Any, Any]] = field(default_factory=list)
    constant_constraints: list[ConstraintData] = field(default_factory=list)

    @property
    def variables(self) -> list[VarData]:
        """Free variables in the order of their columns."""
        return self.columns.variables


def collect_terms(model: BlockData) -> ModelTerms:
    """Walk over everything active in a model, once.

    Raises
    ------
    ModelError
        When the model has several objectives, no free variables or discrete ones, or an expression that vectorised
        functions cannot evaluate.
    """
    objective = only_objective(model)
    columns, calls = Columns(), FunctionCalls()
    sign = 1.0 if objective is None or objective.is_minimizing() else -1.0
    found = ModelTerms(model, columns, Terms(columns, calls), Terms(columns, calls), calls, objective, sign)
    with PauseGC():
        for component in model.component_objects(Constraint, active=True, descend_into=True):
            rows = [row for row in component.values() if row.active]
            _add_rows_by_rule(found, [row for row in rows if row.__class__ is RowByRule])
            for row in rows:
                if row.__class__ is not RowByRule:
                    _add_row(found, row)
        if objective is not None:
            found.cost.add(0, objective.expr, found.sign, keep_constant=True)
            found.cost.named_expressions[id(objective)] = objective
        found.rows.group()
        found.cost.group()
        _add_arguments(found)
    check_variables(model, found.variables)
    return found


def _add_rows_by_rule(found: ModelTerms, rows: list[Any]) -> None:
    """Rows of one component that follow its rule, all at once; those without free variables one by one."""
    if not rows:
        return
    stated = sums_of(rows)
    # Right-hand sides first: the order of the variables decides which optimum some problems with switches find.
    found.columns.add_by_rows(stated[::-1])
    sums = [(repeated, found.columns.table(repeated)) for repeated in stated]
    has_free = np.zeros(len(rows), dtype=bool)
    for repeated, table in sums:
        has_free[np.array(repeated.rows)[(table >= 0).any(axis=0)]] = True
    if not has_free.all():
        for row in np.flatnonzero(~has_free).tolist():
            _add_row(found, rows[row])
        rows = [row for row, is_free in zip(rows, has_free.tolist(), strict=True) if is_free]
        sums = [(repeated, found.columns.table(repeated)) for repeated in sums_of(rows)]
    for repeated, table in sums:
        found.rows.add_repeated(repeated, table, len(found.constraints))
    found.constraints += rows
    found.bounds += [row.bounds() for row in rows]


def _add_row(found: ModelTerms, constraint: ConstraintData) -> None:
    lower, body, upper = constraint.to_bounded_expression()
    if lower is None and upper is None:
        return
    try:
        added = found.rows.add(len(found.constraints), body)
    except ModelError as error:
        raise ModelError(f"'{constraint.name}': {error}") from None
    if added:
        found.constraints.append(constraint)
        found.bounds.append((lower, upper))
    else:
        found.constant_constraints.append(constraint)


def _add_arguments(found: ModelTerms) -> None:
    """Know the inputs of all calls: free variables that are arguments, and others that rows tie to arguments."""
    calls = found.calls
    for call in calls.by_level():
        for argument in call.arguments:
            variable = calls.replacement(argument) if is_function_call(argument) else argument
            is_free = isinstance(variable, VarData) and not variable.fixed
            if not is_free or any(variable is other for other in call.inputs):
                variable = calls.new_input(call)
                try:
                    _add_row(found, calls.tie(variable, argument))
                except ModelError as error:
                    raise ModelError(f"an input of '{call.function.name}': {error}") from None
            call.inputs.append(variable)
            found.columns.of(variable)
    found.rows.group()
