"""The best point of a strategy, and which of two is the better one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.mpcc.stationarity import Multipliers

from .solve_result import Quality, StopReason
from .step import Step
from .tolerances import Tolerances
from .variable_values import Values


@dataclass(eq=False)
class Finding:
    """A point with what is known about it.

    Attributes
    ----------
    strategy : str
    values : list
        Of the user's free variables.
    step : Step
        The run that gave it, with its recomputed residuals.
    reason : StopReason
        Why that run ended.
    stationarity : float or None
        Relative size of the Lagrangian's gradient, where it is known.
    load_suffixes : callable
        Fills the suffixes of the user with its multipliers.
    certificate : Certificate
    explain : callable
        Looks for the multipliers of the pairs; None where there are none to be found.
    outdone : bool
        Whether this strategy has left another local solution for it: there are several then.
    """

    strategy: str
    values: Values
    step: Step
    reason: StopReason
    stationarity: float | None
    load_suffixes: Callable[[], None]
    certificate: Certificate = Certificate.UNKNOWN
    explain: Callable[[], Multipliers | None] = lambda: None
    outdone: bool = False

    def quality(self, tolerances: Tolerances) -> Quality:
        """How good the point is."""
        if self.step.excess(tolerances) > 1.0:
            return Quality.INFEASIBLE
        shown = self.reason is StopReason.FINISHED and self.certificate is not Certificate.DESCENT
        if self.stationarity is not None:
            shown = shown and self.stationarity <= tolerances.stationarity
        return Quality.OPTIMAL if shown else Quality.FEASIBLE

    def is_certain(self, tolerances: Tolerances, polished: bool) -> bool:
        """Whether no further strategy is needed."""
        if self.quality(tolerances) is not Quality.OPTIMAL:
            return False
        strict = self.step.largest_natural_residual <= tolerances.natural
        return not polished or strict

    def is_better_than(self, other: Finding, tolerances: Tolerances, sign: float) -> bool:
        """Feasible first, then exactly complementary, then the objective, then what is certified.

        Parameters
        ----------
        other : Finding
        tolerances : Tolerances
        sign : float
            1 where the objective is minimised, -1 where it is maximised.
        """
        mine, theirs = self.step.excess(tolerances), other.step.excess(tolerances)
        if max(mine, theirs) > 1.0:
            return mine < theirs
        gain = sign * (other.step.objective - self.step.objective) / max(1.0, abs(other.step.objective))
        strict = [each.step.largest_natural_residual <= tolerances.natural for each in (self, other)]
        if strict[0] != strict[1]:
            # A pair that is met only loosely flatters the objective.
            return gain > -1e-2 if strict[0] else gain > 1e-2
        if abs(gain) > 1e-6:
            return gain > 0.0
        ranks = [
            (each.certificate is Certificate.PROVEN, each.quality(tolerances) is Quality.OPTIMAL)
            for each in (self, other)
        ]
        return ranks[0] > ranks[1]
