"""Continuation in process: the model is compiled once, delta moves by shifting rows."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TextIO

import numpy as np

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_library import load_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt, run_scaled
from pyrobocop_pyomo.ipopt.linear_solvers import FELL_BACK
from pyrobocop_pyomo.ipopt.standstill import Standstill
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader, scaling_factors, starting_point
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.mpcc.problem import violation
from pyrobocop_pyomo.programs.compiled_model import CompiledModel, KeptProgram
from pyrobocop_pyomo.programs.composed_program import ComposedProgram
from pyrobocop_pyomo.programs.elastic_rows import ElasticRows
from pyrobocop_pyomo.programs.missing_rank import missing_rank
from pyrobocop_pyomo.programs.nonlinear_program import (
    NonlinearProgram,
    PrimalDualPoint,
    ShiftedRows,
)
from pyrobocop_pyomo.programs.scales import Scales
from pyrobocop_pyomo.programs.stationarity import stationarity

from .automatic_scaling import AutomaticScaling, automatic_scaling, objective_slope, variable_sizes
from .ipopt_options import IPOPT_MU_INIT, SCALED, IpoptOptions
from .iterates import Iterate
from .relaxed_model import RelaxedModel
from .session import DeltaFollowsBarrier, OnIteration


class InProcessSession:
    """See `Session`.

    Parameters
    ----------
    relaxed : RelaxedModel
    derivatives : {"vectorised", "asl"} or None
    output : sequence of text streams
        Where Ipopt's log goes.
    on_iteration : callable, optional
        Told of each iteration.
    scaling : bool
        Whether Ipopt sees the program in variables, rows and an objective of size one.
    program : KeptProgram, optional
        Of the same model, from an earlier session.
    """

    def __init__(
        self,
        relaxed: RelaxedModel,
        derivatives: str | None,
        output: Sequence[TextIO] = (),
        on_iteration: OnIteration | None = None,
        *,
        scaling: bool = False,
        program: KeptProgram | None = None,
    ) -> None:
        self._relaxed, self._derivatives = relaxed, derivatives
        self._output, self._on_iteration = output, on_iteration
        self._compiled = (CompiledModel if program is None else program.of)(relaxed.model, derivatives)
        self._seen_as: ElasticRows | None = None
        self._nlp = self._shifted(self._compiled.nlp)
        self.solver = str(load_ipopt_library())
        self.derivatives = self._compiled.nlp.derivatives
        self.calls_python = isinstance(self._compiled.nlp, ComposedProgram)
        self._is_scaled = scaling
        self.scaling: AutomaticScaling | None = None
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

    @functools.cached_property
    def _of_objective(self) -> dict[str, float]:
        """Ipopt's option for an objective that is too small, of a model with pairs."""
        slope = objective_slope(self._compiled) if self._relaxed.pairs else 1.0
        return {} if slope == 1.0 else {"obj_scaling_factor": 1.0 / slope}

    def _take_sizes(self) -> None:
        """Let the sizes be those of the point on the model: what a run is divided by belongs to where it starts."""
        if self._is_scaled and self._seen_as is None:
            self.scaling = automatic_scaling(self._compiled, like=self.scaling)
            self._scales = self.scaling.scales

    def _slope(self) -> float:
        """The largest derivative of the objective, or 1 if that is larger."""
        try:
            slope = float(abs(self._nlp.gradient(self._compiled.current_point())).max(initial=0.0))
        except EvaluationError:
            slope = 0.0
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
        if not isinstance(nlp, ShiftedRows):
            raise TypeError("delta can follow the barrier parameter only where it shifts rows")
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
        try:
            violated = violation(nlp, point.x)
        except EvaluationError:
            violated = float("inf")
        try:
            left = self._stationarity(nlp, point)
        except EvaluationError:
            left = float("inf")
        loader = InProcessSolutionLoader(self._compiled, outcome)
        return Iterate.of_run(
            label,
            outcome.status,
            delta=delta,
            mu=outcome.mu,
            iterations=outcome.iterations,
            seconds=outcome.seconds,
            options=_recorded(options, outcome),
            stationarity=left,
            constraint_violation=violated,
            multipliers=point,
            undefined_at=undefined_at,
            load_suffixes=loader.load_import_suffixes,
            row_multipliers=loader.row_multipliers,
        )

    def _stationarity(self, nlp: NonlinearProgram, point: PrimalDualPoint) -> float:
        return stationarity(nlp, point, variable_sizes(self._compiled))

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
