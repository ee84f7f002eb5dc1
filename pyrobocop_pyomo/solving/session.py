"""A relaxed model under solution: one run of Ipopt after another, each from a point that is given."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.complementarity import BarrierSchedule
from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel
from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IterationRecord
from pyrobocop_pyomo.ipopt.suffixes import scaling_factors
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.programs.automatic_scaling import (
    AutomaticScaling,
    automatic_scaling,
    objective_slope,
    variable_sizes,
)
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import (
    PrimalDualPoint,
    Scales,
    missing_rank,
    stationarity,
)
from pyrobocop_pyomo.programs.wrapped_programs import ShiftedRows

from .ipopt_options import IPOPT_MU_INIT, SCALED, IpoptOptions
from .iterates import Iterate
from .strategies import Settings

OnIteration = Callable[[IterationRecord], Any]


class Session(ABC):
    """Two ways to do the same: in process, or through the executable.

    The iterates that it returns are not checked yet by what the user stated, and their point is on the model.

    Parameters
    ----------
    relaxed : RelaxedModel
    compiled : CompiledModel or None
        What runs are divided by, and judged by; None where nothing takes derivatives here.
    settings : Settings
        Where Ipopt's log goes, and whether Ipopt sees the program in variables, rows and an objective of size one.

    Attributes
    ----------
    solver, derivatives : str
        Which Ipopt, and which derivatives, for people to read.
    scaling : AutomaticScaling or None
        What the program of the last run was divided by for Ipopt: sizes at the point where it started. Nothing of it is
        left in what comes back.
    """

    solver: str
    derivatives: str
    _scaled_options: Mapping[str, Any] = SCALED

    def __init__(self, relaxed: RelaxedModel, compiled: CompiledModel | None, settings: Settings) -> None:
        self._relaxed, self._compiled, self._output = relaxed, compiled, settings.output
        self._nlp = None if compiled is None else compiled.nlp
        if compiled is not None and relaxed.shifted_rows:
            rows = compiled.numbers_of(relaxed.shifted_rows)
            self._nlp = ShiftedRows(compiled.nlp, rows, base=relaxed.delta.value)
        is_wanted = settings.scaling and "nlp_scaling_method" not in settings.options.user
        # The products of pairs are bounded by delta in the units of the user.
        is_scaled = is_wanted and not relaxed.pairs
        self._stated = scaling_factors(compiled, missing=np.nan) if compiled is not None and is_scaled else None
        self.scaling: AutomaticScaling | None = None

    def run(
        self, delta: float | None, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None = None
    ) -> Iterate:
        """Solve with a fixed delta from the point on the model, with the multipliers of `start` where it is given."""
        if delta is None:
            return self._solve(options, deadline, start)
        self._move_to(delta)
        return replace(self._solve(options, deadline, start), label="fixed delta", delta=delta)

    def _move_to(self, delta: float) -> None:
        """Let the next run be of the program with this delta."""
        self._relaxed.delta.set_value(delta)
        if isinstance(self._nlp, ShiftedRows):
            self._nlp.delta = delta
        elif self._compiled is not None:
            self._compiled.update()
            self._nlp = self._compiled.nlp

    @abstractmethod
    def _solve(self, options: Mapping[str, Any], deadline: Deadline, start: Iterate | None) -> Iterate:
        """One run of Ipopt."""

    @abstractmethod
    def follow(self, schedule: BarrierSchedule, options: IpoptOptions, deadline: Deadline) -> Iterator[Iterate]:
        """Solve with delta following the barrier parameter, from the point on the model."""

    @abstractmethod
    def compiled(self, *, anew: bool = False) -> CompiledModel | None:
        """The relaxed model as numbers, at the last delta; None where nothing here can take its derivatives.

        It may have been compiled before, unless it is requested as it is now.
        """

    @abstractmethod
    def primal_dual(self, iterate: Iterate, compiled: CompiledModel) -> PrimalDualPoint:
        """The point on the model with the multipliers of an iterate of this session, in the order of `compiled`."""

    def missing_rank(self) -> int:
        """Equations that are dependent at the point on the model, to first order; 0 where that is not known."""
        return 0 if self._compiled is None else missing_rank(self._compiled.nlp, self._compiled.current_point())

    def with_elastic_rows(self, price: float) -> Session | None:
        """A session of the same model whose rows may be violated; None where there is no such program.

        Parameters
        ----------
        price : float
            Of a violation of the size of its row, in sizes of the objective; without sizes, of a unit in its slopes.
        """
        return None

    @abstractmethod
    def close(self) -> None:
        """Take everything off the model that the session put there."""

    def _with_scaling(self, options: Mapping[str, Any]) -> tuple[dict[str, Any], Scales | None]:
        """Options of a run, and what its program is divided by: sizes at the point on the model, where it starts."""
        options = {**self._of_objective, **options}
        if self._compiled is None or self._stated is None or "nlp_scaling_method" in options:
            return options, None
        self.scaling = automatic_scaling(self._compiled, self._stated, like=self.scaling)
        for stream in self._output:
            divided = f"the objective divided by {self.scaling.scales.objective:.3g}"
            stream.write(
                f"The log below is about the scaled program: {divided}, variables and rows by typical sizes.\n"
            )
        return {**self._scaled_options, **options}, self.scaling.scales

    @functools.cached_property
    def _of_objective(self) -> dict[str, float]:
        """Ipopt's option for an objective that is too small, of a model with pairs."""
        slope = objective_slope(self._compiled) if self._relaxed.pairs and self._compiled is not None else 1.0
        return {} if slope == 1.0 else {"obj_scaling_factor": 1.0 / slope}

    def _with_stationarity(self, iterate: Iterate) -> Iterate:
        """An iterate, whose point is on the model, with its residual of the first-order conditions.

        That is infinite where derivatives have no value, and not known where nothing takes any.
        """
        if self._compiled is None or self._nlp is None:
            return iterate
        try:
            point = self.primal_dual(iterate, self._compiled)
            return replace(iterate, stationarity=stationarity(self._nlp, point, variable_sizes(self._compiled)))
        except EvaluationError:
            return replace(iterate, stationarity=float("inf"))


class DeltaFollowsBarrier:
    """Moves the shifted rows after each iteration, as the schedule says; a callback of `run_ipopt`.

    Parameters
    ----------
    nlp : ShiftedRows
    schedule : BarrierSchedule
    options : mapping
        Ipopt's options of the run, the first barrier parameter among them.
    on_iteration : callable or None
        Called as well.

    Attributes
    ----------
    path : list of (float, float)
        Barrier parameter and delta of each iteration.
    """

    def __init__(
        self, nlp: ShiftedRows, schedule: BarrierSchedule, options: Mapping[str, Any], on_iteration: OnIteration | None
    ) -> None:
        self._nlp, self._schedule, self._on_iteration = nlp, schedule, on_iteration
        self.path: list[tuple[float, float]] = []
        self.delta = nlp.delta = schedule.delta_for(float(options.get("mu_init", IPOPT_MU_INIT)))

    def __call__(self, record: IterationRecord) -> bool | None:
        """Move the rows, and pass the record on."""
        # Called between iterations: the next trial point is the first to see the new bound. The values that Ipopt
        # keeps of the current point are those under the old one, so delta lags mu by one iteration.
        self.path.append((record.mu, self.delta))
        self.delta = self._nlp.delta = self._schedule.delta_for(record.mu)
        return None if self._on_iteration is None else self._on_iteration(record)
