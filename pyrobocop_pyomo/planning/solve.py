"""`solve`: from a model with complementarity and obstacles to a checked plan, in one call."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, TextIO

from pyrobocop_pyomo.complementarity import Schedule
from pyrobocop_pyomo.diagnosis.before_solve import doubts_before_solve
from pyrobocop_pyomo.diagnosis.findings import Finding, Severity, Subject
from pyrobocop_pyomo.diagnosis.statements import refuse_inconsistent_units, refuse_misplaced
from pyrobocop_pyomo.discretisation.first_meshes import FirstMeshes, mesh_from_statement
from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.ipopt.backends import Backend, available_backends, best_backend
from pyrobocop_pyomo.ipopt.c_output import standard_output
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.keywords import keywords_checked
from pyrobocop_pyomo.modeling.rare_collections import rare_collections
from pyrobocop_pyomo.modeling.variable_values import checksum_of_model
from pyrobocop_pyomo.obstacles.clocks import check_clocks
from pyrobocop_pyomo.obstacles.initial_checks import (
    check_clearances,
    check_contained_motion,
    check_digits,
    check_fixed_inside,
    check_motion,
    warn_about_soft_clearance,
)
from pyrobocop_pyomo.phases import note_outcome, phases_of
from pyrobocop_pyomo.solving.ipopt_options import IpoptOptions
from pyrobocop_pyomo.solving.iterates import Quality, Tolerances
from pyrobocop_pyomo.solving.least_violation import least_violation
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult
from pyrobocop_pyomo.solving.starts import are_renamed
from pyrobocop_pyomo.solving.strategies import Strategy, as_strategies

from .finer_meshes import FinerMeshes
from .integer_controls import open_choices, solve_with_integer_controls
from .safe_planning import SafePlanning, avoidance_blocks, containments
from .switches_at_boundaries import SwitchesAtBoundaries

# What other packages, and Ipopt, call it.
_OTHER_WORDS = {
    "max_iter": "options={'max_iter': ...}",
    "maxiter": "options={'max_iter': ...}",
    "tol": "options={'tol': ...}, or feasibility_tolerance=...",
    "tolerance": "feasibility_tolerance",
    "solver": "backend",
    "linear_solver": "options={'linear_solver': ...}",
    "timelimit": "time_limit",
    "timeout": "time_limit",
    "max_time": "time_limit",
    "verbose": "tee=True",
    "solver_options": "options",
    "method": "strategies",
    "initial_guess": "initial_guess=... of the declarations",
}


@keywords_checked(_OTHER_WORDS)
@rare_collections()
def solve(
    model: Any,
    *,
    relaxation: Any = "scholtes",
    grouping: Any = "pair",
    schedule: Schedule | None = None,
    strategies: str | Strategy | Iterable[str | Strategy] | None = None,
    polish: bool = True,
    exploration: float | None = None,
    backend: Backend | str | None = None,
    options: Mapping[str, Any] | None = None,
    tee: bool | Sequence[TextIO] = False,
    time_limit: float | None = None,
    feasibility_tolerance: float = 1e-6,
    complementarity_tolerance: float = 1e-7,
    progress: bool | Progress | None = None,
    equations: bool = True,
    scaling: bool | None = None,
    mesh_tolerance: float | None = 1e-3,
) -> SolveResult:
    """Solve a model with complementarity pairs: relax, continue, polish, certify, and report.

    The model is checked first, then relaxed, solved by runs of Ipopt, and taken back: afterwards it holds the best
    point found and is otherwise as it was. A relaxation that the user has applied is used and kept, without polish
    where it is not lifted. Where all strategies end infeasible from the initial guess, two follow from elsewhere:
    "simulated, with pairs" and "straight lines, with pairs".

    Models without pairs are solved by one run, "solve". Where it fails or takes more than 500 iterations, further
    strategies follow until one gives a solution by recomputed residuals; together they may take twice its iterations,
    and at least 1500, each at most 500:

    * "absolute values as pairs": where the model holds absolute values, a copy with their two parts is solved; in a
      model with pairs this comes last;
    * "tighter": from a point that is solved by Ipopt's scaled tolerances only, with smaller ones;
    * "own units": with Ipopt's scaling instead of that by typical sizes;
    * "simulated": from the motion of the phases under the controls of the initial guess;
    * "elastic rows": all rows may be violated at a price first, then on from there; what has more equations than
      variables, or equations that follow from each other, is solved by this one;
    * "coarse mesh": from the answer on a quarter of the elements;
    * "adaptive": with Ipopt's adaptive barrier parameter;
    * "straight lines", "inside bounds": from states on lines between their ends, and from the middle of all bounds;
    * "random controls 1", "random start 1": short runs from beside a guess that may be symmetric; first of all after
      500 iterations, and then, where nothing helps, "solve to the end" has the rest of Ipopt's limit.

    A solution of a model with phases is a local one, so that a few other starts follow (see `exploration`), unless its
    rows are linear and its objective is quadratic and convex: the motion under mirrored controls of the answer
    ("mirrored"), under random controls ("random motion 1", ...), random controls with states on lines ("random
    controls 1", ...), random values ("random start 1", ...). The best certified point wins. From 80 elements in a phase
    on, they run on a quarter of the elements, and only a better answer there leads on, as "other optimum".

    After local infeasibility only "own units", "simulated", "elastic rows" and "straight lines"
    follow; after a limit that the caller set by ``options={"max_iter": ...}``, none. With obstacles, the recovery has
    starts of its own instead. An initial guess at which an expression has no value is left for one at which all have,
    and the result names it.

    With pairs, strategies follow each other until one gives a certified point, and the best point of all wins:

    * "barrier": delta follows Ipopt's barrier parameter in one solve, ``FollowBarrier(factor=2)``;
    * "tight": one solve at delta = 1e-8 from the user's initial guess, as a cross-check of up to 100 pairs;
    * "continuation": delta from 1 to 1e-8 by factors of 0.1, warm in primal and dual values; also a second opinion
      on certified points where there are more than 100 pairs, or where the strategies so far do not agree on one;
    * "elastic": the products below a variable with a penalty term in the objective;
    * "projection": the branch that the linearised constraints can be met in, from the best point so far.

    Every strategy ends with a *polish*: the nonlinear program of the nearest branch is solved, so that each pair is met
    exactly; other branches through the point are followed as long as they descend; and the multipliers that are left,
    or a linear program with complementarity constraints, certify that none does. Branches that the same linear program
    names from farther away are explored as well (steps "explore"). Where no branch can be solved, delta goes down to
    1e-12 instead. A polish that fails costs nothing: the point before it stays a candidate.

    From 1000 pairs on, phases with implicit Euler are solved on a coarse mesh of 400 elements first, by "barrier" and
    by "continuation"; the better answer is where "barrier" starts on the user's mesh. Where that gives no certified
    point, the strategies follow as without a coarse mesh.

    Parameters
    ----------
    model : ConcreteModel or Block
        Any Pyomo model, with phases or without.
    relaxation, grouping : str or object
        As for ``pyrobocop.relax_complementarity``.
    schedule : Schedule, optional
        How delta shrinks, in a single strategy of its own instead of the default sequence.
    strategies : str, Strategy or several of them, optional
        Which strategies to run, in this order; by default all. Those for models of the other kind, with pairs or
        without, are left out.
    polish : bool
        Polish the point of each strategy; without it, a point is as complementary as its relaxation.
    exploration : float, optional
        How long to look for better optima beyond a certified point, as a multiple of the time that the rest of the
        solve took so far: in branches farther away, by other ways down, and from up to 32 random starts;
        ``float("inf")`` for no limit but `time_limit`. It ends after eight ways and starts in a row without a better
        point. By default 1 up to 100 pairs, and at least a second; then less, and 0 from 200 pairs; not more
        iterations than those so far, or 300; and, after a solve of at most 300 iterations, three ways and starts.
        Without pairs, in models with phases, by default 80 iterations and 0.4 times those so far, less from 500
        variables on, down to a quarter. A number asks for more starts, as long as eight in a row lead to nothing
        better, in any model without pairs. 0 ends the solve with its first solution.
    backend : Backend or str, optional
        Which Ipopt: ``"in process"`` (the best derivatives present), ``"asl"``, ``"casadi"``, ``"vectorised"`` or
        ``"executable"``. By default ``"vectorised"`` for models with obstacles and for those whose nonlinear
        terms repeat few shapes, as all models on a mesh do; else the best that is present.
    options : mapping, optional
        Ipopt's options; they win over all that are set here, in every run.
    tee : bool or sequence of text streams
        Show Ipopt's log, on standard output or on these streams.
    time_limit : float, optional
        Seconds, for everything together; the run of Ipopt that goes on then ends with its iteration.
    feasibility_tolerance : float
        Largest violation of a constraint or bound in an acceptable point; relative to the largest term that the
        constraint adds up there, or to the variable, where that is above 1.
    complementarity_tolerance : float
        Largest product ``a b`` in an acceptable point.
    progress : bool, optional
        Show a line per step; by default only on a terminal.
    equations : bool
        Among obstacles: whether the motion that the equations make of the plan's controls keeps clear as well, on a
        finer mesh where it has to. False for robots whose controller tracks the polynomials of the plan.
    scaling : bool, optional
        Let Ipopt see variables, rows and objective divided by their typical sizes, where the model has no pairs. By
        default so, except with obstacles and regions, whose rows are of size one where lengths are.
        Values, residuals and multipliers come back in the model's units. A suffix ``scaling_factor`` of the model
        wins for what it names; with Ipopt's option ``nlp_scaling_method`` only that option scales.
    mesh_tolerance : float, optional
        Where the estimated error of the objective is above this part of its size, or that of the motion above ten times
        as much of a state's size, the meshes of all phases get finer, in place, and the model is solved again from
        there; see `SolveResult.discretisation`. Up to eight times the elements, and about ten times the effort of the
        first solve. Before the first solve, they are made fine enough for what is stated over time, such as periods
        and jumps. With pairs that change sides inside elements of several points, boundaries move to the switches.
        Not with obstacles, whose meshes follow from what is proven, and not with integer controls. None keeps the
        meshes as they are.

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
    refuse_misplaced(model)
    _check_limits(time_limit, feasibility_tolerance, complementarity_tolerance)
    blocks, regions = avoidance_blocks(model), containments(model)
    chosen, fallbacks = _backends(backend, vectorised=bool(blocks))
    settings = Settings(
        relaxation=relaxation,
        grouping=grouping,
        backend=chosen,
        fallbacks=fallbacks,
        strategies=_strategies(schedule, strategies),
        options=IpoptOptions(user=dict(options or {})),
        tolerances=Tolerances(feasibility=feasibility_tolerance, product=complementarity_tolerance),
        polish=polish,
        exploration=exploration,
        deadline=Deadline.after(time_limit),
        output=tuple(tee) if isinstance(tee, Sequence) else ((standard_output(),) if tee else ()),
        progress=Progress.of(progress),
        scaling=False if scaling is None and (blocks or regions) else scaling,
    )
    if exploration is not None and not exploration >= 0.0:
        raise ValueError(f"exploration = {exploration!r}; expected a multiple of the solve's time, 0 or more.")
    if mesh_tolerance is not None and not (isinstance(mesh_tolerance, Real) and float(mesh_tolerance) > 0.0):
        raise ValueError(f"mesh_tolerance = {mesh_tolerance!r}; expected a number above 0, such as 1e-3, or None.")
    for phase in phases_of(model):
        phase.check()
    refuse_inconsistent_units(model)
    doubts = doubts_before_solve(model)
    for block in blocks:
        check_clearances(block, feasibility_tolerance)
        warn_about_soft_clearance(block)
        check_motion(block)
        check_digits(block, feasibility_tolerance)
    check_clocks(model, blocks)
    for region in regions:
        check_fixed_inside(region, feasibility_tolerance)
        check_contained_motion(region)

    choices = open_choices(model)

    def as_it_stands() -> SolveResult:
        if blocks or regions:
            # Where no plan is found, the recovery has other starts.
            without = replace(settings, second_tries=False)
            return SafePlanning(model, blocks, regions, without, equations=equations).plan()
        if mesh_tolerance is None or choices or are_renamed(phases_of(model)):
            return solve_model(model, settings)
        first = mesh_from_statement(phases_of(model))
        result = FinerMeshes(model, mesh_tolerance, settings).solve()
        if result.residuals:
            result = SwitchesAtBoundaries(model, settings).improved(result)
        return replace(result, remarks=(*first.remarks, *result.remarks), doubts=(*_unseen(first), *result.doubts))

    if choices:
        result = solve_with_integer_controls(
            model, choices, as_it_stands, settings.deadline, keeps_mesh=mesh_tolerance is None
        )
    else:
        result = as_it_stands()
    # Controls that were rounded are free again: without their values the rows would be those of the relaxed problem.
    if result.quality is Quality.INFEASIBLE and not result.stop_reason.is_final and result.rounding is None:
        result = replace(result, least_violation=least_violation(model, settings.deadline))
    fingerprint = None if result.safety is None else checksum_of_model(model)
    result = replace(
        result,
        doubts=(*doubts, *result.doubts),
        seconds=time.perf_counter() - started,
        fingerprint=fingerprint,
    )
    note_outcome(model, result.outcome)
    return result


def _unseen(first: FirstMeshes) -> list[Finding]:
    remedy = "Declare more elements, or a mesh= with boundaries where it changes."
    return [Finding(Severity.WARNING, Subject.DATA, unseen, (), remedy) for unseen in first.unseen()]


def _check_limits(time_limit: Any, feasibility_tolerance: Any, complementarity_tolerance: Any) -> None:
    tolerances = {
        "feasibility_tolerance": feasibility_tolerance,
        "complementarity_tolerance": complementarity_tolerance,
    }
    for name, tolerance in tolerances.items():
        if not isinstance(tolerance, Real) or not float(tolerance) > 0.0:
            raise ValueError(f"{name} = {tolerance!r}; expected a number above 0, such as 1e-6.")
    if time_limit is not None and (not isinstance(time_limit, Real) or time_limit != time_limit):
        raise ValueError(f"time_limit = {time_limit!r}; expected seconds, or None for no limit.")


def _strategies(
    schedule: Schedule | None, strategies: str | Strategy | Iterable[str | Strategy] | None
) -> tuple[Strategy, ...] | None:
    if schedule is not None and strategies is not None:
        raise ValueError("schedule= is a strategy of its own; give it or strategies=, not both.")
    if schedule is not None:
        return (Strategy("schedule", schedule),)
    return None if strategies is None else as_strategies(strategies)


def _backends(choice: Backend | str | None, *, vectorised: bool) -> tuple[Backend, tuple[Backend, ...]]:
    """The backend to take, and those to take where it cannot take or evaluate the model: none, where one is requested.

    Parameters
    ----------
    choice : Backend, str or None
    vectorised : bool
        Whether the vectorised backend comes first. In models with obstacles each turned normal is part of the rows of
        many corners. ASL differentiates such shared parts anew for each row, which takes several times as long.
    """
    present = available_backends()
    if choice is None:
        best = best_backend()
        # The executable has the derivatives of ASL as well, and nothing that the others lack.
        others: list[Backend] = [backend for backend in present if backend not in (best, Backend.EXECUTABLE)]
        if vectorised and Backend.IN_PROCESS_VECTORISED in others:
            others.remove(Backend.IN_PROCESS_VECTORISED)
            best, others = Backend.IN_PROCESS_VECTORISED, [best, *others]
        return best, tuple(others)
    words = {
        "asl": Backend.IN_PROCESS_ASL,
        "casadi": Backend.IN_PROCESS_CASADI,
        "vectorised": Backend.IN_PROCESS_VECTORISED,
        "executable": Backend.EXECUTABLE,
    }
    if choice == "in process":
        wanted = Backend.IN_PROCESS_ASL if Backend.IN_PROCESS_ASL in present else Backend.IN_PROCESS_CASADI
    elif isinstance(choice, Backend):
        wanted = choice
    elif choice in words:
        wanted = words[choice]
    else:
        raise ValueError(f"backend = {choice!r}; choose 'in process', {', '.join(map(repr, words))} or a Backend.")
    if wanted not in present:
        found = "; ".join(backend.value for backend in present) or "none"
        raise SolverNotFoundError(
            f"{wanted.value}: not found on this machine; found: {found}. "
            "'python -m pyrobocop_pyomo doctor' shows what is missing."
        )
    return wanted, ()
