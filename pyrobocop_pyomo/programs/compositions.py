"""A model that calls Python functions as a program: expressions compiled, functions around them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import NamedTuple

import numpy as np
from pyomo.core.base.constraint import ConstraintData
from pyomo.core.base.var import VarData

from .composed_program import ComposedProgram, Level, Points
from .function_calls import FunctionCall
from .model_terms import ModelTerms
from .vectorised_program import VectorisedProgram


class Composition(NamedTuple):
    """A program with what its variables and rows are in the user's model."""

    nlp: VectorisedProgram | ComposedProgram
    variables: list[VarData]
    constraints: list[ConstraintData]


def vectorised_composition(terms: ModelTerms) -> Composition:
    """The program of a model whose expressions are evaluated by vectorised functions."""
    main = VectorisedProgram(terms)
    if not terms.calls.calls:
        return Composition(main, terms.variables, terms.constraints)
    outputs = [variable for call in terms.calls.calls for variable in call.outputs.values()]
    y_of = {id(variable): place for place, variable in enumerate(outputs)}
    x = [variable for variable in terms.variables if id(variable) not in y_of]
    place_of = {id(variable): place for place, variable in enumerate([*x, *outputs])}
    columns = np.array([place_of[id(variable)] for variable in terms.variables], dtype=np.intp)
    levels = [
        Level(arguments, _points(calls, y_of))
        for calls, arguments in zip(terms.calls.levels, main.arguments, strict=True)
    ]
    nlp = ComposedProgram(main, columns, len(x), levels, len(outputs))
    return Composition(nlp, x, terms.constraints)


def _points(level: Sequence[FunctionCall], y_of: dict[int, int]) -> list[Points]:
    """The calls of each function together, with the rows of their arguments, which are in the order of the calls."""
    row = count()
    alike: dict[tuple[int, int], list[tuple[FunctionCall, list[int]]]] = {}
    for call in level:
        rows = [next(row) for _ in call.arguments]
        alike.setdefault((id(call.function), len(rows)), []).append((call, rows))
    found = []
    for several in alike.values():
        function = several[0][0].function
        outputs = [
            [y_of[id(call.outputs[i])] if i in call.outputs else -1 for i in range(function.output_count)]
            for call, _ in several
        ]
        found.append(Points(function, np.array([rows for _, rows in several], dtype=np.intp), np.array(outputs)))
    return found
