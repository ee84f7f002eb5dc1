"""The numbers of a model that may change between solves, read again without another walk."""

from __future__ import annotations

import math
from operator import attrgetter, is_not
from typing import Any

import numpy as np
from pyomo.common.errors import InfeasibleConstraintException
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.repn.plugins.nl_writer import TOL

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule

from .model_checks import number_in
from .model_terms import ModelTerms
from .nonlinear_program import FloatArray
from .row_values import KNOWN_BOUNDS, BoundArrays

# Attributes of Pyomo's data objects behind its properties: reading ten thousand properties takes ten milliseconds.
_DOMAIN, _FIXED, _ACTIVE, _EXPRESSION = map(attrgetter, ("_domain", "_fixed", "_active", "_expr"))
_VALUE = attrgetter("value")


def _expression_of(row: Any) -> Any:
    """What tells whether a row was set to another expression: of one that follows a rule, whether it still does."""
    return RowByRule if row.__class__ is RowByRule else _EXPRESSION(row)


class ModelNumbers:
    """Bounds, values of parameters, and whether the model's structure is still the one that was walked over.

    Parameters
    ----------
    terms : ModelTerms
        What the walk found.

    Attributes
    ----------
    x_lower, x_upper, g_lower, g_upper : float arrays
        Bounds of variables and rows, infinite where there is none.
    parameters : float array
        Values of the parameters.
    """

    def __init__(self, terms: ModelTerms) -> None:
        self._terms = terms
        self._variables, self._constraints = terms.variables, terms.constraints
        self._fixed_variables = [known for known in terms.columns.parameters if known.is_variable_type()]
        self._structure = self._read_structure()
        self._bounds = BoundArrays(self._variables)
        self.x_lower, self.x_upper = self._bounds.lower, self._bounds.upper
        self.g_lower, lower = _row_bounds([lower for lower, _ in terms.bounds], -math.inf)
        self.g_upper, upper = _row_bounds([upper for _, upper in terms.bounds], math.inf)
        for undefined in np.flatnonzero(np.isnan(self.g_lower) | np.isnan(self.g_upper)):
            raise ModelError(f"'{self._constraints[undefined].name}': a bound of it is nan; give it a number.")
        self._changing_rows = [(self.g_lower, i, e, -math.inf) for i, e in lower]
        self._changing_rows += [(self.g_upper, i, e, math.inf) for i, e in upper]
        self.parameters = np.empty(len(terms.columns.parameters))
        self._read_numbers()

    def refresh(self) -> None:
        """Read everything again.

        Raises
        ------
        ModelError
            When variables were fixed or unfixed or got other domains, rows or named expressions got other expressions,
            rows were added, deleted, replaced, activated or deactivated, or the objective got another sense.
        InfeasibleConstraintException
            When a row without free variables contradicts itself.
        """
        structure = self._read_structure()
        if len(structure) != len(self._structure) or any(map(is_not, structure, self._structure)):
            raise ModelError(
                f"'{self._terms.model.name}': rows, objectives, named expressions, domains, or what is fixed or active "
                "have changed since it was prepared. Prepare it again."
            )
        self._bounds.read()
        self._read_numbers()

    def values_of_variables(self) -> FloatArray:
        """Current values of the variables, 0 where one has none."""
        numbers = list(map(_VALUE, self._variables))
        if None in numbers:
            numbers = [0.0 if number is None else number for number in numbers]
        return np.array(numbers, dtype=float)

    def index_of_parameter(self, data: Any) -> int | None:
        """Where a fixed variable or a mutable Param stands in `parameters`; None for one that is not read."""
        known = self._terms.columns.parameters
        return next((i for i, parameter in enumerate(known) if parameter is data), None)

    def _read_numbers(self) -> None:
        known: dict[int, float] = {}  # one parameter often bounds many rows
        for bounds, i, expression, unbounded in self._changing_rows:
            bound = known.get(id(expression))
            if bound is None:
                bound = known[id(expression)] = number_in(expression, self._constraints[i].name)
            if math.isnan(bound) or bound == -unbounded:
                raise ModelError(f"'{self._constraints[i].name}': a bound of it is {bound}; give it a number.")
            bounds[i] = bound
        values = list(map(_VALUE, self._terms.columns.parameters))
        if None in values:
            missing = self._terms.columns.parameters[values.index(None)]
            raise ModelError(f"'{missing.name}' is fixed without a value. Give it one.")
        self.parameters[:] = values
        for constraint in self._terms.constant_constraints:
            check_constant(constraint)

    def _read_structure(self) -> list[Any]:
        """Objects that stay the same ones as long as nothing but numbers changes."""
        terms, rows = self._terms, _rows_of(self._terms.model)
        collected = terms.rows, terms.cost
        return [
            *map(_FIXED, [*self._variables, *self._fixed_variables]),
            *map(_DOMAIN, self._variables),
            *map(_expression_of, self._constraints),
            *rows,
            *map(_ACTIVE, rows),
            None if terms.objective is None else terms.objective.is_minimizing(),
            *(named.args[0] for terms in collected for named in terms.named_expressions.values()),
        ]


def _row_bounds(bounds: list[Any], unbounded: float) -> tuple[FloatArray, list[tuple[int, Any]]]:
    """Bounds as an array, and those that are expressions with their places."""
    changing = [(i, bound) for i, bound in enumerate(bounds) if bound.__class__ not in KNOWN_BOUNDS]
    numbers = [unbounded if bound is None else bound for bound in bounds]
    for i, _ in changing:
        numbers[i] = 0.0
    return np.array(numbers, dtype=float), changing


def _rows_of(model: Any) -> list[Any]:
    """The rows and objectives of all active components."""
    components = model.component_objects((Constraint, Objective), active=True, descend_into=True)
    return [data for component in components for data in component._data.values()]


def check_constant(constraint: Any) -> None:
    """Check a row without free variables.

    Raises
    ------
    InfeasibleConstraintException
        When its numbers contradict it.
    """
    lowest, body, highest = constraint.to_bounded_expression()
    lower = -math.inf if lowest is None else number_in(lowest, constraint.name)
    upper = math.inf if highest is None else number_in(highest, constraint.name)
    number = number_in(body, constraint.name)
    if lower - number > TOL or number - upper > TOL:
        raise InfeasibleConstraintException(
            f"model contains a trivially infeasible constraint '{constraint.name}' (fixed body value {number} "
            f"outside bounds [{lower}, {upper}])."
        )
