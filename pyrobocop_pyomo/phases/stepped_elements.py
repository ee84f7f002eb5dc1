"""Elements with implicit and algebraic equations, stepped anew by a finer scheme under the controls of a trajectory."""

from __future__ import annotations

from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.numerics import Array, radau
from pyrobocop_pyomo.numerics.flows import Flows
from pyrobocop_pyomo.trajectories import Trajectory

from .between_points import check_rules_between_points
from .companions import indices_of
from .declarations import Algebraic
from .delays import past_of
from .element_integration import Unknowns, find_unknowns, step_element
from .point_model import PointEquations
from .record import PhaseRecord

_MORE_STAGES = 2


def determined_unknowns(block: Any, record: PhaseRecord) -> Unknowns | None:
    """What residual equations determine at a point; None where they determine nothing, or not all.

    Algebraics are found anew where residual equations determine them all, else taken from the trajectory.
    """
    for given in ({}, dict.fromkeys(record.names(Algebraic))):
        try:
            found = find_unknowns(block, record, given)
        except InitialGuessError:
            continue
        if not found.contact:  # between its points an element knows nothing of pairs
            return found if found.implicit or found.algebraics else None
    return None


def stepped_flows(
    block: Any, record: PhaseRecord, trajectory: Trajectory, unknowns: Unknowns, first: Array | None = None
) -> tuple[Flows, Array]:
    """Every element by a Radau scheme of two stages more, with the values of the trajectory on the model.

    Returns
    -------
    flows : Flows
        Infinite where the equations of an element have no solution.
    fractions : array, shape (k,)
        The nodes of the finer scheme.
    """
    names = record.names_of_states
    indices = indices_of(record, trajectory.grid)
    equations = PointEquations(block, record, indices, trajectory.grid, trajectory.parameters)
    stated = [statement for statement in record.statements if statement.kind in ("ode", "residual")]
    check_rules_between_points(block, record, equations.point, stated)
    equations.point.set_values(equations.parameters)
    equations.point.past = past_of(trajectory)
    fine = radau(trajectory.grid.scheme.stages + _MORE_STAGES)
    to_fine = trajectory.grid.scheme.stage_polynomial_at(fine.c)
    boundaries, widths = trajectory.grid.mesh.boundaries, trajectory.grid.mesh.widths
    states = np.array([trajectory.element_states(name) for name in names])
    signals = {name: trajectory.element_signals(name) @ to_fine.T for name in trajectory.signals}

    def stepped(i: int, start: Array) -> Array:
        """States at the nodes of one element, shape ``(k, n)``."""
        if not np.isfinite(start).all():
            return np.full((len(fine.state_nodes), len(names)), np.inf)
        equations.enter(i)
        times = boundaries[i] + widths[i] * fine.c
        asked = tuple(equations.index_at(time) for time in times.tolist())
        nearby = {name: float(signals[name][i, 0]) for name in unknowns.algebraics}
        slopes = (states[:, i, -1] - states[:, i, 0]) / widths[i]
        nearby |= {f"d {name}": float(slopes[names.index(name)]) for name in unknowns.implicit}
        try:
            result = step_element(
                equations, fine, float(widths[i]), asked, {name: values.copy() for name, values in signals.items()},
                {name: np.full((len(widths), fine.stages), np.nan) for name in names}, i, unknowns,
                dict(zip(names, start.tolist(), strict=True)), nearby,
            )  # fmt: skip
        except (ArithmeticError, ValueError):  # on the way to a solution, or at it, an equation has no value
            result = np.inf
        if isinstance(result, float):
            return np.full((len(fine.state_nodes), len(names)), np.inf)
        return np.array([result[name] for name in names]).T

    local = np.array([stepped(i, states[:, i, 0]) for i in range(len(widths))])
    whole = [local[0] if first is None else stepped(0, first)]
    for i in range(1, len(widths)):
        whole.append(stepped(i, whole[-1][-1]))
    equations.point.leave_nodes()
    carried = np.array(whole)
    return Flows(local, carried if np.isfinite(carried).all() else None, 0.0), fine.state_nodes
