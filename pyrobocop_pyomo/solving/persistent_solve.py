"""`PersistentSolve`: a model with pairs, relaxed and compiled once, and solved for other numbers from known points."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.ipopt.ipopt_library import load_ipopt_library
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.lpec import ZERO_SIDE
from pyrobocop_pyomo.mpcc.stationarity import Stationarity
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint

from .ipopt_options import DEFAULT_WITH_PAIRS, IPOPT_TOLERANCE
from .iterate_log import IterateLog, ModelCheck
from .iterates import Iterate, Quality, StopReason
from .polish import Exploration, Polish
from .relaxed_model import forget_removed, relaxed_model
from .settings import Settings
from .solve_result import SolveResult


class PersistentSolve:
    """Solves a model near a point that solves it for other numbers: on the branch of that point, and on to others.

    A context: on leaving it, the model has its pairs back. Between two solves mutable Params, values of fixed
    variables and bounds of rows may change. The answer depends on the point and the numbers alone, not on what was
    solved before.

    Parameters
    ----------
    model : Block
    settings : Settings

    Attributes
    ----------
    decided_pairs : int
        Pairs that bounds had decided when the model was relaxed. Where there are any, other bounds would decide
        otherwise: relax the model anew then.

    Raises
    ------
    ModelError, SolverNotFoundError
        When the model cannot be compiled with vectorised expressions.
    """

    def __init__(self, model: Any, settings: Settings) -> None:
        self._model = model
        self._settings = replace(settings, options=settings.options.with_default(DEFAULT_WITH_PAIRS))
        self._check = ModelCheck(model)
        self._values = VariableValues.of_free(model)
        self._stack = contextlib.ExitStack()
        # Below any tolerance: the relaxing rows are left out of what is solved here.
        relaxation = relaxed_model(model, settings.relaxation, settings.grouping, IPOPT_TOLERANCE)
        with contextlib.ExitStack() as opened:
            self._relaxed = opened.enter_context(relaxation)
            self._compiled = CompiledModel(model, "vectorised")
            self._stack = opened.pop_all()
        self.decided_pairs = len(self._relaxed.decided)

    def __enter__(self) -> PersistentSolve:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()
        forget_removed(self._model)

    def solve(self, near: Sequence[float | None], deadline: Deadline) -> SolveResult:
        """Solve with the numbers that stand on the model now, and put the point that was found on it.

        Parameters
        ----------
        near : sequence of float or None
            Values of the variables that were free when this was made, where to start.
        deadline : Deadline

        Returns
        -------
        SolveResult
            Ask it for its quality and certificate: away from the branches around `near` it looks nowhere.
        """
        started = time.perf_counter()
        settings = replace(self._settings, deadline=deadline)
        self._check.read_bounds()
        self._compiled.update()
        self._values.write(near)
        self._relaxed.start_lifted()
        log = IterateLog(self._check, settings.progress)
        log.check_pairs(self._relaxed.pairs)
        # The branch is solved exactly: only where both sides are zero are there others through the point.
        polish = Polish(
            settings, self._relaxed, self._compiled, log, self._values, Exploration(0.0, started), biactive=ZERO_SIDE
        )
        start = Iterate("start", values=list(near), strategy="neighbour", stop_reason=StopReason.FAILED)
        nlp = self._compiled.nlp
        # Multipliers of other numbers are not known here, and ones at every bound would push into the interior.
        none = np.zeros(nlp.n)
        point = PrimalDualPoint(self._compiled.current_point(), np.zeros(nlp.m), none, none)
        best = polish.improve(start, point, reach=np.inf)
        self._values.write(best.values)
        best.load_suffixes()
        return self._result(best, log, polish, started)

    def _result(self, best: Iterate, log: IterateLog, polish: Polish, started: float) -> SolveResult:
        # Of what is proven already, the kind of its multipliers is not worth more linear programs.
        known = polish.interrupted or best.certificate is Certificate.PROVEN
        multipliers = None if known else best.classify()
        if multipliers is not None and multipliers.kind is Stationarity.S:
            best = replace(best, certificate=Certificate.PROVEN)
        tolerances = self._settings.tolerances
        return SolveResult(
            name=self._model.name,
            stop_reason=StopReason.INTERRUPTED if polish.interrupted else best.stop_reason,
            quality=best.quality(tolerances),
            best=best.record(),
            multipliers=multipliers,
            residuals=log.residuals(),
            steps=log.steps,
            standing=best.standing(tolerances, self._check.sign),
            decided_pairs=self.decided_pairs,
            solver=str(load_ipopt_library()),
            derivatives=self._compiled.nlp.derivatives,
            checking_seconds=log.seconds,
            seconds=time.perf_counter() - started,
        )


def is_certified(result: SolveResult) -> bool:
    """Whether a result needs no second opinion: optimal, and where there are pairs no branch through it descends."""
    return result.quality is Quality.OPTIMAL and (
        not result.residuals or (result.certificate is Certificate.PROVEN and result.largest_natural_residual <= 1e-6)
    )
