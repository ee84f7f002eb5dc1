"""Elements with implicit and algebraic equations, stepped anew by a finer scheme under the controls of a trajectory."""

from __future__ import annotations

from itertools import pairwise
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
from .quick_instants import SAMPLES, instants_to_look_at
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
) -> Flows:
    """Every element by a Radau scheme of two stages more, with the values of the trajectory on the model.

    Where rules change quickly with the time each element takes many such steps.

    Returns
    -------
    Flows
        At the nodes of the finer scheme; infinite where the equations of an element have no solution.
    """
    names = record.names_of_states
    indices = indices_of(record, trajectory.grid)
    equations = PointEquations(block, record, indices, trajectory.grid, trajectory.parameters)
    stated = [statement for statement in record.statements if statement.kind in ("ode", "residual")]
    check_rules_between_points(block, record, equations.point, stated)
    equations.point.set_values(equations.parameters)
    equations.point.past = past_of(trajectory)
    fine = radau(trajectory.grid.scheme.stages + _MORE_STAGES)
    looked_at = instants_to_look_at(block, record, trajectory, indices, stated)
    parts = list(pairwise(looked_at.tolist() if len(looked_at) > SAMPLES + 1 else [0.0, 1.0]))
    nodes = [start + (end - start) * fine.state_nodes for start, end in parts]
    fractions = np.concatenate([nodes[0], *(of[1:] for of in nodes[1:])])
    boundaries, widths = trajectory.grid.mesh.boundaries, trajectory.grid.mesh.widths
    states = np.array([trajectory.element_states(name) for name in names])
    weights = [trajectory.grid.scheme.stage_polynomial_at(start + (end - start) * fine.c).T for start, end in parts]
    signals = [{name: trajectory.element_signals(name) @ at for name in trajectory.signals} for at in weights]

    def stepped(i: int, start: Array) -> Array:
        """States at the nodes of one element, shape ``(k, n)``."""
        paths = [start[None]]
        for part in range(len(parts)):
            paths.append(part_stepped(i, part, paths[-1][-1])[1:])
        return np.concatenate(paths)

    def part_stepped(i: int, part: int, start: Array) -> Array:
        if not np.isfinite(start).all():
            return np.full((len(fine.state_nodes), len(names)), np.inf)
        equations.enter(i)
        begin, end = parts[part]
        times = boundaries[i] + widths[i] * (begin + (end - begin) * fine.c)
        asked = tuple(equations.index_at(time) for time in times.tolist())
        nearby = {name: float(signals[part][name][i, 0]) for name in unknowns.algebraics}
        slopes = (states[:, i, -1] - states[:, i, 0]) / widths[i]
        nearby |= {f"d {name}": float(slopes[names.index(name)]) for name in unknowns.implicit}
        try:
            result = step_element(
                equations, fine, float(widths[i] * (end - begin)), asked,
                {name: values.copy() for name, values in signals[part].items()},
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
    return Flows(fractions, local, carried if np.isfinite(carried).all() else None, 0.0)
