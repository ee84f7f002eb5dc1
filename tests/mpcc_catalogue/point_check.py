"""An independent reading of pairs and points: shares no code with the package, and takes no solver's word."""

import math
from dataclasses import dataclass
from typing import Any

import pyomo.environ as pyo
from pyomo.core.expr import EqualityExpression
from pyomo.core.expr.relational_expr import RelationalExpression
from pyomo.mpec import Complementarity as MpecComplementarity

from pyrobocop_pyomo.complementarity import Complementarity

Range = tuple[float, Any, float]
"""(lower, expression, upper): the expression lies between the numbers."""


@dataclass(frozen=True, eq=False)
class ReadPair:
    """``lower <= first <= upper ⟂ second``, as numbers and expressions; `second` is free in sign between the bounds.

    The one-sided ``0 <= a ⟂ b >= 0`` is the range from 0 to infinity, where `second` has to be nonnegative. In one of
    any sign, `second` is zero where `first` is above its lower bound, and anything where it is not.
    """

    name: str
    lower: float
    first: Any
    upper: float
    second: Any
    one_sided: bool
    any_sign: bool = False

    def hull(self) -> list[Range]:
        """What holds in every branch."""
        rows: list[Range] = [(self.lower, self.first, self.upper)]
        if self.any_sign:
            return rows
        if self.lower == -math.inf and self.upper < math.inf:
            rows.append((-math.inf, self.second, 0.0))
        elif self.one_sided or self.upper == math.inf:
            rows.append((0.0, self.second, math.inf))
        return rows

    def branches(self) -> list[list[Range]]:
        """What holds in addition in each branch; one of them is true at every feasible point."""
        if self.lower == self.upper:
            return [[]]
        if self.any_sign:
            return [[(self.lower, self.first, self.lower)], [(0.0, self.second, 0.0)]]
        found: list[list[Range]] = []
        if self.lower > -math.inf:
            found.append([(self.lower, self.first, self.lower), (0.0, self.second, math.inf)])
        if self.upper < math.inf and not self.one_sided:
            found.append([(self.upper, self.first, self.upper), (-math.inf, self.second, 0.0)])
        return [*found, [(0.0, self.second, 0.0)]]

    def natural(self) -> float:
        """Distance of the first side from its projection ``mid(lower, first - second, upper)``."""
        first, second = pyo.value(self.first), pyo.value(self.second)
        if self.any_sign:
            return max(min(abs(first - self.lower), abs(second)), self.lower - first, first - self.upper)
        if self.one_sided:
            return abs(min(first - self.lower, second)) + max(0.0, first - self.upper)
        return abs(first - min(max(first - second, self.lower), self.upper))

    def product(self) -> float:
        """Largest product of a distance from a bound with the part of the second side that belongs to it."""
        first, second = pyo.value(self.first), pyo.value(self.second)
        if self.lower == self.upper:
            return 0.0
        if self.any_sign:
            return abs((first - self.lower) * second)
        low = abs((first - self.lower) * max(second, 0.0)) if self.lower > -math.inf else 0.0
        high = abs((self.upper - first) * min(second, 0.0)) if self.upper < math.inf and not self.one_sided else 0.0
        return max(low, high)


def read_pairs(model: Any) -> list[ReadPair]:
    """All active pairs of a model."""
    return [
        _read(data)
        for kind in (Complementarity, MpecComplementarity)
        for data in model.component_data_objects(kind, active=True, descend_into=(pyo.Block,))
    ]


def _read(data: Any) -> ReadPair:
    if data.ctype is Complementarity and data.bounds[1] == "any sign":
        (lower, first, upper), (_, second, _) = _side(data.args[0], data.bounds[0]), _side(data.args[1], None)
        if not math.isfinite(lower):
            lower, first, upper = -upper, -first, -lower
        return ReadPair(data.name, lower, first, upper, second, one_sided=True, any_sign=True)
    if data.ctype is Complementarity:
        sides = [_side(*pair) for pair in zip(data.args, data.bounds, strict=True)]
    else:
        sides = [_side(side, None) for side in data._args]
    sides.sort(key=lambda side: -sum(map(math.isfinite, (side[0], side[2]))))
    (lower, first, upper), (other_lower, second, other_upper) = sides
    finite = sum(map(math.isfinite, (other_lower, other_upper)))
    if finite == 0:
        return ReadPair(data.name, lower, first, upper, second, one_sided=False)
    assert finite == 1, f"{data.name}: two ranges"
    nonnegative = second - other_lower if math.isfinite(other_lower) else other_upper - second
    if math.isfinite(lower) and not math.isfinite(upper):
        return ReadPair(data.name, lower, first, upper, nonnegative, one_sided=True)
    if math.isfinite(upper) and not math.isfinite(lower):
        return ReadPair(data.name, 0.0, upper - first, math.inf, nonnegative, one_sided=True)
    if math.isfinite(other_lower):  # l <= F <= u against H >= 0: the lower bound is meant
        return ReadPair(data.name, lower, first, upper, nonnegative, one_sided=True)
    return ReadPair(data.name, -upper, -first, -lower, nonnegative, one_sided=True)


def _side(side: Any, choice: str | None) -> tuple[float, Any, float]:
    if getattr(side, "is_variable_type", bool)():
        low, high = side.lb, side.ub
        body = side
        if choice == "free":
            low = high = None
        elif choice is not None:
            low, high = (low, None) if choice == "lower" else (None, high)
    elif isinstance(side, RelationalExpression):
        low, body, high = _relation(list(side.args), isinstance(side, EqualityExpression))
    else:
        low, body, high = None, side, None
    low, high = (None if bound is None else pyo.value(bound) for bound in (low, high))
    return (-math.inf if low is None else low, body, math.inf if high is None else high)


def _relation(args: list[Any], equation: bool) -> tuple[Any, Any, Any]:
    if len(args) == 3:
        return args[0], args[1], args[2]
    left, right = args
    # By structure, not by what is fixed at the moment.
    if not getattr(left, "is_potentially_variable", bool)():
        return left, right, left if equation else None
    if not getattr(right, "is_potentially_variable", bool)():
        return right if equation else None, left, right
    return 0 if equation else None, left - right, 0


@dataclass(frozen=True)
class Point:
    """What is true of the values on a model.

    Attributes
    ----------
    objective : float
    violation : float
        Largest violation of a constraint, bound or side.
    product, natural : float
        Largest over the pairs.
    """

    objective: float
    violation: float
    product: float
    natural: float

    def as_good_as(self, best: float, maximise: bool, tolerance: float = 1e-4) -> bool:
        """Whether the objective is at least as good as `best`, relative to its size."""
        gap = best - self.objective if maximise else self.objective - best
        return gap <= tolerance * max(1.0, abs(best))


class PointCheck:
    """Remembers the statement of a model, so that what a method adds to the model does not count.

    Parameters
    ----------
    model : ConcreteModel
        Before any method has touched it.
    """

    def __init__(self, model: Any) -> None:
        self.pairs = read_pairs(model)
        self.maximise = maximises(model)
        objectives = model.component_data_objects(pyo.Objective, active=True)
        self._objective = next((objective.expr for objective in objectives), 0.0)
        self._ranges = [(row.lb, row.body, row.ub) for row in model.component_data_objects(pyo.Constraint, active=True)]
        self._ranges += [(v.lb, v, v.ub) for v in model.component_data_objects(pyo.Var)]
        self._ranges += [piece for pair in self.pairs for piece in pair.hull()]

    def point(self) -> Point:
        """Evaluate the point on the model; a value that is not finite makes it infinitely bad."""
        try:
            worst = [_outside(low, _number(body), high) for low, body, high in self._ranges]
            numbers = [_number(self._objective), max(worst, default=0.0)]
            numbers.append(max((pair.product() for pair in self.pairs), default=0.0))
            numbers.append(max((pair.natural() for pair in self.pairs), default=0.0))
        except (ValueError, ZeroDivisionError, OverflowError, TypeError):
            return Point(math.inf, math.inf, math.inf, math.inf)
        if not all(map(math.isfinite, [*numbers, *worst])):
            return Point(math.inf, math.inf, math.inf, math.inf)
        return Point(*map(float, numbers))


def check_point(model: Any) -> Point:
    """Evaluate the point on a model that no method has touched."""
    return PointCheck(model).point()


def _number(expression: Any) -> float:
    if getattr(expression, "is_variable_type", bool)() and expression.value is None:
        return 0.0  # a variable without a value is in no row and no cost: the solvers leave it out
    return float(pyo.value(expression))


def _outside(low: float | None, number: float, high: float | None) -> float:
    below = -math.inf if low is None else low - number
    above = -math.inf if high is None else number - high
    if math.isnan(number):
        return math.inf
    return max(below, above, 0.0)


def maximises(model: Any) -> bool:
    """Whether the model's objective is to be maximised."""
    objectives = list(model.component_data_objects(pyo.Objective, active=True))
    return bool(objectives) and objectives[0].sense == pyo.maximize
