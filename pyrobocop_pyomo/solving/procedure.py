"""Strategy after strategy until a point is certified: the procedure that solves one model as it stands."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from pyomo.common.errors import InfeasibleConstraintException

from pyrobocop_pyomo.diagnosis.difficult_forms import form_findings
from pyrobocop_pyomo.diagnosis.values import boundary_findings, decided_findings
from pyrobocop_pyomo.discretisation import DiscretisationProbe
from pyrobocop_pyomo.errors import ComplementarityError, ContradictionError, EvaluationError, PyRobocopError
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.stationarity import Stationarity
from pyrobocop_pyomo.phases import phases_of

from .curvature import is_convex
from .ipopt_options import WARM_ITERATIONS
from .iterates import Iterate, Quality, StopReason
from .polish import plain_work
from .relaxed_model import forget_removed
from .run_remarks import doubts_on_pairs, doubts_on_point, remarks_on_runs
from .second_tries import SecondTries, first_run, with_pairs, without_pairs
from .settings import Settings
from .solve_result import ModelReference, SolveResult
from .solve_state import SolveState
from .solved_copies import SolvedCopies
from .strategies import (
    DEFAULT_SEQUENCE,
    OTHER_OPTIMUM,
    OTHER_STARTS,
    OTHER_STARTS_WITHOUT_PAIRS,
    OTHER_WAYS,
    SOLVE,
    TIGHT,
    StartingPoint,
    Strategy,
)
from .strategy_runs import StrategyRuns
from .violations import (
    GROWING,
    Violation,
    growing_variables,
    remarks_on_phases_with_pairs,
    worst_of_each_component,
)

logger = logging.getLogger(__name__)

# By default, other ways follow a solve of at most so many iterations of Ipopt.
SHORT_SOLVE = 300
# Exploring ends after so many other ways and starts in a row that led to nothing better: by default, and on request.
PATIENCE, REQUESTED_PATIENCE = 3, 8
# Without pairs and by default: a third of what all starts may take, within these; with less than the least, few come to
# an end.
FEW_ITERATIONS, MANY_ITERATIONS, LEAST_ITERATIONS = 50, 100, 25


def solve_model(model: Any, settings: Settings) -> SolveResult:
    """Solve a model as it stands, and leave the best point on it.

    Parameters
    ----------
    model : Block
    settings : Settings
    """
    return _Procedure(model, settings).solve()


class _Procedure:
    """The state of one solve."""

    def __init__(self, model: Any, settings: Settings) -> None:
        self._state = state = SolveState(model, settings)
        self._model, self._settings, self._log, self._values = model, settings, state.log, state.values
        self._guess, self._found, self._places, self._exploration = (
            state.guess, state.found, state.places, state.exploration,
        )  # fmt: skip
        self._tried: set[str] = set()
        self._copies = SolvedCopies(state, solve_model)
        self._runs = StrategyRuns(state, self._copies)

    def _leave_best_point(self) -> None:
        """Whatever ends it, the model is left with the best point that there is."""
        best = self._found.best
        self._values.write(self._guess.values if best is None else best.values)

    def solve(self) -> SolveResult:
        """Go through the strategies until one gives a point that is certified; the best of all points wins."""
        try:
            with undone_on_failure(self._leave_best_point):
                self._go_through()
        except InfeasibleConstraintException as error:
            raise _contradiction(self._model, error) from error
        best = self._found.best
        if best is None:
            raise ComplementarityError(
                f"'{self._model.name}': delta cannot follow the barrier parameter with the relaxation "
                f"{self._settings.relaxation!r}, which bounds no row by it, and the projection starts from a point "
                "that another strategy left. Use Strategy(schedule=Geometric(...)) or Fixed(...), or other strategies."
            )
        if best.stop_reason is StopReason.ITERATION_LIMIT and any(
            step.stop_reason is StopReason.DIVERGED for step in self._log.steps
        ):
            best = replace(best, stop_reason=StopReason.DIVERGED)  # it was on the same way
        # Where there is no time left, that is the reason, and not a value somewhere on the way.
        if best.quality(self._settings.tolerances) is not Quality.OPTIMAL and self._found.cut is None:
            first = self._found.first
            self._guess.explain(began=first is not None and first.iterations > 0)
        unbounded = self._found.unbounded
        if unbounded is not None:
            self._values.write(unbounded.values)
            self._guess.remarks += [_what_grows(self._values, unbounded, best)]
            best = replace(best, stop_reason=StopReason.DIVERGED)
        self._values.write(best.values)
        self._guess.remarks += self._explanations(best)
        best.load_suffixes()
        forget_removed(self._model)
        return self._result(best)

    def _go_through(self) -> None:
        with self._places:
            if self._state.has_pairs:
                self._go_through_those_for_pairs()
            else:
                self._go_through_those_without_pairs()
            self._runs.explore()
            self._go_other_ways()
            if self._found.best is not None and self._found.cut is not StopReason.INTERRUPTED:
                self._classify(self._found.best)
        # A copy is made when the relaxation is taken back.
        if self._state.has_pairs and self._settings.strategies is None and not self._found.are_enough():
            self._guess.write_start()
            split = self._copies.with_absolute_values_split()
            if split is not None:
                self._found.keep(split)

    def _go_through_those_for_pairs(self) -> None:
        chosen = self._settings.strategies
        for strategy in DEFAULT_SEQUENCE if chosen is None else with_pairs(chosen):
            if strategy is not TIGHT:
                self._runs.explore()
            if not self._found.need(strategy, self._places.pairs):
                continue
            self._try(strategy)
            if self._found.cut is not None or (self._places.place is not None and not self._places.pairs):
                return
        for strategy in OTHER_STARTS if chosen is None else ():
            if self._found.best is None or self._found.best.excess(self._settings.tolerances) <= 1.0:
                return
            if self._found.need(strategy, self._places.pairs):
                self._try(strategy)

    def _go_other_ways(self) -> None:
        """Beyond a certified point: other ways down, then other starts, as long as there is a budget and it pays."""
        pairs, found, without_gain = self._places.pairs, self._found, 0
        missing: set[StartingPoint] = set()  # kinds of starts that this model has not
        requested, before, ends = self._settings.exploration is not None, found.best, []
        by_default = self._log.iterations <= SHORT_SOLVE if pairs else bool(phases_of(self._model))
        if self._settings.strategies is not None or not (requested or by_default):
            return
        for strategy in OTHER_WAYS if pairs else self._other_starts(requested=requested):
            best = found.best
            if best is None or not found.is_certified(best) or found.are_cut():
                break
            if pairs and best.certificate is not Certificate.PROVEN:
                break
            if without_gain == (PATIENCE if pairs and not requested else REQUESTED_PATIENCE):
                break
            if not self._exploration.may_go_on(pairs, self._log.iterations):
                break
            if strategy.name in self._tried or strategy.start in missing:
                continue
            self._classify(best)  # another relaxation takes away the rows whose multipliers this asks for
            with self._exploration.counted(self._log):
                iterate = self._try(strategy, certified=not pairs)
            ends.append(f"'{strategy.name}' " + (f"{iterate.objective:.6g}" if iterate is not None else "no point"))
            if iterate is None:
                missing.add(strategy.start)
            without_gain = without_gain + 1 if found.best is best else 0
            if not without_gain:
                self._runs.explore()
        if ends and before is not None and (requested or found.best is not before):
            relaxed = ", relaxed where they led to nothing better" if pairs else ""
            self._guess.remarks.append(
                f"Objectives of other ways and starts, beside {before.objective:.6g} of '{before.strategy}'{relaxed}: "
                f"{', '.join(ends)}. Strategy(exploration=...) asks for more of them."
            )

    def _other_starts(self, *, requested: bool) -> Iterator[Strategy]:
        """For a solved model without pairs, on fewer elements where there are many; none where it is convex."""
        place, exploration = self._places.place, self._exploration
        if place is None or not self._settings.second_tries or exploration.factor == 0.0:
            return
        compiled = place.session.compiled()
        if compiled is None or is_convex(compiled.nlp, compiled.current_point()):
            return
        if exploration.most_work is None:
            exploration.most_work = plain_work(compiled.nlp.n, self._log.iterations)
        coarse = self._copies.has_fewer_elements()
        if coarse:
            yield replace(OTHER_OPTIMUM, most_iterations=self._iterations_of_start(requested=requested))
        for strategy in OTHER_STARTS_WITHOUT_PAIRS if requested or not coarse else ():
            most = self._iterations_of_start(requested=requested)
            if most < LEAST_ITERATIONS:
                return
            yield replace(strategy, most_iterations=most)

    def _iterations_of_start(self, *, requested: bool) -> int:
        if requested:
            return WARM_ITERATIONS
        exploration = self._exploration
        share = min(MANY_ITERATIONS, max(FEW_ITERATIONS, (exploration.most_work or 0.0) / 3.0))
        return int(min(share, exploration.work_within(0, self._log.iterations)))

    def _go_through_those_without_pairs(self) -> None:
        """One run; where it fails, what else may lead to a solution."""
        chosen = self._settings.strategies
        for strategy in (first_run(self._settings),) if chosen is None else without_pairs(chosen):
            self._try(strategy)
            if self._found.are_enough():
                return
        if self._found.best is None:
            self._try(SOLVE)  # what was chosen has no start of its own here
        if chosen is not None or self._found.best is None:
            return
        tries = SecondTries(self._settings, self._found.best, scaled=self._places.scaling is not None)
        for strategy in tries:
            steps = len(self._log.steps)
            if any(step.label == strategy.name for step in self._log.steps):
                continue  # a dependent start was simulated first
            self._try(strategy)
            tries.spent += sum(step.iterations for step in self._log.steps[steps:])
            if self._found.are_enough():
                return

    def _try(self, strategy: Strategy, *, certified: bool = False) -> Iterate | None:
        """Run a strategy, and return where it ended; what an earlier one found stays whatever happens.

        Parameters
        ----------
        strategy : Strategy
        certified : bool
            Whether to go on from a better point that is not certified, and to keep none that is not.
        """
        found = self._found
        self._tried.add(strategy.name)
        try:
            iterate = self._runs.run(strategy)
            if certified and iterate is not None and not found.is_certified(iterate):
                if found.best is None or not found.is_better(iterate, found.best) or found.are_cut():
                    return iterate
                going_on = replace(strategy, start=StartingPoint.REACHED, most_iterations=WARM_ITERATIONS)
                iterate = self._runs.run(going_on) or iterate
                if not found.is_certified(iterate):
                    return iterate
        except KeyboardInterrupt:
            if found.best is None:
                raise
            found.cut = StopReason.INTERRUPTED
            return None
        except PyRobocopError as error:
            if found.best is None:
                raise
            # What only looks for something better may fail: nothing is lost.
            level = logging.INFO if found.is_certified(found.best) else logging.WARNING
            logger.log(level, "'%s': strategy '%s' failed: %s", self._model.name, strategy.name, error)
            return None
        if iterate is not None:
            if iterate.stop_reason.is_final and found.cut is None:
                found.cut = iterate.stop_reason
            self._runs.keep(iterate)
        return iterate

    def _classify(self, best: Iterate) -> None:
        """Look for the multipliers of the pairs; what has no derivatives has none."""
        try:
            best.classify()
        except EvaluationError as error:
            logger.info("'%s': no multipliers of the pairs: %s", self._model.name, error)
            self._found.best = replace(best, classify=lambda: None)
        except KeyboardInterrupt:
            self._found.cut = StopReason.INTERRUPTED
            self._found.best = replace(best, classify=lambda: None)

    def _result(self, best: Iterate) -> SolveResult:
        cut, places = self._found.cut, self._places
        multipliers = None if cut is StopReason.INTERRUPTED else best.classify()
        if multipliers is not None and multipliers.kind is Stationarity.S:
            best = replace(best, certificate=Certificate.PROVEN)
        residuals, quality = self._log.residuals(), best.quality(self._settings.tolerances)
        return SolveResult(
            name=self._model.name,
            stop_reason=cut or self._why_it_ended(best, quality),
            quality=quality,
            best=best.record(),
            multipliers=multipliers,
            residuals=residuals,
            violations=self._violations() if quality is Quality.INFEASIBLE else (),
            remarks=(*self._guess.remarks, *remarks_on_runs(self._log.steps, best.certificate)),
            doubts=doubts_on_pairs(self._log.too_small(self._settings.tolerances))
            if residuals
            else doubts_on_point(best),
            steps=self._log.steps,
            standing=best.standing(self._settings.tolerances, self._state.check.sign),
            decided_pairs=places.decided_pairs,
            solver=places.solver,
            derivatives=places.derivatives,
            scaling=places.scaling,
            checking_seconds=self._log.seconds,
            model=ModelReference(self._model),
            probe=DiscretisationProbe(self._model, best.row_multipliers, best.objective),
            seconds=time.perf_counter() - self._state.started,
        )

    def _why_it_ended(self, best: Iterate, quality: Quality) -> StopReason:
        """That of the best point; where it is a solution of relaxed pairs alone, what became of those that go on."""
        ends = [step.stop_reason for step in self._log.steps]
        if quality is Quality.INFEASIBLE and best.converged and StopReason.INFEASIBLE in ends:
            return StopReason.INFEASIBLE
        return best.stop_reason

    def _explanations(self, best: Iterate) -> list[str]:
        """What may be the cause of a failure, beside what is not met."""
        said = []
        if best.diverged and self._found.unbounded is None and (growing := growing_variables(self._values, GROWING)):
            said.append(f"What grows: {growing}.")
        infeasible = best.quality(self._settings.tolerances) is Quality.INFEASIBLE
        said += remarks_on_phases_with_pairs(self._model) if infeasible else []
        optimal = best.quality(self._settings.tolerances) is Quality.OPTIMAL
        # A run that reached its limit of iterations is a sign of them, even where another one found a solution.
        stalled = any(step.stop_reason is StopReason.ITERATION_LIMIT for step in self._log.steps)
        if (stalled or not optimal) and not best.stop_reason.is_final:
            said += [f"{finding.message} {finding.remedy}" for finding in form_findings(self._model)]
        return said

    def _violations(self) -> tuple[Violation, ...]:
        tolerances = self._settings.tolerances
        return worst_of_each_component([*self._state.check.violated(tolerances), *self._log.unmet(tolerances)])


def _what_grows(values: VariableValues, unbounded: Iterate, best: Iterate) -> str:
    """Which variables do, at a point that is on the model, and what is left on it."""
    grows = f"What grows: {growing_variables(values, GROWING)}."
    if best.diverged:
        return grows
    return (
        f"{grows} With other sides of pairs at zero the objective has no end; Ipopt stopped at "
        f"{unbounded.objective:.3g}. "
        f"The point on the model is the best of those that do not diverge, with {best.objective:.6g}."
    )


def _contradiction(model: Any, error: Exception) -> ContradictionError:
    """What Pyomo or a program says of rows without free variables, with their names and a remedy."""
    phases = phases_of(model)
    findings = [finding for phase in phases for finding in boundary_findings(phase, [])] or [*decided_findings(model)]
    said = " ".join(f"{finding.message} {finding.remedy}" for finding in findings)
    return ContradictionError(f"'{model.name}' has no solution. {said or error}")
