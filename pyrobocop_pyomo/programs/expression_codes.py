"""The shape of an expression as a short code, apart from the variables and numbers in it.

Rows that a transcription repeats have one code; they differ by their variables and numbers only. A code lists
the nodes in the order of a walk, each before its arguments:

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
====================  ==========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from operator import add, mul
from typing import Any

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_nodes import (
    CALL,
    CHOICE,
    DIVISION,
    FLOAT_FUNCTIONS,
    NAMED,
    NEGATION,
    POWER,
    PRODUCT,
    SUMMATION,
    UNKNOWN,
    apply_operator,
    kind_of_node,
)

Code = tuple[Any, ...]

NUMBER = 0
_SIZE = 1 << 40  # more arguments than any sum has
SUM, FACTORS, SCALED_SUM = _SIZE, 2 * _SIZE, 3 * _SIZE
_ARGUMENTS = {PRODUCT: 2, DIVISION: 2, NEGATION: 1, POWER: 2, CHOICE: 3}
_ARGUMENTS_OF_FUNCTION = {"==": 2, "<=": 2, "<": 2, "<=<=": 3, "<=<": 3, "<<=": 3, "<<": 3}

REMEDY = "Use derivatives='asl', or the ipopt executable."


class NodeKinds(dict[type, int]):
    """Kind of each class of nodes that was met, as a dictionary: the walks look kinds up for every node.

    Raises
    ------
    ModelError
        For a class that has no derivatives here: external functions, minima and maxima, strings.
    """

    def __missing__(self, cls: type) -> int:
        kind = kind_of_node(cls)
        if kind == CALL:
            kind = NAMED  # a call stands for a variable, as a name does for an expression
        if kind == UNKNOWN:
            raise ModelError(
                f"an expression holds a {cls.__name__}, which the vectorised backend does not know. {REMEDY}"
            )
        self[cls] = kind
        return kind


def function_name(node: Any) -> str:
    """Name of a function of one argument.

    Raises
    ------
    ModelError
        For a function that codes do not have.
    """
    name: str = node.getname()
    if name not in FLOAT_FUNCTIONS:
        raise ModelError(f"'{node}': vectorised expressions do not know the function '{name}'. {REMEDY}")
    return name


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
    pending: list[tuple[int, Any, int, list[Any]]] = []  # place, symbol, arguments wanted, arguments found
    for place, symbol in enumerate(code):
        wanted, found = _arguments(symbol, upcoming)
        if wanted:
            pending.append((place, symbol, wanted, found))
            continue
        value = _leaf(symbol, variables, upcoming, values)
        while pending:
            start, operator, wanted, arguments = pending[-1]
            arguments.append(value)
            if len(arguments) < wanted:
                break
            pending.pop()
            value = values[start] = _applied(operator, arguments, functions)
    return value


def _arguments(symbol: Any, upcoming: Iterator[Any]) -> tuple[int, list[Any]]:
    """How many arguments follow; the scales of a sum count as found already."""
    if isinstance(symbol, str):
        return _ARGUMENTS_OF_FUNCTION.get(symbol, 1), []
    if isinstance(symbol, tuple):
        return (1 if symbol[0] == "**" else 0), []
    if symbol >= SCALED_SUM:
        count = symbol - SCALED_SUM
        return 2 * count, [next(upcoming) for _ in range(count)]
    if symbol >= SUM:
        return symbol % _SIZE, []
    return _ARGUMENTS.get(symbol, 0), []


def _leaf(symbol: Any, variables: Sequence[Any], upcoming: Iterator[Any], values: Mapping[int, Any]) -> Any:
    if isinstance(symbol, tuple):
        return values[symbol[1]]
    if symbol == NUMBER:
        return next(upcoming)
    return 0.0 if symbol == SUM else variables[-1 - symbol]


def _applied(symbol: Any, arguments: list[Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    if isinstance(symbol, str):
        return functions[symbol](*arguments)
    if isinstance(symbol, tuple):
        return arguments[0] ** symbol[1]
    if symbol >= SCALED_SUM:
        half = symbol - SCALED_SUM
        return reduce(add, map(mul, arguments[:half], arguments[half:]))
    if symbol >= SUM:
        return apply_operator(PRODUCT if symbol >= FACTORS else SUMMATION, arguments, functions)
    return apply_operator(symbol, arguments, functions)
