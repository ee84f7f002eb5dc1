"""Copies of a model that are solved on the way, in another form or on another mesh; the user's variables stay out."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pyomo.core.base import TransformationFactory
from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo.diagnosis.difficult_forms import holds_absolute_value
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.phases import phases_of

from .found_points import SAME_OBJECTIVE
from .ipopt_options import ITERATIONS_OF_ONE
from .iterates import Iterate, Quality
from .progress import Progress
from .settings import Settings
from .solve_result import SolveResult
from .solve_state import SolveState
from .starts import EXPLORED_ELEMENTS, coarser_copy, elements_of_copy, take_values_of_copy
from .strategies import ABSOLUTE_VALUES, ADAPTIVE, COARSE_MESH, OTHER_OPTIMUM, SOLVE, Strategy

logger = logging.getLogger(__name__)


class SolvedCopies:
    """The copies of one solve.

    Parameters
    ----------
    state : SolveState
        Its log has the runs of copies too, under the names of their strategies.
    solve_copy : callable
        ``solve_copy(copy, settings)`` solves another model.
    """

    def __init__(self, state: SolveState, solve_copy: Callable[[Any, Settings], SolveResult]) -> None:
        self._model, self._values, self._settings = state.model, state.values, state.settings
        self._log, self._found, self._started, self._solve_copy = state.log, state.found, state.started, solve_copy

    def start_on_fewer_elements(self) -> bool:
        """Solve a copy with fewer elements; its answer is put on the model, as a start. False where there is none."""
        copy = coarser_copy(self._model)
        result = None if copy is None else self._answer(copy, COARSE_MESH, (SOLVE, ADAPTIVE))
        if result is None or result.quality is Quality.INFEASIBLE or self._found.cut is not None:
            return False
        take_values_of_copy(self._model, copy)
        return True

    def has_fewer_elements(self) -> bool:
        """Whether other starts are tried on fewer elements: where these are enough to tell optima of the problem."""
        return bool(elements_of_copy(self._model, EXPLORED_ELEMENTS))

    def start_at_other_optimum(self, work: float) -> bool:
        """Try other starts on a copy with fewer elements; where they lead to a better answer, put it on the model.

        The copy is solved from the answer on the model first: fewer elements may flatter the objective.

        Parameters
        ----------
        work : float
            Iterations that it may take, of the model's size.

        Returns
        -------
        bool
            Whether there is a better answer. False where less time is left than has passed.
        """
        left = self._settings.deadline.left
        # Making a copy is not cut off. There is an answer already: its solve tells what another one would take.
        if left is not None and left < time.perf_counter() - self._started:
            return False
        copy = coarser_copy(self._model, EXPLORED_ELEMENTS)
        if copy is None:
            return False
        share = elements_of(copy) / elements_of(self._model)
        result = self._answer(copy, OTHER_OPTIMUM, None, exploration=None, explored_work=work / share)
        if result is None or self._found.cut is not None:
            return False
        first = result.steps[0]
        gain = abs(first.objective - result.objective) > SAME_OBJECTIVE * max(1.0, abs(first.objective))
        # Of two solutions the copy has kept the better one.
        if result.quality is not Quality.OPTIMAL or result.best_step == 0 or not (gain or not first.converged):
            return False
        take_values_of_copy(self._model, copy)
        return True

    def with_absolute_values_split(self) -> Iterate | None:
        """Solve a copy with its absolute values in two parts; its answer is one of the model, and is checked there.

        Returns
        -------
        Iterate or None
            None where there are no absolute values, or the model is part of another one.
        """
        if self._model.model() is not self._model or not holds_absolute_value(self._model):
            return None
        split = TransformationFactory("pyrobocop.absolute_values_to_complementarity")
        copy = split.create_using(self._model)
        result = self._answer(copy, ABSOLUTE_VALUES, None)
        if result is None:
            return None
        take_values_of_copy(self._model, copy)
        best = replace(
            result.best,
            label=ABSOLUTE_VALUES.name,
            strategy=ABSOLUTE_VALUES.name,
            number=len(self._log.steps) - len(result.steps) + result.best_step,
            delta=None,
            values=self._values.read(),
            load_suffixes=lambda: _take_suffixes(self._model, copy),
        )
        if not self._log.pairs and best.certificate is Certificate.PROVEN:
            best = replace(best, certificate=Certificate.UNKNOWN)  # which is of pairs, and the model has none
        best = self._log.checked(best)
        self._settings.progress.line(best.line(pairs=bool(self._log.pairs)))
        return best

    def _answer(
        self, copy: Any, strategy: Strategy, strategies: tuple[Strategy, ...] | None, **changes: Any
    ) -> SolveResult | None:
        """Solve a copy, and log its runs as those of a strategy; None where it cannot be solved at all."""
        options = self._settings.options.with_default({"max_iter": ITERATIONS_OF_ONE})
        settings = replace(self._settings, options=options, strategies=strategies, progress=Progress(False), **changes)
        try:
            result = self._solve_copy(copy, settings)
        except PyRobocopError as error:
            logger.info("'%s': no answer of the copy for '%s': %s", self._model.name, strategy.name, error)
            return None
        for step in result.steps:
            self._log.steps.append(replace(step, label=strategy.name, number=len(self._log.steps)))
        if result.stop_reason.is_final:
            self._found.cut = result.stop_reason
        return result


def elements_of(model: Any) -> int:
    """Of all phases together."""
    return sum(phase.grid.mesh.elements for phase in phases_of(model))


def _take_suffixes(model: Any, copy: Any) -> None:
    """What the solve of a copy has written to its suffixes, for the components that the model has too."""
    for suffix in model.component_objects(Suffix, active=True):
        for part, number in copy.find_component(suffix).items():
            own = None if part is None else model.find_component(part)
            if suffix.import_enabled() and own is not None:
                suffix[own] = number
