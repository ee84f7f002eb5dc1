"""Continuation in process: the model is compiled once, delta moves by shifting rows."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_library import load_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus, IterationRecord
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt, run_scaled
from pyrobocop_pyomo.ipopt.linear_solvers import FELL_BACK
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader, scaling_factors, starting_point
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.elastic_rows import ElasticRows
from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram, PrimalDualPoint, ShiftedRows, missing_rank
from pyrobocop_pyomo.programs.scales import Scales

from .automatic_scaling import automatic_scaling
from .ipopt_options import IPOPT_MU_INIT, SCALED, IpoptOptions
from .iterates import Iterate
from .progress import Progress
from .relaxed_model import RelaxedModel
from .session import DeltaFollowsBarrier, OnIteration, Session
from .settings import Settings

# So many iterations in a row stand; a step below this size, and a change of the objective, are none.
STANDING_ITERATIONS, SMALLEST_STEP, SAME_OBJECTIVE, FEASIBLE = 50, 1e-9, 1e-12, 1e-8


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
        self._seen_as: ElasticRows | None = None
        self._nlp = self._shifted(self._compiled.nlp)
        self.solver = str(load_ipopt_library())
        self.derivatives = self._compiled.nlp.derivatives
        self._scales: Scales | None = None

    def _shifted(self, nlp: NonlinearProgram) -> NonlinearProgram:
        if not self._relaxed.shifted_rows:
            return nlp
        row_of = self._compiled.row_of
        # A row without free variables is not in the program.
        positions: Any = np.array([row_of[row] for row in self._relaxed.shifted_rows if row in row_of], dtype=np.intp)
        return ShiftedRows(nlp, positions, base=self._relaxed.delta.value)

    def with_elastic_rows(self, price: float) -> InProcessSession:
        """See `Session.with_elastic_rows`."""
        self._take_sizes()
        elastic, scales = copy.copy(self), self._scales
        size = self._slope() if scales is None else scales.objective
        prices = None if scales is None else 1.0 / scales.g
        rows = elastic._seen_as = elastic._nlp = ElasticRows(self._nlp, price * size, prices)
        if scales is not None:
            elastic._scales = replace(scales, x=rows.completed(scales.x, scales.g), objective=1.0)
        return elastic

    def _take_sizes(self) -> None:
        """Let the sizes be those of the point on the model: what a run is divided by belongs to where it starts."""
        if self._is_scaled and self._seen_as is None:
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
        first = float(resolved.get("mu_init", IPOPT_MU_INIT))
        follow_mu = DeltaFollowsBarrier(nlp, schedule, first, self._on_iteration)
        outcome = self._solve(resolved, deadline, None, follow_mu)
        yield replace(self._iterate("delta follows mu", follow_mu.delta, resolved, outcome), path=follow_mu.path)

    def _solve(
        self, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None, on_iteration: OnIteration | None
    ) -> IpoptOutcome:
        point = starting_point(self._compiled)
        seen_as = self._seen_as
        if seen_as is not None:
            point = PrimalDualPoint(seen_as.restrict(point.x))
        if start is not None:
            point = replace(start.multipliers, x=point.x)
        options = {**self._of_objective, **options}
        how: dict[str, Any] = {"deadline": deadline, "on_iteration": on_iteration, "output": self._output}
        if "nlp_scaling_method" not in options:
            self._take_sizes()
        if self._scales is not None and "nlp_scaling_method" not in options:
            outcome = run_scaled(self._nlp, self._scales, {**SCALED, **options}, point, **how)
        else:
            by_user = options.get("nlp_scaling_method") == "user-scaling" and seen_as is None
            factors = scaling_factors(self._compiled) if by_user else None
            outcome = run_ipopt(self._nlp, options, point, scaling=factors, **how)
        self._compiled.load_point(outcome.x if seen_as is None else seen_as.at(outcome.x))
        return outcome

    def _iterate(self, label: str, delta: float | None, options: Mapping[str, Any], outcome: IpoptOutcome) -> Iterate:
        nlp, point, undefined_at = self._nlp, outcome.point, outcome.undefined_at
        if self._seen_as is not None:
            undefined_at = None if undefined_at is None else self._seen_as.at(undefined_at)
            nlp = self._seen_as.nlp
            rows, lower, upper = self._seen_as.multipliers(point)
            outcome = replace(
                outcome,
                x=self._seen_as.at(outcome.x),
                g_multipliers=rows,
                lower_multipliers=lower,
                upper_multipliers=upper,
            )
            point = outcome.point
        loader = InProcessSolutionLoader(self._compiled, outcome)
        return Iterate.of_run(
            label,
            outcome.status,
            delta=delta,
            mu=outcome.mu,
            iterations=outcome.iterations,
            seconds=outcome.seconds,
            options=_recorded(options, outcome),
            stationarity=self._stationarity(nlp, point),
            multipliers=point,
            undefined_at=undefined_at,
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
        stands = before is not None and record.primal_infeasibility <= FEASIBLE and _stands(before, record)
        self._count = self._count + 1 if stands else 0
        self.reached = self._count >= STANDING_ITERATIONS
        return not self.reached


def _stands(before: IterationRecord, now: IterationRecord) -> bool:
    if now.restoration:
        return before.restoration and before.primal_infeasibility <= FEASIBLE
    return (
        now.mu == before.mu
        and now.step_norm <= SMALLEST_STEP
        and abs(now.objective - before.objective) <= SAME_OBJECTIVE * max(1.0, abs(now.objective))
    )
