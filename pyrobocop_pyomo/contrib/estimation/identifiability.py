"""What the measurements can say of the parameters, before a fit: findings as `diagnose` gives them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.diagnosis import Diagnosis
from pyrobocop_pyomo.diagnosis.findings import Finding, Severity
from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.solving import Quality
from pyrobocop_pyomo.solving.strategies import in_order
from pyrobocop_pyomo.studies.outcomes import seconds_left, solve_as_given

from .problem import EstimationProblem

# Another guess, so near that the model can be solved there, so far that nothing vanishes there by accident.
_MOVED = 0.07
BARELY_SEEN = 1e-6  # relative singular value, up to which a combination is hardly seen
SHARE = 0.05  # of a combination, from which on a parameter is named in it


class UnseenCombination(NamedTuple):
    """A combination of unknowns along which the outputs hardly move.

    Attributes
    ----------
    names : tuple of str
    shares : tuple of float
        Of each in a direction of unit length, in relative changes.
    singular_value : float
        Relative to the largest.
    """

    names: tuple[str, ...]
    shares: tuple[float, ...]
    singular_value: float

    def __str__(self) -> str:
        parts = [f"{share:+.2g} '{name}'" for name, share in zip(self.names, self.shares, strict=True)]
        return " ".join(parts).lstrip("+").strip()


def unseen_combinations(matrix: Array, scales: Array, names: Sequence[str]) -> list[UnseenCombination]:
    """Directions in which the weighted outputs hardly move, for changes of the unknowns relative to their scales.

    Parameters
    ----------
    matrix : array, shape (outputs, unknowns)
        Derivatives of the outputs, each over its standard deviation.
    scales : array, shape (unknowns,)
        Sizes of the unknowns.
    names : sequence of str
    """
    _, sizes, directions = np.linalg.svd(matrix * scales, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(len(names) - sizes.size)])
    shares = sizes / max(float(sizes.max(initial=0.0)), 1e-300)
    found = []
    for size, direction in zip(shares.tolist(), directions, strict=True):
        if size <= BARELY_SEEN:
            order = np.argsort(-np.abs(direction), kind="stable")
            order = order[np.abs(direction[order]) >= SHARE]
            parts = direction[order] * np.sign(direction[order[0]])
            found.append(UnseenCombination(tuple(names[i] for i in order), tuple(parts.tolist()), size))
    return found


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
    values = VariableValues.of_all(problem.model)
    options = {**options, "strategies": in_order(options.get("strategies"), ("barrier",))}
    try:
        unseen, reason = _unseen(problem, deadline, options)
        again = []
        if unseen:
            _move_guess(problem)
            again = [each for each in _unseen(problem, deadline, options)[0] if each.singular_value <= NEGLIGIBLE]
    finally:
        values.restore()
    findings = tuple(
        _finding(problem, each, is_unseen=each.singular_value <= NEGLIGIBLE and number < len(again))
        for number, each in enumerate(unseen)
    )
    remarks = (f"what the measurements see: {reason}",) if reason else ()
    return Diagnosis(problem.model.name, findings, (), remarks)


def _move_guess(problem: EstimationProblem) -> None:
    for i, unknown in enumerate(problem.unknowns):
        number, upper = unknown.variable.value, unknown.variable.ub
        step = _MOVED * max(abs(number), 0.1) * (1.0 + 0.37 * i / len(problem.unknowns))
        unknown.put(number + step if upper is None or number + step < upper else number - step)


def _unseen(
    problem: EstimationProblem, deadline: Deadline, options: dict[str, Any]
) -> tuple[list[UnseenCombination], str]:
    """Combinations that are not seen where the model is simulated, or why that is not known."""
    sizes = []
    for unknown in problem.unknowns:  # their values, or parts of their ranges
        lower, upper = unknown.variable.bounds
        width = 0.0 if lower is None or upper is None else upper - lower
        sizes.append(max(abs(unknown.variable.value), 0.01 * width) or 1.0)
    try:
        with problem.simulated():
            result = solve_as_given(problem.model, **{**options, "time_limit": seconds_left(deadline)})
        if result.quality is Quality.INFEASIBLE:
            return [], f"the model could not be simulated at the guess ({result.stop_reason.value})"
        matrix, _ = problem.sensitivities.at_current_values()
    except ModelError:
        raise  # a fit would fail in the same way
    except PyRobocopError as error:
        return [], str(error)
    return unseen_combinations(np.sqrt(problem.weights)[:, None] * matrix, np.array(sizes), problem.names), ""


def _finding(problem: EstimationProblem, combination: UnseenCombination, *, is_unseen: bool) -> Finding:
    is_error = is_unseen and not any(True for _ in active_sources(problem.model))
    is_one = len(combination.names) == 1
    what = f"'{combination.names[0]}'" if is_one else f"the combination {combination} (of relative changes)"
    how = "moves no measured output" if is_unseen else "hardly moves any measured output"
    return Finding(
        Severity.ERROR if is_error else Severity.WARNING,
        f"{what} {how} at the guess{' and near it' if is_error else ''}: its singular value is "
        f"{combination.singular_value:.1e} of the largest.",
        combination.names,
        f"Measure something else, excite the system otherwise, or fix {'it' if is_one else 'one of them'}.",
    )
