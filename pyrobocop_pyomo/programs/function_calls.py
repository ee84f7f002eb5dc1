"""The calls of Python functions in a model: each with variables that stand for its outputs.

A source of derivatives sees the variables in place of the calls, and the arguments of the calls as rows of programs of
their own. `ComposedProgram` puts the functions in between.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

from pyomo.core.base.var import VarData
from pyomo.core.expr.numvalue import NumericValue, native_numeric_types

from pyrobocop_pyomo.modeling.bulk_parts import new_variable
from pyrobocop_pyomo.modeling.functions import Function, FunctionOutput, is_function_call
from pyrobocop_pyomo.modeling.shared_nodes import NodesOnce


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
    """

    function: Function
    arguments: tuple[Any, ...]
    level: int
    outputs: dict[int, VarData] = field(default_factory=dict)


class ConstantCall(NumericValue):
    """An output of a function whose arguments hold no free variable: a parameter of the program.

    Parameters
    ----------
    node : ExternalFunctionExpression
    """

    __slots__ = ("_node",)

    def __init__(self, node: Any) -> None:
        self._node = node

    @property
    def value(self) -> float:
        """The function at the current values of parameters and fixed variables."""
        # Asked of the function itself: Pyomo's `value` would log an error before this package says what to do about it.
        return float(self._node._fcn.evaluate(self._node.args))


class FunctionCalls(NodesOnce):
    """All different calls that a walk over a model has met; those with the same arguments are one.

    What is found at an expression is the level that a call of it has, in a tuple, which no number is; None where
    nothing in it is free.

    Attributes
    ----------
    calls : list of FunctionCall
        Those that depend on free variables.
    given : list
        Fixed variables and parameters that arguments hold.
    """

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[FunctionCall] = []
        self.given: list[Any] = []
        self._different: dict[tuple[Any, ...], FunctionCall | None] = {}
        self._constants: dict[int, ConstantCall] = {}

    def replacement(self, node: Any) -> VarData | ConstantCall:
        """What stands for a call: a variable, or a parameter where nothing in its arguments is free."""
        self.of(node)
        call = self._different[_key(node)]
        if call is None:
            return self._constants.setdefault(id(node), ConstantCall(node))
        output = node._fcn.index
        if output not in call.outputs:
            call.outputs[output] = new_variable(None, None, 0.0)
        return call.outputs[output]

    def by_level(self) -> list[FunctionCall]:
        """The calls, those of lower levels first."""
        return sorted(self.calls, key=attrgetter("level"))

    def of_leaf(self, leaf: Any) -> tuple[int] | None:
        """Level 0 for a free variable; what is fixed or a parameter is noted."""
        if leaf.is_variable_type() and not leaf.fixed:
            return (0,)
        if not leaf.is_constant():
            self.given.append(leaf)
        return None

    def of_operation(self, node: Any, found: list[Any]) -> tuple[int] | None:
        """The highest level among the arguments, and one more for a call, which is known from then on."""
        highest = max((each for each in found if each.__class__ is tuple), default=None)
        if not is_function_call(node):
            return highest
        key = _key(node)
        if key not in self._different:
            self._different[key] = None
            if highest is not None:
                self._different[key] = new = FunctionCall(node._fcn.function, tuple(node._args_), *highest)
                self.calls.append(new)
        return None if highest is None else (highest[0] + 1,)


def _key(node: Any) -> tuple[Any, ...]:
    output: FunctionOutput = node._fcn
    arguments = [a if a.__class__ in native_numeric_types else (id(a),) for a in node._args_]
    return (id(output.function), *arguments)
