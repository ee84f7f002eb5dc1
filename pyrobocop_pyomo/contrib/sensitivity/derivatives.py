"""How a solution moves with its data: derivatives of a strictly complementary point by one factorisation.

The active constraints are found from distances and multipliers, the point is refined by Newton's method on them, and
the refined point shows whether the active set is beyond doubt. Then the implicit function theorem gives the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import EvaluationError
from pyrobocop_pyomo.mpcc.problem import Linearisation
from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram
from pyrobocop_pyomo.solving.curvature import NEAR

STRICT = 1e-7  # smallest relative multiplier of an active one, and smallest relative distance of an inactive one
NEWTON_STEPS = 6


@dataclass(frozen=True, eq=False)
class Derivatives:
    """A solution, and its derivatives with respect to parameters.

    Attributes
    ----------
    x : float array, shape (n,)
        The refined point; parameters among it as they were.
    objective : float array, shape (k,)
        Derivative of the minimised objective.
    variables : float array, shape (n, k)
        Of the variables; a row of the identity for each parameter.
    active : int array, shape (a,)
        Numbers of the active constraints: first rows, then bounds of variables.
    multipliers : float array, shape (a,)
        Of the active constraints: the Lagrangian is f + multipliers @ constraints. The shortest ones of several.
    """

    x: FloatArray
    objective: FloatArray
    variables: FloatArray
    active: NDArray[np.intp]
    multipliers: FloatArray


def derivatives(
    nlp: NonlinearProgram,
    x: FloatArray,
    parameters: NDArray[np.intp],
    describe: Callable[[int], str],
) -> Derivatives:
    """Differentiate a local solution with respect to some variables that stand for parameters.

    Parameters
    ----------
    nlp : NonlinearProgram
        Its variables are the variables of the problem and the parameters, whose bounds do not count.
    x : float array, shape (n,)
        A local solution to a solver's accuracy.
    parameters : int array, shape (k,)
        Numbers of the variables that are parameters.
    describe : callable
        From the number of a constraint (rows first, then bounds of variables) to its name, for messages.

    Raises
    ------
    EvaluationError
        If the point is not stationary, an active constraint has no multiplier, active constraints that depend on each
        other move apart, or the Lagrangian is flat in a direction that they leave.

    References
    ----------
    Fiacco (1976), Sensitivity analysis for nonlinear programming using penalty methods,
    doi:10.1007/BF01580677
    """
    constraints = _Constraints(nlp, parameters, describe)
    active, multipliers = _guess_active(constraints, x)
    x, multipliers = _refined(constraints, x, active, multipliers)
    free = constraints.free
    solve, _, jacobian = _kkt(constraints, x, active, multipliers)
    hessian = constraints.hessian(x, active, multipliers)
    # One parameter after the other, as thousands of them take room.
    right = scipy.sparse.vstack([hessian[free][:, parameters], jacobian[:, parameters]], format="csc")
    moved = np.zeros((nlp.n, parameters.size))
    for place, parameter in enumerate(parameters.tolist()):
        moved[free, place] = -solve(right[:, [place]].toarray().ravel())[: free.size]
        moved[parameter, place] = 1.0
    _check_strict(constraints, x, active, multipliers, moved)
    # The envelope theorem: only what a parameter does to the Lagrangian by itself counts.
    objective = (nlp.gradient(x) + jacobian.T @ multipliers)[parameters]
    return Derivatives(x, objective, moved, active, multipliers)


class _Constraints:
    """Rows and bounds of the free variables in one list, with their first and second derivatives."""

    def __init__(self, nlp: NonlinearProgram, parameters: NDArray[np.intp], describe: Callable[[int], str]) -> None:
        self.nlp, self.parameters, self.describe = nlp, parameters, describe
        self.free = np.setdiff1d(np.arange(nlp.n), parameters)
        lower, upper = nlp.x_lower.copy(), nlp.x_upper.copy()
        lower[parameters], upper[parameters] = -np.inf, np.inf
        self.lower = np.concatenate([nlp.g_lower, lower])
        self.upper = np.concatenate([nlp.g_upper, upper])
        self.equations = self.lower == self.upper
        rows, columns = nlp.jacobian_structure
        self.has_free = np.isin(np.arange(self.lower.size), [*rows[np.isin(columns, self.free)], *(nlp.m + self.free)])

    def values(self, x: FloatArray) -> FloatArray:
        return np.concatenate([self.nlp.constraints(x), x])

    def jacobian(self, x: FloatArray) -> Any:
        rows = Linearisation.at(self.nlp, x).jacobian
        return scipy.sparse.vstack([rows, scipy.sparse.eye_array(self.nlp.n)], format="csr")

    def hessian(self, x: FloatArray, active: NDArray[np.intp], multipliers: FloatArray) -> Any:
        every = np.zeros(self.nlp.m)
        of_rows = active < self.nlp.m
        every[active[of_rows]] = multipliers[of_rows]
        rows, columns = self.nlp.hessian_structure
        lower = scipy.sparse.csr_array(
            (self.nlp.hessian(x, 1.0, every), (rows, columns)), shape=(self.nlp.n, self.nlp.n)
        )
        return scipy.sparse.csr_array(lower + lower.T - scipy.sparse.diags_array(lower.diagonal()))

    def is_at_lower(self, x: FloatArray) -> BoolArray:
        """Where the lower bound is the nearer one."""
        values = self.values(x)
        return values - self.lower <= self.upper - values

    def gaps(self, x: FloatArray) -> FloatArray:
        """What the constraints lack to the nearer one of their bounds."""
        return self.values(x) - np.where(self.is_at_lower(x), self.lower, self.upper)

    def relative_distance(self, x: FloatArray) -> FloatArray:
        """Distance from the nearer bound, relative to its size where that is above one."""
        gaps = self.gaps(x)
        nearer = np.where(np.isfinite(gaps), self.values(x) - gaps, 0.0)
        return np.abs(gaps) / np.maximum(1.0, np.abs(nearer))

    def pushes(self, x: FloatArray, active: NDArray[np.intp], multipliers: FloatArray) -> FloatArray:
        """Multipliers with the sign that is positive where an inequality holds back, relative to the gradient."""
        return np.where(self.is_at_lower(x)[active], -multipliers, multipliers) / self.scale(x)

    def scale(self, x: FloatArray) -> float:
        return max(1.0, float(np.abs(self.nlp.gradient(x)[self.free]).max(initial=0.0)))


def _guess_active(constraints: _Constraints, x: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Which constraints are active: those whose multiplier is larger than the distance from their bound."""
    distance = constraints.relative_distance(x)
    near = np.flatnonzero(constraints.equations | (distance <= NEAR))
    near = near[constraints.has_free[near]]  # a row of parameters alone is a matter of data
    push = constraints.pushes(x, near, _least_squares_multipliers(constraints, x, near))
    active = near[constraints.equations[near] | (push > distance[near])]
    return active, _least_squares_multipliers(constraints, x, active)


def _least_squares_multipliers(constraints: _Constraints, x: FloatArray, chosen: NDArray[np.intp]) -> FloatArray:
    """The multipliers that leave the least gradient of the Lagrangian, the shortest ones where they are not unique."""
    free = constraints.free
    jacobian = constraints.jacobian(x)[chosen][:, free]
    sizes = np.maximum(np.sqrt(np.asarray(jacobian.power(2).sum(axis=1)).ravel()), 1e-300)
    solve = _augmented_solver(scipy.sparse.eye_array(free.size), scipy.sparse.diags_array(1.0 / sizes) @ jacobian)
    right = np.concatenate([-constraints.nlp.gradient(x)[free], np.zeros(chosen.size)])
    return solve(right)[free.size :] / sizes


def _refined(
    constraints: _Constraints, x: FloatArray, active: NDArray[np.intp], multipliers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Newton's method on the active constraints: what an interior-point solver left open is closed."""
    free, scale = constraints.free, constraints.scale(x)
    start = x
    for _ in range(NEWTON_STEPS):
        solve, gradient, _ = _kkt(constraints, x, active, multipliers)
        gaps = constraints.gaps(x)[active]
        if max(np.abs(gradient).max(initial=0.0) / scale, np.abs(gaps).max(initial=0.0)) <= 1e-11:
            break
        step = solve(-np.concatenate([gradient, gaps]))
        x = x.copy()
        x[free] += step[: free.size]
        multipliers = multipliers + step[free.size :]
    moved = np.abs(x - start) / np.maximum(1.0, np.abs(start))
    if not moved.max(initial=0.0) <= 1e-2:
        worst = int(np.argmax(np.nan_to_num(moved, nan=np.inf)))
        raise EvaluationError(
            f"the point is no solution that could be refined: Newton's method moves "
            f"{constraints.describe(constraints.nlp.m + worst)} from {start[worst]:g} to {x[worst]:g}. Solve again, "
            "with a tighter tolerance: options={'tol': 1e-10}."
        )
    return x, multipliers


def _check_strict(
    constraints: _Constraints, x: FloatArray, active: NDArray[np.intp], multipliers: FloatArray, moved: FloatArray
) -> None:
    """Refuse a point where it is in doubt which inequalities are active, or where active constraints move apart."""
    jacobian = constraints.jacobian(x)
    # A row that stays met with equality says nothing new, as a bound of a side that is held at zero.
    leaves = np.zeros(constraints.lower.size, dtype=bool)
    for direction in moved.T:
        leaves |= np.abs(jacobian @ direction) > 1e-6 * np.maximum(1.0, abs(jacobian) @ np.abs(direction))
    apart = active[leaves[active]]
    if apart.size:
        raise EvaluationError(
            "the active constraints are linearly dependent, and the parameters move them apart; among them: "
            f"{_names(constraints, apart)}. Remove what says the same twice."
        )
    push = constraints.pushes(x, active, multipliers)
    weak = active[~constraints.equations[active] & ~(push >= STRICT)]
    values = constraints.values(x)
    outside = (values < constraints.lower) | (values > constraints.upper)
    met = outside | (constraints.relative_distance(x) < STRICT)
    unsure = ~constraints.equations & constraints.has_free & met & leaves
    doubtful = np.union1d(weak, np.flatnonzero(unsure))
    if doubtful.size:
        raise EvaluationError(
            f"strict complementarity fails: {doubtful.size} inequalities are met with equality but nothing pushes "
            f"against them: {_names(constraints, doubtful)}. The solution has a kink in the parameters there; remove "
            "the inequalities if they do not matter, or move the data."
        )


def _kkt(
    constraints: _Constraints, x: FloatArray, active: NDArray[np.intp], multipliers: FloatArray
) -> tuple[Callable[[FloatArray], FloatArray], FloatArray, Any]:
    """A solver of the KKT system, the gradient of the Lagrangian at free variables, and the active Jacobian."""
    free = constraints.free
    jacobian = scipy.sparse.csr_array(constraints.jacobian(x)[active])
    hessian = constraints.hessian(x, active, multipliers)[free][:, free]
    gradient = (constraints.nlp.gradient(x) + jacobian.T @ multipliers)[free]
    probe = np.append(np.random.default_rng(0).normal(size=free.size), np.zeros(active.size))
    try:
        solve = _augmented_solver(hessian, jacobian[:, free])
        response = solve(probe)
    except RuntimeError:  # SciPy's way to say: exactly singular
        response = np.array([np.inf])
    if not np.abs(response).max() <= 1e12 * np.abs(probe).max():
        where = ""
        if response.size > 1 and np.isfinite(response).all():
            order = np.argsort(-np.abs(response[: free.size]))[:3]
            where = f", among them along {_names(constraints, constraints.nlp.m + free[order])}"
        raise EvaluationError(
            "the solution is not unique: there is a direction in which the active constraints and the Lagrangian are "
            f"flat{where}. Make the objective strictly convex there, for example by a small quadratic term, or fix "
            "what is undetermined."
        )
    return solve, gradient, jacobian


def _augmented_solver(upper_left: Any, jacobian: Any) -> Callable[[FloatArray], FloatArray]:
    """Solves a system of a symmetric matrix and constraints, which may depend on each other: they share a force."""
    matrix = scipy.sparse.block_array([[upper_left, jacobian.T], [jacobian, None]], format="csc")
    softness = scipy.sparse.diags_array(np.repeat([0.0, 1e-10], jacobian.shape[::-1]))
    solve = scipy.sparse.linalg.splu((matrix - softness).tocsc()).solve

    def refined(right: FloatArray) -> FloatArray:
        found = solve(right)
        return np.asarray(found + solve(right - matrix @ found))

    return refined


def _names(constraints: _Constraints, numbers: NDArray[np.intp]) -> str:
    shown = ", ".join(constraints.describe(int(number)) for number in numbers[:5])
    return shown + (", ..." if numbers.size > 5 else "")
