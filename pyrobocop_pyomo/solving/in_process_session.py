"""Continuation in process: the model is compiled once, delta moves by shifting rows."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel
from pyrobocop_pyomo.ipopt.backends import load_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.ipopt.linear_solvers import FELL_BACK
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader, scaling_factors, starting_point
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.programs.automatic_scaling import objective_slope
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram, PrimalDualPoint
from pyrobocop_pyomo.programs.wrapped_programs import ElasticRows, ScaledProgram, ShiftedRows

from .ipopt_options import IpoptOptions
from .iterates import Iterate
from .session import DeltaFollowsBarrier, OnIteration, Session
from .strategies import Settings


class InProcessSession(Session):
    """See `Session`.

    Parameters
    ----------
    relaxed : RelaxedModel
    settings : Settings
    derivatives : {"vectorised", "asl"} or None
    """

    _compiled: CompiledModel
    _nlp: NonlinearProgram

    def __init__(self, relaxed: RelaxedModel, settings: Settings, derivatives: str | None) -> None:
        known = None if relaxed.pairs else settings.program
        compiled = (CompiledModel if known is None else known.of)(relaxed.model, derivatives)
        super().__init__(relaxed, compiled, settings)
        self._derivatives = derivatives
        self._live = None if settings.output else _live_line(settings.progress, relaxed.model.name)
        self._price: float | None = None  # of violated rows, where these are elastic
        self.solver = str(load_ipopt_library())
        self.derivatives = self._compiled.nlp.derivatives

    def with_elastic_rows(self, price: float) -> InProcessSession:
        """See `Session.with_elastic_rows`."""
        elastic = copy.copy(self)
        elastic._price = price
        if self._stated is None:
            elastic._price *= max(1.0, objective_slope(self._compiled, below=np.inf))
        return elastic

    def follow(self, schedule: BarrierSchedule, options: IpoptOptions, deadline: Deadline) -> Iterator[Iterate]:
        """See `Session.follow`."""
        assert isinstance(self._nlp, ShiftedRows)
        resolved = options.resolve()
        follow_mu = DeltaFollowsBarrier(self._nlp, schedule, resolved, self._live)
        iterate = self._solve(resolved, deadline, None, follow_mu)
        yield replace(iterate, label="delta follows mu", delta=follow_mu.delta, path=follow_mu.path)

    def _solve(
        self, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None, follow: OnIteration | None = None
    ) -> Iterate:
        watch = follow or self._live
        nlp, point = self._nlp, starting_point(self._compiled)
        if start is not None:
            point = replace(start.multipliers, x=point.x)
        options, scales = self._with_scaling(options)
        if scales is not None:
            nlp, point = ScaledProgram(nlp, scales), scales.scaled(point)
        elastic = None if self._price is None else ElasticRows(nlp, self._price)
        if elastic is not None:
            point = PrimalDualPoint(elastic.restrict(point.x))
        by_user = options.get("nlp_scaling_method") == "user-scaling" and elastic is None
        unit = 1.0 if scales is None or elastic is not None else scales.objective
        outcome = run_ipopt(
            elastic or nlp,
            options,
            point,
            deadline=deadline,
            scaling=scaling_factors(self._compiled) if by_user else None,
            on_iteration=watch and (lambda record: watch(record._replace(objective=record.objective * unit))),
            output=self._output,
        )
        end = outcome.point if elastic is None else elastic.inner(outcome.point)
        undefined_at = None if outcome.undefined_at is None else outcome.undefined_at[: nlp.n]
        if scales is not None:
            end = scales.unscaled(end, self._nlp)
            undefined_at = None if undefined_at is None else undefined_at * scales.x
        self._compiled.load_point(end.x)
        loader = InProcessSolutionLoader(self._compiled, replace(outcome, **vars(end)))
        solver = FELL_BACK if outcome.fell_back else outcome.linear_solver  # empty where Ipopt decided itself
        iterate = Iterate.of_run(
            "solve",
            outcome.status,
            mu=outcome.mu,
            iterations=outcome.iterations,
            seconds=outcome.seconds,
            options={**options, "linear_solver": solver} if solver else options,
            multipliers=end,
            undefined_at=undefined_at,
            load_suffixes=loader.load_import_suffixes,
            row_multipliers=loader.row_multipliers,
        )
        return self._with_stationarity(iterate)

    def compiled(self, *, anew: bool = False) -> CompiledModel | None:
        """See `Session.compiled`."""
        return CompiledModel(self._relaxed.model, self._derivatives) if anew else self._compiled

    def primal_dual(self, iterate: Iterate, compiled: CompiledModel) -> PrimalDualPoint:
        """See `Session.primal_dual`."""
        x = compiled.current_point()
        # Compiled anew, with or without a penalty term, the multipliers are other ones.
        return replace(iterate.multipliers, x=x) if compiled is self._compiled else PrimalDualPoint(x)

    def close(self) -> None:
        """Nothing was put on the model."""


def _live_line(progress: Progress, name: str) -> OnIteration:
    def show(record: IterationRecord) -> None:
        if record.iteration % 10 == 0:
            progress.live(
                f"{name}: iteration {record.iteration}, mu {record.mu:.1e}, objective {record.objective:.6g}, "
                f"infeasibility {record.primal_infeasibility:.1e}"
            )

    return show
