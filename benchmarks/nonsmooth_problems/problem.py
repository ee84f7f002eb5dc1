"""What every problem here offers: a model, what is known about its answer, an assessment by independent numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

from .filippov import Chattering


@dataclass(frozen=True)
class Assessment:
    """How good the values on a model are; nothing of it comes from a solver.

    Attributes
    ----------
    violation : float
        Largest violation of the stated equations, bounds and constraints, recomputed by `Trajectory.verify`.
    natural_residual : float
        Largest ``|min(a, b)|`` over all complementarity pairs, recomputed likewise.
    objective : float
    objective_error : float or None
        Relative to the known optimum; negative where the discretised problem is better. None where none is known.
    deviation : float
        Largest difference, over the element boundaries, between the plan and the true motion under the plan's
        own controls: closed form, or an integration that locates every switch.
    faults : tuple of str
        What is not as it must be; empty when the problem is solved.
    """

    violation: float
    natural_residual: float
    objective: float
    objective_error: float | None
    deviation: float
    faults: tuple[str, ...]

    @property
    def solved(self) -> bool:
        """True when nothing is wrong."""
        return not self.faults


@dataclass(frozen=True)
class NonsmoothProblem:
    """A problem with a known answer.

    Attributes
    ----------
    name : str
    build : callable
        ``build(elements, stages, scheme)`` states the model; it has one phase, ``m.phase``, and one objective. With
        ``moving=True`` the boundaries of the elements move; with ``detect=True`` pairs are sums over an element, too.
    deviation : callable
        ``deviation(model)`` compares the plan with the true motion; see `Assessment`.
    optimum : callable or None
        ``optimum()`` is the best objective in continuous time.
    accuracy : float
        Allowed relative error of the objective, and allowed `deviation`, both with 50 elements. A step that contains
        a switch costs an error of the order of its width, whatever the scheme: both grow with the width.
    """

    name: str
    build: Callable[..., pyo.ConcreteModel]
    deviation: Callable[[pyo.ConcreteModel], float]
    optimum: Callable[[], float] | None
    accuracy: tuple[float, float]

    def assess(self, model: pyo.ConcreteModel, tolerance: float = 1e-6, residual: float = 1e-6) -> Assessment:
        """Assess the values on a model of this problem.

        Parameters
        ----------
        model : ConcreteModel
            From `build`, with values.
        tolerance, residual : float
            Largest allowed violation and natural residual.
        """
        (objective,) = (pyo.value(found) for found in model.component_data_objects(pyo.Objective, active=True))
        try:
            verified = model.phase.trajectory().verify()
        except rcp.errors.PyRobocopError as error:  # boundaries that moved past each other make no trajectory
            return Assessment(inf, inf, objective, None, inf, (str(error),))
        violation = max(verified.defect, verified.continuity, verified.equations, verified.bounds)
        best = None if self.optimum is None else self.optimum()
        error = None if best is None else (objective - best) / abs(best)
        try:
            deviation = self.deviation(model)
        except Chattering:
            deviation = inf
        coarseness = 50 / model.phase.trajectory().grid.mesh.elements
        allowed_error, allowed_deviation = (coarseness * allowed for allowed in self.accuracy)
        faults = []
        for what, number, allowed in (
            ("violation", violation, tolerance),
            ("natural residual", verified.natural_residual, residual),
            ("objective error", 0.0 if error is None else abs(error), allowed_error),
            ("deviation", deviation, allowed_deviation),
        ):
            if not number <= allowed:  # a NaN is a fault as well
                faults.append(f"{what} {number:.1e} > {allowed:.1e}")
        return Assessment(violation, verified.natural_residual, objective, error, deviation, tuple(faults))


def element_controls(trajectory: rcp.Trajectory, name: str) -> np.ndarray:
    """Values of a control that is constant on each element, shape ``(N,)``."""
    return trajectory.element_signals(name)[:, 0]


def at_boundaries(trajectory: rcp.Trajectory, *names: str) -> np.ndarray:
    """States at the element boundaries, shape ``(N + 1, states)``."""
    columns = [np.append(trajectory.element_states(name)[:, 0], trajectory.states[name][-1]) for name in names]
    return np.column_stack(columns)
