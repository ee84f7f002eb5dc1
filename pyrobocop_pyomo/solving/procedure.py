"""Strategy after strategy until a point is certified: the procedure that solves one model as it stands."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pyomo.common.collections import ComponentMap

from pyrobocop_pyomo.complementarity import BarrierSchedule, Geometric, active_sources, pairs_of
from pyrobocop_pyomo.diagnosis.undefined_rows import named_undefined_rows
from pyrobocop_pyomo.discretisation import DiscretisationProbe
from pyrobocop_pyomo.errors import ComplementarityError, EvaluationError, FunctionError, ModelError, PyRobocopError
from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.ipopt.ipopt_library import find_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus, IterationRecord
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.stationarity import Stationarity
from pyrobocop_pyomo.programs.repetition import repeats_large_rows

from .automatic_scaling import SPREAD_SIZES, ScalingRecord
from .continuation import Continuation
from .executable_session import ExecutableSession
from .in_process_session import InProcessSession
from .ipopt_options import DEFAULT_WITH_PAIRS, FROM_COARSE_MESH, NEARLY_THERE, TIGHTENED, TIGHTER_TOLERANCES
from .iterate_log import IterateLog, ModelCheck
from .iterates import STEP_HEADER, Iterate, Quality, StopReason
from .polish import Exploration, Polish
from .progress import Progress
from .relaxed_model import RelaxedModel, forget_removed, relaxed_model
from .second_tries import ITERATIONS_OF_ONE, SecondTries, may_be_scaled, with_pairs, without_pairs
from .session import OnIteration, Session
from .settings import Settings
from .solve_result import SolveResult
from .starts import coarser_copy, defined_start, put_start, take_values_of_copy
from .strategies import (
    ADAPTIVE,
    BARRIER,
    CONTINUATION,
    DEFAULT_SEQUENCE,
    PROJECTION,
    SOLVE,
    TIGHT,
    StartingPoint,
    Strategy,
)

logger = logging.getLogger(__name__)

# Up to here a second solve from the user's initial guess costs little, and finds the better optimum now and then.
# Where it does, it is quick; where it is not, it rarely does.
CROSS_CHECKED_PAIRS = 100
# Objectives that differ by less, relative to their size, are those of one solution.
SAME_OBJECTIVE = 1e-4
# From so many pairs on, a problem is solved on a coarse mesh of about so many elements first, where it can be.
COARSENED_PAIRS, COARSE_ELEMENTS = 1000, 400
# What a unit of violation costs with elastic rows, in slopes of the objective.
PENALTY = 1e3
# Where the polish fails: a smaller delta makes the pairs nearly as exact as a branch would.
TIGHTENED_SCHEDULE = Geometric(first=1e-10, factor=1e-2, last=1e-12)


def solve_model(model: Any, settings: Settings) -> SolveResult:
    """Solve a model as it stands, and leave the best point on it.

    Parameters
    ----------
    model : Block
    settings : Settings
    """
    return _Procedure(model, settings).solve()


@dataclass(eq=False)
class _Workplace:
    """A relaxed model with an open session."""

    relaxation: Any
    relaxed: RelaxedModel
    session: Session
    values: VariableValues
    start: Values


class _Procedure:
    """The state of one solve."""

    def __init__(self, model: Any, settings: Settings) -> None:
        self._model, self._settings = model, settings
        self._started = time.perf_counter()
        self._check = ModelCheck(model)
        self._has_pairs = bool(active_sources(model) or pairs_of(model))
        self._log = IterateLog(self._check, settings.progress)
        self._values = VariableValues.of_free(model)
        self._initial = self._values.read()
        self._exploration = Exploration(settings.exploration, self._started)
        self._backends = [settings.backend, *settings.fallbacks]
        self._stack = contextlib.ExitStack()
        self._place: _Workplace | None = None
        self._found: list[Iterate] = []
        self._best: Iterate | None = None
        self._cut: StopReason | None = None  # by the clock or by Ctrl-C
        self._start = self._initial  # where strategies start: another point, where that has no value
        self._remarks: list[str] = []
        self._undefined_on_the_way = ""
        self._decided = 0
        self._coarse_mesh_led = False
        self._solver = self._derivatives = ""
        self._scaling: ScalingRecord | None = None

    def solve(self) -> SolveResult:
        """Go through the strategies until one gives a point that is certified; the best of all points wins."""
        try:
            self._go_through()
        except BaseException:
            # Whatever ends it, the model is left with the best point that there is.
            self._values.write(self._initial if self._best is None else self._best.values)
            raise
        best = self._best
        if best is None:
            raise ComplementarityError(
                f"'{self._model.name}': delta cannot follow the barrier parameter with the relaxation "
                f"{self._settings.relaxation!r}, which bounds no row by it, and the projection starts from a point "
                "that another strategy left. Use schedule=Geometric(...) or Fixed(...), or other strategies."
            )
        if best.quality(self._settings.tolerances) is not Quality.OPTIMAL:
            self._name_undefined()
        self._values.write(best.values)
        best.load_suffixes()
        forget_removed(self._model)
        return self._result(best)

    def _go_through(self) -> None:
        with self._stack:
            if self._has_pairs:
                self._go_through_those_for_pairs()
            else:
                self._go_through_those_without_pairs()
            self._explore()
            if self._best is not None and self._cut is not StopReason.INTERRUPTED:
                self._classify(self._best)

    def _go_through_those_for_pairs(self) -> None:
        sequence = DEFAULT_SEQUENCE if self._settings.strategies is None else with_pairs(self._settings.strategies)
        for strategy in sequence:
            if strategy is not TIGHT:
                self._explore()
            if self._best is not None and not self._needs(strategy):
                continue
            self._try(strategy)
            if self._cut is not None or (self._place is not None and not self._place.relaxed.pairs):
                break

    def _go_through_those_without_pairs(self) -> None:
        """One run; where it fails, what else may lead to a solution."""
        chosen = self._settings.strategies
        for strategy in (SOLVE,) if chosen is None else without_pairs(chosen):
            self._try(strategy)
            if self._is_finished():
                return
        if self._best is None:
            self._try(SOLVE)  # what was chosen has no start of its own here
        if chosen is not None or not self._settings.second_tries or self._best is None:
            return
        tries = SecondTries(self._settings, self._best, scaled=self._scaling is not None)
        for strategy in tries:
            steps = len(self._log.steps)
            self._try(strategy)
            tries.spent += sum(step.iterations for step in self._log.steps[steps:])
            if self._is_finished():
                return

    def _is_finished(self) -> bool:
        """Whether there is a solution, or no time to look for one."""
        if self._cut is None and self._settings.deadline.has_passed and not self._has_certified():
            self._cut = StopReason.TIME_LIMIT
        return self._cut is not None or self._has_certified()

    def _has_certified(self) -> bool:
        return self._best is not None and self._best.is_certified(self._settings.tolerances, self._settings.polish)

    # ---------------------------------------------------------------- one strategy

    def _try(self, strategy: Strategy) -> None:
        """Run a strategy; what an earlier one found stays whatever happens."""
        try:
            iterate = self._run(strategy)
        except KeyboardInterrupt:
            if self._best is None:
                raise
            self._cut = StopReason.INTERRUPTED
            return
        except EvaluationError as error:
            iterate = self._not_evaluated(strategy, str(error))
        except Exception as error:
            if self._best is None or not isinstance(error, PyRobocopError):
                raise
            logger.warning("'%s': strategy '%s' failed: %s", self._model.name, strategy.name, error)
            return
        if iterate is not None:
            if iterate.stop_reason.is_final and self._cut is None:
                self._cut = iterate.stop_reason
            self._keep(iterate)

    def _keep(self, iterate: Iterate) -> None:
        """Remember what was found, and whether it is the best."""
        self._found.append(iterate)
        self._note_undefined(iterate)
        if self._best is None or self._is_better(iterate, self._best):
            logger.info("'%s': strategy '%s' has the best point so far", self._model.name, iterate.strategy)
            self._best = iterate

    def _note_undefined(self, iterate: Iterate) -> None:
        """Remember where a function had no value on the way to a point that is no solution."""
        if iterate.converged or iterate.undefined_at is None or self._place is None:
            return
        compiled = self._place.session.compiled()
        if compiled is None or compiled.nlp.n != iterate.undefined_at.size:
            return
        before = VariableValues(compiled.variables)
        try:
            compiled.load_point(iterate.undefined_at)
            self._undefined_on_the_way = named_undefined_rows(self._model)
        finally:
            before.restore()

    def _name_undefined(self) -> None:
        """Say what has no value, where the start has none, or a function had none on the way."""
        if self._cut is not None:
            return  # there is no time left, and the limit is the reason
        self._values.write(self._initial)
        at_start = "" if self._remarks else named_undefined_rows(self._model)
        if at_start:
            self._remarks.append(
                f"The initial guess could not be evaluated: {at_start}. Give another one, or keep the expression away "
                "from there by bounds."
            )
        elif self._undefined_on_the_way:
            self._remarks.append(
                f"On the way an expression had no value: {self._undefined_on_the_way}. Bounds that keep it away from "
                "there may help."
            )

    def _run(self, strategy: Strategy) -> Iterate | None:
        """Run a strategy on the first backend that can evaluate the model where it leads."""
        iterate = self._run_here(strategy)
        if iterate is None or iterate.converged:
            return iterate
        # The executable does not say why it could not begin.
        if iterate.iterations == 0 and not iterate.stop_reason.is_final and self._move_start():
            return self._run(strategy)
        if iterate.status is not IpoptStatus.INVALID_NUMBER or len(self._backends) == 1:
            return iterate
        self._keep(iterate)
        return self._not_evaluated(strategy, iterate.status.value)

    def _move_start(self) -> bool:
        """Start from a point that has a value, where the initial guess has none and one is found; asked once."""
        if self._start is not self._initial:
            return False
        place = self._place
        self._values.write(self._initial)
        remark = defined_start(self._model)
        if not remark:
            return False
        logger.info("'%s': %s", self._model.name, remark)
        self._remarks.append(remark)
        self._start = self._values.read()
        if place is not None:
            place.relaxed.start_lifted()
            place.start = place.values.read()
        return True

    def _run_here(self, strategy: Strategy) -> Iterate | None:
        self._move_to(strategy)
        place = self._place
        assert place is not None
        self._log.pairs = place.relaxed.pairs
        if not place.relaxed.pairs:
            # The presolve may have settled all of them: then strategies for pairs are one solve.
            return self._run_without_pairs(place, SOLVE if self._has_pairs else strategy)
        if strategy is PROJECTION:
            return self._projected(place)
        if isinstance(strategy.schedule, BarrierSchedule) and not place.relaxed.shifted_rows:
            return None
        if strategy is BARRIER and self._settings.strategies is None and self._find_start_on_coarse_mesh(place):
            iterate = self._polished(place, replace(strategy, options=FROM_COARSE_MESH))
            self._coarse_mesh_led = iterate.is_certified(self._settings.tolerances, self._settings.polish)
            if self._coarse_mesh_led or self._cut is not None:
                return iterate
            self._keep(iterate)
        if strategy.from_initial_guess:
            place.values.write(place.start)
        return self._polished(place, strategy)

    def _run_without_pairs(self, place: _Workplace, strategy: Strategy) -> Iterate | None:
        if strategy is not SOLVE:
            place.values.write(place.start)
            if strategy.start is StartingPoint.COARSE_MESH:
                if not self._start_on_coarser_copy():
                    return None
                strategy = replace(strategy, options={**NEARLY_THERE, **strategy.options})
            elif strategy.start is StartingPoint.BEST:
                if self._best is None or self._best.values is None:
                    return None
                self._values.write(self._best.values)
                strategy = replace(strategy, options={**NEARLY_THERE, **TIGHTER_TOLERANCES, **strategy.options})
            elif not put_start(self._model, strategy.start):
                return None
        if not strategy.elastic_rows:
            return self._polished(place, strategy, strategy.name)
        session = place.session.with_elastic_rows(self._penalty(place))
        if session is None:
            return None
        elastic = self._continuation(place, strategy, session).run(None, label=strategy.name)
        if not elastic.excess(self._settings.tolerances) <= 1.0 and elastic.converged:
            elastic = replace(elastic, stop_reason=StopReason.INFEASIBLE)
        iterate = replace(elastic, strategy=strategy.name, values=self._values.read())
        if iterate.is_certified(self._settings.tolerances, self._settings.polish) or iterate.stop_reason.is_final:
            return iterate
        self._keep(iterate)
        # The point is nearly feasible: on from there with the rows as they are.
        on = replace(strategy, options={**NEARLY_THERE, **strategy.options})
        return self._polished(place, on, "solve from there")

    def _start_on_coarser_copy(self) -> bool:
        """Solve a copy with fewer elements; its answer is the start. The copy keeps the user's variables out of it."""
        copy = coarser_copy(self._model)
        if copy is None:
            return False
        options = self._settings.options.with_default({"max_iter": ITERATIONS_OF_ONE})
        settings = replace(self._settings, options=options, strategies=(SOLVE, ADAPTIVE), progress=Progress(False))
        try:
            result = solve_model(copy, settings)
        except PyRobocopError as error:
            logger.info("'%s': no answer on fewer elements: %s", self._model.name, error)
            return False
        for step in result.steps:
            self._log.steps.append(replace(step, label="coarse mesh", number=len(self._log.steps)))
        if result.stop_reason.is_final:
            self._cut = result.stop_reason
        if result.quality is Quality.INFEASIBLE or self._cut is not None:
            return False
        take_values_of_copy(self._model, copy)
        return True

    def _penalty(self, place: _Workplace) -> float:
        """Of a unit of violation, or of a row's scale: above what multipliers may be expected to be."""
        if place.session.scaling is not None:
            return PENALTY * place.session.scaling.scales.objective
        compiled = place.session.compiled()
        if compiled is None:
            return PENALTY
        try:
            slope = float(abs(compiled.nlp.gradient(compiled.current_point())).max(initial=0.0))
        except EvaluationError:
            slope = 0.0
        return PENALTY * max(1.0, slope)

    def _find_start_on_coarse_mesh(self, place: _Workplace) -> bool:
        """Solve a large problem on a coarse mesh, in two ways; put the better answer on the model."""
        if len(place.relaxed.pairs) < COARSENED_PAIRS:
            return False
        session = place.session.coarsened(COARSE_ELEMENTS)
        if session is None:
            return False
        found: list[Iterate] = []
        for strategy in (BARRIER, CONTINUATION):
            place.values.write(place.start)
            continuation = self._continuation(place, strategy, session)
            continuation.run(strategy.schedule)
            if self._settings.deadline.has_passed or continuation.last.stop_reason.is_final:
                break
            if continuation.last.converged:
                found.append(continuation.last)
        place.values.write(place.start)
        if not found:
            return False
        best = min(found, key=lambda iterate: self._check.sign * iterate.objective)
        place.values.write(best.values)
        place.relaxed.start_lifted()
        return True

    def _not_evaluated(self, strategy: Strategy, why: str) -> Iterate | None:
        """Another backend may know the derivatives at this point; where there is none, the point itself is reported."""
        logger.info("'%s': strategy '%s', %s: %s", self._model.name, strategy.name, self._backends[0].value, why)
        if len(self._backends) > 1:
            del self._backends[0]
            self._leave()
            try:
                return self._run(strategy)
            except (EvaluationError, FunctionError) as error:  # another process cannot call what is in Python
                return self._not_evaluated(strategy, str(error))
        if self._best is not None:
            return None
        self._values.write(self._initial)
        label, status = "no derivatives", IpoptStatus.INVALID_NUMBER
        iterate = self._log.add(Iterate.of_run(label, status, delta=None, mu=None, iterations=0, seconds=0.0))
        return replace(iterate, strategy=strategy.name, values=self._initial)

    def _polished(self, place: _Workplace, strategy: Strategy, label: str = "solve") -> Iterate:
        """Run the strategy's schedule and polish the best point of it."""
        continuation = self._continuation(place, strategy)
        relaxed = continuation.run(strategy.schedule, label=label, leads_no_further=self._leads_no_further)
        if self._leads_no_further(continuation.last):
            place.values.write(relaxed.values)
            return replace(relaxed, strategy=strategy.name, values=self._values.read())
        iterate = self._improved(place, strategy, relaxed)
        if not (self._settings.polish and place.relaxed.shifted_rows and self._is_loose(iterate)):
            return iterate
        continuation = self._continuation(place, strategy)
        tightened = continuation.run(TIGHTENED_SCHEDULE, start=relaxed, purpose=TIGHTENED)
        tightened = self._improved(place, strategy, tightened)
        return tightened if self._is_better(tightened, iterate) else iterate

    def _continuation(self, place: _Workplace, strategy: Strategy, session: Session | None = None) -> Continuation:
        self._last = continuation = Continuation(
            session or place.session,
            self._log,
            place.values,
            self._settings,
            self._check.sign,
            self._options_of(strategy, place),
            exact=not place.relaxed.shifted_rows,
        )
        return continuation

    def _improved(self, place: _Workplace, strategy: Strategy, relaxed: Iterate) -> Iterate:
        """What a polish makes of the best relaxed point, in terms of the user's variables."""
        place.values.write(relaxed.values)
        iterate = replace(relaxed, strategy=strategy.name, values=self._values.read())
        if self._last.last.stop_reason.is_final:
            self._cut = self._last.last.stop_reason
            return iterate
        polish, compiled = self._polish(place)
        if polish is None or compiled is None:
            return iterate
        try:
            return polish.improve(iterate, place.session.primal_dual(relaxed, compiled))
        finally:
            self._note_interruption(polish)

    def _projected(self, place: _Workplace) -> Iterate | None:
        polish, _ = self._polish(place)
        if self._best is None or polish is None:
            return None
        self._values.write(self._best.values)
        place.relaxed.start_lifted()
        try:
            return polish.project(self._best)
        finally:
            self._note_interruption(polish)

    def _explore(self) -> None:
        """Look for better optima beyond the best point, if that is certified and there is time for it."""
        best, place = self._best, self._place
        if best is None or place is None or self._cut is not None or best.certificate is not Certificate.PROVEN:
            return
        try:
            polish, _ = self._polish(place)
            if polish is None:
                return
            self._values.write(best.values)
            place.relaxed.start_lifted()
            explored = polish.explore(best)
            self._note_interruption(polish)
            if explored is not best:
                self._keep(explored)
        except KeyboardInterrupt:
            self._cut = StopReason.INTERRUPTED
        except EvaluationError as error:
            logger.info("'%s': exploration ends: %s", self._model.name, error)

    def _note_interruption(self, polish: Polish) -> None:
        if polish.interrupted:
            self._cut = StopReason.INTERRUPTED

    def _polish(self, place: _Workplace) -> tuple[Polish | None, Any]:
        """What polishes and certifies, with its compiled model; None where it is not wanted or cannot be done here."""
        if not self._settings.polish or not place.relaxed.lifted or find_ipopt_library() is None:
            return None, None
        if place.relaxed.has_penalty:
            with place.relaxed.without_penalty():
                compiled = place.session.compiled(anew=True)
        else:
            compiled = place.session.compiled()
        if compiled is None:
            return None, None
        settings = replace(self._settings, options=self._options())
        polish = Polish(settings, place.relaxed, compiled, self._log, self._values, self._exploration)
        return polish, compiled

    # ---------------------------------------------------------------- where it is run

    def _move_to(self, strategy: Strategy) -> None:
        """Keep the workplace, or change it for one with the relaxation that the strategy asks for."""
        relaxation = self._settings.relaxation if strategy.relaxation is None else strategy.relaxation
        place = self._place
        same = place is not None and (strategy is PROJECTION or place.relaxation == relaxation)
        if place is not None and same and not (strategy.typical_sizes and place.session.scaling is None):
            return
        self._leave()
        self._place = self._stack.enter_context(self._workplace(relaxation, strategy))

    def _leave(self) -> None:
        self._place = None
        self._stack.close()
        self._values.write(self._start)

    @contextlib.contextmanager
    def _workplace(self, relaxation: Any, strategy: Strategy) -> Iterator[_Workplace]:
        delta = 1e-2 if strategy.schedule is None else next(iter(strategy.schedule.steps()))
        with relaxed_model(self._model, relaxation, self._settings.grouping, delta) as relaxed:
            self._decided = len(relaxed.decisions)
            session = self._open_session(relaxed, strategy)
            self._solver, self._derivatives = session.solver, session.derivatives
            self._scaling = None if session.scaling is None else session.scaling.record
            self._check.scales = ComponentMap() if session.scaling is None else session.scaling.by_component
            values = VariableValues.of_free(self._model)
            try:
                yield _Workplace(relaxation, relaxed, session, values, values.read())
            finally:
                session.close()

    def _open_session(self, relaxed: RelaxedModel, strategy: Strategy) -> Session:
        """A session of the first backend that takes the model."""
        name, progress = self._model.name, self._settings.progress
        self._prefer_vectorised(relaxed)
        while True:
            try:
                session = _session(self._backends[0], relaxed, self._settings, strategy)
                break
            except (ModelError, EvaluationError) as error:
                if len(self._backends) == 1:
                    raise
                logger.info("'%s': %s is not taken: %s", name, self._backends[0].value, error)
                del self._backends[0]
        logger.info("'%s': %s, derivatives by %s", name, session.solver, session.derivatives)
        progress.line_once(f"{name}: {session.solver}, derivatives by {session.derivatives}")
        progress.line(STEP_HEADER)
        return session

    def _prefer_vectorised(self, relaxed: RelaxedModel) -> None:
        """Take the vectorised backend first, where the caller chose none and the rows repeat large expressions.

        Also where a coarse mesh comes first: each of its iterations evaluates the functions of the whole mesh.
        """
        vectorised = Backend.IN_PROCESS_VECTORISED
        if self._solver or vectorised not in self._backends[1:]:
            return  # decided by the first session, or by the caller
        if len(relaxed.pairs) >= COARSENED_PAIRS or repeats_large_rows(relaxed.model):
            logger.info("'%s': its rows repeat large expressions: %s", self._model.name, vectorised.value)
            self._backends.remove(vectorised)
            self._backends.insert(0, vectorised)

    def _options(self) -> Any:
        """Ipopt's options, those that pairs need by default among them."""
        assert self._place is not None
        options = self._settings.options
        return options.with_default(DEFAULT_WITH_PAIRS) if self._place.relaxed.pairs else options

    def _options_of(self, strategy: Strategy, place: _Workplace) -> Any:
        options: Mapping[str, Any] = strategy.options
        small = len(place.relaxed.pairs) <= CROSS_CHECKED_PAIRS
        if self._settings.strategies is None and small and strategy.small_problem_iterations is not None:
            # A small problem that takes longer does not get anywhere; the next strategy does.
            options = {"max_iter": strategy.small_problem_iterations, **options}
        return self._options().with_strategy(options)

    # ---------------------------------------------------------------- what is enough

    def _is_better(self, first: Iterate, second: Iterate) -> bool:
        return first.is_better_than(second, self._settings.tolerances, self._check.sign)

    def _leads_no_further(self, relaxed: Iterate) -> bool:
        """Whether smaller products and a polish of a relaxed point hardly lead to a better point than a certified one.

        The products that are left flatter its objective: with them it falls, and does not rise.
        """
        settings, best = self._settings, self._best
        if best is None or not best.is_certified(settings.tolerances, settings.polish):
            return False
        loss = self._check.sign * (relaxed.objective - best.objective)
        feasible = relaxed.converged and relaxed.constraint_violation <= settings.tolerances.feasibility
        return feasible and loss >= -SAME_OBJECTIVE * max(1.0, abs(best.objective))

    def _is_loose(self, iterate: Iterate) -> bool:
        tolerances = self._settings.tolerances
        return (
            self._cut is None
            and iterate.excess(tolerances) <= 1.0
            and not iterate.is_exact(tolerances)
            and not self._settings.deadline.has_passed
        )

    def _needs(self, strategy: Strategy) -> bool:
        """Whether a strategy is to be run, after what the others have found."""
        assert self._best is not None
        settings = self._settings
        if settings.deadline.has_passed:
            if not self._best.is_certified(settings.tolerances, settings.polish):
                self._cut = StopReason.TIME_LIMIT
            return False
        if not self._best.is_certified(settings.tolerances, settings.polish):
            return True
        small = self._place is not None and len(self._place.relaxed.pairs) <= CROSS_CHECKED_PAIRS
        if strategy is TIGHT:
            return small or settings.strategies is not None
        # A certified point is a local solution. In large problems, which tend to have many, and where two solves have
        # disagreed or the second one failed, the slow way down from delta = 1 is worth its time: it finds the better
        # solution more often than not.
        if self._coarse_mesh_led:
            return False  # both ways were gone there
        return strategy is CONTINUATION and (not small or self._disagree()) and settings.polish

    def _disagree(self) -> bool:
        """Whether the strategies so far have found different solutions, or one of them none."""
        tolerances = self._settings.tolerances
        feasible = [iterate.objective for iterate in self._found if iterate.excess(tolerances) <= 1.0]
        if len(feasible) < len(self._found):
            return True
        return len(feasible) > 1 and max(feasible) - min(feasible) > SAME_OBJECTIVE * max(1.0, *map(abs, feasible))

    def _classify(self, best: Iterate) -> None:
        """Look for the multipliers of the pairs; what has no derivatives has none."""
        try:
            best.classify()
        except EvaluationError as error:
            logger.info("'%s': no multipliers of the pairs: %s", self._model.name, error)
            self._best = replace(best, classify=lambda: None)
        except KeyboardInterrupt:
            self._cut = StopReason.INTERRUPTED
            self._best = replace(best, classify=lambda: None)

    def _result(self, best: Iterate) -> SolveResult:
        multipliers = None if self._cut is StopReason.INTERRUPTED else best.classify()
        if multipliers is not None and multipliers.kind is Stationarity.S:
            best = replace(best, certificate=Certificate.PROVEN)
        return SolveResult(
            name=self._model.name,
            stop_reason=self._cut or best.stop_reason,
            quality=best.quality(self._settings.tolerances),
            best=best.record(),
            multipliers=multipliers,
            residuals=self._log.residuals(),
            remarks=tuple(self._remarks),
            steps=self._log.steps,
            standing=best.standing(self._settings.tolerances, self._check.sign),
            decided_pairs=self._decided,
            solver=self._solver,
            derivatives=self._derivatives,
            scaling=self._scaling,
            checking_seconds=self._log.seconds,
            probe=DiscretisationProbe(self._model, best.row_multipliers, best.objective),
            seconds=time.perf_counter() - self._started,
        )


def _session(backend: Backend, relaxed: RelaxedModel, settings: Settings, strategy: Strategy) -> Session:
    scaling = _least_spread(relaxed, settings, strategy)
    if backend is Backend.EXECUTABLE:
        return ExecutableSession(relaxed, settings.output, scaling=scaling)
    live = None if settings.output else _live_line(settings.progress, relaxed.model.name)
    return InProcessSession(relaxed, backend.derivatives, settings.output, live, scaling=scaling)


def _least_spread(relaxed: RelaxedModel, settings: Settings, strategy: Strategy) -> float | None:
    """How far apart typical sizes have to be to scale by them; None not to scale.

    Not with pairs, whose products delta bounds in the user's units, nor where the user scales.
    """
    if relaxed.pairs or not may_be_scaled(settings):
        return None
    return 1.0 if settings.scaling or strategy.typical_sizes else SPREAD_SIZES


def _live_line(progress: Progress, name: str) -> OnIteration:
    def show(record: IterationRecord) -> None:
        if record.iteration % 10 == 0:
            progress.live(
                f"{name}: iteration {record.iteration}, mu {record.mu:.1e}, objective {record.objective:.6g}, "
                f"infeasibility {record.primal_infeasibility:.1e}"
            )

    return show
