"""A Pyomo model as linear and nonlinear terms, from one walk over its active rows and its objective."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.expression import Expression
from pyomo.core.base.external import ExternalFunction
from pyomo.core.base.objective import Objective, ObjectiveData
from pyomo.core.base.param import Param
from pyomo.core.base.set import RangeSet, Set
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var, VarData
from pyomo.network import Port
from pyomo.repn.util import categorize_valid_components

from pyrobocop_pyomo.errors import ModelError

from .expression_terms import Terms
from .model_checks import refuse_discrete, single_objective
from .term_groups import Columns

# An ExternalFunction or a Port does nothing by itself.
_SEEN = {Block, Objective, Constraint, Var, Param, Expression, Set, RangeSet, Suffix, ExternalFunction, Port}


@dataclass(eq=False)
class ModelTerms:
    """What one walk over a model found.

    Attributes
    ----------
    model : Block
    columns : Columns
        Free variables and parameters.
    rows, cost : Terms
        Terms of the rows, and of the objective as a row 0; a maximised objective appears negated.
    constraints : list of ConstraintData
        In the order of the rows. Those without free variables or without bounds are absent.
    bounds : list of pairs
        Lower and upper bound of each row: numbers, expressions without variables, or None.
    constant_constraints : list of ConstraintData
        Those without free variables.
    objective : ObjectiveData or None
    sign : float
        1 for a minimised objective, -1 for a maximised one.
    """

    model: BlockData
    columns: Columns
    rows: Terms
    cost: Terms
    constraints: list[ConstraintData]
    bounds: list[tuple[Any, Any]]
    constant_constraints: list[ConstraintData]
    objective: ObjectiveData | None
    sign: float

    @property
    def variables(self) -> list[VarData]:
        """Free variables in the order of their columns."""
        return self.columns.variables


def collect_terms(model: BlockData) -> ModelTerms:
    """Walk over everything active in a model, once.

    Raises
    ------
    ModelError
        When the model has several objectives, no free variables or discrete ones, or an expression that vectorised
        functions cannot evaluate.
    """
    _refuse_unknown_components(model)
    objective = single_objective(model)
    columns = Columns()
    found = ModelTerms(
        model=model,
        columns=columns,
        rows=Terms(columns),
        cost=Terms(columns),
        constraints=[],
        bounds=[],
        constant_constraints=[],
        objective=objective,
        sign=1.0 if objective is None or objective.is_minimizing() else -1.0,
    )
    with PauseGC():
        for constraint in model.component_data_objects(Constraint, active=True, descend_into=True):
            lower, body, upper = constraint.to_bounded_expression()
            if lower is None and upper is None:
                continue
            try:
                added = found.rows.add(len(found.constraints), body)
            except ModelError as error:
                raise ModelError(f"'{constraint.name}': {error}") from None
            if added:
                found.constraints.append(constraint)
                found.bounds.append((lower, upper))
            else:
                found.constant_constraints.append(constraint)
        if objective is not None:
            found.cost.add(0, objective.expr, found.sign, keep_constant=True)
            found.cost.named_expressions[id(objective)] = (objective, objective._args_[0])
        found.rows.group()
        found.cost.group()
    refuse_discrete(model, found.variables)
    return found


def _refuse_unknown_components(model: BlockData) -> None:
    _, unknown = categorize_valid_components(model, active=True, valid=_SEEN)
    if unknown:
        shown = ", ".join(f"'{each.name}' ({ctype.__name__})" for ctype, several in unknown.items() for each in several)
        raise ModelError(
            f"'{model.name}' has active components that are no constraints, and that a solver would not see: {shown}. "
            "Transform them, or deactivate them."
        )
