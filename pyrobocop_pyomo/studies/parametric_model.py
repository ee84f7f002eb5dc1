"""The branch that a solution is on, as a model in which parameters are variables. Nothing of the user's is touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.objective import Objective
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import native_numeric_types, value
from pyomo.core.expr.visitor import identify_mutable_parameters, identify_variables, replace_expressions

from pyrobocop_pyomo.complementarity import (
    CanonicalForm,
    CanonicalPair,
    SidePart,
    active_sources,
    canonical_form,
    pair_residuals,
)
from pyrobocop_pyomo.errors import ModelError, SensitivityError
from pyrobocop_pyomo.solving.pair_report import ZERO_SIDE


@dataclass(eq=False)
class ParametricModel:
    """A model of rows over the user's variables, and over variables that stand for parameters.

    Attributes
    ----------
    model : ConcreteModel
    stand_ins : list of VarData
        One per parameter, with its value.
    names : dict from id of a row to str
        What each row says, for messages.
    moving_bounds : list of (VarData, "lower" or "upper")
        Bounds of variables that hold a parameter: they are rows here.
    """

    model: Any
    stand_ins: list[Any]
    names: dict[int, str]
    moving_bounds: list[tuple[Any, str]]


class ParametricBuilder:
    """Writes a model's rows with stand-ins for its parameters.

    Parameters
    ----------
    model : Block
        At a solution.
    parameters : sequence of ParamData or fixed VarData
    """

    def __init__(self, model: Any, parameters: Sequence[Any]) -> None:
        self._source, self._parameters = model, parameters
        self._model = ConcreteModel()
        self._model.stand_in = Var(range(len(parameters)))
        self._model.rows = ConstraintList()
        stand_ins = list(self._model.stand_in.values())
        for stand_in, parameter in zip(stand_ins, parameters, strict=True):
            stand_in.set_value(value(parameter))
        self._substitution = {id(each): new for each, new in zip(parameters, stand_ins, strict=True)}
        self._has_variables = any(each.is_variable_type() for each in parameters)
        self._used: set[int] = set()
        self._built = ParametricModel(self._model, stand_ins, {}, [])

    def build(self) -> ParametricModel:
        """Write everything.

        Raises
        ------
        SensitivityError
            At biactive pairs, and at pairs that are not met.
        ModelError
            If a parameter is used nowhere in the active model.
        """
        for objective in self._source.component_data_objects(Objective, active=True):
            self._model.cost = Objective(expr=self._substituted(objective.expr), sense=objective.sense)
        for row in self._source.component_data_objects(Constraint, active=True):
            self._add_row(row.to_bounded_expression(), row.expr, f"'{row.name}'")
        self._add_pairs([canonical_form(source) for source in active_sources(self._source)])
        self._add_moving_bounds()
        unused = [each.name for each in self._parameters if id(each) not in self._used]
        if unused:
            raise ModelError(
                f"'{self._source.name}': {_listed(unused)} is used in no active constraint, objective, bound or pair, "
                "so nothing depends on it. A number that was read with value() when the model was built leaves no "
                "trace: put the Param itself into the expressions."
            )
        return self._built

    def _substituted(self, expression: Any) -> Any:
        """The expression with stand-ins; the same object where there is nothing to replace."""
        if expression.__class__ in native_numeric_types or expression is None:
            return expression
        found = {id(each) for each in identify_mutable_parameters(expression)}
        if self._has_variables:
            found |= {id(each) for each in identify_variables(expression, include_fixed=True)}
        found &= self._substitution.keys()
        if not found:
            return expression
        self._used |= found
        return replace_expressions(expression, {each: self._substitution[each] for each in found})

    def _add(self, relation: Any, name: str) -> None:
        self._built.names[id(self._model.rows.add(relation))] = name

    def _add_row(self, bounded: tuple[Any, Any, Any], relation: Any, name: str) -> None:
        lower, _, upper = bounded
        new = [self._substituted(each) for each in bounded]
        if all(each is old for each, old in zip(new, bounded, strict=True)):
            if lower is not None or upper is not None:
                self._add(relation, name)
            return
        if lower is upper and lower is not None:
            self._add(new[1] - new[0] == 0, name)
            return
        # Two rows for a range: its ends may move apart.
        if lower is not None:
            self._add(new[1] - new[0] >= 0, f"the lower bound of {name}")
        if upper is not None:
            self._add(new[1] - new[2] <= 0, f"the upper bound of {name}")

    def _add_pairs(self, forms: Sequence[CanonicalForm]) -> None:
        pairs = [pair for form in forms for pair in form.pairs]
        values = dict(zip(map(id, pairs), pair_residuals(pairs), strict=True))
        biactive = [each.name for each in values.values() if max(each.a, each.b) <= ZERO_SIDE]
        if biactive:
            raise SensitivityError(
                f"'{self._source.name}': {len(biactive)} pairs are biactive (both sides zero): {_listed(biactive)}. "
                "The solution has a kink there. Move the data so that one side is positive."
            )
        for form in forms:
            for number, relation in enumerate(form.rows):
                row = Constraint(expr=relation)
                row.construct()
                self._add_row(row.to_bounded_expression(), relation, f"row {number + 1} of '{form.source.name}'")
            held_by_first = False
            for pair in form.pairs:
                sides = values[id(pair)]
                for side in (pair.a, pair.b):
                    self._substituted(side)  # a parameter of a positive side is used as well
                if min(abs(sides.a), abs(sides.b)) > ZERO_SIDE:
                    raise SensitivityError(
                        f"'{pair.name}': the sides are {sides.a:g} and {sides.b:g}, so neither is zero. Solve with "
                        "polish=True, and do not change values afterwards."
                    )
                if sides.a < sides.b:
                    self._hold(pair, pair.a, "first")
                    held_by_first = True
            # The parts of a free side are zero together: it is held once, and only where no bound of the range is.
            whole = [pair for pair in form.pairs if values[id(pair)].a >= values[id(pair)].b]
            parts = [pair for pair in whole if pair.b_part is not SidePart.WHOLE]
            for pair in [each for each in whole if each.b_part is SidePart.WHOLE] + (
                [] if held_by_first else parts[:1]
            ):
                self._hold(pair, pair.b, "second")

    def _hold(self, pair: CanonicalPair, side: Any, which: str) -> None:
        self._add(self._substituted(side) == 0, f"the {which} side of '{pair.name}'")

    def _add_moving_bounds(self) -> None:
        for variable in self._source.component_data_objects(Var, active=True):
            if variable.fixed:
                continue
            # The stored bounds: the public ones are joined with the domain's, which cannot be differentiated.
            for which, bound in (("lower", variable._lb), ("upper", variable._ub)):
                new = self._substituted(bound)
                if new is not bound:
                    self._built.moving_bounds.append((variable, which))
                    relation = variable - new >= 0 if which == "lower" else variable - new <= 0
                    self._add(relation, f"the {which} bound of '{variable.name}'")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"'{name}'" for name in names[:5]) + (", ..." if len(names) > 5 else "")
