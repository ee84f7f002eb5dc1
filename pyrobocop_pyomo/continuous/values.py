"""Values along a continuous set, as a trajectory."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pyomo.core.base.expression import Expression
from pyomo.core.base.var import Var
from pyomo.dae import ContinuousSet, DerivativeVar

from pyrobocop_pyomo.complementarity import canonical_form, side_values
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.trajectories import Trajectory

from .record import Discretisation, discretisation_of
from .structure import PAIRS, Spot, axes_of, axis_on, label, spots


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
