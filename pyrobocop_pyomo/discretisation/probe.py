"""`DiscretisationProbe`: the values and multipliers of an answer, from which its errors are estimated on demand."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.objective import Objective, maximize

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.flows import integrate_elements
from pyrobocop_pyomo.numerics.tables import tables_continued
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.bounds_between_points import bounds_passed, sentence_on_bounds
from pyrobocop_pyomo.phases.companions import indices_of
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.phases.rate_arrays import RateArrays
from pyrobocop_pyomo.trajectories import Trajectory

from .estimates import DiscretisationEstimate, PhaseEstimate
from .integral_weights import integral_weights
from .lagrangian import PhaseLagrangian
from .phase_multipliers import PhaseMultipliers, no_multipliers, phase_multipliers
from .row_multipliers import RowMultipliers

logger = logging.getLogger(__name__)

# Of the integration of each element, relative to the size of each state; a state that stays at zero has a size too.
_TOLERANCE, _SMALLEST_SCALE = 1e-8, 1e-6
# Where rules are evaluated at each instant, which takes a thousand times as long, and what they say may jump.
_TOLERANCE_BY_INSTANT = 1e-3
_SAMPLES = 2
# A control that passes its bound by more than this part of its size is told beside the states.
_LARGE = 1e-2


class DiscretisationProbe:
    """What an answer says of its own mesh.

    Parameters
    ----------
    model : Block
        Holding the answer. What is read of it is read now; the rules of its phases are evaluated when errors are.
    multipliers : callable
        Gives `RowMultipliers`, or None.
    objective : float
        Of the answer.
    """

    def __init__(self, model: Any, multipliers: Callable[[], RowMultipliers | None], objective: float) -> None:
        self._objective = objective
        self._found: DiscretisationEstimate | None = None
        self._phases: list[_Captured] = []
        phases = phases_of(model)
        if phases:
            with PauseGC():  # many small objects, all of which live on
                self._capture(model, phases, multipliers)

    def _capture(self, model: Any, phases: list[Any], multipliers: Callable[[], RowMultipliers | None]) -> None:
        sign, weights, known, why = 1.0, {}, multipliers(), "the solver gave no multipliers."
        if known is not None:
            try:
                weights = integral_weights(model, phases, known)
                goals = [data.sense for data in model.component_data_objects(Objective, active=True)]
                sign = -1.0 if maximize in goals else 1.0
            except (PyRobocopError, ArithmeticError, ValueError, TypeError) as error:
                known, why = None, str(error)
        for phase in phases:
            try:
                self._phases.append(_Captured(phase, known, weights.get(id(phase), []), sign, why))
            # TypeError: rows of steps, and components that were renamed, are not where a phase has them.
            except (PyRobocopError, ArithmeticError, ValueError, LookupError, TypeError) as error:
                logger.info("phase '%s': nothing is known of the errors of its mesh: %s", phase.name, error)

    def error(self) -> DiscretisationEstimate:
        """The errors, estimated when they are requested first."""
        if self._found is None:
            with tables_continued():
                errors = {captured.phase.name: captured.error(self._objective) for captured in self._phases}
            self._found = DiscretisationEstimate(self._objective, errors)
            self._phases = []  # what was captured, the model among it, is not needed any more
        return self._found

    def __getstate__(self) -> dict[str, Any]:
        # A pickle holds no model.
        return {"_objective": self._objective, "_found": self.error(), "_phases": []}


class _Captured:
    """One phase: its values, and its multipliers where they are known."""

    def __init__(self, phase: Any, known: RowMultipliers | None, weights: list[float], sign: float, why: str) -> None:
        self.phase, self._weights, self._sign, self._why = phase, weights, sign, why
        self._trajectory: Trajectory = PhaseValues(phase).trajectory(evaluate=False)
        self._multipliers: PhaseMultipliers | None = None
        self._rows = no_multipliers(phase)
        if any(True for _ in phase.component_data_objects(PAIR_TYPES, active=True)):
            # On finer meshes of a slider that is pushed the estimate stayed at twenty times the objective.
            self._why = "It has pairs, whose forces and multipliers jump inside elements."
        elif known is not None:
            try:
                self._multipliers = phase_multipliers(phase, known, self._trajectory.grid.mesh.widths)
            except TrajectoryError as error:
                self._why = str(error)

    def error(self, size: float) -> PhaseEstimate:
        """The errors of the phase, as far as they can be estimated; `size` is that of the objective."""
        remarks = []
        motion, state, largest, objective, net, flattered = None, "", 0.0, None, None, 0.0
        name = self.phase.name
        try:
            self._refuse_other_rules()
            motion, state, largest = self._motion()
        except Exception as error:  # rules that were written for single instants may raise anything
            remarks.append(f"phase '{name}': error of the motion not estimated. {_said(error)}")
        try:
            self._refuse_other_rules()
            if self._multipliers is None:
                raise TrajectoryError(self._why)
            nets, objective, parts = PhaseLagrangian(
                self.phase, self._trajectory, self._multipliers, self._weights, self._sign
            ).errors(abs(size))
            net, flattered = float(nets.sum()), float(parts.sum())
        except Exception as error:  # as above
            remarks.append(f"phase '{name}': error of the objective not estimated. {_said(error)}")
        excesses = relative_excesses = None
        try:
            self._refuse_other_rules()
            none = [0.0] * len(self.phase.record.integrals)
            limits = PhaseLagrangian(self.phase, self._trajectory, self._rows, none, self._sign)
            excesses, relative_excesses = (limits.excesses(smallest) for smallest in (1.0, _SMALLEST_SCALE))
        except Exception as error:  # as above
            remarks.append(f"phase '{name}': what is passed between the points is not known. {_said(error)}")
        passed = bounds_passed(self.phase.record, self._trajectory)
        # A control with a value at each point passes a bound by a little wherever it is on it: verify() tells that.
        told = {name: one for name, one in passed.items() if not one.is_control or one.excess > _LARGE * one.size}
        beyond = sentence_on_bounds(told)
        order = self._trajectory.grid.scheme.order
        return PhaseEstimate(
            name, order, motion, state, largest, objective, tuple(remarks), net, flattered, excesses, relative_excesses,
            f"phase '{name}': {beyond}" if beyond else "",
        )  # fmt: skip

    def _refuse_other_rules(self) -> None:
        if self.phase.record.discrete_states:
            raise TrajectoryError("Step maps lead its states; on another mesh it would be another motion.")

    def _motion(self) -> tuple[Array, str, float]:
        """Errors of the elements relative to each state, and where the largest one is, in its own units."""
        record, trajectory = self.phase.record, self._trajectory
        names = record.names_of_states
        implicit = sorted(set(names) - set(record.equation_of))
        if implicit or not names:
            raise TrajectoryError(f"Without explicit equation: {', '.join(implicit)}." if implicit else "No states.")
        indices = indices_of(record, trajectory.grid)
        rates = RateArrays(self.phase, record, trajectory, indices, by_instant=True)
        starts = np.array([trajectory.element_states(name)[:, 0] for name in names]).T
        sizes = _SMALLEST_SCALE + np.array([np.abs(trajectory.states[name]).max() for name in names])
        tolerance = _TOLERANCE_BY_INSTANT if rates.asks_by_instant else _TOLERANCE
        found = integrate_elements(rates, starts, sizes, np.linspace(0.0, 1.0, _SAMPLES + 1), tolerance)
        if found is None:
            raise TrajectoryError(
                "No integration of all elements at once meets its tolerance: the motion is not smooth."
            )
        ends = np.array([[*starts[1:, j], trajectory.states[name][-1]] for j, name in enumerate(names)]).T
        errors = np.abs(found[0] - ends)
        relative = errors / sizes
        worst = int(relative.max(axis=0).argmax())
        return relative.max(axis=1), names[worst], float(errors[:, worst].max())


def _said(error: Exception) -> str:
    return str(error) if isinstance(error, PyRobocopError) else f"{type(error).__name__}: {error}"
