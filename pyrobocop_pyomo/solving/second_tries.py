"""Which strategies follow where the one run of a model without pairs failed, and for how many iterations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.mpcc.active_set import Certificate

from .ipopt_options import ITERATIONS_OF_ONE
from .iterate_log import IterateLog
from .iterates import Iterate, StopReason
from .settings import Settings
from .strategies import (
    ABSOLUTE_VALUES,
    ADAPTIVE,
    ELASTIC_ROWS,
    OWN_UNITS,
    SECOND_TRIES,
    SIDE_STARTS,
    SIMULATED,
    SOLVE_TO_THE_END,
    STRAIGHT_LINES,
    TIGHTER,
    Strategy,
)

# All that follows may take so many iterations together; a start at the side takes few.
LATER_ITERATIONS, SIDE_ITERATIONS = 3 * ITERATIONS_OF_ONE, 100
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


def second_tries(settings: Settings, first: Iterate, log: IterateLog, *, scaled: bool) -> Iterator[Strategy]:
    """Strategies for a model without pairs, as long as they are worth trying, each with its limit of iterations.

    Limits are numbers of iterations: what comes out does not depend on how fast the machine is.

    Parameters
    ----------
    settings : Settings
    first : Iterate
        Where the first run ended.
    log : IterateLog
        Of all runs of the solve.
    scaled : bool
        Whether that run was of a program divided by typical sizes.
    """
    chosen, most = _chosen(settings, first, scaled), log.iterations + LATER_ITERATIONS
    for strategy in chosen:
        if log.iterations >= most:
            break
        limit = min(ITERATIONS_OF_ONE, most - log.iterations)
        yield replace(strategy, options={"max_iter": limit, **strategy.options})
    if chosen and settings.second_tries and first.status is IpoptStatus.ITERATION_LIMIT:
        yield SOLVE_TO_THE_END


def _chosen(settings: Settings, first: Iterate, scaled: bool) -> tuple[Strategy, ...]:
    user, status = settings.options.user, first.status
    if first.certificate is Certificate.DESCENT:
        return ()  # the same starts lead to the same saddle, and what follows one was tried
    # Ipopt's tolerances are relative to its scaling; the residuals are not. A run that converged has met no kink:
    # smaller tolerances take a few iterations, where absolute values in two parts take hundreds.
    nearest = (TIGHTER, ABSOLUTE_VALUES) if first.converged else (ABSOLUTE_VALUES,)
    if not settings.second_tries:
        return nearest  # other starts are the caller's
    if status in _HOPELESS or (status is IpoptStatus.ITERATION_LIMIT and "max_iter" in user):
        return ()
    if status is IpoptStatus.INTERNAL_ERROR:
        return (ABSOLUTE_VALUES,)  # the executable says no more where a step to a kink fails
    if status is IpoptStatus.TOO_FEW_FREEDOMS:
        return (ELASTIC_ROWS,)
    reason = first.stop_reason
    sides = tuple(replace(strategy, most_iterations=SIDE_ITERATIONS) for strategy in SIDE_STARTS)
    following = _FOLLOWING.get(reason, (*SECOND_TRIES, *sides))
    stuck = reason is not StopReason.DIVERGED and first.excess(settings.tolerances) <= 1.0
    if stuck and not first.converged:
        # A run that came to a feasible point and no further often ends there by a few more of new multipliers.
        following = (TIGHTER, *following)
    if status is IpoptStatus.ITERATION_LIMIT:
        following = (*sides, *following)  # which has them once more, for other failures
    # The caller's options win: a strategy that only sets them would be the first run again.
    return tuple(
        strategy
        for strategy in (*nearest, *following)
        if (not strategy.options or any(name not in user for name in strategy.options))
        and not (strategy is OWN_UNITS and not scaled)  # how the first run went
    )
