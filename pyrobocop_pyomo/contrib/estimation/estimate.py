"""`estimate`: parameters of a model from data, with what the data can say of them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from pyomo.common.collections import ComponentSet
from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.studies.outcomes import seconds_left, solve_as_given

from .estimation_result import EstimationResult
from .fit_remarks import remarks_on_mesh
from .fit_statistics import statistics_of
from .identifiability import identifiability
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
    confidence: float = 0.95,
    unidentifiable: str = "refuse",
    time_limit: float | None = None,
    progress: bool | None = None,
    **options: Any,
) -> EstimationResult:
    """Estimate time-invariant parameters of a model from measurements.

    Each data set gets a copy of the model, and all are solved together: a sum of weighted squared residuals is
    minimised subject to the equations, pairs included. Objectives of the model do not count. Measured variables start
    from their measurements. Before that, the experiments are simulated at the guess, and combinations of parameters
    that no measurement sees are named.

    Parameters
    ----------
    model : Block, or labelled models
        A model with a `PhaseBlock`, which is copied; or, without `data`, what `pyomo.contrib.parmest` takes: a model
        with the suffixes ``experiment_outputs`` and ``unknown_parameters`` (`rcp.label_measurements` makes them), an
        object with ``get_labeled_model()``, or a list of them, where each experiment has a model of its own.
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
    confidence : float
        Level of the confidence intervals.
    unidentifiable : "refuse", "report" or "ignore"
        What to do about combinations that no measurement sees: raise before the fit, go on and keep the findings in the
        result, or do not look.
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
    EstimationError
        When measurements do not see the parameters; nothing was fitted then.
        When model, data and names do not fit together.

    References
    ----------
    Bard (1974), Nonlinear Parameter Estimation, sec. 7-5;
    Raghunathan, Jha & Romeres, ICRA 2022, sec. V-E, doi:10.1109/ICRA46639.2022.9812069
    """
    started, deadline = time.perf_counter(), Deadline.after(time_limit)
    if not isinstance(confidence, (int, float)) or not 0.0 < confidence < 1.0:
        raise EstimationError(f"confidence = {confidence!r}; expected a level between 0 and 1, such as 0.95.")
    if unidentifiable not in ("refuse", "report", "ignore"):
        raise EstimationError(f"unidentifiable = {unidentifiable!r}; expected 'refuse', 'report' or 'ignore'.")
    problem = EstimationProblem(
        model, data, parameters=parameters, own=own, outputs=outputs, phase=phase, error=error, initial=initial
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
            raise EstimationError(
                f"nothing was fitted: {said}\nunidentifiable='report' goes on nevertheless.", diagnosis
            )
    bar.live("fitting")
    result = solve_as_given(problem.model, **{"progress": progress, **options, "time_limit": seconds_left(deadline)})
    bar.live("the mesh")
    statistics = statistics_of(problem)
    if result.solved and not deadline.has_passed:
        coarse = remarks_on_mesh(problem, statistics.matrix, statistics.standard_errors)
        statistics = replace(statistics, remarks=(*statistics.remarks, *coarse))
    bar.live("")
    if isinstance(model, BlockData) and len(problem.experiments) == 1:
        _give_back(model, problem)
    return EstimationResult(problem, result, statistics, diagnosis, confidence, time.perf_counter() - started)


def _give_back(model: Any, problem: EstimationProblem) -> None:
    """Put the fit on the user's model: its copy has the same variables in the same order."""
    (experiment,) = problem.experiments.values()
    theirs, ours = VariableValues.of_all(model).variables, VariableValues.of_all(experiment.model).variables
    if len(theirs) != len(ours):
        return  # Params that became variables are in the copy only
    unknown = ComponentSet(each.variable for each in problem.unknowns)
    for variable, fitted in zip(theirs, ours, strict=True):
        if not variable.fixed or fitted in unknown:
            variable.set_value(fitted.value, skip_validation=True)
