"""A model that calls Python functions as a program: expressions compiled, functions around them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.objective import Objective, ObjectiveData
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Any as AnySet
from pyomo.core.base.var import VarData
from pyomo.core.expr.numvalue import native_numeric_types, value

from pyrobocop_pyomo.modeling.bulk_parts import new_row
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement, variables_in

from .composed_program import ComposedProgram, Level, Points
from .function_calls import ConstantCall, FunctionCall, FunctionCalls, calls_in
from .model_numbers import check_constant
from .model_terms import ModelTerms
from .nl_files import FileProgram, ProgramBuilder, model_file
from .nonlinear_program import NonlinearProgram
from .vectorised_program import VectorisedProgram


class Composition(NamedTuple):
    """A program with what its variables and rows are in the user's model."""

    nlp: NonlinearProgram
    variables: list[VarData]
    constraints: list[ConstraintData]


class _Places:
    """Places of variables in the vector of x and y."""

    def __init__(self, calls: FunctionCalls) -> None:
        y = [variable for call in calls.calls for variable in call.outputs.values()]
        self._y_of = {id(variable): place for place, variable in enumerate(y)}
        self.outputs = len(y)
        self.x: list[VarData] = []
        self._x_of: dict[int, int] = {}

    def add(self, variables: Sequence[VarData]) -> None:
        """Give places to those that are no outputs and have none yet."""
        for variable in variables:
            if id(variable) not in self._y_of and id(variable) not in self._x_of:
                self._x_of[id(variable)] = len(self.x)
                self.x.append(variable)

    def of(self, variables: Sequence[VarData]) -> np.ndarray:
        """Places, once all have been added."""
        n, x_of, y_of = len(self.x), self._x_of, self._y_of
        return np.array([x_of[id(v)] if id(v) in x_of else n + y_of[id(v)] for v in variables], dtype=np.intp)

    def output(self, call: FunctionCall, i: int) -> int:
        """Place among y of an output, -1 where nothing uses it."""
        variable = call.outputs.get(i)
        return -1 if variable is None else self._y_of[id(variable)]


def vectorised_composition(terms: ModelTerms) -> Composition:
    """The program of a model whose expressions are evaluated by vectorised functions."""
    main = VectorisedProgram(terms)
    if not terms.calls.calls:
        return Composition(main, terms.variables, terms.constraints)
    places = _Places(terms.calls)
    places.add(terms.variables)
    columns = places.of(terms.variables)
    levels = []
    for calls, arguments in zip(terms.calls.levels, main.arguments, strict=True):
        points = _points(calls, places, partial(_next_row, count()))
        levels.append(Level(arguments, columns, points))
    nlp = ComposedProgram(main, columns, len(places.x), levels, places.outputs, [(main, columns)])
    return Composition(nlp, places.x, terms.constraints)


def composition_of_files(
    model: BlockData, owner: BlockData, objective: ObjectiveData | None, build: ProgramBuilder
) -> Composition:
    """The program of a model whose expressions are read from ``.nl`` files, one for each level of calls.

    Nothing is put on the model: rows with calls are rewritten on another one. Messages name the rows of the owner, the
    user's model.

    Raises
    ------
    InfeasibleConstraintException
        When a row without free variables contradicts itself.
    """
    calls = FunctionCalls()
    other, row_of = _rewritten(model, objective, calls)
    main = model_file(other, owner).program(build, objective is not None)
    files: list[tuple[list[FunctionCall], FileProgram | None, dict[int, int]]] = []
    for level in calls.levels:
        arguments, row_of_argument = _argument_model(level, calls)
        text = model_file(arguments, owner) if row_of_argument else None
        file = text.program(build, has_objective=False) if text is not None and text.constraints else None
        position = {} if file is None else {id(row): i for i, row in enumerate(file.constraints)}
        # A writer leaves out a row whose variables cancel; such an argument is a number.
        written = {key: position[id(row)] for key, row in row_of_argument.items() if id(row) in position}
        files.append((level, file, written))
    places = _Places(calls)
    places.add(main.variables)
    for _, file, _ in files:
        places.add([] if file is None else file.variables)
    levels, sources = [], [(main.nlp, places.of(main.variables))]
    for level, file, row in files:
        columns = np.empty(0, dtype=np.intp) if file is None else places.of(file.variables)
        points = _points(level, places, partial(_argument, file, row))
        levels.append(Level(None if file is None else file.nlp, columns, points))
        if file is not None:
            sources.append((file.nlp, columns))
    nlp = ComposedProgram(main.nlp, sources[0][1], len(places.x), levels, places.outputs, sources)
    return Composition(nlp, places.x, [row_of[id(row)] for row in main.constraints])


def _rewritten(
    model: BlockData, objective: ObjectiveData | None, calls: FunctionCalls
) -> tuple[ConcreteModel, dict[int, ConstraintData]]:
    """Rows and objective with variables in place of calls, and from the ids of these rows to the model's own."""
    other, without_calls = ConcreteModel(name=model.name), _WithoutCalls(calls)
    other.rows = Constraint(AnySet)
    row_of = {}
    for i, row in enumerate(model.component_data_objects(Constraint, active=True, descend_into=True)):
        lower, body, upper = row.to_bounded_expression()
        if lower is None and upper is None:
            continue
        expression = row.expr
        if calls_in(body):
            body = without_calls.of(body)
            if next(variables_in(body, include_fixed=False), None) is None:
                check_constant(row)
                continue
            expression = body == lower if row.equality else (lower, body, upper)
        row_of[id(new_row(other.rows, i, expression))] = row
    if objective is not None:
        other.objective = Objective(expr=without_calls.of(objective.expr), sense=objective.sense)
    return other, row_of


def _argument_model(level: list[FunctionCall], calls: FunctionCalls) -> tuple[ConcreteModel, dict[int, ConstraintData]]:
    """A model whose rows are the arguments that are no numbers, and from the ids of arguments to rows."""
    other, without_calls = ConcreteModel(name="arguments"), _WithoutCalls(calls)
    other.rows = Constraint(AnySet)
    row_of: dict[int, ConstraintData] = {}
    for call in level:
        for argument in call.arguments:
            if argument.__class__ in native_numeric_types or id(argument) in row_of:
                continue
            expression = without_calls.of(argument)
            if next(variables_in(expression, include_fixed=False), None) is not None:
                # Some bound is needed: a writer leaves out what has none.
                row_of[id(argument)] = new_row(other.rows, len(row_of), expression <= 0.0)
    return other, row_of


class _WithoutCalls:
    """Puts variables in place of the calls in expressions."""

    def __init__(self, calls: FunctionCalls) -> None:
        self._calls, self._replacement = calls, NodeReplacement({})

    def of(self, expression: Any) -> Any:
        """The expression itself where it holds no calls."""
        called = calls_in(expression)
        for node in called:
            stands = self._calls.replacement(node)
            self._replacement.put(node, stands.value if isinstance(stands, ConstantCall) else stands)
        return self._replacement.of(expression) if called else expression


def _points(level: Sequence[FunctionCall], places: _Places, row_of: Callable[[Any], tuple[int, float]]) -> list[Points]:
    """The calls of each function together, with the rows of their arguments."""
    alike: dict[tuple[int, int], list[tuple[FunctionCall, list[tuple[int, float]]]]] = {}
    for call in level:
        arguments = [row_of(argument) for argument in call.arguments]
        alike.setdefault((id(call.function), len(arguments)), []).append((call, arguments))
    found = []
    for several in alike.values():
        function = several[0][0].function
        found.append(
            Points(
                function,
                np.array([[row for row, _ in arguments] for _, arguments in several], dtype=np.intp),
                np.array([[number for _, number in arguments] for _, arguments in several]),
                np.array([[places.output(call, i) for i in range(function.output_count)] for call, _ in several]),
            )
        )
    return found


def _next_row(rows: Iterator[int], argument: Any) -> tuple[int, float]:
    """Row of an argument where all arguments are rows, call by call."""
    return next(rows), 0.0


def _argument(file: FileProgram | None, row_of: Mapping[int, int], argument: Any) -> tuple[int, float]:
    """Row of an argument and what it lacks; -1 and the number itself where it is one."""
    if file is not None and id(argument) in row_of:
        row = row_of[id(argument)]
        # Constants of a row stand in its bounds in the file; it was written as argument <= 0.
        return row, -float(file.nlp.g_upper[row])
    return -1, float(argument if argument.__class__ in native_numeric_types else value(argument))
