"""Local error of each element, for phases with explicit, implicit and algebraic equations."""

from __future__ import annotations

from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError, TrajectoryError
from pyrobocop_pyomo.numerics import Array, radau
from pyrobocop_pyomo.trajectories import Trajectory

from .between_points import check_rules_between_points
from .companions import indices_of, put_on_model
from .declarations import Algebraic
from .element_integration import Unknowns, find_unknowns, step_element
from .point_model import PointEquations
from .record import PhaseRecord
from .verification import element_errors as reintegrated_errors

_MORE_STAGES = 2


def estimate_element_errors(block: Any, record: PhaseRecord, trajectory: Trajectory) -> Array:
    """How far each element ends from where the equations lead from its own start, shape ``(N,)``.

    Controls are taken as the trajectory's polynomials. Explicit equations are integrated by SciPy; with implicit or
    algebraic equations each element is stepped anew by a Radau scheme of two stages more.

    Raises
    ------
    TrajectoryError
        When there are no states, or a step map leads them, or the equations do not determine the algebraics.
    """
    names = record.names_of_states
    if not names:
        raise TrajectoryError(f"phase '{block.name}' has no states: there is no error to estimate.")
    if record.discrete_states:
        raise TrajectoryError(
            f"phase '{block.name}': no error of discretisation of {', '.join(sorted(record.discrete_states))}. A step "
            "leads them from element to element; on another mesh it would be another motion."
        )
    if set(record.equation_of) == set(names):
        return reintegrated_errors(block, record, trajectory)
    unknowns = _unknowns(block, record)
    with put_on_model([(block, trajectory)]):
        return _stepped_errors(block, record, trajectory, unknowns)


def _stepped_errors(block: Any, record: PhaseRecord, trajectory: Trajectory, unknowns: Unknowns) -> Array:
    """Errors of elements that are stepped anew, with the values of the trajectory on the model."""
    names = record.names_of_states
    indices = indices_of(record, trajectory.grid)
    equations = PointEquations(block, record, indices, trajectory.grid, trajectory.parameters)
    stated = [statement for statement in record.statements if statement.kind in ("ode", "residual")]
    check_rules_between_points(block, record, equations.point, stated)
    equations.point.set_values(equations.parameters)
    fine = radau(trajectory.grid.scheme.stages + _MORE_STAGES)
    to_fine = trajectory.grid.scheme.stage_polynomial_at(fine.c)
    boundaries, widths = trajectory.grid.mesh.boundaries, trajectory.grid.mesh.widths
    states = {name: trajectory.element_states(name) for name in names}
    signals = {name: trajectory.element_signals(name) @ to_fine.T for name in trajectory.signals}
    errors = np.empty(len(widths))
    for i, width in enumerate(widths):
        equations.enter(i)
        times = boundaries[i] + width * fine.c
        asked = tuple(equations.index_at(time) for time in times.tolist())
        start = {name: float(states[name][i, 0]) for name in names}
        nearby = {name: float(signals[name][i, 0]) for name in unknowns.algebraics}
        nearby |= {f"d {name}": float(states[name][i, -1] - states[name][i, 0]) / width for name in unknowns.implicit}
        result = step_element(
            equations, fine, width, asked, {name: values.copy() for name, values in signals.items()},
            {name: np.full((len(widths), fine.stages), np.nan) for name in names}, i, unknowns, start, nearby,
        )  # fmt: skip
        if isinstance(result, float):
            errors[i] = np.inf
            continue
        last = i + 1 == len(widths)
        reached = {name: trajectory.states[name][-1] if last else states[name][i + 1, 0] for name in names}
        errors[i] = max(abs(result[name][-1] - reached[name]) for name in names)
    equations.point.leave_nodes()
    return errors


def _unknowns(block: Any, record: PhaseRecord) -> Unknowns:
    """Algebraics are found anew where residual equations determine them all, else taken from the trajectory."""
    for given in ({}, dict.fromkeys(record.names(Algebraic))):
        try:
            found = find_unknowns(block, record, given)
        except InitialGuessError:
            continue
        if not found.contact:  # between its points an element knows nothing of pairs
            return found
    raise TrajectoryError(
        f"phase '{block.name}': the error of its elements cannot be estimated, since its residual equations "
        "determine neither all algebraics nor the derivatives alone."
    )
