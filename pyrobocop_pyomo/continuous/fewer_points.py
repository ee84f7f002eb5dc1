"""Controls of lower degree than the states: fewer free values in each element."""

from __future__ import annotations

from typing import Any

from pyomo.common.modeling import unique_component_name
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.var import Var
from pyomo.core.expr import LinearExpression
from pyomo.dae import ContinuousSet

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics.lagrange import evaluation_matrix

from .record import discretisation_of
from .structure import axis_on


def add_interpolation(model: Any, variable: Any, points: int, domain: Any) -> Any:
    """Make a variable a polynomial through the last points of each element: ``u(t_k) = sum_j l_j(t_k) u(t_j)``.

    Parameters
    ----------
    model : Block
        Where the rows go.
    variable : Var
    points : int
        How many values of each element stay free.
    domain : ContinuousSet

    Returns
    -------
    Constraint or None
        The rows; None where there is nothing to do.

    Raises
    ------
    ModelError
        When this cannot be done.
    """
    discretisation = discretisation_of(domain) if getattr(domain, "ctype", None) is ContinuousSet else None
    if discretisation is None:
        raise ModelError(
            f"contset: '{getattr(domain, 'name', domain)}' was not discretised by pyrobocop.collocation. Apply it "
            "first, and pass the ContinuousSet."
        )
    axis = axis_on(variable, domain) if getattr(variable, "ctype", None) is Var else None
    if axis is None:
        raise ModelError(
            f"var: '{getattr(variable, 'name', variable)}' is no variable that is indexed by '{domain.name}'."
        )
    scheme, stages = discretisation.grid.scheme, discretisation.grid.scheme.stages
    if not isinstance(points, int) or not 1 <= points <= stages:
        raise ModelError(
            f"'{variable.name}': ncp = {points!r}, but '{domain.name}' has {stages} points in each element. Give a "
            f"whole number from 1 to {stages}."
        )
    if points == stages:
        return None
    if discretisation.grid.elements_share_points:
        raise ModelError(
            f"'{variable.name}': with {scheme.name} neighbouring elements share a point, so that no element has values "
            "of its own. Choose radau or gauss."
        )
    if not discretisation.state_ids().isdisjoint(map(id, variable.values())):
        raise ModelError(
            f"'{variable.name}': has a derivative with respect to '{domain.name}', whose equations need all of its "
            "values. Only controls and algebraics can have fewer."
        )
    weights = evaluation_matrix(scheme.c[-points:], scheme.c[:-points]).tolist()
    rows = Constraint(variable.index_set())
    model.add_component(unique_component_name(model, f"{variable.local_name}_interpolation_constraints"), rows)
    first = discretisation.grid.points[0]
    for others in [axis.others(index) for index in variable if axis.time(index) == first]:
        for times in discretisation.grid.stage_times:
            free = [variable[axis.join(others, time)] for time in times[-points:]]
            for time, row in zip(times[:-points], weights, strict=True):
                index = axis.join(others, time)
                rows.add(index, (LinearExpression(linear_vars=[variable[index], *free], linear_coefs=[-1.0, *row]), 0))
    return rows
