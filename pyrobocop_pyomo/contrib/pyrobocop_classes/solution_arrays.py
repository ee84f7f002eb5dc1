"""A solution as the arrays that PyRoboCOP's ``parsesolution`` gives."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases import Algebraic, Control, State


class SolutionArrays(NamedTuple):
    """Values by element, variable and point; what unpacks into ``x, xdot, y, u, p``.

    Attributes
    ----------
    x : array, shape (N + 1, n_d, K + 1)
        States at the start of each element, then at its K points; at last the final state, in all columns.
    xdot : array, shape (N, n_d, K)
    y : array, shape (N, n_a, K)
    u : array, shape (N, n_u, K)
    p : array, shape (n_p,)
    """

    x: Array
    xdot: Array
    y: Array
    u: Array
    p: Array


def solution_arrays(model: Any) -> SolutionArrays:
    """The values that stand on a model of `from_pyrobocop`.

    Parameters
    ----------
    model : ConcreteModel

    Raises
    ------
    ModelError
        When the model was not made by `from_pyrobocop`.
    """
    phase = model.component("phase")
    if phase is None or phase.component("x0") is None:
        raise ModelError(f"'{model.name}' was not made by from_pyrobocop.")
    trajectory = phase.trajectory()
    names = {kind: phase.record.names(kind) for kind in (State, Algebraic, Control)}
    elements, stages = len(trajectory.grid.node_times), trajectory.grid.scheme.stages

    def stacked(parts: list[Array]) -> Array:
        return np.stack(parts, axis=1) if parts else np.empty((elements, 0, stages))

    states = stacked([trajectory.element_states(name)[:, : stages + 1] for name in names[State]])
    final = np.array([trajectory.states[name][-1] for name in names[State]])
    return SolutionArrays(
        np.concatenate([states, np.repeat(final[None, :, None], stages + 1, axis=2)]),
        stacked([trajectory.element_rates(name) for name in names[State]]),
        stacked([trajectory.element_signals(name) for name in names[Algebraic]]),
        stacked([trajectory.element_signals(name) for name in names[Control]]),
        np.array(list(trajectory.parameters.values())),
    )
