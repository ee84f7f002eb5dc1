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
from pyrobocop_pyomo.modeling.shared_nodes import topmost_nodes


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


class FunctionCalls:
    """All different calls that a walk over a model has met; those with the same arguments are one.

    Attributes
    ----------
    calls : list of FunctionCall
        Those that depend on free variables.
    given : list
        Fixed variables and parameters that arguments hold.
    """

    def __init__(self) -> None:
        self.calls: list[FunctionCall] = []
        self.given: list[Any] = []
        self._known: dict[tuple[Any, ...], FunctionCall | None] = {}
        self._constants: dict[int, ConstantCall] = {}
        self._kept: list[Any] = []  # calls are known by the ids of their arguments: these have to live on

    def replacement(self, node: Any) -> VarData | ConstantCall:
        """What stands for a call: a variable, or a parameter where nothing in its arguments is free."""
        self._register(node)
        call = self._known[_key(node)]
        if call is None:
            constant = self._constants.get(id(node))
            if constant is None:
                constant = self._constants[id(node)] = ConstantCall(node)
                self._kept.append(node)
            return constant
        output = node._fcn.index
        if output not in call.outputs:
            call.outputs[output] = new_variable(None, None, 0.0)
        return call.outputs[output]

    def by_level(self) -> list[FunctionCall]:
        """The calls, those of lower levels first."""
        return sorted(self.calls, key=attrgetter("level"))

    def _register(self, node: Any) -> None:
        """Make the call known, and those in its arguments before it; nested calls may be many."""
        pending = [node]
        while pending:
            top = pending[-1]
            key = _key(top)
            if key in self._known:
                pending.pop()
                continue
            inner, free, given = _held(top._args_)
            unknown = [call for call in inner if _key(call) not in self._known]
            if unknown:
                pending += unknown
                continue
            pending.pop()
            self._kept.append(top)
            self.given += given
            level, depends = 0, free
            for nested in inner:
                call = self._known[_key(nested)]
                if call is not None:
                    self.replacement(nested)
                    level, depends = max(level, call.level + 1), True
            self._known[key] = None
            if depends:
                self._known[key] = new = FunctionCall(top._fcn.function, tuple(top._args_), level)
                self.calls.append(new)


def _held(arguments: Any) -> tuple[list[Any], bool, list[Any]]:
    """Calls in arguments, whether a variable is free there, and what is fixed or a parameter."""
    inner, free, given = [], False, []
    for node in topmost_nodes(arguments, lambda node: is_function_call(node) or not node.is_expression_type()):
        if is_function_call(node):
            inner.append(node)
        elif node.is_variable_type() and not node.fixed:
            free = True
        elif not node.is_constant():
            given.append(node)
    return inner, free, given


def _key(node: Any) -> tuple[Any, ...]:
    output: FunctionOutput = node._fcn
    arguments = [a if a.__class__ in native_numeric_types else (id(a),) for a in node._args_]
    return (id(output.function), *arguments)
