"""What the measurements can say of the parameters, before a fit: findings as `diagnose` gives them."""

from __future__ import annotations

from typing import Any

import numpy as np

from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.diagnosis.findings import Finding, Severity, Subject
from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.solving import Quality
from pyrobocop_pyomo.studies.outcomes import seconds_left, solve_as_given

from .problem import EstimationProblem
from .statistics import UNSEEN, unseen_combinations

# Another guess, so near that the model can be solved there, so far that nothing vanishes there by accident.
_MOVED = 0.07


def identifiability(problem: EstimationProblem, deadline: Deadline, options: dict[str, Any]) -> Diagnosis:
    """Simulate the experiments at the guess, and look at how the measured outputs move with the unknowns.

    What is not seen at the guess is looked at once more near it: only what is unseen at both places is an error. With
    pairs it is a warning, since another contact may see it. The values of the model are as before.

    Parameters
    ----------
    problem : EstimationProblem
    deadline : Deadline
    options : dict
        Of `solve`.
    """
    remarks: list[str] = []
    findings: list[Finding] = []
    values = problem.values()
    try:
        first = _unseen_at(problem, problem.estimates(), deadline, options, remarks)
        if first:
            moved = _moved_guess(problem)
            again = _unseen_at(problem, moved, deadline, options, [])
            findings = _findings(problem, first, again)
    finally:
        values.restore()
    return Diagnosis(problem.model.name, tuple(findings), (), {}, tuple(remarks))


def _moved_guess(problem: EstimationProblem) -> Array:
    found = []
    for i, unknown in enumerate(problem.unknowns):
        number = unknown.variable.value
        step = _MOVED * max(abs(number), 0.1) * (1.0 + 0.37 * i / max(len(problem.unknowns), 1))
        upper = unknown.variable.ub
        found.append(number + step if upper is None or number + step < upper else number - step)
    return np.array(found)


def _unseen_at(
    problem: EstimationProblem, guess: Array, deadline: Deadline, options: dict[str, Any], remarks: list[str]
) -> list[Any]:
    """Combinations that are not seen where the model is simulated with a guess."""
    try:
        for unknown, number in zip(problem.unknowns, guess.tolist(), strict=True):
            unknown.put(number)
        with problem.simulated():
            barrier = {"strategies": ("barrier",), **options, "time_limit": seconds_left(deadline)}
            result = solve_as_given(problem.model, **barrier)
        solved = result.quality is not Quality.INFEASIBLE
        why = result.stop_reason.value
    except ModelError:
        raise  # a fit would fail in the same way
    except PyRobocopError as error:
        solved, why = False, str(error)
    if not solved:
        remarks.append(f"what the measurements see: the model could not be simulated at the guess ({why})")
    if not solved:
        return []
    try:
        derivatives = problem.sensitivities.at_current_values()
    except PyRobocopError as error:
        remarks.append(f"what the measurements see: {error}")
        return []
    if derivatives.undetermined:
        remarks.append(
            f"what the measurements see: {derivatives.undetermined} further variables are determined by nothing but "
            "the data; they were held where they are"
        )
    weighted = np.sqrt(problem.weights)[:, None] * derivatives.matrix
    return unseen_combinations(weighted, sizes_of(problem), problem.names)


def sizes_of(problem: EstimationProblem) -> Array:
    """Sizes of the unknowns, by which changes are measured: their values, or parts of their ranges."""
    found = []
    for unknown in problem.unknowns:
        size = abs(unknown.variable.value)
        lower, upper = unknown.variable.bounds
        if lower is not None and upper is not None:
            size = max(size, 0.01 * (upper - lower))
        found.append(size if size > 0.0 else 1.0)
    return np.array(found)


def _findings(problem: EstimationProblem, first: list[Any], again: list[Any]) -> list[Finding]:
    has_pairs = problem.has_pairs
    findings = []
    everywhere = [each for each in again if each.singular_value <= UNSEEN]
    for number, combination in enumerate(first):
        unseen = combination.singular_value <= UNSEEN and number < len(everywhere)
        error = unseen and not has_pairs
        where = "at the guess" if has_pairs or not unseen else "at the guess and near it"
        if len(combination.names) == 1:
            what = f"'{combination.names[0]}' moves no measured output {where}"
            if not unseen:
                what = f"'{combination.names[0]}' hardly moves any measured output at the guess"
        else:
            what = (
                f"the combination {combination} {'moves no' if unseen else 'hardly moves any'} measured output {where}"
            )
            what += " (in changes relative to the values)"
        findings.append(
            Finding(
                Severity.ERROR if error else Severity.WARNING,
                Subject.IDENTIFIABILITY,
                f"{what}: its singular value is {combination.singular_value:.1e} of the largest.",
                combination.names,
                "Measure something else, excite the system otherwise, or fix "
                + ("it." if len(combination.names) == 1 else "one of them."),
            )
        )
    return findings
