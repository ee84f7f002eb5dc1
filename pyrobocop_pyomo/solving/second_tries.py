"""Which strategies follow where the one run of a model without pairs failed, and for how many iterations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import Certificate

from .iterates import Iterate, StopReason
from .settings import Settings
from .strategies import (
    ABSOLUTE_VALUES,
    ADAPTIVE,
    DEFAULT_SEQUENCE,
    ELASTIC_ROWS,
    OWN_UNITS,
    SECOND_TRIES,
    SIDE_STARTS,
    SIMULATED,
    SOLVE,
    SOLVE_TO_THE_END,
    STRAIGHT_LINES,
    TIGHTER,
    Strategy,
)

# All that follows may take twice the iterations of the run that failed, but these in any case; one strategy, so many.
LATER_ITERATIONS, LEAST_LATER_ITERATIONS, ITERATIONS_OF_ONE = 2.0, 1500, 500
# The first run has so many before others are tried, and goes to its end after them; a start at the side takes few.
FIRST_ITERATIONS, SIDE_ITERATIONS = 500, 100
# Where the run ended locally infeasible, there may be no solution: only these follow.
TRIES_IF_INFEASIBLE = (OWN_UNITS, SIMULATED, ELASTIC_ROWS, STRAIGHT_LINES)
# Where variables grow without end, rows that give way would let them grow the more.
TRIES_IF_DIVERGING = (OWN_UNITS, SIMULATED, ADAPTIVE, STRAIGHT_LINES)
# What another way to go cannot change.
_HOPELESS = (
    IpoptStatus.INVALID_PROBLEM,
    IpoptStatus.INVALID_OPTION,
    IpoptStatus.OUT_OF_MEMORY,
)
_FOLLOWING = {StopReason.INFEASIBLE: TRIES_IF_INFEASIBLE, StopReason.DIVERGED: TRIES_IF_DIVERGING}


class SecondTries:
    """Strategies for a model without pairs, as long as they are worth trying.

    Limits are numbers of iterations: what comes out does not depend on how fast the machine is.

    Parameters
    ----------
    settings : Settings
    first : Iterate
        Where the first run ended.
    scaled : bool
        Whether that run was of a program divided by typical sizes.

    Attributes
    ----------
    spent : int
        Iterations of what followed; the caller adds to it.
    """

    def __init__(self, settings: Settings, first: Iterate, *, scaled: bool) -> None:
        self._settings, self._first, self._scaled = settings, first, scaled
        self.spent = 0

    def __iter__(self) -> Iterator[Strategy]:
        """The strategies that are left, each with its limit of iterations."""
        chosen = self._chosen()
        for strategy in chosen:
            left = max(LEAST_LATER_ITERATIONS, int(LATER_ITERATIONS * self._first.iterations)) - self.spent
            if left <= 0:
                break
            limit = min(ITERATIONS_OF_ONE, left)
            yield replace(strategy, options={"max_iter": limit, **strategy.options})
        if chosen and self._settings.second_tries and self._first.status is IpoptStatus.ITERATION_LIMIT:
            yield SOLVE_TO_THE_END

    def _chosen(self) -> tuple[Strategy, ...]:
        user, status = self._settings.options.user, self._first.status
        if self._first.certificate is Certificate.DESCENT:
            return ()  # the same starts lead to the same saddle, and what follows one was tried
        # Ipopt's tolerances are relative to its scaling; the residuals are not. A run that converged has met no kink:
        # smaller tolerances take a few iterations, where absolute values in two parts take hundreds.
        nearest = (TIGHTER, ABSOLUTE_VALUES) if self._first.converged else (ABSOLUTE_VALUES,)
        if not self._settings.second_tries:
            return nearest  # other starts are the caller's
        if status in _HOPELESS or (status is IpoptStatus.ITERATION_LIMIT and "max_iter" in user):
            return ()
        if status is IpoptStatus.INTERNAL_ERROR:
            return (ABSOLUTE_VALUES,)  # the executable says no more where a step to a kink fails
        if status is IpoptStatus.TOO_FEW_FREEDOMS:
            return (ELASTIC_ROWS,)
        reason = self._first.stop_reason
        sides = tuple(replace(strategy, most_iterations=SIDE_ITERATIONS) for strategy in SIDE_STARTS)
        following = _FOLLOWING.get(reason, (*SECOND_TRIES, *sides))
        stuck = reason is not StopReason.DIVERGED and self._first.excess(self._settings.tolerances) <= 1.0
        if stuck and not self._first.converged:
            # A run that came to a feasible point and no further often ends there by a few more of new multipliers.
            following = (TIGHTER, *following)
        if status is IpoptStatus.ITERATION_LIMIT:
            following = (*sides, *following)  # which has them once more, for other failures
        # The caller's options win: a strategy that only sets them would be the first run again.
        return tuple(
            strategy
            for strategy in (*nearest, *following)
            if (not strategy.options or any(name not in user for name in strategy.options))
            and not (strategy is OWN_UNITS and not self._scaled)  # how the first run went
        )


def first_run(settings: Settings) -> Strategy:
    """The run from the initial guess; a long one is cut short where others follow."""
    return replace(SOLVE, small_problem_iterations=FIRST_ITERATIONS) if settings.second_tries else SOLVE


def may_be_scaled(settings: Settings) -> bool:
    """Whether typical sizes are of use, and the caller sets no scaling of their own."""
    return settings.scaling and "nlp_scaling_method" not in settings.options.user


def without_pairs(strategies: tuple[Strategy, ...]) -> tuple[Strategy, ...]:
    """Those of the caller's strategies that are for models without pairs; one plain run where there are none."""
    return tuple(strategy for strategy in strategies if not strategy.for_pairs) or (SOLVE,)


def with_pairs(strategies: tuple[Strategy, ...]) -> tuple[Strategy, ...]:
    """Those of the caller's strategies that are for models with pairs; all of these where there are none."""
    return tuple(strategy for strategy in strategies if strategy.for_pairs) or DEFAULT_SEQUENCE
