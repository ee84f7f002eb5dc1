"""Nonlinear terms of one shape each, with their variables and numbers in arrays, from one walk over each term.

The shape of an expression is a short code. Rows that a transcription repeats have one code; they differ by their
variables and numbers only. A code lists the nodes in the order of a walk, each before its arguments:

====================  ==========================================================================
``-1 - j``            variable ``j`` of the term; each repetition of a variable has its number again
``0``                 the next number of the term
``PRODUCT``, ...      an operator with a fixed count of arguments
``SUM + n``           a sum of ``n`` arguments
``FACTORS + n``       a product of ``n`` arguments
``SCALED_SUM + n``    a sum of ``n`` arguments, each times one of the next ``n`` numbers
``"sin"``, ...        a function of one argument, or a comparison
``("**", 2.0)``       a power with a constant exponent, which derivatives depend on
``("same", i)``       the node that stands at place ``i`` of the code
``("call", f, n)``    the output ``f`` of a `Function` of ``n`` arguments, where calls are evaluated
====================  ==========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from itertools import chain, islice
from operator import add, mul
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_nodes import (
    ARITHMETIC,
    CALL,
    CHOICE,
    CONSTANT,
    DIVISION,
    FLOAT_FUNCTIONS,
    FUNCTION,
    LEAF,
    NAMED,
    NEGATION,
    POWER,
    PRODUCT,
    SUMMATION,
    UNKNOWN,
    comparison_name,
    kind_of_node,
)
from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum
from pyrobocop_pyomo.numerics import Array

from .nonlinear_program import IndexArray

Code = tuple[Any, ...]

NUMBER = 0
_SIZE = 1 << 40  # more arguments than any sum has
SUM, FACTORS, SCALED_SUM = _SIZE, 2 * _SIZE, 3 * _SIZE
_ARGUMENTS = {PRODUCT: 2, DIVISION: 2, NEGATION: 1, POWER: 2, CHOICE: 3}
_ARGUMENTS_OF_FUNCTION = {"==": 2, "<=": 2, "<": 2, "<=<=": 3, "<=<": 3, "<<=": 3, "<<": 3}


class NodeKinds(dict[type, int]):
    """Kind of each class of nodes that was met, as a dictionary: the walks look kinds up for every node.

    Attributes
    ----------
    calls : int
        Kind of calls; by default they stand for variables, as names do for expressions.

    Raises
    ------
    ModelError
        For a class that has no derivatives here: external functions, minima and maxima, strings.
    """

    calls = NAMED

    def __missing__(self, cls: type) -> int:
        kind = kind_of_node(cls)
        if kind == CALL:
            kind = self.calls
        if kind == UNKNOWN:
            raise not_vectorised(cls)
        self[cls] = kind
        return kind


def not_vectorised(cls: type) -> ModelError:
    """What is said of a class of nodes that has no derivatives here."""
    return ModelError(
        f"an expression holds a {cls.__name__}, which the vectorised backend does not know. Use derivatives='asl', or "
        "the ipopt executable."
    )


def decoded(
    code: Code,
    variables: Sequence[Any],
    numbers: Sequence[Any],
    functions: Mapping[str, Callable[..., Any]] = FLOAT_FUNCTIONS,
) -> Any:
    """Value of a code, for whatever kind of values knows arithmetic: floats, arrays, symbols of CasADi.

    Parameters
    ----------
    code : tuple
        From `TermGroup.code`.
    variables, numbers : sequence
        Values of the term's variables and numbers, in the order of the code.
    functions : mapping of name to callable
        What the functions, comparisons and ``"choose"`` mean for those values.
    """
    upcoming = iter(numbers)
    values: dict[int, Any] = {}
    pending: list[tuple[int, int, Callable[[list[Any]], Any], list[Any]]] = []  # place, arguments wanted, found
    for place, symbol in enumerate(code):
        if symbol.__class__ is int and symbol <= NUMBER:
            value = variables[-1 - symbol] if symbol else next(upcoming)
        elif symbol == SUM:
            value = 0.0
        elif symbol.__class__ is tuple and symbol[0] == "same":
            value = values[symbol[1]]
        else:
            pending.append((place, *_operation(symbol, upcoming, functions), []))
            continue
        while pending:
            start, wanted, operate, arguments = pending[-1]
            arguments.append(value)
            if len(arguments) < wanted:
                break
            pending.pop()
            value = values[start] = operate(arguments)
    return value


def _operation(
    symbol: Any, upcoming: Iterator[Any], functions: Mapping[str, Callable[..., Any]]
) -> tuple[int, Callable[[list[Any]], Any]]:
    """How many arguments an operation has, and its value from these."""
    if symbol.__class__ is str:
        return _ARGUMENTS_OF_FUNCTION.get(symbol, 1), lambda arguments: functions[symbol](*arguments)
    if symbol.__class__ is tuple and symbol[0] == "call":
        return symbol[2], lambda arguments: functions["call"](symbol[1], *arguments)
    if symbol.__class__ is tuple:
        return 1, lambda arguments: arguments[0] ** symbol[1]
    if symbol >= SCALED_SUM:
        scales = list(islice(upcoming, symbol - SCALED_SUM))
        return len(scales), lambda arguments: reduce(add, map(mul, scales, arguments))
    if symbol == CHOICE:
        return _ARGUMENTS[symbol], lambda arguments: functions["choose"](*arguments)
    if symbol >= FACTORS:
        return symbol % _SIZE, lambda arguments: reduce(mul, arguments)
    kind = SUMMATION if symbol >= SUM else symbol
    return _ARGUMENTS.get(symbol, symbol % _SIZE), lambda arguments: ARITHMETIC[kind](*arguments)


class TermGroup:
    """Nonlinear terms of one shape: ``scales[i] * term(variables[i], numbers[i])`` is added to row ``rows[i]``.

    Attributes
    ----------
    code : tuple
        The shape; see the module.
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

    def arrays(self) -> TermArrays:
        """All terms."""
        terms = len(self.rows)
        numbers = np.array(self.numbers, dtype=float).reshape(terms, self.numbers_per_term)
        parameters = np.full(numbers.size, -1, dtype=np.intp)
        places, known = np.array(self.parameters, dtype=np.intp).reshape(-1, 2).T
        parameters[places] = known
        return TermArrays(
            self.code,
            np.array(self.columns, dtype=np.intp).reshape(terms, self.size),
            numbers,
            parameters.reshape(numbers.shape),
            np.array(self.rows, dtype=np.intp),
            np.array(self.scales, dtype=float),
        )


class TermArrays(NamedTuple):
    """The terms of a group as arrays.

    Attributes
    ----------
    code : tuple
        See the module.
    columns : int array, shape (terms, variables)
    numbers : float array, shape (terms, numbers)
    parameters : int array, shape (terms, numbers)
        The parameters that stand in `numbers`; -1 for a number that stays.
    rows : int array, shape (terms,)
    scales : float array, shape (terms,)
    """

    code: Code
    columns: np.ndarray
    numbers: Array
    parameters: np.ndarray
    rows: np.ndarray
    scales: Array


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

    def of(self, leaf: Any) -> int:
        """Column of a variable or parameter."""
        column = self.column_of.get(id(leaf))
        return self.add(leaf) if column is None else column

    def add_by_rows(self, sums: list[RepeatedSum]) -> None:
        """Meet the variables of several sums in the order of the rows, as a walk over these does."""
        leaves = list(chain.from_iterable(chain.from_iterable(each.variables) for each in sums))
        rows = np.concatenate([np.tile(each.rows, len(each.variables)) for each in sums])
        known = self.column_of
        for i in np.argsort(rows, kind="stable").tolist():
            if id(leaves[i]) not in known:
                self.add(leaves[i])

    def table(self, repeated: RepeatedSum) -> IndexArray:
        """Columns of what stands in the place of each variable of a sum, shape ``(variables, places)``."""
        known = self.column_of.get
        found = np.empty((len(repeated.variables), len(repeated.rows)), dtype=np.int32)
        for columns, leaves in zip(found, repeated.variables, strict=True):
            columns[:] = [self.add(leaf) if (column := known(id(leaf))) is None else column for leaf in leaves]
        return found


def repetitions(table: IndexArray) -> Iterator[tuple[list[int], dict[int, list[int]]]]:
    """Places of a sum whose terms differ by their columns alone.

    Where some variables are fixed, or where two are one, the terms are other ones.

    Parameters
    ----------
    table : int array, shape (variables, places)
        Of `Columns.table`.

    Yields
    ------
    places : list of int
    exchanged : dict of int to list of int
        From the columns at the first place to those at each.
    """
    ordered = np.sort(table, axis=0)
    same = (ordered[1:] == ordered[:-1]).any(axis=0)
    yield from (([place], {}) for place in np.flatnonzero(same).tolist())
    is_fixed = table < 0
    has_fixed = is_fixed.any(axis=0)
    groups = [np.flatnonzero(~has_fixed & ~same)]
    by_pattern: dict[bytes, list[int]] = {}
    for place in np.flatnonzero(has_fixed & ~same).tolist():
        by_pattern.setdefault(is_fixed[:, place].tobytes(), []).append(place)
    groups += map(np.array, by_pattern.values())
    for places in groups:
        if places.size:
            yield places.tolist(), {int(columns[places[0]]): columns[places].tolist() for columns in table}


class NonlinearTerm(NamedTuple):
    """A nonlinear term: ``scale`` times its nodes under an operator, or times its only node."""

    nodes: tuple[Any, ...]
    scale: float = 1.0
    symbol: int | None = None
    scales: tuple[float, ...] = ()


class TermGroups(dict[Code, TermGroup]):
    """Groups by their codes.

    Parameters
    ----------
    columns : Columns
    kinds : NodeKinds
    content_of : callable
        From a named expression to what it stands for, and from a call that is evaluated to the output of a function.
    """

    def __init__(self, columns: Columns, kinds: NodeKinds, content_of: Callable[[Any], Any]) -> None:
        super().__init__()
        self._columns, self._kinds, self._content_of = columns, kinds, content_of

    def put(
        self, term: NonlinearTerm, rows: list[int], scales: list[float], exchanged: Mapping[int, list[int]]
    ) -> None:
        """Walk over a term once, and put it into its group for one or several rows.

        Parameters
        ----------
        term : NonlinearTerm
            As it is in the first of them.
        rows : list of int
        scales : list of float
            Of each row, beside that of the term.
        exchanged : mapping of int to list of int
            For columns of variables and parameters of the term, those that stand in their places in each row.
        """
        group, columns, numbers, parameters = self._shape(term)
        count, start = len(rows), len(group.numbers)
        group.rows += rows
        group.scales += [term.scale * scale for scale in scales]
        if exchanged:
            of_terms = [exchanged.get(column, [column] * count) for column in columns]
            columns = list(chain.from_iterable(zip(*of_terms, strict=True)))
        group.columns += columns
        group.numbers += numbers * count
        for place, parameter in parameters:
            for i, column in enumerate(exchanged.get(-1 - parameter, [-1 - parameter] * count)):
                group.parameters.append((start + i * len(numbers) + place, -1 - column))

    def _shape(self, term: NonlinearTerm) -> tuple[TermGroup, list[int], list[float], list[tuple[int, int]]]:
        """The group of a term, its variables and numbers, and which of these are parameters."""
        nodes = list(reversed(term.nodes))
        code: list[Any] = [] if term.symbol is None else [term.symbol]
        numbers = list(term.scales)
        kinds, column_of = self._kinds, self._columns.column_of
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
                    column = self._columns.add(node)
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
                nodes.append(self._content_of(node))
                continue
            identity = id(node)
            place = places.get(identity)
            if place is not None:
                # The same node again: a common subexpression, evaluated once, however often it is nested.
                put(("same", place))
                continue
            places[identity] = len(code)
            if kind == POWER and kinds[node.args[1].__class__] == CONSTANT:
                put(("**", node.args[1]))
                nodes.append(node.args[0])
            elif kind <= CHOICE:
                put(kind)
                nodes += reversed(node.args)
            elif kind == SUMMATION:
                put(SUM + node.nargs())
                nodes += reversed(node.args)
            elif kind == FUNCTION:
                put(node.getname())
                nodes.append(node.args[0])
            elif kind == CALL:
                put(("call", self._content_of(node), node.nargs()))
                nodes += reversed(node.args)
            else:
                put(comparison_name(node))
                nodes += reversed(node.args)
        key = tuple(code)
        group = self.get(key)
        if group is None:
            group = self[key] = TermGroup(key, len(columns), len(numbers))
        return group, list(columns), numbers, parameters
