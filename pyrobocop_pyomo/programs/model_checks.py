"""What every way to Ipopt asks of a model before it is solved."""

from __future__ import annotations

from pyomo.core.base.block import BlockData
from pyomo.core.base.objective import Objective, ObjectiveData
from pyomo.core.base.var import VarData

from pyrobocop_pyomo.errors import ModelError


def single_objective(model: BlockData) -> ObjectiveData | None:
    """The active objective, if there is any.

    Raises
    ------
    ModelError
        When there are several.
    """
    objectives = list(model.component_data_objects(Objective, active=True, descend_into=True))
    if len(objectives) > 1:
        names = ", ".join(f"'{objective.name}'" for objective in objectives)
        raise ModelError(
            f"'{model.name}' has {len(objectives)} active objectives ({names}); Ipopt takes one. Deactivate the "
            "others, or add them up in a single one."
        )
    return objectives[0] if objectives else None


def refuse_discrete(model: BlockData, variables: list[VarData]) -> None:
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
        shown = ", ".join(f"'{name}'" for name in discrete[:5]) + (", ..." if len(discrete) > 5 else "")
        raise ModelError(
            f"'{model.name}' has {len(discrete)} discrete variables ({shown}); Ipopt solves continuous problems "
            "only. Fix them, or relax them with TransformationFactory('core.relax_integer_vars')."
        )
