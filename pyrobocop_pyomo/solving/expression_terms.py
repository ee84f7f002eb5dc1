"""A model's rows and objective as a linear part and groups of nonlinear terms of one shape each."""

from __future__ import annotations

from typing import Any, NamedTuple

from pyomo.core.expr.numeric_expr import MonomialTermExpression

from .expression_codes import CHOICE, DIVISION, FACTORS, NEGATION, NUMBER, POWER, PRODUCT, SCALED_SUM, SUM, Code
from .expression_kinds import CONSTANT, FUNCTION, LEAF, NAMED, SUMMATION, NodeKinds, comparison_name, function_name

# A sum of up to so many nonlinear terms is one term, whose parts share what they have in common; a longer one, as
# an integral, is taken apart, so that its parts can be evaluated as repetitions of each other.
LONGEST_TERM = 16


class TermGroup:
    """Nonlinear terms of one shape: ``scales[i] * term(variables[i], numbers[i])`` is added to row ``rows[i]``.

    Attributes
    ----------
    code : tuple
        The shape; see `expression_codes`.
    size, numbers_per_term : int
        Counts of variables and of numbers in one term.
    rows : list of int
    scales : list of float
    columns : list of int
        Variables, `size` for each term.
    numbers : list of float
        Numbers, `numbers_per_term` for each term; 0 where a parameter stands.
    parameters : list of pairs of int
        Places in `numbers` and the parameters that stand there.
    """

    __slots__ = ("code", "columns", "numbers", "numbers_per_term", "parameters", "rows", "scales", "size")

    def __init__(self, code: Code, size: int, numbers_per_term: int) -> None:
        self.code, self.size, self.numbers_per_term = code, size, numbers_per_term
        self.rows: list[int] = []
        self.scales: list[float] = []
        self.columns: list[int] = []
        self.numbers: list[float] = []
        self.parameters: list[tuple[int, int]] = []


class Columns:
    """Variables and parameters in the order in which a walk meets them.

    Attributes
    ----------
    variables : list of VarData
        Free variables.
    parameters : list
        Fixed variables and mutable Params: numbers that may change without a new walk.
    column_of : dict of id to int
        Place of a variable, or ``-1 - place`` of a parameter.
    """

    def __init__(self) -> None:
        self.variables: list[Any] = []
        self.parameters: list[Any] = []
        self.column_of: dict[int, int] = {}

    def add(self, leaf: Any) -> int:
        """Column of a variable or parameter that is met for the first time."""
        if leaf.is_variable_type() and not leaf.fixed:
            column = len(self.variables)
            self.variables.append(leaf)
        else:
            column = -1 - len(self.parameters)
            self.parameters.append(leaf)
        self.column_of[id(leaf)] = column
        return column


class _Part(NamedTuple):
    """A nonlinear summand: ``scale * product of factors * node``."""

    node: Any
    scale: float
    factors: tuple[Any, ...]


class _Encoded(NamedTuple):
    """A term on its way into its group."""

    code: Code
    scale: float
    columns: dict[int, int]
    numbers: list[float]
    parameters: list[tuple[int, int]]


class Terms:
    """What is known of a set of rows: ``constants + linear part + sum of the groups``.

    Parameters
    ----------
    columns : Columns
        Shared among the sets of rows of one model.

    Attributes
    ----------
    linear_rows, linear_columns, linear_coefficients : list
        Triplets; a column ``-1 - i`` is the parameter i.
    constants : dict of row to float
    groups : dict of code to TermGroup
    named_expressions : dict of id to pair of named expression and what it stood for at the time of the walk
    """

    def __init__(self, columns: Columns) -> None:
        self.columns = columns
        self.linear_rows: list[int] = []
        self.linear_columns: list[int] = []
        self.linear_coefficients: list[float] = []
        self.constants: dict[int, float] = {}
        self.groups: dict[Code, TermGroup] = {}
        self.named_expressions: dict[int, tuple[Any, Any]] = {}
        self._kinds = NodeKinds()

    def add(self, row: int, expression: Any, scale: float = 1.0, keep_constant: bool = False) -> bool:
        """Add ``scale * expression`` to a row, in linear terms as far as possible.

        Returns
        -------
        bool
            False when the expression has no free variables; it is then not added, except with `keep_constant`.
        """
        columns: list[int] = []
        coefficients: list[float] = []
        constant, parts = self._split(expression, scale, columns, coefficients)
        terms = self._encode(parts) if parts else []
        variable = any(column >= 0 for column in columns) or any(term.columns for term in terms)
        if not (variable or keep_constant):
            return False
        if constant:
            self.constants[row] = constant
        self.linear_rows += [row] * len(columns)
        self.linear_columns += columns
        self.linear_coefficients += coefficients
        for term in terms:
            self._put_into_group(row, term)
        return variable

    def _split(
        self, expression: Any, scale: float, columns: list[int], coefficients: list[float]
    ) -> tuple[float, list[_Part]]:
        """Take the linear terms out; return the constant and the nonlinear summands."""
        kinds, column_of = self._kinds, self.columns.column_of
        constant = 0.0
        parts: list[_Part] = []
        factors: tuple[Any, ...] = ()
        pending: list[tuple[Any, float, tuple[Any, ...]]] = [(expression, scale, factors)]
        while pending:
            node, scale, factors = pending.pop()
            kind = kinds[node.__class__]
            if kind == SUMMATION:
                for argument in reversed(node._args_[: node._nargs]):
                    # The quick way of the most frequent case: a number times a variable that was met before.
                    if argument.__class__ is MonomialTermExpression and not factors:
                        coefficient, variable = argument._args_
                        column = column_of.get(id(variable))
                        if column is not None and coefficient.__class__ is float:
                            columns.append(column)
                            coefficients.append(scale * coefficient)
                            continue
                    pending.append((argument, scale, factors))
            elif kind == LEAF and not factors:
                column = column_of.get(id(node))
                columns.append(self.columns.add(node) if column is None else column)
                coefficients.append(scale)
            elif kind == NEGATION:
                pending.append((node._args_[0], -scale, factors))
            elif kind == PRODUCT:
                first, last = node._args_
                if kinds[first.__class__] == CONSTANT:
                    pending.append((last, scale * float(first), factors))
                elif kinds[last.__class__] == CONSTANT:
                    pending.append((first, scale * float(last), factors))
                elif self._is_long_sum(last):
                    pending.append((last, scale, (*factors, first)))
                elif self._is_long_sum(first):
                    pending.append((first, scale, (*factors, last)))
                else:
                    parts.append(_Part(node, scale, factors))
            elif kind == DIVISION and kinds[node._args_[1].__class__] == CONSTANT and node._args_[1]:
                pending.append((node._args_[0], scale / float(node._args_[1]), factors))
            elif kind == NAMED:
                pending.append((self._content(node), scale, factors))
            elif kind == CONSTANT and not factors:
                constant += scale * float(node)
            else:
                parts.append(_Part(node, scale, factors))
        return constant, parts

    def _is_long_sum(self, node: Any) -> bool:
        """Whether a factor is worth being multiplied out: an integral over a free duration is such a product."""
        kinds = self._kinds
        while True:
            kind = kinds[node.__class__]
            if kind == NAMED:
                node = self._content(node)
            elif kind == PRODUCT and kinds[node._args_[0].__class__] == CONSTANT:
                node = node._args_[1]
            else:
                return kind == SUMMATION and node._nargs > LONGEST_TERM

    def _content(self, named: Any) -> Any:
        """The expression behind a name, remembered so that a later change of it can be noticed."""
        expression = named._args_[0]
        self.named_expressions[id(named)] = (named, expression)
        return expression

    def _encode(self, parts: list[_Part]) -> list[_Encoded]:
        if len(parts) == 1 and not parts[0].factors:
            return [self._encode_term(parts[0].scale, [parts[0].node], [], [])]
        if len(parts) <= LONGEST_TERM and not any(part.factors for part in parts):
            # What the scales have in common stays outside, so that elements of other widths have the same numbers.
            common = parts[0].scale if len({abs(part.scale) for part in parts}) == 1 else 1.0
            scales = [part.scale / common for part in parts] if common else [0.0] * len(parts)
            return [
                self._encode_term(common, [part.node for part in reversed(parts)], [SCALED_SUM + len(parts)], scales)
            ]
        return [
            self._encode_term(
                part.scale, [part.node, *part.factors], [FACTORS + 1 + len(part.factors)] if part.factors else [], []
            )
            for part in parts
        ]

    def _encode_term(self, scale: float, nodes: list[Any], code: list[Any], numbers: list[float]) -> _Encoded:
        """Walk over the nodes of a term, the last of them first; consumes `nodes`, continues `code` and `numbers`."""
        kinds, column_of = self._kinds, self.columns.column_of
        columns: dict[int, int] = {}  # to the numbers of the variables within this term
        parameters: list[tuple[int, int]] = []
        places: dict[int, int] = {}
        pop, put = nodes.pop, code.append
        while nodes:
            node = pop()
            kind = kinds[node.__class__]
            if kind == LEAF:
                column = column_of.get(id(node))
                if column is None:
                    column = self.columns.add(node)
                if column >= 0:
                    number = columns.get(column)
                    if number is None:
                        number = columns[column] = -1 - len(columns)
                    put(number)
                else:
                    put(NUMBER)
                    parameters.append((len(numbers), -1 - column))
                    numbers.append(0.0)
                continue
            if kind == CONSTANT:
                put(NUMBER)
                numbers.append(node)
                continue
            if kind == NAMED:
                nodes.append(self._content(node))
                continue
            identity = id(node)
            place = places.get(identity)
            if place is not None:
                # The same node again: a common subexpression, evaluated once, however often it is nested.
                put(("same", place))
                continue
            places[identity] = len(code)
            if kind == POWER and kinds[node._args_[1].__class__] == CONSTANT:
                put(("**", node._args_[1]))
                nodes.append(node._args_[0])
            elif kind <= CHOICE:
                put(kind)
                nodes += reversed(node._args_)
            elif kind == SUMMATION:
                put(SUM + node._nargs)
                nodes += reversed(node._args_[: node._nargs])
            elif kind == FUNCTION:
                put(function_name(node))
                nodes.append(node._args_[0])
            else:
                put(comparison_name(node))
                nodes += reversed(node._args_)
        return _Encoded(tuple(code), scale, columns, numbers, parameters)

    def _put_into_group(self, row: int, term: _Encoded) -> None:
        group = self.groups.get(term.code)
        if group is None:
            group = self.groups[term.code] = TermGroup(term.code, len(term.columns), len(term.numbers))
        start = len(group.numbers)
        group.rows.append(row)
        group.scales.append(term.scale)
        group.columns += term.columns
        group.numbers += term.numbers
        group.parameters += [(start + place, parameter) for place, parameter in term.parameters]
