"""`sensitivity`: how a solution and its objective move with the data of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import pairs_of
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.mpcc.sensitivity import derivatives
from pyrobocop_pyomo.mpcc.wrapped_programs import WithBounds
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray
from pyrobocop_pyomo.solving.iterate_log import ModelCheck
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.solve_result import SolveResult

from .named_data import by_component, data_members, named
from .parametric_model import ParametricBuilder, ParametricModel


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of a solution with respect to parameters.

    Attributes
    ----------
    parameters : list of ParamData or VarData
    variables : list of VarData
        Those that the model uses.
    parameter_values : array, shape (parameters,)
    variable_values : array, shape (variables,)
        The solution, refined by Newton's method.
    matrix : array, shape (variables, parameters)
        Derivatives of the variables.
    objective_gradient : array, shape (parameters,)
        Derivatives of the user's objective, in its own sense.
    constraints : list of str
        Names of the active constraints: rows, bounds, and the sides that are zero.
    multipliers : array, shape (constraints,)
        Of the active constraints ``g = 0``, in the Lagrangian ``f + multipliers @ g`` of the minimised problem; the
        negatives of the multipliers in `PairReport`.
    multiplier_derivatives : array, shape (constraints, parameters)
    """

    parameters: list[Any]
    variables: list[Any]
    parameter_values: FloatArray = field(repr=False)
    variable_values: FloatArray = field(repr=False)
    matrix: FloatArray = field(repr=False)
    objective_gradient: FloatArray = field(repr=False)
    constraints: list[str] = field(repr=False)
    multipliers: FloatArray = field(repr=False)
    multiplier_derivatives: FloatArray = field(repr=False)

    @cached_property
    def _rows(self) -> ComponentMap:
        return ComponentMap((each, i) for i, each in enumerate(self.variables))

    @cached_property
    def _columns(self) -> ComponentMap:
        return ComponentMap((each, i) for i, each in enumerate(self.parameters))

    def derivative(self, variable: Any, parameter: Any) -> float:
        """Derivative of a variable with respect to a parameter.

        Raises
        ------
        ModelError
            If one of them is not in the problem.
        """
        return float(self.matrix[_place(self._rows, variable), _place(self._columns, parameter)])

    def objective_derivative(self, parameter: Any) -> float:
        """Derivative of the objective with respect to a parameter.

        Raises
        ------
        ModelError
            If it was not asked for.
        """
        return float(self.objective_gradient[_place(self._columns, parameter)])

    def predict(self, values: Mapping[Any, float] | Iterable[tuple[Any, float]]) -> ComponentMap:
        """Predict the variables for other data, to first order and while the same constraints are active.

        Parameters
        ----------
        values : mapping or iterable
            The new values: ``{"p": 1.5}`` by name, or pairs ``[(m.p, 1.5)]``. A parameter that is left out keeps
            its own.

        Returns
        -------
        ComponentMap from variable to float
        """
        change = np.zeros(len(self.parameters))
        for parameter, number in by_component(values, self.parameters[0].model()):
            column = _place(self._columns, parameter)
            change[column] = number - self.parameter_values[column]
        moved = self.variable_values + self.matrix @ change
        return ComponentMap(zip(self.variables, moved.tolist(), strict=True))

    def to_pandas(self) -> Any:
        """A data frame with a row per variable, the objective first, and a column per parameter."""
        return pandas.DataFrame(
            np.vstack([self.objective_gradient, self.matrix]),
            index=pandas.Index(["objective", *(each.name for each in self.variables)], name="derivative of"),
            columns=[each.name for each in self.parameters],
        )

    def __str__(self) -> str:
        lines = [f"{'parameter':<24} {'d objective':>14} {'largest move':>14}  of"]
        for k, parameter in enumerate(self.parameters):
            row = int(np.abs(self.matrix[:, k]).argmax())
            lines.append(
                f"{parameter.name:<24} {self.objective_gradient[k]:>14.6g} {self.matrix[row, k]:>14.6g}  "
                f"{self.variables[row].name}"
            )
        return "\n".join(lines)


def sensitivity(model: Any, result: SolveResult, parameters: Any, *, derivatives_by: str | None = None) -> Sensitivity:
    """Differentiate a solution with respect to mutable Params.

    The solution is continued on its branch: sides that are zero stay zero, active constraints stay active. That
    holds for small changes where each pair has one positive side and each active inequality a positive multiplier,
    which is checked. The model is only read.

    Parameters
    ----------
    model : Block
        With the values that `solve` left on it.
    result : SolveResult
        Of that solve.
    parameters : Param, fixed Var, str or list
        What to differentiate for, or names of it. Indexed ones stand for all their members.
    derivatives_by : {"asl", "casadi"}, optional
        Where derivatives come from; by default ASL where it is present.

    Returns
    -------
    Sensitivity

    Raises
    ------
    SensitivityError
        At biactive pairs; where an inequality is active without a multiplier; where active constraints are dependent
        or the solution is not unique. The message names them.
    ModelError
        If a parameter is not mutable or used nowhere, a relaxation is applied, or the model does not hold the point
        of the result.

    References
    ----------
    Scheel & Scholtes (2000), Mathematical programs with complementarity constraints: stationarity, optimality, and
    sensitivity, doi:10.1287/moor.25.1.1.15213;
    Pirnay, Lopez-Negrete & Biegler (2012), Optimal sensitivity based on IPOPT, doi:10.1007/s12532-012-0043-2
    """
    chosen = _members(model, parameters)
    _check(model, result)
    built = ParametricBuilder(model, chosen).build()
    written = CompiledModel(built.model, derivatives_by)
    place = {id(each): i for i, each in enumerate(written.variables)}
    columns = np.array([place.get(id(each), -1) for each in built.stand_ins], dtype=np.intp)
    in_use = np.flatnonzero(columns >= 0)
    found = derivatives(
        _with_moving_bounds(written, built),
        written.current_point(),
        columns[in_use],
        lambda number: _name(written, built, number),
    )
    stand_ins = set(columns[in_use].tolist())
    kept = [i for i in range(written.nlp.n) if i not in stand_ins]
    k = len(chosen)
    matrix, objective = np.zeros((len(kept), k)), np.zeros(k)
    moved = np.zeros((found.active.size, k))
    # Adding zero turns the zero of negative sign into the plain one.
    matrix[:, in_use] = found.variables[kept] + 0.0
    objective[in_use] = written.sign * found.objective + 0.0
    moved[:, in_use] = found.multiplier_derivatives + 0.0
    names = [_name(written, built, number) for number in found.active.tolist()]
    return Sensitivity(
        chosen,
        [written.variables[i] for i in kept],
        np.array([value(each) for each in chosen], dtype=float),
        found.x[kept],
        matrix,
        objective,
        names,
        found.multipliers,
        moved,
    )


def _members(model: Any, parameters: Any) -> list[Any]:
    """The single parameters, each once."""
    several = parameters if isinstance(parameters, (list, tuple)) else [parameters]
    found = {id(member): member for each in several for member in data_members(named(each, model))}
    if not found:
        raise ModelError("no parameters were given; name at least one mutable Param or fixed Var.")
    for member in found.values():
        if value(member, exception=False) is None:
            raise ModelError(f"'{member.name}': has no value.")
    return list(found.values())


def _check(model: Any, result: SolveResult) -> None:
    if any(not pair.source.active for pair in pairs_of(model)):
        raise ModelError(
            f"'{model.name}': a relaxation is applied, and a relaxed solution is on no branch. Revert it, solve again."
        )
    if result.quality is Quality.INFEASIBLE:
        raise ModelError(f"'{result.name}': {result.quality.value} There is no solution to differentiate.")
    objective = ModelCheck(model).objective()
    if not abs(objective - result.objective) <= 1e-8 * max(1.0, abs(objective)):
        raise ModelError(
            f"'{model.name}': has the objective {objective:.10g} where the result has {result.objective:.10g}: values "
            "or data were changed since. Solve again."
        )


def _with_moving_bounds(written: CompiledModel, built: ParametricModel) -> WithBounds:
    """The program without the bounds that are rows; bounds of domains stay."""
    lower, upper = written.nlp.x_lower.copy(), written.nlp.x_upper.copy()
    place = {id(each): i for i, each in enumerate(written.variables)}
    for variable, which in built.moving_bounds:
        ends = variable.domain.bounds()
        if which == "lower":
            lower[place[id(variable)]] = -np.inf if ends[0] is None else ends[0]
        else:
            upper[place[id(variable)]] = np.inf if ends[1] is None else ends[1]
    return WithBounds(written.nlp, lower, upper)


def _name(written: CompiledModel, built: ParametricModel, number: int) -> str:
    if number < written.nlp.m:
        return built.names[id(written.constraints[number])]
    return f"a bound of '{written.variables[number - written.nlp.m].name}'"


def _place(places: ComponentMap, component: Any) -> int:
    place = places.get(component)
    if place is None:
        raise ModelError(
            f"'{component.name}': is not among the {len(places)} components of this sensitivity. Variables have to be "
            "free and used by the model, parameters have to be asked for."
        )
    return int(place)
