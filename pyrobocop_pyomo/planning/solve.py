"""`solve`: from a model with complementarity and obstacles to a checked plan, in one call."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, TextIO

from pyrobocop_pyomo.diagnosis.diagnose import doubts_before_solve, is_renamed
from pyrobocop_pyomo.diagnosis.findings import Finding, warning_about
from pyrobocop_pyomo.diagnosis.least_violation import least_violation
from pyrobocop_pyomo.diagnosis.statements import duration_findings, refuse_no_model
from pyrobocop_pyomo.discretisation.first_meshes import mesh_from_statement
from pyrobocop_pyomo.discretisation.probe import stepped_over
from pyrobocop_pyomo.errors import SolverNotFoundError
from pyrobocop_pyomo.ipopt.backends import Backend, available_backends, best_backend
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.keywords import keywords_checked
from pyrobocop_pyomo.modeling.variable_values import checksum_of_model
from pyrobocop_pyomo.obstacles import avoidance_blocks, containments
from pyrobocop_pyomo.obstacles.initial_checks import check_block, check_clocks, check_region
from pyrobocop_pyomo.phases import note_outcome, phases_of
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.solving.ipopt_options import IpoptOptions
from pyrobocop_pyomo.solving.iterates import Quality, checked_tolerances
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.solve_result import SolveResult
from pyrobocop_pyomo.solving.strategies import Choices, Settings, settings_of

from .integer_controls import open_choices, solve_with_integer_controls
from .mesh_loop import solve_on_finer_meshes
from .safe_planning import SafePlanning
from .switches_at_boundaries import SwitchesAtBoundaries

# What a strategy, other packages and Ipopt call it.
OTHER_WORDS = {
    **{
        name: f"strategies=rcp.Strategy({name}=...)"
        for name in ("relaxation", "grouping", "schedule", "polish", "exploration")
    },
    "max_iter": "options={'max_iter': ...}",
    "maxiter": "options={'max_iter': ...}",
    "tol": "options={'tol': ...}, or tolerances={'feasibility': ...}",
    "tolerance": "tolerances={'feasibility': ...}",
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


@keywords_checked(OTHER_WORDS)
def solve(
    model: Any,
    *,
    strategies: Choices = None,
    backend: Backend | str | None = None,
    options: Mapping[str, Any] | None = None,
    tee: bool | Sequence[TextIO] = False,
    time_limit: float | None = None,
    tolerances: Mapping[str, float] | None = None,
    progress: bool | Progress | None = None,
    mesh_tolerance: float | None = 1e-3,
) -> SolveResult:
    """Solve a model with complementarity pairs: relax, continue, polish, certify, and report.

    The model is checked first, then relaxed, solved by runs of Ipopt, and taken back: afterwards it holds the best
    point found and is otherwise as it was. A relaxation that the user has applied is used and kept, without polish
    where it is not lifted.

    Strategies follow each other in the order of a table until one gives a certified point, and the best point of all
    wins (see "When a run fails" in the documentation). Models without pairs are solved by one run, "solve". Where it
    fails or takes more than 500 iterations, what follows may take 1500 iterations together, each at most 500; after a
    limit that the caller set by ``options={"max_iter": ...}``, nothing does. With obstacles, the recovery has starts of
    its own instead. An initial guess at which an expression has no value is left for one at which all have, and the
    result names it.

    A solution of a model with phases is a local one, so that a few other starts follow (see `Strategy`), unless its
    rows are linear and its objective is quadratic and convex: the motion under mirrored controls of the answer
    ("mirrored"), under random controls ("random motion", "random motion 2", ...), random controls with states on lines
    ("random controls", ...), random values ("random start", ...). From 80 elements in a phase on, they run on a quarter
    of the elements, and only a better answer there leads on, as "other optimum".

    With pairs, "barrier" lets delta follow Ipopt's barrier parameter in one solve, ``FollowBarrier(factor=2)``,
    "continuation" takes it from 1 to 1e-8 by factors of 0.1, warm in primal and dual values, "elastic" bounds the
    products by a variable with a penalty term in the objective, and "tight" is one solve at delta = 1e-8.

    Where all of these end at worse points than the initial guess, and rows and pairs hold there, the initial guess is
    polished itself.

    Every strategy ends with a *polish*: the nonlinear program of the nearest branch is solved, so that each pair is met
    exactly; other branches through the point are followed as long as they descend; and the multipliers that are left,
    or a linear program with complementarity constraints, certify that none does. Branches that the same linear program
    names from farther away are explored as well (steps "explore"). Where no branch can be solved, delta goes down to
    1e-12 instead. A polish that fails costs nothing: the point before it stays a candidate.

    Parameters
    ----------
    model : ConcreteModel or Block
        Any Pyomo model, with phases or without.
    strategies : str, Strategy or several of them, optional
        Which strategies to run, in this order; by default all. Those for models of the other kind, with pairs or
        without, are left out. A `Strategy` says also how pairs are relaxed and grouped, whether points are polished
        and how long better optima are looked for: ``rcp.Strategy(polish=False)`` is the default sequence without
        polish.
    backend : Backend or str, optional
        Which Ipopt: ``"vectorised"`` (in this process, derivatives by CasADi; also called ``"casadi"``), ``"asl"`` (in
        this process, derivatives by ASL), ``"in process"`` (the first of these that is present) or ``"executable"``.
        By default the first that is present and takes the model.
    options : mapping, optional
        Ipopt's options; they win over all that are set here, in every run. Models without pairs, obstacles and regions
        are scaled: Ipopt sees variables, rows and objective divided by their typical sizes; values, residuals and
        multipliers come back in the model's units. A suffix ``scaling_factor`` of the model wins for what it names;
        with the option ``nlp_scaling_method`` only that option scales.
    tee : bool or sequence of text streams
        Show Ipopt's log, on standard output or on these streams.
    time_limit : float, optional
        Seconds, for everything together; the run of Ipopt that goes on then ends with its iteration.
    tolerances : mapping of str to float, optional
        Of an acceptable point: ``"feasibility"`` is the largest violation of a constraint or bound, relative to the
        largest term that the constraint adds up there, or to the variable, where that is above 1 (1e-6);
        ``"complementarity"`` the largest product ``a b`` (1e-7); ``"natural"`` the largest ``|min(a, b)|`` of a pair
        that is met exactly (1e-6); ``"stationarity"`` what may be left of first-order conditions (1e-5).
    progress : bool, optional
        Show a line per step; by default only on a terminal.
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
    refuse_no_model(model)
    limits = checked_tolerances(tolerances)
    if time_limit is not None and (not isinstance(time_limit, Real) or time_limit != time_limit):
        raise ValueError(f"time_limit = {time_limit!r}; expected seconds, or None for no limit.")
    blocks, regions = avoidance_blocks(model), containments(model)
    chosen, fallbacks = _backends(backend)
    settings = Settings(
        **settings_of(strategies),
        backend=chosen,
        fallbacks=fallbacks,
        options=IpoptOptions(user=dict(options or {})),
        tolerances=limits,
        deadline=Deadline.after(time_limit),
        output=tuple(tee) if isinstance(tee, Sequence) else ((sys.stdout,) if tee else ()),
        progress=Progress.of(progress),
        scaling=not (blocks or regions),  # their rows are of size one where lengths are
    )
    if mesh_tolerance is not None and not (isinstance(mesh_tolerance, Real) and float(mesh_tolerance) > 0.0):
        raise ValueError(f"mesh_tolerance = {mesh_tolerance!r}; expected a number above 0, such as 1e-3, or None.")
    for phase in phases_of(model):
        phase.check()
    doubts = doubts_before_solve(model)
    for block in blocks:
        check_block(block, limits.feasibility)
    check_clocks(blocks)
    for region in regions:
        check_region(region, limits.feasibility)

    has_choices = bool(open_choices(model))

    def as_it_stands() -> SolveResult:
        if blocks or regions:
            # Where no plan is found, the recovery has other starts.
            return SafePlanning(model, replace(settings, second_tries=False)).plan()
        if mesh_tolerance is None or has_choices or is_renamed(model):
            return solve_model(model, settings)
        first = mesh_from_statement(phases_of(model))
        result = solve_on_finer_meshes(model, mesh_tolerance, settings)
        if result.residuals:
            result = SwitchesAtBoundaries(model, settings).improved(result)
        return replace(result, remarks=(*first, *result.remarks))

    if has_choices:
        result = solve_with_integer_controls(model, as_it_stands, settings.deadline)
    else:
        result = as_it_stands()
    # Controls that were rounded are free again: without their values the rows would be those of the relaxed problem.
    if result.quality is Quality.INFEASIBLE and not result.stop_reason.is_final and result.rounding is None:
        result = replace(result, least_violation=least_violation(model, settings.deadline))
    if result.quality is not Quality.INFEASIBLE and not is_renamed(model):
        missed = _missed_between_points(phases_of(model))
        result = replace(result, doubts=(*result.doubts, *missed, *duration_findings(model)))
    fingerprint = None if result.safety is None else checksum_of_model(model)
    seconds = time.perf_counter() - started
    result = replace(result, doubts=(*doubts, *result.doubts), seconds=seconds, fingerprint=fingerprint)
    note_outcome(model, result.outcome)
    return result


def _missed_between_points(phases: Iterable[Any]) -> Iterator[Finding]:
    for phase in phases:
        missed = sorted(stepped_over(phase), key=lambda found: -found[1])
        for name, amount, moment in missed[:1]:
            more = f", and {len(missed) - 1} more" if len(missed) > 1 else ""
            yield warning_about(
                f"phase '{phase.name}': constraint '{name}' holds at the points of the mesh, and is missed between "
                f"them, at t = {moment:.6g} by {amount:.2g}{more}.",
                (f"{phase.name}.{name}" for name, _, _ in missed),
                "Take more elements, a margin, or for an obstacle an ObstacleAvoidanceBlock, which is kept in between.",
            )


def _backends(choice: Backend | str | None) -> tuple[Backend, tuple[Backend, ...]]:
    """The backend to take, and those to take where it cannot take the model: none, where one is requested.

    CasADi's comes first: what rows share is differentiated once, and it needs nothing but a package from PyPI.
    """
    present = available_backends()
    if choice is None:
        best = best_backend()
        # The executable has the derivatives of ASL as well, and nothing that the others lack.
        return best, tuple(backend for backend in present if backend not in (best, Backend.EXECUTABLE))
    words = {
        "in process": next((of for of in present if of is not Backend.EXECUTABLE), Backend.IN_PROCESS_VECTORISED),
        "asl": Backend.IN_PROCESS_ASL,
        "casadi": Backend.IN_PROCESS_CASADI,
        "vectorised": Backend.IN_PROCESS_VECTORISED,
        "executable": Backend.EXECUTABLE,
    }
    wanted = choice if isinstance(choice, Backend) else words.get(choice)
    if wanted is None:
        raise ValueError(f"backend = {choice!r}; choose {', '.join(map(repr, words))} or a Backend.")
    if wanted not in present:
        found = "; ".join(backend.value for backend in present) or "none"
        raise SolverNotFoundError(
            f"{wanted.value}: not found on this machine; found: {found}. "
            "'python -m pyrobocop_pyomo doctor' shows what is missing."
        )
    return wanted, ()
