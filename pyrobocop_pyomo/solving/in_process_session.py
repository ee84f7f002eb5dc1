"""Continuation in process: the model is written once, delta moves by shifting rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TextIO

import numpy as np
from pyomo.common.collections import ComponentMap

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.ipopt.ipopt_library import load_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IterationRecord
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader, starting_multipliers
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import (
    FloatArray,
    NonlinearProgram,
    ShiftedRows,
    lagrangian_residual,
)

from .relaxed_model import RelaxedModel
from .session import DEFAULT_MU, WARM_START_OPTIONS, OnIteration, Run


class InProcessSession:
    """See `Session`.

    Parameters
    ----------
    relaxed : RelaxedModel
    derivatives : {"asl", "casadi", "vectorised"} or None
    options : mapping
        Ipopt's.
    output : sequence of text streams
        Where Ipopt's log goes.
    on_iteration : callable, optional
        Told of each iteration.
    """

    def __init__(
        self,
        relaxed: RelaxedModel,
        derivatives: str | None,
        options: Mapping[str, Any],
        output: Sequence[TextIO],
        on_iteration: OnIteration | None = None,
    ) -> None:
        self._library = load_ipopt_library()
        self._relaxed = relaxed
        self._derivatives = derivatives
        self._options = dict(options)
        self._output = output
        self._on_iteration = on_iteration
        self._outcome: IpoptOutcome | None = None
        self._nlp: NonlinearProgram
        self._write()
        self.solver = str(self._library)
        self.derivatives = self._written.nlp.derivatives

    def _write(self) -> None:
        self._written = CompiledModel(self._relaxed.model, self._derivatives)
        self._nlp = self._written.nlp
        rows = self._relaxed.shifted_rows
        if rows:
            # A row without free variables is not in the program.
            positions = [self._written.row_of[row] for row in rows if row in self._written.row_of]
            self._nlp = ShiftedRows(self._written.nlp, positions, base=self._relaxed.delta.value)

    def run(
        self,
        delta: float | None,
        *,
        warm: bool = False,
        time_limit: float | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> Run:
        """See `Session.run`."""
        if delta is not None:
            if isinstance(self._nlp, ShiftedRows):
                self._nlp.delta = delta
            elif self._relaxed.go_on_to(delta, self._row_multipliers() if warm else None):
                self._written.update()
                self._nlp = self._written.nlp
        options = {**self._options, **(options or {})}
        if warm:
            options = {**WARM_START_OPTIONS, "mu_init": min(DEFAULT_MU, delta or 1e-6), **options}
        outcome = self._solve(options, warm, time_limit)
        return self._report("fixed delta" if delta is not None else "solve", delta, outcome)

    def _row_multipliers(self) -> ComponentMap:
        assert self._outcome is not None
        return ComponentMap(zip(self._written.constraints, self._outcome.g_multipliers.tolist(), strict=True))

    def follow(
        self, schedule: BarrierSchedule, *, time_limit: float | None = None, options: Mapping[str, Any] | None = None
    ) -> Iterator[Run]:
        """See `Session.follow`."""
        nlp = self._nlp
        if not isinstance(nlp, ShiftedRows):
            raise TypeError("delta can follow the barrier parameter only where it shifts rows")
        wanted = {**self._options, **(options or {})}
        delta = schedule.delta_for(float(wanted.get("mu_init", DEFAULT_MU)))
        nlp.delta = delta
        path: list[tuple[float, float]] = []

        def follow_mu(record: IterationRecord) -> None:
            # Called between iterations: the next trial point is the first to see the new bound. The values that
            # Ipopt keeps of the current point are those under the old one, so delta lags mu by one iteration.
            nonlocal delta
            path.append((record.mu, delta))
            nlp.delta = delta = schedule.delta_for(record.mu)

        outcome = self._solve(wanted, False, time_limit, follow_mu)
        yield self._report("delta follows mu", delta, outcome, path)

    def _solve(
        self, options: Mapping[str, Any], warm: bool, time_limit: float | None, follow_mu: OnIteration | None = None
    ) -> IpoptOutcome:
        def on_iteration(record: IterationRecord) -> bool | None:
            if follow_mu is not None:
                follow_mu(record)
            return None if self._on_iteration is None else self._on_iteration(record)

        if time_limit is not None:
            options = {**options, "max_wall_time": max(time_limit, 1e-3)}
        last = self._outcome if warm else None
        exported = starting_multipliers(self._written)
        self._outcome = run_ipopt(
            self._library,
            self._nlp,
            options,
            x=self._written.current_point(),
            g_multipliers=exported.g_multipliers if last is None else last.g_multipliers,
            lower_multipliers=exported.lower_multipliers if last is None else last.lower_multipliers,
            upper_multipliers=exported.upper_multipliers if last is None else last.upper_multipliers,
            on_iteration=on_iteration,
            output=self._output,
        )
        self._written.load_point(self._outcome.x)
        return self._outcome

    @staticmethod
    def _report(
        label: str, delta: float | None, outcome: IpoptOutcome, path: list[tuple[float, float]] | None = None
    ) -> Run:
        mu = outcome.records[-1].mu if outcome.records else None
        return Run(label, delta, mu, outcome.status, outcome.iterations, outcome.seconds, path or [])

    def written(self, *, anew: bool = False) -> CompiledModel | None:
        """See `Session.written`."""
        return CompiledModel(self._relaxed.model, self._derivatives) if anew else self._written

    def multipliers(self, written: CompiledModel) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `Session.multipliers`."""
        if self._outcome is None or written is not self._written:
            nlp = written.nlp
            return np.zeros(nlp.m), np.ones(nlp.n), np.ones(nlp.n)
        return self._outcome.g_multipliers, self._outcome.lower_multipliers, self._outcome.upper_multipliers

    def stationarity(self) -> float | None:
        """See `Session.stationarity`."""
        if self._outcome is None:
            return None
        outcome = self._outcome
        return lagrangian_residual(
            self._nlp, outcome.x, outcome.g_multipliers, outcome.lower_multipliers, outcome.upper_multipliers
        )

    def rewinder(self) -> Callable[[], None]:
        """See `Session.rewinder`."""
        outcome = self._outcome

        def rewind() -> None:
            self._outcome = outcome

        return rewind

    def suffix_loader(self) -> Callable[[], None]:
        """See `Session.suffix_loader`."""
        assert self._outcome is not None
        return InProcessSolutionLoader(self._written, self._outcome).load_import_suffixes

    def close(self) -> None:
        """Nothing was put on the model."""
