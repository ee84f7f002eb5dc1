"""`estimate`: parameters of a model from data, with what the data can say of them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.errors import EstimationError, NotIdentifiable
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.phases import note_outcome
from pyrobocop_pyomo.solving import Quality, SolveResult
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.studies.outcomes import seconds_left, solve_as_given
from pyrobocop_pyomo.studies.sweep import SweepResult, sweep

from .estimation_result import EstimationResult
from .fit_statistics import statistics_of
from .identifiability import identifiability
from .mesh_shift import remark_on_mesh
from .problem import EstimationProblem


def estimate(
    model: Any,
    data: Any = None,
    *,
    parameters: Sequence[str] | None = None,
    own: Sequence[str] = (),
    outputs: Any = None,
    phase: Any = None,
    error: Any = None,
    initial: str | Sequence[str] = "known",
    criterion: str = "least squares",
    starts: int = 1,
    seed: int = 0,
    spread: float = 1.0,
    confidence: float = 0.95,
    unidentifiable: str = "refuse",
    guess_from_data: bool = True,
    time_limit: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> EstimationResult:
    """Estimate time-invariant parameters of a model from measurements.

    Each data set gets a copy of the model, and all are solved together: a sum of weighted squared residuals is
    minimised subject to the equations, pairs included. Objectives of the model do not count. Before that, the
    experiments are simulated at the guess, and combinations of parameters that no measurement sees are named.

    Parameters
    ----------
    model : Block, callable, or labelled models
        A model with a `PhaseBlock`, which is copied; or a function that builds one from an item of `data`; or, without
        `data`, what `pyomo.contrib.parmest` takes: a model with the suffixes ``experiment_outputs`` and
        ``unknown_parameters``, an object with ``get_labeled_model()``, or a list of them.
    data : DataFrame, mapping, DataSet, or a list or mapping of them
        Measurements as `DataSet` describes them. Columns that are controls of the phase are what was applied, unless
        they are among the outputs.
    parameters : list of str, optional
        Names of variables to estimate, such as `rcp.Parameter` declares them; by default all free ones of the phase.
        Indexed ones stand for all their members.
    own : list of str
        Those among them that each data set has for itself; the others are shared.
    outputs : list of str, or mapping of str to rule or to name of an Expression, optional
        What was measured: states, algebraics, controls, Expressions indexed by the times of the phase, or rules
        ``rule(phase, t)``; by default all columns of the data.
    phase : str or PhaseBlock, optional
        Which phase was measured, where there are several.
    error : number, or mapping of output to number, optional
        Standard deviations of the measurements, where the data sets do not say them.
    initial : "known", "estimated" or list of str
        States whose values at the start are to be estimated for each data set. What the model leaves free there is
        estimated in any case.
    criterion : "least squares" or "normalised rmse"
        Least squares divide residuals by their standard deviations, where these are given. The other one divides them
        by the range of the data of their output, and counts every output the same.
    starts : int
        Number of starts; the first is the guess on the model. Others draw the unknowns.
    seed : int
        Of these draws.
    spread : float
        Unknowns with two bounds are drawn between them; others within a factor of ``1 + spread`` of their guess.
    confidence : float
        Level of the confidence intervals.
    unidentifiable : "refuse", "report" or "ignore"
        What to do about combinations that no measurement sees: raise before the fit, go on and keep the findings in the
        result, or do not look.
    guess_from_data : bool
        Start measured variables from their measurements instead of from the guess on the model.
    time_limit : float, optional
        Seconds, for everything together.
    progress : bool, optional
        Show how far it is; by default only on a terminal.
    **options
        Passed to `solve`.

    Returns
    -------
    EstimationResult
        Also when the fit was not solved. A single model that was given with a single data set holds the fit.

    Raises
    ------
    NotIdentifiable
        When measurements do not see the parameters; nothing was fitted then.
    EstimationError
        When model, data and names do not fit together.

    References
    ----------
    Bard (1974), Nonlinear Parameter Estimation, sec. 7-5;
    Raghunathan, Jha & Romeres, ICRA 2022, sec. V-E, doi:10.1109/ICRA46639.2022.9812069;
    Raue et al. (2009), Structural and practical identifiability analysis of partially observed dynamical models by
    exploiting the profile likelihood, doi:10.1093/bioinformatics/btp358
    """
    started, deadline = time.perf_counter(), Deadline.after(time_limit)
    _check_arguments(starts, spread, confidence, unidentifiable)
    problem = EstimationProblem(
        model,
        data,
        parameters=parameters,
        own=own,
        outputs=outputs,
        phase=phase,
        error=error,
        initial=initial,
        criterion=criterion,
        guess_from_data=guess_from_data,
    )
    bar = Progress(progress)
    diagnosis: Diagnosis | None = None
    if unidentifiable != "ignore":
        bar.live("what the measurements see")
        diagnosis = identifiability(problem, deadline, {"progress": False, **options})
        for finding in diagnosis.findings:
            bar.line(str(finding))
        if diagnosis.errors and unidentifiable == "refuse":
            said = "\n".join(map(str, diagnosis.errors))
            raise NotIdentifiable(
                f"nothing was fitted: {said}\nunidentifiable='report' goes on nevertheless.", diagnosis
            )
    several: SweepResult | None = None
    if starts > 1:
        several = _from_several(problem, starts, seed, spread, deadline, progress, options)
        result = several.load(several.best.case.number)
    else:
        bar.live("fitting")
        result = _fit(problem, deadline, {"progress": progress, **options})
    bar.live("the mesh")
    statistics = statistics_of(problem)
    if result.solved and not deadline.has_passed and (remark := remark_on_mesh(problem, statistics)):
        statistics = replace(statistics, remarks=(*statistics.remarks, remark))
    bar.live("")
    found = EstimationResult(
        problem=problem,
        result=result,
        statistics=statistics,
        diagnosis=diagnosis,
        starts=several,
        level=confidence,
        seconds=time.perf_counter() - started,
    )
    if isinstance(model, BlockData) and len(problem.experiments) == 1:
        _give_back(model, problem)
    return found


def _check_arguments(starts: Any, spread: Any, confidence: Any, unidentifiable: Any) -> None:
    if isinstance(starts, bool) or not isinstance(starts, int) or starts < 1:
        raise EstimationError(f"starts = {starts!r}; expected a number of starting points of at least 1.")
    if not isinstance(spread, (int, float)) or not 0.0 < spread < float("inf"):
        raise EstimationError(f"spread = {spread!r}; expected a positive number.")
    if not isinstance(confidence, (int, float)) or not 0.0 < confidence < 1.0:
        raise EstimationError(f"confidence = {confidence!r}; expected a level between 0 and 1, such as 0.95.")
    if unidentifiable not in ("refuse", "report", "ignore"):
        raise EstimationError(f"unidentifiable = {unidentifiable!r}; expected 'refuse', 'report' or 'ignore'.")


def _fit(problem: EstimationProblem, deadline: Deadline, options: dict[str, Any]) -> SolveResult:
    """Fit from the guess; where that leads nowhere, from the motion that the guess of the parameters gives."""
    start = VariableValues.of_all(problem.model)
    first = solve_as_given(problem.model, **{**options, "time_limit": seconds_left(deadline)})
    if first.solved or first.stop_reason.is_final:
        return first
    found = VariableValues.of_all(problem.model)
    start.restore()
    with problem.simulated():
        barrier = {"strategies": ("barrier",), **options, "time_limit": seconds_left(deadline)}
        simulated = solve_as_given(problem.model, **barrier)
    if simulated.quality is not Quality.INFEASIBLE and not deadline.has_passed:
        second = solve_as_given(problem.model, **{**options, "time_limit": seconds_left(deadline)})
        if second.standing.is_better_than(first.standing):
            return second
    found.restore()
    note_outcome(problem.model, first.outcome)
    return first


def _from_several(
    problem: EstimationProblem,
    starts: int,
    seed: int,
    spread: float,
    deadline: Deadline,
    progress: bool | None,
    options: dict[str, Any],
) -> SweepResult:
    """Fit from several values of the unknowns."""
    generator = np.random.default_rng(seed)
    cases = [dict(zip(problem.names, problem.estimates().tolist(), strict=True))]
    for _ in range(starts - 1):
        cases.append({unknown.name: _drawn(unknown.variable, spread, generator) for unknown in problem.unknowns})

    def put(model: Any, guess: dict[str, float]) -> None:
        for unknown in problem.unknowns:
            unknown.put(guess[unknown.name])

    def read(model: Any, result: SolveResult) -> dict[str, float]:
        return {f"fitted {name}": number for name, number in zip(problem.names, problem.estimates(), strict=True)}

    left = seconds_left(deadline)
    return sweep(
        problem.model, cases, put=put, read=read, start_from=None, time_limit=left, progress=progress, **options
    )


def _drawn(variable: Any, spread: float, generator: np.random.Generator) -> float:
    lower, upper = variable.bounds
    if lower is not None and upper is not None:
        if lower > 0.0 and upper > 10.0 * lower:  # over decades, each as likely as the others
            return float(np.exp(generator.uniform(np.log(lower), np.log(upper))))
        return float(generator.uniform(lower, upper))
    guess = float(variable.value)
    reach = np.log1p(spread)
    drawn = guess * np.exp(generator.uniform(-reach, reach)) if guess else spread * generator.uniform(-1.0, 1.0)
    drawn = drawn if lower is None else max(drawn, lower)
    return float(drawn if upper is None else min(drawn, upper))


def _give_back(model: Any, problem: EstimationProblem) -> None:
    """Put the fit on the user's model: its copy has the same variables in the same order."""
    (experiment,) = problem.experiments.values()
    theirs, ours = VariableValues.of_all(model), VariableValues.of_all(experiment.model)
    if len(theirs.variables) != len(ours.variables):
        return  # Params that became variables are in the copy only
    for variable, number in zip(theirs.variables, ours.read(), strict=True):
        if not variable.fixed:
            variable.set_value(number, skip_validation=True)
    for unknown, name in ((each, each.variable.name) for each in problem.unknowns):
        own = model.find_component(name.removeprefix(f"{experiment.model.name}."))
        if own is not None and own.fixed:
            own.set_value(unknown.variable.value, skip_validation=True)
