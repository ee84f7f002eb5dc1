"""`sensitivity`: how a solution and its objective move with the data of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.objective import Objective
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import (
    CanonicalForm,
    SidePart,
    active_sources,
    canonical_form,
    pairs_of,
    side_values,
    sides_at_zero,
)
from pyrobocop_pyomo.diagnosis.findings import quoted
from pyrobocop_pyomo.errors import EvaluationError, ModelError
from pyrobocop_pyomo.modeling.pyomo_internals import stored_bounds
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray
from pyrobocop_pyomo.programs.wrapped_programs import WrappedProgram
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.model_check import ModelCheck
from pyrobocop_pyomo.solving.solve_result import SolveResult
from pyrobocop_pyomo.studies.sweep_cases import by_component, fixed_members, named, unread_members

from .derivatives import derivatives


@dataclass(frozen=True, eq=False)
class Sensitivity(Presented):
    """Derivatives of a solution with respect to parameters.

    Attributes
    ----------
    result : SolveResult
        The solution that was differentiated.
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
    """

    result: SolveResult = field(repr=False)
    parameters: list[Any]
    variables: list[Any]
    parameter_values: FloatArray = field(repr=False)
    variable_values: FloatArray = field(repr=False)
    matrix: FloatArray = field(repr=False)
    objective_gradient: FloatArray = field(repr=False)
    constraints: list[str] = field(repr=False)

    def derivative(self, variable: Any, parameter: Any) -> float:
        """Derivative of a variable with respect to a parameter.

        Raises
        ------
        ModelError
            If one of them is not in the problem.
        """
        return float(self.matrix[_place(self.variables, variable), _place(self.parameters, parameter)])

    def objective_derivative(self, parameter: Any) -> float:
        """Derivative of the objective with respect to a parameter.

        Raises
        ------
        ModelError
            If it was not asked for.
        """
        return float(self.objective_gradient[_place(self.parameters, parameter)])

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
            column = _place(self.parameters, parameter)
            change[column] = number - self.parameter_values[column]
        moved = self.variable_values + self.matrix @ change
        return ComponentMap(zip(self.variables, moved.tolist(), strict=True))

    def __str__(self) -> str:
        lines = [f"{'parameter':<24} {'d objective':>14} {'largest move':>14}  of"]
        for k, parameter in enumerate(self.parameters):
            row = int(np.abs(self.matrix[:, k]).argmax())
            lines.append(
                f"{parameter.name:<24} {self.objective_gradient[k]:>14.6g} {self.matrix[row, k]:>14.6g}  "
                f"{self.variables[row].name}"
            )
        return "\n".join(lines)


def sensitivity(model: Any, result: SolveResult, parameters: Any) -> Sensitivity:
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

    Returns
    -------
    Sensitivity

    Raises
    ------
    EvaluationError
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
    parametric = ParametricModel(model, chosen)
    compiled = CompiledModel(parametric.model, is_view=True)
    place = {id(variable): i for i, variable in enumerate(compiled.variables)}
    columns = np.array([place.get(id(variable), -1) for variable in parametric.parameter_variables], dtype=np.intp)
    in_use = np.flatnonzero(columns >= 0)
    slopes = derivatives(
        _with_moving_bounds(compiled, parametric),
        compiled.current_point(),
        columns[in_use],
        lambda number: _name(compiled, parametric, number),
    )
    # What stands for calls of Python functions is on no model, and is not told of.
    parts, m = [*compiled.constraints, *compiled.variables], compiled.nlp.m
    own = set(compiled.of_model(parts, np.arange(len(parts)))[1].tolist())
    of_parameters = set(columns[in_use].tolist())
    of_variables = [i for i in range(compiled.nlp.n) if m + i in own and i not in of_parameters]
    k = len(chosen)
    matrix, objective = np.zeros((len(of_variables), k)), np.zeros(k)
    # Adding zero turns the zero of negative sign into the plain one.
    matrix[:, in_use] = slopes.variables[of_variables] + 0.0
    objective[in_use] = compiled.sign * slopes.objective + 0.0
    names = [_name(compiled, parametric, number) for number in slopes.active.tolist() if number in own]
    return Sensitivity(
        result,
        chosen,
        [compiled.variables[i] for i in of_variables],
        np.array([value(parameter) for parameter in chosen], dtype=float),
        slopes.x[of_variables],
        matrix,
        objective,
        names,
    )


def _members(model: Any, parameters: Any) -> list[Any]:
    """The single parameters, each once."""
    several = parameters if isinstance(parameters, (list, tuple)) else [parameters]
    members = {id(member): member for component in several for member in fixed_members(named(component, model))}
    if not members:
        raise ModelError("no parameters were given; name at least one mutable Param or fixed Var.")
    for member in members.values():
        if value(member, exception=False) is None:
            raise ModelError(f"'{member.name}': has no value.")
    return list(members.values())


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


def _with_moving_bounds(compiled: CompiledModel, parametric: ParametricModel) -> WrappedProgram:
    """The program without the bounds that are rows; bounds of domains stay."""
    lower, upper = compiled.nlp.x_lower.copy(), compiled.nlp.x_upper.copy()
    place = {id(variable): i for i, variable in enumerate(compiled.variables)}
    for variable, which in parametric.moving_bounds:
        ends = variable.domain.bounds()
        if which == "lower":
            lower[place[id(variable)]] = -np.inf if ends[0] is None else ends[0]
        else:
            upper[place[id(variable)]] = np.inf if ends[1] is None else ends[1]
    return WrappedProgram(compiled.nlp, lower, upper)


def _name(compiled: CompiledModel, parametric: ParametricModel, number: int) -> str:
    if number < compiled.nlp.m:
        row = compiled.constraints[number]
        return parametric.names.get(id(row), row.name)
    return f"a bound of '{compiled.variables[number - compiled.nlp.m].name}'"


def _place(components: Sequence[Any], wanted: Any) -> int:
    for place, component in enumerate(components):
        if component is wanted:
            return place
    raise ModelError(
        f"'{wanted.name}': is not among the {len(components)} components of this sensitivity. Variables have to be "
        "free and used by the model, parameters have to be asked for."
    )


class ParametricModel:
    """The branch of a solution, as rows over the user's variables and over variables that stand for parameters.

    Parameters
    ----------
    source : Block
        At a solution. It is only read.
    parameters : sequence of ParamData or fixed VarData

    Attributes
    ----------
    model : ConcreteModel
    parameter_variables : list of VarData
        One per parameter, with its value.
    names : dict from id of a row to str
        What each row says, for messages.
    moving_bounds : list of (VarData, "lower" or "upper")
        Bounds of variables that hold a parameter: they are rows here.

    Raises
    ------
    EvaluationError
        At biactive pairs, and at pairs that are not met.
    ModelError
        If a parameter is used nowhere in the active model.
    """

    def __init__(self, source: Any, parameters: Sequence[Any]) -> None:
        self._source = source
        self.model = ConcreteModel()
        self.model.parameter_variable = Var(range(len(parameters)))
        self.model.rows = ConstraintList()
        self.parameter_variables = list(self.model.parameter_variable.values())
        for parameter_variable, parameter in zip(self.parameter_variables, parameters, strict=True):
            parameter_variable.set_value(value(parameter))
        replaced = zip(map(id, parameters), self.parameter_variables, strict=True)
        self._substituted = NodeReplacement(dict(replaced)).of
        self.names: dict[int, str] = {}
        self.moving_bounds: list[tuple[Any, str]] = []
        for objective in source.component_data_objects(Objective, active=True):
            self.model.cost = Objective(expr=self._substituted(objective.expr), sense=objective.sense)
        for row in source.component_data_objects(Constraint, active=True):
            self._add_row(row, f"'{row.name}'")
        self._add_pairs([canonical_form(stated) for stated in active_sources(source)])
        self._add_moving_bounds()
        unused = [parameter.name for parameter in unread_members(source, parameters)]
        if unused:
            raise ModelError(
                f"'{source.name}': {quoted(unused)} is used in no active constraint, objective, bound or pair, "
                "so nothing depends on it. A number that was read with value() when the model was built leaves no "
                "trace: put the Param itself into the expressions."
            )

    def _add(self, relation: Any, name: str) -> None:
        self.names[id(self.model.rows.add(relation))] = name

    def _add_row(self, row: Any, name: str) -> None:
        lower, body, upper = map(self._substituted, row.to_bounded_expression())
        least, _, most = row.to_bounded_expression(evaluate_bounds=True)  # None where there is none, or it is infinite
        if row.equality:
            self._add(body - lower == 0, name)
            return
        # Two rows for a range: its ends may move apart.
        if least is not None:
            self._add(body - lower >= 0, f"the lower bound of {name}")
        if most is not None:
            self._add(body - upper <= 0, f"the upper bound of {name}")

    def _add_pairs(self, forms: Sequence[CanonicalForm]) -> None:
        pairs = [pair for form in forms for pair in form.pairs]
        biactive = [pair.name for pair in pairs if max(side_values(pair)) <= MET]
        if biactive:
            raise EvaluationError(
                f"'{self._source.name}': {len(biactive)} pairs are biactive (both sides zero): {quoted(biactive)}. "
                "The solution has a kink there. Move the data so that one side is positive."
            )
        for form in forms:
            for number, relation in enumerate(form.rows):
                row = Constraint(expr=relation)
                row.construct()
                self._add_row(row, f"row {number + 1} of '{form.source.name}'")
            for pair in (pair for pair in form.pairs if pair.a_part is SidePart.WHOLE):
                a, b = side_values(pair)
                if min(abs(a), abs(b)) > MET:
                    raise EvaluationError(
                        f"'{pair.name}': the sides are {a:g} and {b:g}, so neither is zero. Solve with "
                        "polish=True, and do not change values afterwards."
                    )
            for pair, side, which in sides_at_zero(form):
                self._add(self._substituted(side) == 0, f"the {which} side of '{pair.name}'")

    def _add_moving_bounds(self) -> None:
        for variable in self._source.component_data_objects(Var, active=True):
            if variable.fixed:
                continue
            # The stored bounds: the public ones are joined with the domain's, which cannot be differentiated.
            for which, bound in zip(("lower", "upper"), stored_bounds(variable), strict=True):
                new = self._substituted(bound)
                if new is not bound:
                    self.moving_bounds.append((variable, which))
                    relation = variable - new >= 0 if which == "lower" else variable - new <= 0
                    self._add(relation, f"the {which} bound of '{variable.name}'")
