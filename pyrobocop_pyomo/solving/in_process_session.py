"""Continuation in process: the model is compiled once, delta moves by shifting rows."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_library import load_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus, IterationRecord
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.ipopt.linear_solvers import FELL_BACK
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader, scaling_factors, starting_point
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE, ROUNDING
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram, PrimalDualPoint, Scales, missing_rank
from pyrobocop_pyomo.programs.wrapped_programs import ElasticRows, ScaledProgram, ShiftedRows

from .automatic_scaling import automatic_scaling
from .ipopt_options import IPOPT_TOLERANCE, SCALED, IpoptOptions
from .iterates import Iterate
from .progress import Progress
from .relaxed_model import RelaxedModel
from .session import DeltaFollowsBarrier, OnIteration, Session
from .settings import Settings

# So many iterations in a row stand.
STANDING_ITERATIONS = 50


class InProcessSession(Session):
    """See `Session`.

    Parameters
    ----------
    relaxed : RelaxedModel
    settings : Settings
    derivatives : {"vectorised", "asl"} or None
    """

    _compiled: CompiledModel

    def __init__(self, relaxed: RelaxedModel, settings: Settings, derivatives: str | None) -> None:
        known = None if relaxed.pairs else settings.program
        compiled = (CompiledModel if known is None else known.of)(relaxed.model, derivatives)
        super().__init__(relaxed, compiled, settings)
        self._derivatives = derivatives
        self._on_iteration = None if settings.output else _live_line(settings.progress, relaxed.model.name)
        self._price: float | None = None  # of violated rows, where these are elastic
        self._nlp = self._shifted(self._compiled.nlp)
        self.solver = str(load_ipopt_library())
        self.derivatives = self._compiled.nlp.derivatives
        self._scales: Scales | None = None

    def _shifted(self, nlp: NonlinearProgram) -> NonlinearProgram:
        if not self._relaxed.shifted_rows:
            return nlp
        rows = self._compiled.numbers_of(self._relaxed.shifted_rows)
        return ShiftedRows(nlp, rows, base=self._relaxed.delta.value)

    def with_elastic_rows(self, price: float) -> InProcessSession:
        """See `Session.with_elastic_rows`."""
        self._take_sizes()
        elastic = copy.copy(self)
        elastic._price = price if self._scales is not None else price * self._slope()
        return elastic

    def _take_sizes(self) -> None:
        """Let the sizes be those of the point on the model: what a run is divided by belongs to where it starts."""
        if self._is_scaled and self._price is None:
            self.scaling = automatic_scaling(self._compiled, like=self.scaling)
            self._scales = self.scaling.scales

    def _slope(self) -> float:
        """The largest derivative of the objective, or 1 if that is larger."""
        slope = 0.0
        with contextlib.suppress(EvaluationError):
            slope = float(abs(self._nlp.gradient(self._compiled.current_point())).max(initial=0.0))
        return max(1.0, slope)

    def run(
        self, delta: float | None, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None = None
    ) -> Iterate:
        """See `Session.run`."""
        if delta is not None:
            if isinstance(self._nlp, ShiftedRows):
                self._nlp.delta = delta
            else:
                self._relaxed.delta.set_value(delta)
                self._compiled.update()
                self._nlp = self._compiled.nlp
        standstill = Standstill(self._on_iteration)
        outcome = self._solve(options, deadline, start, standstill)
        if standstill.reached and outcome.status is IpoptStatus.STOPPED:
            outcome = replace(outcome, status=IpoptStatus.TINY_STEP)
        return self._iterate("fixed delta" if delta is not None else "solve", delta, options, outcome)

    def follow(self, schedule: BarrierSchedule, options: IpoptOptions, deadline: Deadline) -> Iterator[Iterate]:
        """See `Session.follow`."""
        nlp = self._nlp
        assert isinstance(nlp, ShiftedRows)
        resolved = options.resolve()
        follow_mu = DeltaFollowsBarrier(nlp, schedule, resolved, self._on_iteration)
        outcome = self._solve(resolved, deadline, None, follow_mu)
        yield replace(self._iterate("delta follows mu", follow_mu.delta, resolved, outcome), path=follow_mu.path)

    def _solve(
        self, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None, on_iteration: OnIteration
    ) -> IpoptOutcome:
        nlp, point, scales, head = self._nlp, starting_point(self._compiled), None, ""
        if start is not None:
            point = replace(start.multipliers, x=point.x)
        options = {**self._of_objective, **options}
        if "nlp_scaling_method" not in options:
            self._take_sizes()
            scales = self._scales
        if scales is not None:
            nlp, point, options = ScaledProgram(nlp, scales), scales.scaled(point), {**SCALED, **options}
            head = (
                f"The log below is about the scaled program: the objective divided by {scales.objective:.3g}, "
                "variables and rows by their typical sizes.\n"
            )
        elastic = None if self._price is None else ElasticRows(nlp, self._price)
        if elastic is not None:
            point = PrimalDualPoint(elastic.restrict(point.x))
        by_user = options.get("nlp_scaling_method") == "user-scaling" and elastic is None
        factors = scaling_factors(self._compiled) if by_user else None
        unit = 1.0 if scales is None or elastic is not None else scales.objective

        def stated(record: IterationRecord) -> IterationRecord:
            return record._replace(objective=record.objective * unit)

        outcome = run_ipopt(
            elastic or nlp,
            options,
            point,
            deadline=deadline,
            scaling=factors,
            on_iteration=lambda record: on_iteration(stated(record)),
            output=self._output,
            head=head,
        )
        end, undefined_at = outcome.point, outcome.undefined_at
        if elastic is not None:
            end = elastic.inner(end)
        if scales is not None:
            end = scales.unscaled(end, self._nlp)
        if undefined_at is not None:
            undefined_at = undefined_at[: nlp.n] * (1.0 if scales is None else scales.x)
        self._compiled.load_point(end.x)
        records = [stated(record) for record in outcome.records]
        return replace(outcome, undefined_at=undefined_at, records=records, **vars(end))

    def _iterate(self, label: str, delta: float | None, options: Mapping[str, Any], outcome: IpoptOutcome) -> Iterate:
        loader = InProcessSolutionLoader(self._compiled, outcome)
        return Iterate.of_run(
            label,
            outcome.status,
            delta=delta,
            mu=outcome.mu,
            iterations=outcome.iterations,
            seconds=outcome.seconds,
            options=_recorded(options, outcome),
            stationarity=self._stationarity(self._nlp, outcome.point),
            multipliers=outcome.point,
            undefined_at=outcome.undefined_at,
            load_suffixes=loader.load_import_suffixes,
            row_multipliers=loader.row_multipliers,
        )

    def compiled(self, *, anew: bool = False) -> CompiledModel | None:
        """See `Session.compiled`."""
        return CompiledModel(self._relaxed.model, self._derivatives) if anew else self._compiled

    def missing_rank(self) -> int:
        """See `Session.missing_rank`."""
        return missing_rank(self._compiled.nlp, self._compiled.current_point())

    def primal_dual(self, iterate: Iterate, compiled: CompiledModel) -> PrimalDualPoint:
        """See `Session.primal_dual`."""
        x = compiled.current_point()
        # Compiled anew, with or without a penalty term, the multipliers are other ones.
        return replace(iterate.multipliers, x=x) if compiled is self._compiled else PrimalDualPoint(x)

    def close(self) -> None:
        """Nothing was put on the model."""


def _recorded(options: Mapping[str, Any], outcome: IpoptOutcome) -> dict[str, Any]:
    """Options of a run, with the linear solver where that was not Ipopt's own decision."""
    solver = FELL_BACK if outcome.fell_back else outcome.linear_solver
    return {**options, "linear_solver": solver} if solver else dict(options)


def _live_line(progress: Progress, name: str) -> OnIteration:
    def show(record: IterationRecord) -> None:
        if record.iteration % 10 == 0:
            progress.live(
                f"{name}: iteration {record.iteration}, mu {record.mu:.1e}, objective {record.objective:.6g}, "
                f"infeasibility {record.primal_infeasibility:.1e}"
            )

    return show


class Standstill:
    """Tells a run to stop that no longer moves from a feasible point.

    Ipopt ends with tiny steps itself, but only where they vanish beside every variable. With a badly conditioned
    system they stay a little larger, regularised more and less by turns; or a restoration phase that was called where
    everything is feasible already has nothing to restore. Both go on until the limit of iterations.

    Parameters
    ----------
    on_iteration : callable or None
        The user's callback, asked first.

    Attributes
    ----------
    reached : bool
        Whether the run was told to stop.
    """

    def __init__(self, on_iteration: OnIteration | None) -> None:
        self._on_iteration, self._count = on_iteration, 0
        self._before: IterationRecord | None = None
        self.reached = False

    def __call__(self, record: IterationRecord) -> bool:
        """Whether the run may go on."""
        if self._on_iteration is not None and self._on_iteration(record) is False:
            return False
        before, self._before = self._before, record
        stands = before is not None and record.primal_infeasibility <= IPOPT_TOLERANCE and _stands(before, record)
        self._count = self._count + 1 if stands else 0
        self.reached = self._count >= STANDING_ITERATIONS
        return not self.reached


def _stands(before: IterationRecord, now: IterationRecord) -> bool:
    if now.restoration:
        return before.restoration and before.primal_infeasibility <= IPOPT_TOLERANCE
    return (
        now.mu == before.mu
        and now.step_norm <= NEGLIGIBLE
        and abs(now.objective - before.objective) <= ROUNDING * max(1.0, abs(now.objective))
    )
