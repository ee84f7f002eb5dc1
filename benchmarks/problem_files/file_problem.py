"""`FileProblem`: a problem with complementarity as a file states it, as a model, and as numbers at a point."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pyomo.core.base.constraint import Constraint
from pyomo.core.base.expression import Expression
from pyomo.core.base.objective import Objective, maximize, minimize
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Any as AnySet
from pyomo.core.base.var import Var
from pyomo.core.expr import inequality
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.complementarity import Complementarity, complements
from pyrobocop_pyomo.errors import ContradictionError, ModelError
from pyrobocop_pyomo.modeling.expressions import is_plain_variable
from pyrobocop_pyomo.presentation import Presented

from .arithmetic import EXPRESSIONS, NUMBERS, Arithmetic


class FileRow(NamedTuple):
    """``lower <= body <= upper``."""

    name: str
    lower: float
    body: Any
    upper: float


class FilePair(NamedTuple):
    """``lower <= first <= upper ⟂ second``: nonnegative at the lower bound, nonpositive at the upper, zero between."""

    name: str
    lower: float
    first: Any
    upper: float
    second: Any


class FileStatement(NamedTuple):
    """What a file states, over one kind of number."""

    objective: Any
    rows: list[FileRow]
    pairs: list[FilePair]


class FilePoint(NamedTuple):
    """What a point is worth by the statement of a file.

    Attributes
    ----------
    objective : float
        NaN where it does not exist.
    violation : float
        Largest violation of a row or a bound; infinite where a number does not exist, as that of the objective.
    natural : float
        Largest distance ``|F - mid(l, F - H, u)|`` over the pairs ``l <= F <= u ⟂ H``; of ``0 <= a ⟂ b >= 0`` it is
        ``|min(a, b)|``.
    """

    objective: float
    violation: float
    natural: float


@dataclass(frozen=True, eq=False)
class FileProblem(Presented):
    """A problem with complementarity as a file states it.

    Attributes
    ----------
    name : str
        Of the file, without its suffix.
    variables : tuple of str
        Their names, or ``"0"``, ``"1"``, ... where the file has none.
    lower, upper : list of float
        Their bounds; infinite where there is none.
    start : list of float or None
    maximise : bool
    """

    name: str
    variables: tuple[str, ...]
    lower: list[float]
    upper: list[float]
    start: list[float | None]
    maximise: bool
    evaluate: Callable[[Sequence[Any], Arithmetic], FileStatement]

    def _summary(self) -> str:
        return f"'{self.name}', {len(self.variables)} variables"

    def model(self) -> ConcreteModel:
        """A new model of the problem.

        Returns
        -------
        ConcreteModel
            With the variables ``x``, the ``rows``, the ``pairs``, and the ``objective``; all indexed by the names of
            the file. Expressions that the file uses several times are in ``shared``.

        Raises
        ------
        ContradictionError
            When a row without variables does not hold.
        """
        model = ConcreteModel(name=self.name)
        bounds = {
            name: tuple(bound if math.isfinite(bound) else None for bound in ends)
            for name, *ends in zip(self.variables, self.lower, self.upper, strict=True)
        }
        model.x = Var(self.variables, bounds=bounds)
        for variable, start in zip(model.x.values(), self.start, strict=True):
            variable.set_value(start, skip_validation=True)  # files may start outside of bounds
        model.shared = Expression(AnySet)
        stated = self.evaluate(
            [model.x[name] for name in self.variables],
            Arithmetic(EXPRESSIONS.functions, lambda value: _named(model.shared, value)),
        )
        decided = {pair.name: _decided(pair) for pair in stated.pairs}
        rows = {row.name: _relation(row, self.name) for row in (*stated.rows, *decided.values()) if row is not None}
        pairs = {pair.name: _complements(pair) for pair in stated.pairs if decided[pair.name] is None}
        model.rows = Constraint(AnySet, rule={name: row for name, row in rows.items() if row is not None})
        model.pairs = Complementarity(list(pairs), rule=pairs)
        model.objective = Objective(expr=stated.objective, sense=maximize if self.maximise else minimize)
        return model

    def check(self, values: Sequence[float | None]) -> FilePoint:
        """What a point is worth: from the statement of the file, by nothing that solves or transforms it.

        Parameters
        ----------
        values : sequence of float or None
            Of the variables, in the order of the file; None is where no row asks for one.

        Raises
        ------
        ModelError
            When there are not as many values as variables.
        """
        if len(values) != len(self.variables):
            raise ModelError(f"'{self.name}': {len(values)} values for {len(self.variables)} variables.")
        point = [math.nan if value is None else float(value) for value in values]
        stated = self.evaluate(point, NUMBERS)
        ends = zip(self.lower, values, self.upper, strict=True)
        violations = [_outside(lower, float(x), upper) for lower, x, upper in ends if x is not None]
        violations += [_outside(row.lower, row.body, row.upper) for row in stated.rows]
        violations.append(math.inf if math.isnan(stated.objective) else 0.0)
        return FilePoint(float(stated.objective), max(violations), max(map(_natural, stated.pairs), default=0.0))


def _named(shared: Any, value: Any) -> Any:
    if value.__class__ in native_numeric_types or not (value.is_expression_type() and value.is_numeric_type()):
        return value  # a number, a variable, a comparison
    index = len(shared)
    shared[index] = value
    return shared[index]


def _relation(row: FileRow, problem: str) -> Any:
    """The row as a constraint takes it; None where it says nothing."""
    is_number = row.body.__class__ in native_numeric_types
    if (row.lower == row.upper and math.isinf(row.lower)) or (
        is_number and _outside(row.lower, row.body, row.upper) > 0
    ):
        what = f"{row.body:g}, which holds no variable," if is_number else "what it bounds"
        raise ContradictionError(
            f"'{problem}': in '{row.name}' {what} is not between {row.lower:g} and {row.upper:g}. Nothing can satisfy "
            "it; correct the file."
        )
    if is_number:
        return None
    if row.lower == row.upper:
        return row.body == row.lower
    lower, upper = (bound if math.isfinite(bound) else None for bound in (row.lower, row.upper))
    return None if lower is upper is None else (lower, row.body, upper)


def _decided(pair: FilePair) -> FileRow | None:
    """What is left of a pair of which one side is a number; None where none is."""
    name, lower, first, upper, second = pair
    if second.__class__ in native_numeric_types:
        return FileRow(name, upper if second < 0 else lower, first, lower if second > 0 else upper)
    if first.__class__ not in native_numeric_types:
        return None
    if not lower <= first <= upper:
        return FileRow(name, lower, first, upper)
    return FileRow(name, -math.inf if first == upper else 0.0, second, math.inf if first == lower else 0.0)


def _complements(pair: FilePair) -> Any:
    if math.isinf(pair.upper):
        return complements(pair.first >= pair.lower, pair.second >= 0)
    if math.isinf(pair.lower):
        return complements(pair.first <= pair.upper, pair.second <= 0)
    free = "free" if is_plain_variable(pair.second) else None  # bounds of its own are no part of the pair
    return complements(inequality(pair.lower, pair.first, pair.upper), pair.second, second_bound=free)


def _outside(lower: float, number: float, upper: float) -> float:
    return math.inf if math.isnan(number) else max(lower - number, number - upper, 0.0)


def _natural(pair: FilePair) -> float:
    moved = pair.first - pair.second
    return math.inf if math.isnan(moved) else abs(pair.first - min(max(moved, pair.lower), pair.upper))
