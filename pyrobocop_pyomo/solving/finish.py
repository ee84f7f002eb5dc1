"""The end of a strategy: exactly complementary, on the best branch around, with multipliers and a certificate."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_library import load_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, Candidate, Certificate, Limits, candidate_at
from pyrobocop_pyomo.mpcc.branch import restricted
from pyrobocop_pyomo.mpcc.linearisation import Linearisation
from pyrobocop_pyomo.mpcc.multipliers import MultiplierProblem, classify, strong_multipliers
from pyrobocop_pyomo.mpcc.stationarity import Multipliers, Stationarity
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, lagrangian_residual

from .attempt import StepRecorder, stop_reason
from .finding import Finding
from .numeric_pairs import numeric_pairs, without_crossed
from .relaxed_model import RelaxedModel
from .session import WARM_START_OPTIONS, Run
from .settings import Settings
from .solve_result import Quality, Step, StopReason
from .variable_values import VariableValues

logger = logging.getLogger(__name__)

# Enough to leave a bound that the branch does not hold any more, little enough to stay near the point.
POLISH_OPTIONS = {
    **WARM_START_OPTIONS,
    "mu_init": 1e-6,
    # In a degenerate branch multipliers grow without bound, and Ipopt would take its tolerance relative to them.
    "s_max": 1e8,
    "warm_start_bound_push": 1e-8,
    "warm_start_bound_frac": 1e-8,
    "warm_start_slack_bound_push": 1e-8,
    "warm_start_slack_bound_frac": 1e-8,
    "warm_start_mult_bound_push": 1e-8,
}


# Up to here a look beyond the nearest solution costs little, and finds the better optimum now and then.
EXPLORED_PAIRS = 100


POLISHED_VIOLATION = 1e-2


class Finish:
    """Works on one relaxed model, as numbers.

    Parameters
    ----------
    settings : Settings
    relaxed : RelaxedModel
    written : CompiledModel
        Of the relaxed model.
    recorder : StepRecorder
    values : VariableValues
        The user's variables.
    left : callable
        Seconds that are left, or None.
    explored : set
        Branches that need not be explored again; grows.
    """

    def __init__(
        self,
        settings: Settings,
        relaxed: RelaxedModel,
        written: CompiledModel,
        recorder: StepRecorder,
        values: VariableValues,
        left: Callable[[], float | None],
        explored: set[bytes],
    ) -> None:
        self._settings, self.written, self._recorder = settings, written, recorder
        self._values, self._left = values, left
        self._library = load_ipopt_library()
        self._explored = explored
        self._crossed = relaxed.crossed
        self._program, self._kept_rows = numeric_pairs(written, relaxed.lifted, relaxed.relaxing_rows, relaxed.crossed)
        self._explores = self._program.pairs <= EXPLORED_PAIRS
        self._limits = Limits(feasibility=settings.tolerances.feasibility)

    def improve(self, finding: Finding, multipliers: tuple[FloatArray, FloatArray, FloatArray]) -> Finding:
        """Polish the point on the model, follow descending branches, and certify where that ends.

        Where a function has no derivative at an exactly complementary point, the finding stays as it is.
        """
        try:
            return self._improved(finding, multipliers)
        except EvaluationError as error:
            logger.info("strategy '%s': its point cannot be polished or certified: %s", finding.strategy, error)
            self._values.write(finding.values)
            return finding

    def _improved(self, finding: Finding, multipliers: tuple[FloatArray, FloatArray, FloatArray]) -> Finding:
        start = candidate_at(self._program, self.written.current_point(), self._without_relaxing_rows(multipliers))
        search = self._search()
        # Far from feasible the nearest branch means nothing: that is for other strategies.
        polished = search.polish(start) if start.violation <= POLISHED_VIOLATION else start
        return self._judged(finding, search, polished, start)

    def project(self, finding: Finding) -> Finding:
        """Look for a feasible branch near the point on the model."""
        x = self.written.current_point()
        nlp = self._program.nlp
        start = candidate_at(self._program, x, (np.zeros(nlp.m), np.ones(nlp.n), np.ones(nlp.n)))
        search = self._search()
        return self._judged(replace(finding, strategy="projection"), search, search.project(start), start)

    def _judged(self, finding: Finding, search: ActiveSetSearch, found: Candidate, start: Candidate) -> Finding:
        best, certificate = self._certified(search, found)
        if self._explores and certificate is Certificate.PROVEN and best.branch is not None:
            explored = search.explore(best, self._explored)
            if explored is not best:
                best, certificate = self._certified(search, explored)
                finding = replace(finding, outdone=True)
        self.written.load_point(best.x)
        if best is not start:
            finding = self._replaced(finding, best)
        explain = functools.cache(functools.partial(self._explained, best))
        finding = replace(finding, certificate=certificate, explain=explain)
        if finding.quality(self._settings.tolerances) is not Quality.FEASIBLE:
            return finding
        # What Ipopt said does not count where multipliers are at hand that show the point to be stationary.
        multipliers = explain()
        if multipliers is None or multipliers.kind is Stationarity.NONE:
            return finding
        return replace(finding, reason=StopReason.FINISHED, stationarity=multipliers.residual)

    def _certified(self, search: ActiveSetSearch, found: Candidate) -> tuple[Candidate, Certificate]:
        """Follow descending branches, unless the multipliers show already that there are none."""
        if found.branch is None or found.violation > self._limits.feasibility:
            return found, Certificate.UNKNOWN
        if self._strong(found, Linearisation.at(self._program.nlp, found.x)) is not None:
            return found, Certificate.PROVEN
        descended = search.descend(found)
        return descended, search.certificate

    def _explained(self, found: Candidate) -> Multipliers | None:
        """Multipliers of the strongest kind at a point; None where it is not met, or there was no time."""
        if max(found.violation, found.natural_residual) > self._settings.tolerances.natural:
            return None
        point = Linearisation.at(self._program.nlp, found.x)
        multipliers = self._strong(found, point) or classify(
            MultiplierProblem(self._program, point), time_limit=self._limits.lpec_seconds
        )
        return None if multipliers is None else without_crossed(multipliers, self._crossed)

    def _replaced(self, finding: Finding, found: Candidate) -> Finding:
        """The finding at a point that a branch gave."""
        step, outcome = next((step, outcome) for step, outcome, candidate in self._solved if candidate is found)
        assert found.branch is not None
        return replace(
            finding,
            values=self._values.read(),
            step=step,
            reason=stop_reason(step),
            stationarity=lagrangian_residual(restricted(self._program, found.branch), found.x, *found.multipliers),
            load_suffixes=InProcessSolutionLoader(self.written, self._with_all_rows(outcome)).load_import_suffixes,
        )

    def _strong(self, found: Candidate, point: Linearisation) -> Multipliers | None:
        if found.branch is None or found.violation > self._limits.feasibility:
            return None
        return strong_multipliers(self._program, point, found.branch, found.multipliers)

    def _search(self) -> ActiveSetSearch:
        self._solved: list[tuple[Step, IpoptOutcome, Candidate]] = []
        return ActiveSetSearch(self._program, self._solve, self._limits, self._record)

    def _solve(self, nlp: NonlinearProgram, start: Candidate, iterations: int) -> IpoptOutcome:
        options: Mapping[str, Any] = {**POLISH_OPTIONS, **self._settings.options}
        options = {**options, "max_iter": min(iterations, options["max_iter"])}
        left = self._left()
        if left is not None:
            options = {**options, "max_wall_time": max(left, 1e-3)}
        if int((nlp.x_lower < nlp.x_upper).sum()) < int((nlp.g_lower == nlp.g_upper).sum()):
            # Ipopt refuses more equations than variables that it may move, even where they agree.
            options = {**options, "fixed_variable_treatment": "relax_bounds"}
        return run_ipopt(
            self._library,
            nlp,
            options,
            x=start.x,
            g_multipliers=start.g_multipliers,
            lower_multipliers=start.lower_multipliers,
            upper_multipliers=start.upper_multipliers,
            output=self._settings.output,
        )

    def _record(self, purpose: str, outcome: IpoptOutcome, found: Candidate, kept: bool) -> None:
        self.written.load_point(found.x)
        mu = outcome.records[-1].mu if outcome.records else None
        label = purpose if kept else f"{purpose} (not kept)"
        step = self._recorder.record(Run(label, None, mu, outcome.status, outcome.iterations, outcome.seconds))
        self._solved.append((step, outcome, found))

    def _without_relaxing_rows(
        self, multipliers: tuple[FloatArray, FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        return multipliers[0][self._kept_rows], *multipliers[1:]

    def _with_all_rows(self, outcome: IpoptOutcome) -> IpoptOutcome:
        every = np.zeros(self.written.nlp.m)
        every[self._kept_rows] = outcome.g_multipliers
        return replace(outcome, g_multipliers=every)
