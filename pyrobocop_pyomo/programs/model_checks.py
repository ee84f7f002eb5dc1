"""What every backend asks of a model before it is solved."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.external import AMPLExternalFunction, ExternalFunction, PythonCallbackFunction
from pyomo.core.base.objective import Objective
from pyomo.core.base.param import Param
from pyomo.core.base.set import RangeSet, Set
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var, VarData
from pyomo.core.expr.numeric_expr import ExternalFunctionExpression
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.visitor import identify_mutable_parameters
from pyomo.dae import ContinuousSet, DerivativeVar, Integral
from pyomo.network import Port
from pyomo.repn.util import categorize_valid_components

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.diagnosis.findings import quoted
from pyrobocop_pyomo.diagnosis.statements import unfinished_findings
from pyrobocop_pyomo.errors import EvaluationError, FunctionError, ModelError
from pyrobocop_pyomo.modeling.activity import ONE_MODEL, foreign_read, foreign_variable
from pyrobocop_pyomo.modeling.functions import FunctionOutput, python_function_refused
from pyrobocop_pyomo.modeling.pyomo_internals import function_of_call
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule
from pyrobocop_pyomo.modeling.shared_nodes import shared_value, topmost_nodes, variables_in

# An ExternalFunction or a Port does nothing by itself; a derivative along a set that was discretised is a Var.
_SEEN = {
    *(Block, Objective, Constraint, Var, Param, Expression, Set, RangeSet, Suffix, ExternalFunction, Port),
    *(ContinuousSet, DerivativeVar, Integral),
}


def refuse_unseen_components(model: BlockData) -> None:
    """Check that a model has nothing active that a solver would not see.

    Raises
    ------
    ModelError
        Naming what it has, and what makes rows of it.
    """
    _, unseen = categorize_valid_components(model, active=True, valid=_SEEN)
    for finding in unfinished_findings(model):
        raise ModelError(f"'{model.name}': {finding.message} {finding.remedy}")
    pairs = [component.name for ctype in PAIR_TYPES for component in unseen.get(ctype, ())]
    if pairs:
        raise ModelError(
            f"'{model.name}': {quoted(pairs)} {'holds' if len(pairs) == 1 else 'hold'} pairs, and Ipopt sees "
            "constraints only. Solve it by rcp.solve(m) or SolverFactory('pyrobocop.mpcc'), or make constraints of the "
            "pairs first: TransformationFactory('pyrobocop.relax_complementarity').apply_to(m)."
        )
    if unseen:
        shown = ", ".join(
            f"'{component.name}' ({ctype.__name__})" for ctype, components in unseen.items() for component in components
        )
        raise ModelError(
            f"'{model.name}' has active components that are no constraints, and that a solver would not see: {shown}. "
            "Transform them, or deactivate them."
        )


def check_variables(model: BlockData, variables: list[VarData]) -> None:
    """Check the free variables of a model.

    Raises
    ------
    ModelError
        When there are none, or discrete ones among them.
    """
    if not variables:
        raise ModelError(
            f"'{model.name}' has no free variable in any active constraint or objective: there is nothing to "
            "solve. Unfix a variable, or activate what uses it."
        )
    discrete = [variable.name for variable in variables if not variable.is_continuous()]
    if discrete:
        raise ModelError(
            f"'{model.name}' has {len(discrete)} discrete variables ({quoted(discrete)}); Ipopt solves continuous "
            "problems only. Fix them, relax them with TransformationFactory('core.relax_integer_vars'), or use a "
            "mixed-integer solver; an integer control of a phase is Control(integer=(0, 1)), and rcp.solve rounds it."
        )


def refuse_foreign(model: BlockData, variables: list[VarData]) -> None:
    """Check that rows hold no variables of another model beside those of their own.

    Raises
    ------
    ModelError
        Naming a row that does.
    """
    foreign = foreign_variable(model, variables)
    # Rows that are all about one other model are a view of it, which is made on purpose.
    if foreign is not None and foreign_variable(foreign, variables) is not None:
        row = next(row for row in _active_rows(model) if any(found is foreign for found in variables_in(row.expr)))
        raise ModelError(f"'{row.name}' {foreign_read(foreign, model)} {ONE_MODEL}")


def refuse_function_calls(model: BlockData) -> None:
    """Check the functions that active rows and the objective call.

    ASL calls functions of compiled libraries only; where it finds none, it ends the process.

    Raises
    ------
    FunctionError
        For a `Function`.
    ModelError
        For another Python function, a library that cannot be loaded, or a function that its library does not have.
    """
    checked = set()
    for row in _active_rows(model):
        if row.__class__ is RowByRule:  # its rule reads variables alone
            continue
        for function in _functions_called((row.expr,)):
            if id(function) in checked:
                continue
            checked.add(id(function))
            if isinstance(function, FunctionOutput):
                raise FunctionError(python_function_refused(f"'{row.name}': the Python function '{function.name}'"))
            if isinstance(function, PythonCallbackFunction):
                raise ModelError(f"'{row.name}' {external_function_refused(function.name)}")
            if isinstance(function, AMPLExternalFunction):
                _require_compiled(function, row.name)


def _functions_called(expressions: Iterable[Any]) -> Iterator[Any]:
    for node in topmost_nodes(expressions, lambda node: isinstance(node, ExternalFunctionExpression)):
        yield function_of_call(node)
        yield from _functions_called(node.args)


def external_function_refused(name: str) -> str:
    """Why Ipopt cannot call a Python function that is given to Pyomo's ExternalFunction, after what calls it."""
    return (
        f"calls the Python function '{name}', and Ipopt's interfaces to .nl files call compiled functions only. State "
        "it as a Pyomo expression, or as rcp.Function(value, jacobian, hessian), or compile it: "
        "pyo.ExternalFunction(library='/path/to/library.so', function='name')."
    )


def _require_compiled(function: AMPLExternalFunction, row_name: str) -> None:
    try:
        function.load_library()
    except (OSError, AttributeError) as error:
        raise ModelError(
            f"'{row_name}' calls '{function.name}', whose library '{function._library}' cannot be loaded: {error}. "
            "Correct the path; a library for AMPL exports 'funcadd_ASL'."
        ) from None
    if function._function not in function._known_functions:
        present = ", ".join(sorted(map(str, function._known_functions))) or "none"
        raise ModelError(
            f"'{row_name}' calls '{function.name}', but '{function._library}' has no function "
            f"'{function._function}'. It has: {present}."
        )


def number_in(expression: Any, owner: str) -> float:
    """Value of an expression, for the component named `owner`.

    Raises
    ------
    EvaluationError
        When it does not exist: a division by zero, a logarithm of a negative number, an overflow.
    ModelError
        When a variable or a Param in it has no value.
    """
    try:
        number = shared_value(expression)
    except (ArithmeticError, ValueError, TypeError) as error:  # a complex number that is compared is a TypeError
        leaves = [*variables_in(expression), *identify_mutable_parameters(expression)]
        missing = next((leaf.name for leaf in leaves if value(leaf, exception=False) is None), None)
        if missing is not None:
            raise ModelError(f"'{owner}': '{missing}' has no value. Give it one.") from None
        raise _undefined(owner, str(error)) from None
    if isinstance(number, complex):
        raise _undefined(owner, f"{number} is not real")
    return float(number)


def _undefined(owner: str, reason: str) -> EvaluationError:
    return EvaluationError(
        f"'{owner}': an expression has no value: {reason}. Give Params and fixed variables values that it is "
        "defined for."
    )


def _active_rows(model: BlockData) -> Iterator[Any]:
    return model.component_data_objects((Constraint, Objective), active=True, descend_into=True)
