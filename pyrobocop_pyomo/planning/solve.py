"""`solve`: from a model with complementarity and obstacles to a checked plan, in one call."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TextIO

from pyrobocop_pyomo.complementarity import Schedule, pairs_of
from pyrobocop_pyomo.ipopt.backends import Backend, available_backends
from pyrobocop_pyomo.obstacles.initial_checks import (
    check_clearances,
    check_contained_motion,
    check_fixed_inside,
    check_motion,
)
from pyrobocop_pyomo.solving.procedure import (
    DEFAULT_OPTIONS,
    DEFAULT_PAIR_OPTIONS,
    _check_phases,
    _chosen_strategies,
    _find_backend,
    climb,
)
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult
from pyrobocop_pyomo.solving.strategies import Strategy
from pyrobocop_pyomo.solving.tolerances import Tolerances

from .safe_planning import SafePlanning, avoidance_blocks, containments


def solve(
    model: Any,
    *,
    relaxation: Any = "scholtes",
    grouping: Any = "pair",
    schedule: Schedule | None = None,
    strategies: str | Strategy | Iterable[str | Strategy] | None = None,
    polish: bool = True,
    backend: Backend | str | None = None,
    options: Mapping[str, Any] | None = None,
    tee: bool | Sequence[TextIO] = False,
    time_limit: float | None = None,
    feasibility_tolerance: float = 1e-6,
    complementarity_tolerance: float = 1e-7,
    progress: bool | None = None,
) -> SolveResult:
    """Solve a model with complementarity pairs: relax, continue, polish, certify, and report.

    The model is checked first, then relaxed, solved by runs of Ipopt, and taken back: afterwards it holds the best
    point found and is otherwise as it was. A relaxation that the user has applied is used and kept, without polish
    where it is not lifted. Models without pairs are solved by one run.

    The strategies of the ladder are climbed until one gives a certain point, and the best point of all wins:

    * "barrier": delta follows Ipopt's barrier parameter in one solve, ``FollowBarrier(factor=2)``;
    * "tight": one solve at delta = 1e-8 from the user's guess, as a cross-check of up to 100 pairs;
    * "continuation": delta from 1 to 1e-8 by factors of 0.1, warm in primal and dual values; also a second opinion
      on certain points where there are more than 100 pairs, or where solutions found so far differ;
    * "elastic": the products below a variable that is charged in the objective;
    * "projection": the branch that the linearised constraints can be met in, from the best point so far.

    Every strategy is finished by a *polish*: the nonlinear program of the nearest branch is solved, so that each pair
    is met exactly; other branches through the point are followed as long as they descend; and the multipliers that are
    left, or a linear program with complementarity constraints, certify that none does. Up to 100 pairs, branches that
    the same linear program names from farther away are tried as well (steps "explore"). Where no branch can be solved,
    delta goes down to 1e-12 instead.

    Parameters
    ----------
    model : ConcreteModel or Block
        Any Pyomo model, with phases or without.
    relaxation, grouping : str or object
        As for ``pyrobocop.relax_complementarity``.
    schedule : Schedule, optional
        How delta shrinks, in a single strategy of its own instead of the ladder.
    strategies : str, Strategy or several of them, optional
        Which strategies to climb; by default the whole ladder.
    polish : bool
        Finish each strategy as described; without it, a point is as complementary as its relaxation.
    backend : Backend or str, optional
        Which Ipopt: ``"in process"`` (the best derivatives present), ``"asl"``, ``"casadi"``, ``"vectorised"`` or
        ``"executable"``. By default the best that is present; for models with obstacles ``"vectorised"``, which is
        faster there.
    options : mapping, optional
        Ipopt's options; they win over those that are set here.
    tee : bool or sequence of text streams
        Show Ipopt's log, on standard output or on these streams.
    time_limit : float, optional
        Seconds, for all runs together.
    feasibility_tolerance : float
        Largest violation of a constraint or bound in an acceptable point.
    complementarity_tolerance : float
        Largest product ``a b`` in an acceptable point.
    progress : bool, optional
        Show a line per step; by default only on a terminal.

    Returns
    -------
    SolveResult
        Also after a failure, a limit or Ctrl-C.

    Raises
    ------
    ModelError
        When the model makes no sense; nothing was solved then.
    SolverNotFoundError
        When there is no Ipopt; the message lists the remedies.

    References
    ----------
    Raghunathan & Biegler, An interior point method for mathematical programs with complementarity constraints,
    SIAM J. Optim. 15 (2005), doi:10.1137/S1052623403429081;
    Raghunathan, Jha & Romeres, ICRA 2022, sec. III-B, doi:10.1109/ICRA46639.2022.9812069;
    Nurkanovic & Leyffer (2025), A globally convergent method for computing B-stationary points of mathematical
    programs with equilibrium constraints, doi:10.48550/arXiv.2501.13835
    """
    started = time.perf_counter()
    blocks, regions = avoidance_blocks(model), containments(model)
    chosen_backend, otherwise = _find_backend(backend), None
    # Each turned normal is part of the rows of many corners. ASL differentiates such shared parts anew for each row,
    # which takes several times as long; vectorised expressions do not know all functions, though.
    if blocks and backend is None and Backend.IN_PROCESS_VECTORISED in available_backends():
        chosen_backend, otherwise = Backend.IN_PROCESS_VECTORISED, chosen_backend
    chosen_strategies = _chosen_strategies(schedule, strategies)
    _check_phases(model)
    for block in blocks:
        check_clearances(block, feasibility_tolerance)
        check_motion(block)
    for region in regions:
        check_fixed_inside(region, feasibility_tolerance)
        check_contained_motion(region)
    bar = Progress(progress)
    tolerances = Tolerances(feasibility=feasibility_tolerance, product=complementarity_tolerance)
    has_pairs = bool(pairs_of(model))
    wanted = {**DEFAULT_OPTIONS, **(DEFAULT_PAIR_OPTIONS if has_pairs else {}), **(options or {})}
    output = tuple(tee) if isinstance(tee, Sequence) else ((sys.stdout,) if tee else ())
    settings = Settings(relaxation, grouping, chosen_backend, wanted, output, tolerances, polish, otherwise)

    def left() -> float | None:
        return None if time_limit is None else time_limit - (time.perf_counter() - started)

    if blocks or regions:
        result = SafePlanning(
            model, blocks, regions, partial(climb, model), settings, chosen_strategies, bar, left
        ).plan()
    else:
        result = climb(model, settings, chosen_strategies, bar, left)
    return replace(result, seconds=time.perf_counter() - started)
