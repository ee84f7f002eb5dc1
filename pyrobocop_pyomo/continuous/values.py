"""Values along a continuous set, as a trajectory.

Values to show where the states determine none: a control at the start with Radau, at element ends with Gauss.

Such a variable equals the one at the nearest collocation point of the element that ends there, or of the first element:
the value that a control has on its way to that point. One more row says so, which restricts nothing else. Equations
that then give a variable without bounds explicitly, ``y[t] == x[t] + u[t]``, hold as well. At the first point, where
the model may fix what it likes afterwards, other equations hold too: with the values that are shown where they give
derivatives, else with variables that they leave to choose.

What is left is fixed to None, so that whoever uses it learns about it: variables whose bounds do not allow for that,
and derivatives without an equation of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint, ConstraintData
from pyomo.core.base.expression import Expression
from pyomo.core.base.var import Var
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import value
from pyomo.dae import ContinuousSet, DerivativeVar

from pyrobocop_pyomo.complementarity import canonical_form, side_values
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.pyomo_internals import put_part
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.trajectories import Trajectory

from .holding_rows import Absent
from .structure import (
    PAIRS,
    Discretisation,
    Spot,
    axes_of,
    axis_on,
    discretisation_of,
    label,
    other_side,
    row_variables,
    spots,
)


def dae_trajectory(model: Any, wrt: Any) -> Trajectory:
    """Values along a continuous set that ``pyrobocop.collocation`` has discretised.

    Parameters
    ----------
    model : ConcreteModel or Block
        What is read, with everything below it.
    wrt : ContinuousSet
        The set that the values are indexed by.

    Returns
    -------
    Trajectory
        Its ``states`` are the variables with a derivative, its ``signals`` all others, derivatives included. What
        has further indices is named with them, ``"x[a]"``; what sits in blocks as ``"tank[1].level"``.
        ``parameters`` are the variables that are not indexed by a continuous set.

    Raises
    ------
    TrajectoryError
        When the set is not discretised, or a variable has no value.
    """
    discretisation = discretisation_of(wrt) if getattr(wrt, "ctype", None) is ContinuousSet else None
    if discretisation is None:
        raise TrajectoryError(
            f"'{getattr(wrt, 'name', wrt)}' was not discretised by pyrobocop.collocation. Apply it first, and pass the "
            "ContinuousSet of this very model."
        )
    found = list(spots(model))
    states: dict[str, Array] = {}
    signals: dict[str, Array] = {}
    lines: dict[int, tuple[str, dict[float, Any]]] = {}  # by the variable at the last point
    grid, last = discretisation.grid, discretisation.grid.points[-1]
    for family, is_state, data in families(found, discretisation):
        times = grid.times if is_state else grid.points
        missing = next((data[time] for time in times if time in data and data[time].value is None), None)
        if missing is not None and isinstance(missing.parent_component(), (DerivativeVar, Expression)):
            continue  # along space, where no row gives it
        if missing is not None:
            raise TrajectoryError(f"'{missing.name}' has no value. Solve the model first, or give it an initial value.")
        if all(time in data for time in times):
            lines[id(data[last])] = label(family), data
            (states if is_state else signals)[label(family)] = np.array([data[time].value for time in times])
    rates: dict[str, Array] = {}
    for state, rate in discretisation.derivatives:
        seen, axis = discretisation.substitutions.get(rate, rate), axis_on(rate, wrt)
        for index in [index for index in seen if axis is not None and axis.time(index) == last]:
            if id(state[index]) in lines and id(seen[index]) in lines:
                values = lines[id(seen[index])][1]
                rates[lines[id(state[index])][0]] = np.array([values[time].value for time in grid.points], dtype=float)
    return Trajectory(
        name=model.name,
        grid=grid,
        states=states,
        signals=signals,
        parameters=dict(_parameters(found)),
        pairs=_pairs(found, discretisation),
        rates=rates,
    )


def families(found: list[Spot], discretisation: Discretisation) -> Iterator[tuple[Any, bool, dict[float, Any]]]:
    """Each variable along the set: its key, whether it is a state, and what has its value at each time."""
    along: dict[Any, dict[float, Any]] = {}
    put_aside = set(map(id, discretisation.substitutions))
    shown = set(map(id, discretisation.substitutions.values()))
    for spot in found:
        is_variable = spot.component.ctype in (Var, DerivativeVar) and id(spot.component) not in put_aside
        if not is_variable and id(spot.component) not in shown:
            continue
        for family, time, data in spot.members_along(discretisation.domain):
            along.setdefault(family, {})[time] = data
    states = discretisation.state_ids()
    for family, by_time in along.items():
        yield family, id(next(iter(by_time.values()))) in states, by_time


def _parameters(found: list[Spot]) -> Iterator[tuple[str, float]]:
    for spot in found:
        if spot.component.ctype is Var and not spot.outer and not axes_of(spot.component):
            for data in spot.component.values():
                if data.value is not None:
                    yield data.name, float(data.value)


def _pairs(found: list[Spot], discretisation: Discretisation) -> dict[str, Array]:
    position = {time: i for i, time in enumerate(discretisation.grid.points)}
    read: dict[str, Array] = {}
    for spot in found:
        if spot.component.ctype not in PAIRS:
            continue
        for family, time, data in spot.members_along(discretisation.domain):
            for pair in canonical_form(data).pairs if time in position else ():
                name = f"{label(family)} ({pair.role})" if pair.role else label(family)
                sides = read.setdefault(name, np.full((2, len(position)), np.nan))
                sides[:, position[time]] = side_values(pair)
    return read


# ------------------------------------------------------------------------------------------------------- values to show


class ShownValue(ConstraintData):
    """The row of a shown value; not active while the variable is fixed, or one that follows from it.

    So what is fixed after the transformation restricts nothing else, as if it had been fixed before.

    Parameters
    ----------
    data, source : Var
    following : tuple of Var
        What equations at this point make of the value.
    component : Constraint
    """

    __slots__ = ("_following", "_shown")

    def __init__(self, data: Any, source: Any, following: tuple[Any, ...], component: Any) -> None:
        self._shown, self._following = data, following
        super().__init__((LinearExpression(linear_vars=[data, source], linear_coefs=[1.0, -1.0]), 0), component)

    @property
    def active(self) -> bool:
        """Whether the row holds."""
        if not self._active or self._shown.fixed:
            return False
        # Derivatives that an expression replaces are fixed to None.
        return not any(variable.fixed and variable.value is not None for variable in self._following)


def find_shown_values(
    spots: list[Spot], absent: Absent, used: set[int], discretisation: Discretisation
) -> dict[int, tuple[Any, Any]]:
    """Find values to show for variables that have none.

    Parameters
    ----------
    spots : list of Spot
    absent : dict of id to (variable, point)
    used : set of int
        Ids of the variables in rows that hold.
    discretisation : Discretisation

    Returns
    -------
    dict of id to (variable, variable)
        Each with the one whose value it can have.
    """
    found, points = {}, discretisation.grid.points
    for _, _, along in families(spots, discretisation):
        for time, data in along.items():
            # What was a DerivativeVar is a Var once its sets are discretised.
            if id(data) not in absent or isinstance(data.parent_component(), DerivativeVar):
                continue
            source = along.get(max((point for point in points if point < time), default=points[0]))
            if source is not None and id(source) in used and id(source) not in absent and _allows(data, source):
                found[id(data)] = (data, source)
    return found


def find_definitions(rows: Iterable[Any], absent: Absent, sources: dict[int, Any]) -> dict[int, Any]:
    """Equations that give a variable explicitly by states and shown values.

    Parameters
    ----------
    rows : iterable of ConstraintData
        Equations that do not hold because variables of theirs are absent.
    absent : dict of id to (variable, point)
    sources : dict of id to (variable, variable)

    Returns
    -------
    dict of id to ConstraintData
        From each variable to the row that gives it.
    """
    everything = {key: data for key, (data, _) in absent.items()}
    free = {key for key, data in everything.items() if data.is_continuous() and data.lower is data.upper is None}
    given, _ = row_variables(rows, free)
    read = {key: variables_in(other_side(row.expr, everything[key])) for key, row in given.items()}
    waiting = {key: (row, set(map(id, read[key])) & everything.keys()) for key, row in given.items()}
    known, chosen = set(sources) - waiting.keys(), dict[int, Any]()
    while waiting:
        ready = {key: row for key, (row, needed) in waiting.items() if needed <= known}
        shown = next((key for key in waiting if key in sources), None)
        if not ready and shown is None:
            break
        chosen |= ready
        known.update(ready if ready or shown is None else [shown])  # equations that wait for each other
        waiting = {key: waiting[key] for key in waiting.keys() - known}
    return chosen


def add_shown_values(discretisation: Discretisation) -> None:
    """Add the rows of all shown values of a discretisation, in a generated block."""
    if not discretisation.shown:
        return
    home, parent = Block(concrete=True), discretisation.domain.parent_block()
    parent.add_component(unique_component_name(parent, f"{discretisation.domain.local_name}_shown_values"), home)
    discretisation.generated.append(home)
    home.equals = Constraint(range(len(discretisation.shown)))
    for i, (data, source, following) in enumerate(discretisation.shown):
        data.unfix()
        data.set_value(source.value, skip_validation=True)
        put_part(home.equals, i, ShownValue(data, source, following, home.equals))


def _allows(data: Any, source: Any) -> bool:
    """Whether a variable can have every value of another."""
    lowest, highest = value(data.lower), value(data.upper)
    least, largest = value(source.lower), value(source.upper)
    return (
        data.domain is source.domain
        and (lowest is None or (least is not None and lowest <= least))
        and (highest is None or (largest is not None and highest >= largest))
    )
