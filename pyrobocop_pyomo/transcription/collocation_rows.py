"""The rows that make a polynomial follow a differential equation.

On element ``i`` with width ``h_i``, values ``x_{i,n}`` at the state's nodes (the element start first) and right-hand
sides ``f_{i,k}`` at the stages, with the matrices ``D`` and ``F`` of the scheme::

    sum_n D[r, n] x_{i,n} - h_i sum_k F[r, k] f_{i,k} = 0     one per row r          (collocation)
    sum_n end_weights[n] x_{i,n} - x_{i+1,0}          = 0                            (continuity)

The second family exists only where the element end is no node. ``F`` is the identity but for schemes that start and
end on a stage, so this form holds ``f`` once or twice per row; the Runge-Kutta form ``x_{i,k} = x_{i,0} + h_i sum_j
A[k, j] f_j`` would hold it up to ``s`` times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numeric_expr import MonomialTermExpression, SumExpression
from pyomo.core.util import quicksum

from pyrobocop_pyomo.modeling.rows_by_rule import RepeatedSum
from pyrobocop_pyomo.numerics import Grid, Scheme


def collocation_row(
    state: Mapping[float, Any], rate: Mapping[float, Any], grid: Grid, element: int, row: int, width: Any
) -> Any:
    """One row ``D[row] x - h F[row] f = 0`` of an element.

    Parameters
    ----------
    state : mapping of time to variable
        The state at the nodes of the element.
    rate : mapping of collocation point to expression, variable or number
        The right-hand sides that the row has, or variables that stand for derivatives.
    grid : Grid
    element, row : int
    width : number or expression
        Of the element; an expression when the duration is a variable.

    Returns
    -------
    (body, 0)
        The tuple form of an equality constraint.
    """
    coefficients, mixture = grid.scheme.D[row].tolist(), grid.scheme.F[row].tolist()
    variables = [state[time] for time in grid.node_times[element]]
    backward = -width
    # One flat sum, made from its terms, takes half the time of operators, to build and to walk over again.
    terms = list(map(MonomialTermExpression, zip(coefficients, variables, strict=True)))
    for stage, weight in zip(grid.stage_times[element], mixture, strict=True):
        if weight != 0.0:
            terms.append((backward if weight == 1.0 else backward * weight) * rate[stage])
    return SumExpression(terms), 0


def collocation_sums(
    grid: Grid,
    state: Mapping[float, Any],
    times: list[float],
    rates: Callable[[list[float], list[int]], tuple[list[list[Any]], Callable[[int], Any]]],
    widths: list[float],
) -> list[RepeatedSum]:
    """What rows of `collocation_row` are the sums of.

    Parameters
    ----------
    grid : Grid
    state : mapping of time to variable
    times : list of float
        Of the rows.
    rates : callable
        From times and their elements to what right-hand sides read there, and from a place to the one there.
    widths : list of float
        Of the elements, as far as they are numbers.
    """
    places = [grid.row_places[time] for time in times]
    sums = []
    for row, coefficients in enumerate(grid.scheme.D.tolist()):
        rows = [i for i, (_, of_row) in enumerate(places) if of_row == row]
        nodes = [grid.node_times[places[i][0]] for i in rows]
        variables = [[state[of_element[k]] for of_element in nodes] for k in range(len(coefficients))]
        sums.append(RepeatedSum(rows, [1.0] * len(rows), variables, partial(_weighted, coefficients, variables)))
    mixture = [[(k, weight) for k, weight in enumerate(row) if weight] for row in grid.scheme.F.tolist()]
    parts = [(i, element, k, weight) for i, (element, row) in enumerate(places) for k, weight in mixture[row]]
    stages = [grid.stage_times[element][k] for _, element, k, _ in parts]
    scales = [-widths[element] * weight for _, element, _, weight in parts]
    sums.append(RepeatedSum([i for i, *_ in parts], scales, *rates(stages, [element for _, element, *_ in parts])))
    return [repeated for repeated in sums if repeated.rows]


def _weighted(coefficients: list[float], variables: list[list[Any]], place: int) -> Any:
    return LinearExpression(linear_coefs=coefficients, linear_vars=[each[place] for each in variables])


def continuity_row(state: Mapping[float, Any], grid: Grid, element: int) -> Any:
    """The row ``x_{i+1,0} = x_i(1)`` at the end of an element, for schemes whose last stage is not the end."""
    variables = [state[grid.mesh.boundaries[element + 1]], *(state[time] for time in grid.node_times[element])]
    return LinearExpression(linear_vars=variables, linear_coefs=[-1.0, *grid.scheme.end_weights.tolist()]), 0


def can_step(scheme: Scheme) -> bool:
    """True when an element is one step: one stage, and a state at its start and at its end only.

    Implicit and explicit Euler are such schemes. The stage of a Gauss scheme lies inside the element, where a map from
    one boundary to the next says nothing.
    """
    return scheme.stages == 1 and scheme.end_is_a_node


def quadrature(integrand: Callable[[float], Any], weights: Mapping[float, Any]) -> Any:
    """``sum_t weights[t] * integrand(t)`` as a Pyomo expression (or a number).

    With the weights ``h_i b_k`` that the collocation equations imply, the value has the order of the scheme: it
    equals what an additional state ``xdot = integrand`` would have gained at the end.

    Parameters
    ----------
    integrand : callable
        Collocation point -> expression or number.
    weights : mapping of collocation point to number or expression
        ``Grid.quadrature_weights``, or expressions where element widths are variables.
    """
    return quicksum(weight * integrand(time) for time, weight in weights.items())
