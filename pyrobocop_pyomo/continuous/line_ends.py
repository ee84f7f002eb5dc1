"""Equations that are left out at an end of a continuous set, where a boundary condition takes their place.

Along a set with ``s`` stages per element, a variable ``x`` with derivative ``a`` has one collocation row per stage, and
``a`` needs an equation at each. Partial differential equations often have none at a boundary:

* The equation of a first derivative holds at the first point and not at the last: what it describes comes from the
  end. With Radau, which has its stages at the right of an element, the rows then are those of the nodes at the left,
  ``sum_m D'[j, m] x_{i,m} = h_i a_{i,j}`` for ``j = 0 .. s - 1``: the same polynomials, differentiated on the side that
  the information comes from, as a forward difference is beside a backward one.
* Otherwise ``a`` has one degree less in the element at that end: ``sum_k w_k a_{i,k} = 0`` with the barycentric weights
  ``w`` of the stages, the divided difference of highest order.

Anything else that is missing is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from pyomo.common.collections import ComponentMap
from pyomo.core.expr import LinearExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.numerics.lagrange import barycentric_weights, differentiation_matrix

from .record import DerivativeEnds, Discretisation, LineEnds
from .structure import Axis, axes_of, axis_on


def rows_from_left(
    state: Mapping[float, Any], rate: Mapping[float, Any], grid: Grid, widths: list[Any]
) -> Iterator[tuple[float, Any]]:
    """Rows ``sum_m D'[j, m] x_m - h a_j = 0`` at every node of an element but its end.

    Parameters
    ----------
    state, rate : mapping of time to variable
        The variable and its derivative.
    grid : Grid
        Of a scheme whose last stage is the element end.
    widths : list
        Width of each element.

    Yields
    ------
    (time, row) : tuple
        The row stands at the end of its element instead of the start, so that each time has one.
    """
    slopes = differentiation_matrix(grid.scheme.state_nodes).tolist()
    for nodes, width in zip(grid.node_times, widths, strict=True):
        variables = [state[time] for time in nodes]
        for j, time in enumerate(nodes[:-1]):
            slope = LinearExpression(linear_vars=variables, linear_coefs=slopes[j])
            yield time if j else nodes[-1], (slope - width * rate[time], 0)


def closing_rows(rate: Mapping[float, Any], grid: Grid, without: tuple[float, ...]) -> Iterator[tuple[float, Any]]:
    """Rows that take one degree from a derivative in the elements where it has no equation at an end.

    Parameters
    ----------
    rate : mapping of time to variable
        The derivative at the collocation points.
    grid : Grid
    without : tuple of float
        The first or the last collocation point, or both.

    Yields
    ------
    (time, row) : tuple
    """
    weights = barycentric_weights(grid.scheme.c)
    weights = (weights / abs(weights).max()).tolist()
    for time in without:
        stages = grid.stage_times[0 if time == grid.points[0] else -1]
        variables = [rate[stage] for stage in stages]
        yield time, (LinearExpression(linear_vars=variables, linear_coefs=weights), 0)


def find_line_ends(discretisation: Discretisation, has_equation: Callable[[Any], bool], open_ids: set[int]) -> Any:
    """Look where the derivatives along a set have equations.

    Parameters
    ----------
    discretisation : Discretisation
    has_equation : callable
        Whether a row that the user stated holds a variable.
    open_ids : set of int
        Ids of the continuous sets that are still to be discretised.

    Returns
    -------
    ComponentMap
        As `Discretisation.ends`.

    Raises
    ------
    ModelError
        When an equation is missing elsewhere than at an end.
    """
    ends, grid = ComponentMap(), discretisation.grid
    states = {id(state) for state in discretisation.states}
    orders = _orders(discretisation)
    for _, derivative in discretisation.derivatives:
        if id(derivative) in states:
            continue
        axis = axis_on(derivative, discretisation.domain)
        assert axis is not None
        lines: dict[Any, set[float]] = {}
        for index, data in derivative.items():
            equations = lines.setdefault(axis.others(index), set())
            if has_equation(data):
                equations.add(axis.time(index))
        if not any(lines.values()):
            continue
        sets = [other.domain for other in axes_of(derivative) if other != axis]
        found: dict[Any, LineEnds] = {}
        for others, equations in lines.items():
            line = _Line(derivative, axis, others, equations, orders[id(derivative)])
            if sets and equations <= {grid.times[0]}:
                continue  # what is fixed at the start alone is no equation
            if line.can_be_closed(grid):
                found[others] = line.ends(grid)
            elif not any(id(domain) in open_ids for domain in sets):
                raise line.refusal(grid)
        special = next((one for one in found.values() if one != LineEnds()), None)
        if special is not None:
            # Lines without any equation, such as those at the initial time, have nothing that could be missing.
            without = LineEnds(from_left=special.from_left)
            ends[derivative] = DerivativeEnds({others: found.get(others, without) for others in lines}, special)
    return ends


def _orders(discretisation: Discretisation) -> dict[int, int]:
    orders: dict[int, int] = {}
    for state, rate in discretisation.derivatives:
        orders[id(rate)] = orders.get(id(state), 0) + 1
    return orders


class _Line(NamedTuple):
    """A derivative along a set for one choice of its other indices, and the times at which it has an equation."""

    derivative: Any
    axis: Axis
    others: Any
    equations: set[float]
    order: int

    def _missing(self, grid: Grid) -> list[float]:
        return [time for time in grid.points if time not in self.equations]

    def can_be_closed(self, grid: Grid) -> bool:
        missing = self._missing(grid)
        fits = grid.mesh.elements > 1 or len(missing) < grid.scheme.stages or not missing
        return set(missing) <= {grid.points[0], grid.points[-1]} and fits

    def ends(self, grid: Grid) -> LineEnds:
        missing = self._missing(grid)
        radau_like = grid.scheme.stiffly_accurate and not grid.scheme.starts_on_a_stage
        from_left = self.order == 1 and radau_like and missing == [grid.points[-1]] and grid.times[0] in self.equations
        return LineEnds(from_left=True) if from_left else LineEnds(without=tuple(missing))

    def refusal(self, grid: Grid) -> ModelError:
        missing = self._missing(grid)
        inner = [time for time in missing if time not in (grid.points[0], grid.points[-1])]
        name = self.derivative[self.axis.join(self.others, (inner or missing)[0])].name
        return ModelError(
            f"'{name}': has no equation, though the same derivative has one at other points. Index the constraint by "
            f"'{self.axis.domain.local_name}' itself, not by a list of its points; Constraint.Skip may leave out the "
            "first and the last point."
        )
