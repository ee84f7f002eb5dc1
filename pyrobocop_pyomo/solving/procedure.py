"""Strategy after strategy until a point is certified: the procedure that solves one model as it stands."""

from __future__ import annotations

import contextlib
import math
import time
import weakref
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Any

from pyomo.common.errors import InfeasibleConstraintException
from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.complementarity import Geometric
from pyrobocop_pyomo.complementarity.relaxed_model import clean_suffixes
from pyrobocop_pyomo.diagnosis import Finding, Severity
from pyrobocop_pyomo.diagnosis.statements import form_findings
from pyrobocop_pyomo.diagnosis.values import boundary_findings, decided_findings
from pyrobocop_pyomo.discretisation import DiscretisationProbe
from pyrobocop_pyomo.errors import ComplementarityError, ContradictionError
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.modeling.rows_by_rule import content_of
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.multipliers import Multipliers, Stationarity
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.phases import phases_of

from .curvature import is_convex
from .ipopt_options import ITERATIONS_OF_ONE, ROUGH
from .iterates import Iterate, Quality, StopReason
from .record import EXPLORED_WORK
from .runner import Runner
from .solve_result import SolveResult
from .starts import EXPLORED_ELEMENTS, elements_of_copy
from .strategies import (
    ELASTIC,
    ONWARD,
    OTHER_OPTIMUM,
    OTHER_START,
    OWN_UNITS,
    PLAIN,
    SIMULATED,
    SOLVE,
    STRATEGIES,
    TIGHT,
    Settings,
    StartingPoint,
    Strategy,
    other_starts,
    starts_at_the_side,
)
from .violations import (
    GROWING,
    diverging_variables,
    remarks_on_phases_with_pairs,
    worst_of_each_component,
)

# Exploring ends after so many other ways and starts in a row that led to nothing better: by default, and on request.
PATIENCE, REQUESTED_PATIENCE = 2, 8
MIXED_INTEGER_PROGRAM = (
    "A local optimum: no choice of zero sides nearby is better. All rows are linear but for the pairs, so that a "
    "mixed-integer solver finds the best of all choices: "
    "TransformationFactory('pyrobocop.complementarity_to_disjunctions') states the model for it."
)
# Without pairs and by default one start may take a third of what all may, but so many in any case; with less, few come
# to an end.
FEW_ITERATIONS = 50
# Without pairs all that follows a first run may take so many iterations together.
LATER_ITERATIONS = 3 * ITERATIONS_OF_ONE


def solve_model(model: Any, settings: Settings) -> SolveResult:
    """Solve a model as it stands, and leave the best point on it.

    Parameters
    ----------
    model : Block
    settings : Settings
    """
    return _Procedure(model, settings).solve()


class _Procedure(Runner):
    """One solve: which strategies follow each other, and what comes out."""

    def __init__(self, model: Any, settings: Settings) -> None:
        super().__init__(model, settings, solve_model)
        self.tried: list[str] = []  # names of strategies
        self.multipliers: Multipliers | None = None

    def solve(self) -> SolveResult:
        """Go through the strategies until one gives a point that is certified; the best of all points wins."""
        try:
            with undone_on_failure(self._leave_best_point):
                self._go_through()
        except InfeasibleConstraintException as error:
            raise _contradiction(self.model, error) from error
        best = self.record.best
        if best is None:
            raise ComplementarityError(
                f"'{self.model.name}': delta cannot follow the barrier parameter with the relaxation "
                f"{self.settings.relaxation!r}, which bounds no row by it. Use Strategy(schedule=Geometric(...)) or "
                "Fixed(...), or other strategies."
            )
        if best.stop_reason is StopReason.ITERATION_LIMIT and any(step.diverged for step in self.record.steps):
            best = replace(best, stop_reason=StopReason.DIVERGED)  # it was on the same way
        # Where there is no time left, that is the reason, and not a value somewhere on the way.
        if best.quality(self.settings.tolerances) is not Quality.OPTIMAL and self.record.cut is None:
            first = self.record.first
            self.guess.explain(began=first is not None and first.iterations > 0)
        unbounded = self.record.unbounded
        self.values.write(best.values if unbounded is None else unbounded.values)
        if (unbounded is not None or best.diverged) and (growing := diverging_variables(self.values, GROWING)):
            self.guess.remarks += [f"What grows: {growing}."]
        if unbounded is not None and not best.diverged:
            self.guess.remarks += [
                "With other sides of pairs at zero the objective has no end; Ipopt stopped at "
                f"{unbounded.objective:.3g}. The point on the model is the best of those that do not diverge, with "
                f"{best.objective:.6g}."
            ]
            best = replace(best, stop_reason=StopReason.DIVERGED)
        self.values.write(best.values)
        self.guess.remarks += self._explanations(best)
        best.load_suffixes()
        clean_suffixes(self.model)
        return self._result(best)

    def _leave_best_point(self) -> None:
        """Whatever ends it, the model is left with the best point that there is."""
        best = self.record.best
        self.values.write(self.guess.values if best is None else best.values)

    def _go_through(self) -> None:
        with contextlib.closing(self.sessions):
            for strategy in self._strategies():
                self._try(strategy)
            self.go_back_to_start()
            self.explore()
            self._look_further()
            if self.record.best is not None and self.record.cut is not StopReason.INTERRUPTED:
                with self.keep_best_when_stopped("the search for multipliers"):
                    self.multipliers = self.record.best.classify()

    def _strategies(self) -> Iterator[Strategy]:
        """The caller's strategies for such a model, or else the strategies of the table that follow."""
        record, chosen = self.record, self.settings.strategies
        if chosen is not None and (not self.has_pairs or any(row.for_pairs is not False for row in chosen)):
            for row in chosen:
                if row.for_pairs in (None, self.has_pairs) and record.has_to_run(row, is_chosen=True):
                    yield row
            if record.best is None and not self.has_pairs:
                yield SOLVE  # the chosen strategies have no start of their own here
            return
        first, most = next(row for row in STRATEGIES if row.for_pairs is self.has_pairs), math.inf
        is_alone = not (self.has_pairs or self.settings.second_tries)  # other starts are the caller's
        if first is SOLVE and not is_alone:
            yield replace(SIMULATED, options={"max_iter": ITERATIONS_OF_ONE})  # where equations are dependent
        for row in chain.from_iterable(starts_at_the_side() if row is OTHER_START else [row] for row in STRATEGIES):
            is_meant = row.for_pairs in (None, self.has_pairs) and (not is_alone or row in PLAIN)
            # Runs that take long rarely get anywhere where the next strategy does.
            limit = int(min(ITERATIONS_OF_ONE, most - record.iterations))
            if not is_meant or row.name in self.tried or limit <= 0:
                continue
            if row is OWN_UNITS and (self.sessions.last is None or self.sessions.last.session.scaling is None):
                continue  # how the first run went
            is_several = self.has_pairs and isinstance(row.schedule, Geometric)  # runs, each of which may take as many
            if record.has_to_run(row, is_chosen=row is first):
                yield row if is_alone or is_several else replace(row, options={"max_iter": limit, **row.options})
            if row is first:
                record.first = record.best
                most = most if self.has_pairs else record.iterations + LATER_ITERATIONS
        ends = TIGHT.follows | {StopReason.ITERATION_LIMIT}
        rest = replace(first, name=f"{first.name} to the end", most_iterations=None, follows=ends)
        was_cut_short = record.first is not None and record.first.stop_reason is StopReason.ITERATION_LIMIT
        if was_cut_short and not is_alone and record.has_to_run(rest):
            yield rest  # with its remaining iterations

    def _look_further(self) -> None:
        """Beyond a certified point: other ways down, then other starts, as long as there is a budget and it pays."""
        record, is_requested, before = self.record, self.settings.exploration is not None, self.record.best
        patience = PATIENCE if self.has_pairs and not is_requested else REQUESTED_PATIENCE
        without_gain, known = 0, len(self.tried)
        missing: set[StartingPoint] = set()  # kinds of starts that this model has not
        for strategy in self._other_ways() if self.settings.strategies is None else ():
            best = record.best
            if without_gain == patience or not record.left_to_explore()[1]:
                break
            if strategy.name in self.tried or strategy.start in missing:
                continue
            with record.counted_as_exploring():
                if not self._try(strategy):
                    missing.add(strategy.start)
            without_gain = without_gain + 1 if record.best is best else 0
            if not without_gain:
                self.explore()
        tried = self.tried[known:]
        if tried and before is not None and (is_requested or record.best is not before):
            self.guess.remarks.append(
                f"Beside '{before.strategy}' with {before.objective:.6g}, other ways and starts were tried: "
                f"{', '.join(tried)}. Strategy(exploration=...) asks for more of them."
            )

    def _other_ways(self) -> Iterator[Strategy]:
        """For a model without pairs on fewer elements where there are many; none where it is convex."""
        opened, left = self.sessions.current, self.record.left_to_explore()[1]
        is_requested = self.settings.exploration is not None
        by_default = self.record.iterations <= EXPLORED_WORK if self.has_pairs else bool(phases_of(self.model))
        if opened is None or not (is_requested or by_default):
            return
        if self.has_pairs:
            yield from chain([ELASTIC], other_starts(has_pairs=True))
            return
        compiled = opened.session.compiled() if self.settings.second_tries and left else None
        if compiled is None or is_convex(compiled.nlp, compiled.current_point()):
            return
        is_fine = bool(elements_of_copy(self.model, EXPLORED_ELEMENTS))
        most = int(min(ITERATIONS_OF_ONE, max(FEW_ITERATIONS, left / 3.0)))
        if is_fine:
            yield replace(OTHER_OPTIMUM, most_iterations=most)
        for strategy in other_starts(has_pairs=False) if is_requested or not is_fine else ():
            left = self.record.left_to_explore()[1]
            if left < FEW_ITERATIONS / 2:
                return
            yield replace(strategy, most_iterations=int(min(most, left)))

    def _try(self, strategy: Strategy) -> bool:
        """Run a strategy, if it has something to work on; what an earlier one found stays whatever happens."""
        with self.keep_best_when_stopped(f"strategy '{strategy.name}'"):
            iterate = self.run(strategy)
            if iterate is None:
                return False
            self.tried.append(strategy.name)
            if self._is_on_the_way(strategy, iterate):
                self.keep(iterate)
                onward = self.run(ONWARD)
                iterate = iterate if onward is None else replace(onward, strategy=strategy.name)
            self.keep(iterate)
        return True

    def _is_on_the_way(self, strategy: Strategy, iterate: Iterate) -> bool:
        """Whether a run without pairs ended at no solution, but where elastic rows led to or near a better one."""
        record, best = self.record, self.record.best
        if self.has_pairs or record.is_certified(iterate) or iterate.stop_reason.is_final or record.has_to_stop():
            return False
        if best is None or not record.is_certified(best):
            return strategy.elastic_rows
        nearly = replace(self.settings.tolerances, feasibility=ROUGH["tol"])
        one, other = (point.standing(nearly, record.check.sign) for point in (iterate, best))
        return strategy.elastic_rows or one.is_better_than(other)

    def _result(self, best: Iterate) -> SolveResult:
        cut, opened = self.record.cut, self.sessions.last
        scaling = None if opened is None else opened.session.scaling
        scale = None if scaling is None else scaling.scales.objective
        if self.multipliers is not None and self.multipliers.kind is Stationarity.S:
            best = replace(best, certificate=Certificate.PROVEN)
        quality, ends = best.quality(self.settings.tolerances), {step.stop_reason for step in self.record.steps}
        # Where it is a solution of relaxed pairs alone, what became of those that go on.
        is_relaxed = quality is Quality.INFEASIBLE and best.converged and StopReason.INFEASIBLE in ends
        return SolveResult(
            name=self.model.name,
            stop_reason=cut or (StopReason.INFEASIBLE if is_relaxed else best.stop_reason),
            quality=quality,
            best=best.record(),
            multipliers=self.multipliers,
            residuals=self.record.residuals(),
            violations=worst_of_each_component(self.record.unmet()) if quality is Quality.INFEASIBLE else (),
            remarks=tuple(self.guess.remarks),
            doubts=self._doubts(best),
            steps=self.record.steps,
            standing=best.standing(self.settings.tolerances, self.record.check.sign),
            decided_pairs=0 if opened is None else len(opened.relaxed.decided),
            solver="" if opened is None else opened.session.solver,
            derivatives="" if opened is None else opened.session.derivatives,
            scaling=None if scaling is None else scaling.record,
            checking_seconds=self.record.seconds,
            model=weakref.ref(self.model),
            probe=DiscretisationProbe(self.model, best.row_multipliers, best.objective, scale),
            seconds=time.perf_counter() - self.record.started,
        )

    def _explanations(self, best: Iterate) -> list[str]:
        """Possible causes of a failure, beside the violations."""
        quality = best.quality(self.settings.tolerances)
        said = [*remarks_on_phases_with_pairs(self.model)] if quality is Quality.INFEASIBLE else []
        if self.record.pairs and quality is Quality.OPTIMAL and self._is_linear():
            said.append(MIXED_INTEGER_PROGRAM)
        # A run that reached its limit of iterations is a sign of them, even where another one found a solution.
        stalled = any(step.stop_reason is StopReason.ITERATION_LIMIT for step in self.record.steps)
        if (stalled or quality is not Quality.OPTIMAL) and not best.stop_reason.is_final:
            said += [f"{finding.message} {finding.remedy}" for finding in form_findings(self.model)]
        return said

    def _doubts(self, best: Iterate) -> tuple[Finding, ...]:
        """Why the best point may not be what was meant, or pairs not be met although both sides are small."""
        small = self.record.pairs_with_small_sides()
        if small:
            message = (
                f"Both sides of pair '{small[0].name}' differ from zero, and one of them is smaller than "
                f"{MET:g} all the time: whether such pairs are met, {len(small)} in all, is not known."
            )
            remedy = "State what is so small in a smaller unit, so that it has values near 1."
        elif best.certificate is Certificate.DESCENT and not self.record.pairs:
            message = (
                "The point is stationary, but no minimum: along a direction that the constraints leave free the "
                "objective falls, and no better point was reached along it."
            )
            remedy = "Give an initial guess that is not symmetric, or compare starts: rcp.studies.multistart(model)."
        elif best.stationarity is None and best.quality(self.settings.tolerances) is Quality.OPTIMAL:
            message = "Whether the point is stationary is not known: Ipopt converged, and no derivatives say more."
            remedy = "'python -m pyrobocop_pyomo doctor' shows what takes them."
        else:
            return ()
        return (Finding(Severity.WARNING, message, (), remedy),)

    def _is_linear(self) -> bool:
        """Whether all rows and sides of pairs are."""
        rows = (content_of(row) for row in self.model.component_data_objects(Constraint, active=True))
        sides = (side for pair in self.record.pairs for side in (pair.a, pair.b))
        return all(expression.polynomial_degree() in (0, 1) for expression in chain(sides, rows))


def _contradiction(model: Any, error: Exception) -> ContradictionError:
    """What Pyomo or a program says of rows without free variables, with their names and a remedy."""
    phases = phases_of(model)
    findings = [finding for phase in phases for finding in boundary_findings(phase, [])] or [*decided_findings(model)]
    said = " ".join(f"{finding.message} {finding.remedy}" for finding in findings)
    return ContradictionError(f"'{model.name}' has no solution. {said or error}")
