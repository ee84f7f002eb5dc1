"""The polish of a nearly complementary point: exact pairs, the best branch around, multipliers and a certificate."""

from __future__ import annotations

import functools
import logging
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Certificate, Limits
from pyrobocop_pyomo.mpcc.multipliers import (
    STATIONARY,
    MultiplierProblem,
    Multipliers,
    Stationarity,
    classify,
    strong_multipliers,
)
from pyrobocop_pyomo.mpcc.problem import Linearisation, nearest_branch, restricted
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.automatic_scaling import objective_slope, variable_sizes
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint, stationarity

from .ipopt_options import OVERDETERMINED, POLISH
from .iterates import Iterate, Quality, StopReason
from .numeric_pairs import numeric_pairs, without_crossed
from .record import Record
from .session import Session
from .strategies import Settings

logger = logging.getLogger(__name__)

# Far from feasible the nearest branch means nothing: that is for other strategies.
POLISHED_VIOLATION = 1e-2
# A pair this near to a change of its branch is looked at, as if it were there.
NEARLY_BIACTIVE = 1e-3


class Polish:
    """Works on one relaxed model, as numbers.

    Parameters
    ----------
    settings : Settings
    relaxed : RelaxedModel
    compiled : CompiledModel
        Of the relaxed model.
    record : Record
    values : VariableValues
        The user's variables.

    Attributes
    ----------
    has_diverged : bool
        Whether variables grew without end on one of the branches.
    """

    def __init__(
        self,
        settings: Settings,
        relaxed: RelaxedModel,
        compiled: CompiledModel,
        record: Record,
        values: VariableValues,
    ) -> None:
        self._settings, self._compiled, self._record, self._values = settings, compiled, record, values
        self._crossed = relaxed.crossed
        # What is absolute in linear programs, and where a branch ends, then means the same for every objective.
        self._slope = objective_slope(compiled, below=1.0)
        self._program, self._relaxing_rows = numeric_pairs(
            compiled, relaxed.lifted, relaxed.relaxing_rows, relaxed.crossed, objective=self._slope
        )
        self._limits = Limits(feasibility=settings.tolerances.feasibility)
        self.has_diverged = False
        self._solved: dict[int, tuple[Iterate, IpoptOutcome]] = {}
        self._search = ActiveSetSearch(self._program, self._solve, self._limits, self._add, settings.deadline)

    def improve(self, iterate: Iterate, session: Session) -> Iterate:
        """Solve the nearest branch, follow descending ones, and certify where that ends.

        Parameters
        ----------
        iterate : Iterate
            Its point is on the model.
        session : Session
            Of the run that ended there, if it has multipliers.

        Returns
        -------
        Iterate
            The better one of the given iterate and what was found; the given one, too, where a function has no
            derivative at an exactly complementary point.
        """
        try:
            point = PrimalDualPoint(self._compiled.current_point())
            if iterate.multipliers is not None:
                point = session.primal_dual(iterate, self._compiled)
            rows = np.array(point.complete(self._compiled.nlp)[0])
            rows[self._relaxing_rows] = 0.0
            point = replace(point, g_multipliers=rows).with_objective_divided(self._slope)
            start = BranchPoint.at(self._program, point)
            found = self._search.polish(start) if start.violation <= POLISHED_VIOLATION else start
            return self._better(iterate, self._examined(iterate, found, start))
        except EvaluationError as error:
            logger.info("strategy '%s': its point cannot be polished or certified: %s", iterate.strategy, error)
            return iterate
        finally:
            self._note_interruption()

    def explore(self, iterate: Iterate) -> Iterate:
        """Look for a better optimum beyond a certified one, in the time that this may take; or return the same."""
        record, before = self._record, self._record.iterations
        seconds, work = record.left_to_explore()
        _ = scipy.optimize.milp  # loaded before the time counts: else a new process would explore less than an old one
        deadline = self._settings.deadline.within(seconds)
        self._settings.progress.live(f"exploring other branches, at most {deadline.left:.1f} s")
        x = self._compiled.current_point()
        start = BranchPoint.at(self._program, PrimalDualPoint(x), nearest_branch(self._program, x))
        try:
            with record.counted_as_exploring():
                best = self._search.explore(start, record.explored_branches, deadline, work)
                self._add_linear_programs("explore", best)
        finally:
            if np.isfinite(work):  # linear programs
                record.explored_work += work - self._search.work_left - (record.iterations - before)
            self._search.work_left = np.inf
            self._note_interruption()
        return iterate if best is start else self._examined(iterate, best, start)

    def _note_interruption(self) -> None:
        if self._search.interrupted:
            self._record.cut = StopReason.INTERRUPTED

    def _better(self, before: Iterate, after: Iterate) -> Iterate:
        """A polish that failed must not cost the point that it started from.

        Products of a relaxed point flatter its objective, so that does not decide: where its solved branch costs more,
        it is no solution itself. And where another branch descends from the polished point, it does from the point
        before, too.
        """
        ranks = [list(Quality).index(iterate.quality(self._settings.tolerances)) for iterate in (before, after)]
        # Objectives that differ by no more belong to one solution, relaxed and exact.
        flattered = abs(after.objective - before.objective) > MET * max(1.0, abs(before.objective))
        refuted = after.certificate is Certificate.DESCENT or (after.converged and flattered)
        return before if ranks[0] < ranks[1] and not refuted else after

    def _examined(self, iterate: Iterate, found: BranchPoint, start: BranchPoint) -> Iterate:
        """The iterate at the best point that is found from here, with its certificate and multipliers."""
        best, certificate = self._certified(found)
        if best is not start:
            iterate = self._at(best, iterate.strategy)
        iterate = replace(
            iterate, certificate=certificate, classify=functools.cache(functools.partial(self._classified, best))
        )
        if iterate.quality(self._settings.tolerances) is not Quality.FEASIBLE:
            return iterate
        # What Ipopt said does not count where multipliers are at hand that show the point to be stationary, and a
        # direction of descent that led nowhere does not count where they show that there is none.
        try:
            multipliers = iterate.classify()
        except KeyboardInterrupt:
            self._record.cut = StopReason.INTERRUPTED
            return iterate
        if multipliers is None or multipliers.kind is Stationarity.NONE:
            return iterate
        # What they leave in all variables together is the steepest descent that there may be.
        left = multipliers.residual * self._program.nlp.n
        if multipliers.kind is Stationarity.S and (left <= STATIONARY or certificate is not Certificate.DESCENT):
            iterate = replace(iterate, certificate=Certificate.PROVEN)
        return replace(iterate, stop_reason=StopReason.FINISHED, stationarity=multipliers.residual)

    def _certified(self, branch_point: BranchPoint) -> tuple[BranchPoint, Certificate]:
        """Follow descending branches, unless the multipliers show already that there are none."""
        if branch_point.branch is None or branch_point.violation > self._limits.feasibility:
            return branch_point, Certificate.UNKNOWN
        if self._strong(branch_point, Linearisation.at(self._program.nlp, branch_point.x)) is not None:
            return branch_point, Certificate.PROVEN
        if branch_point is self._search.certified:
            return branch_point, Certificate.PROVEN
        descended = self._search.descend(branch_point)
        self._add_linear_programs("certificate", descended)
        return descended, self._search.certificate

    def _classified(self, branch_point: BranchPoint) -> Multipliers | None:
        """Multipliers of the strongest kind at a point; None where it is not met, or there was no time."""
        if max(branch_point.violation, branch_point.natural_residual) > self._settings.tolerances.natural:
            return None
        point = Linearisation.at(self._program.nlp, branch_point.x)
        multipliers = self._strong(branch_point, point)
        if multipliers is None:
            problem, seconds = MultiplierProblem(self._program, point), self._limits.lpec_seconds
            multipliers = classify(problem, time_limit=seconds, deadline=self._settings.deadline)
        if multipliers is None:
            return None
        numbers = {name: getattr(multipliers, name) * self._slope for name in ("nu", "xi", "rows")}
        return without_crossed(replace(multipliers, **numbers), self._crossed)

    def _strong(self, branch_point: BranchPoint, point: Linearisation) -> Multipliers | None:
        if branch_point.branch is None or branch_point.violation > self._limits.feasibility:
            return None
        sizes = self._sizes(branch_point)
        return strong_multipliers(self._program, point, branch_point.branch, branch_point.point, sizes, NEARLY_BIACTIVE)

    def _sizes(self, found: BranchPoint) -> FloatArray:
        """Sizes of the variables at a point."""
        x = self._compiled.current_point()
        self._compiled.load_point(found.x)
        try:
            return variable_sizes(self._compiled)
        finally:
            self._compiled.load_point(x)

    def _at(self, end: BranchPoint, strategy: str) -> Iterate:
        """The iterate of the run that solved a branch, its point on the model."""
        iterate, outcome = self._solved[id(end)]
        self._compiled.load_point(end.x)
        point = outcome.point.with_objective_divided(1.0 / self._slope)
        names = ("g_multipliers", "lower_multipliers", "upper_multipliers")
        outcome = replace(outcome, **{name: getattr(point, name) for name in names})
        loader = InProcessSolutionLoader(self._compiled, outcome)
        return replace(
            iterate,
            strategy=strategy,
            values=self._values.read(),
            # What no program was solved at has no multipliers.
            stationarity=None
            if end.branch is None
            else stationarity(restricted(self._program, end.branch), end.point, self._sizes(end)),
            load_suffixes=loader.load_import_suffixes,
            row_multipliers=loader.row_multipliers,
        )

    def _solve(self, nlp: NonlinearProgram, start: PrimalDualPoint, iterations: int) -> IpoptOutcome:
        purposes: list[dict[str, Any]] = [POLISH, {"max_iter": iterations}]
        if int((nlp.x_lower < nlp.x_upper).sum()) < int((nlp.g_lower == nlp.g_upper).sum()):
            purposes.append(OVERDETERMINED)
        self._options = self._settings.options.resolve(*purposes)
        deadline: Deadline = self._search.deadline
        return run_ipopt(nlp, self._options, start, deadline=deadline, output=self._settings.output)

    def _add(self, purpose: str, outcome: IpoptOutcome, branch_point: BranchPoint, kept: bool) -> None:
        self._compiled.load_point(branch_point.x)
        iterate = self._record.add(
            Iterate.of_run(
                purpose if kept else f"{purpose} (not kept)",
                outcome.status,
                mu=outcome.mu,
                iterations=outcome.iterations,
                seconds=outcome.seconds + self._linear_seconds(),
                options=self._options,
            ),
            exact=True,
        )
        if iterate.diverged:
            self.has_diverged = True
            self._record.remember_diverged(replace(iterate, values=self._values.read()))
        self._solved[id(branch_point)] = (replace(iterate, multipliers=branch_point), outcome)

    def _add_linear_programs(self, purpose: str, at: BranchPoint) -> None:
        """Log the linear programs after the last run, at the point where they led no further."""
        seconds = self._linear_seconds()
        if seconds > 0.0:
            self._compiled.load_point(at.x)
            label = f"{purpose} (linear)"
            if purpose == "certificate" and self._search.undecided:
                label = f"{purpose} (linear, {self._search.undecided} pairs undecided)"
            self._record.add(Iterate(label, seconds=seconds), exact=True)

    def _linear_seconds(self) -> float:
        seconds, self._search.linear_seconds = self._search.linear_seconds, 0.0
        return seconds
