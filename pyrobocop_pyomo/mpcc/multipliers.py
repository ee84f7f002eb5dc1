"""Looking for multipliers at a point: are there any with the signs that a kind of stationarity asks for?

Multipliers are a matter of existence. Where they are not unique, the signs of a solver's multipliers prove nothing, so
they are looked for among all: by a linear program for W and S, with a binary or two per biactive pair for M, C and A.

Kinds of stationary points of a complementarity problem, and the multipliers that show them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.numerics.linear_programs import LinearProgram, LinearStatus, Rows
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, PrimalDualPoint, stationarity

from .problem import Branch, ComplementarityProgram, Linearisation, Sides, restricted

if TYPE_CHECKING:
    from scipy.sparse import csr_array


import enum
from dataclasses import dataclass

from pyrobocop_pyomo.presentation import Presented

# ------------------------------------------------------------------------------------------------ kinds of stationarity


class Stationarity(enum.Enum):
    """Kinds of stationary points, strongest first; the value is a sentence.

    With the Lagrangian ``f + multipliers @ g - nu @ a - xi @ b`` and nu, xi the multipliers of the two sides, every
    kind asks that nu vanish where a > 0 and xi where b > 0. They differ at biactive pairs, where a = b = 0.

    References
    ----------
    Scheel & Scholtes (2000), Mathematical programs with complementarity constraints: stationarity, optimality, and
    sensitivity, Math. Oper. Res. 25, doi:10.1287/moor.25.1.1.15213
    """

    S = "Strongly stationary: nu >= 0 and xi >= 0 at every biactive pair, so no direction descends."
    M = "M-stationary: at every biactive pair nu and xi are both positive, or one of them is zero."
    C = "C-stationary: nu * xi >= 0 at every biactive pair."
    A = "A-stationary: nu >= 0 or xi >= 0 at every biactive pair."
    W = "Weakly stationary: there are multipliers, but not with the signs of a stronger kind."
    NONE = "Not stationary: there are no multipliers."


@dataclass(frozen=True, eq=False)
class Multipliers(Presented):
    """Multipliers of the strongest kind of stationarity, or the nearest to weak stationarity where there are none.

    Attributes
    ----------
    kind : Stationarity
    nu, xi : float array, shape (k,)
        Of the sides a and b, in the units of the objective per unit of the side: by how much the minimised objective
        grows where the side is held at a small positive number instead of zero.
    rows : float array, shape (m,)
        Of the rows; positive where an upper bound holds back, negative where a lower one does.
    residual : float
        What they leave of the stationarity conditions, relative to the objective's gradient.
    """

    kind: Stationarity
    nu: FloatArray
    xi: FloatArray
    rows: FloatArray
    residual: float

    def _summary(self) -> str:
        return f"{self.kind.value}, residual {self.residual:.1e}, {len(self.nu)} pairs"


# Multipliers beyond this multiple of the objective's gradient are taken for none at all: the constraints there are
# as good as dependent, and a mixed-integer program could not tell such a number from its own tolerance.
LARGEST_MULTIPLIER = 1e5
# What multipliers may leave of the stationarity conditions, relative to what has to balance.
STATIONARY = 1e-5


# What a kind asks of nu (0) and xi (1) of each biactive pair, by its binaries z: ``sign * side <= bound - factors @ z``
# in units of the largest multiplier.
_CHOICES: dict[Stationarity, list[tuple[float, int, tuple[float, ...], float]]] = {
    # 1 asks for nu >= 0, 0 for xi >= 0.
    Stationarity.A: [(-1.0, 0, (1.0,), 1.0), (-1.0, 1, (-1.0,), 0.0)],
    # 1 asks for both >= 0, 0 for both <= 0.
    Stationarity.C: [
        *((-1.0, side, (1.0,), 1.0) for side in (0, 1)),
        *((1.0, side, (-1.0,), 0.0) for side in (0, 1)),
    ],
    # The first asks for nu = 0, the second for xi = 0, neither for both >= 0.
    Stationarity.M: [
        *((sign, 0, (1.0, 0.0), 1.0) for sign in (-1.0, 1.0)),
        *((sign, 1, (0.0, 1.0), 1.0) for sign in (-1.0, 1.0)),
        *((-1.0, side, (-1.0, -1.0), 0.0) for side in (0, 1)),
    ],
}


class MultiplierProblem:
    """The conditions that multipliers have to meet at one point.

    Parameters
    ----------
    program : ComplementarityProgram
    point : Linearisation
        At a feasible point. Rows and bounds up to a hundredth away may have multipliers; the distance times the
        multiplier is a residual as well.
    """

    def __init__(self, program: ComplementarityProgram, point: Linearisation) -> None:
        self._program, self._point = program, point
        nlp, eye = point.nlp, scipy.sparse.eye_array(point.nlp.n, format="csr")
        a, b = program.a.values(point.x), program.b.values(point.x)
        a_zero, b_zero = a <= MET, b <= MET
        self._a_pairs = np.flatnonzero(a_zero & ~program.a.constant)
        self._b_pairs = np.flatnonzero(b_zero & ~program.b.constant)
        biactive = np.flatnonzero(a_zero & b_zero & ~program.a.constant & ~program.b.constant)
        # Rows, and behind them the variables with their bounds.
        gradients = scipy.sparse.vstack([point.jacobian, eye], format="csr")
        values = np.concatenate([point.rows, point.x])
        to_lower = np.abs(values - np.concatenate([nlp.g_lower, nlp.x_lower]))
        to_upper = np.abs(np.concatenate([nlp.g_upper, nlp.x_upper]) - values)
        at_lower, at_upper = to_lower <= 1e-2, to_upper <= 1e-2
        # What only says that a zero side is nonnegative has no multiplier of its own: it is the pair's nu or xi.
        for at_bound, numbers in zip(
            (at_lower, at_upper), constraints_of_sides(program, gradients, (self._a_pairs, self._b_pairs)), strict=True
        ):
            at_bound[numbers] = False
        active = np.flatnonzero(at_lower | at_upper)
        self._row_numbers = active[active < nlp.m]
        sides = [
            eye[sides.index[pairs]].T * -sides.sign[pairs]
            for sides, pairs in ((program.a, self._a_pairs), (program.b, self._b_pairs))
        ]
        self._columns = scipy.sparse.hstack([gradients[active].T, *sides], format="csr")
        of_sides = np.zeros(self._a_pairs.size + self._b_pairs.size)
        distance = np.where(at_lower ^ at_upper, np.where(at_lower, to_lower, to_upper), 0.0)
        self._weights = np.concatenate([distance[active], of_sides])
        # Positive at upper bounds, negative at lower ones, of any sign at zero sides.
        largest = np.full(of_sides.size, LARGEST_MULTIPLIER)
        self._least = np.concatenate([np.where(at_lower, -LARGEST_MULTIPLIER, 0.0)[active], -largest])
        self._most = np.concatenate([np.where(at_upper, LARGEST_MULTIPLIER, 0.0)[active], largest])
        self._ends = np.cumsum([self._row_numbers.size, active.size - self._row_numbers.size, self._a_pairs.size])
        self._biactive = [
            first + np.searchsorted(pairs, biactive)
            for first, pairs in zip(self._ends[1:], (self._a_pairs, self._b_pairs), strict=True)
        ]
        # With an objective whose slope is 1: the tolerances of linear programs are absolute.
        self._gradient = point.gradient / point.slope

    def find(
        self, kind: Stationarity, deadline: Deadline = NO_DEADLINE, most: float = STATIONARY
    ) -> Multipliers | None:
        """Look for multipliers of a kind that leave at most so much of each condition, and the least in sum.

        Returns
        -------
        Multipliers or None
            None where there are none, or none are found in time.
        """
        linear = self._least_residual(kind, most)
        choices = _CHOICES.get(kind, [])
        if choices:
            count = self._biactive[0].size
            binaries = count * len(choices[0][2])
            rows: list[Rows] = [
                (self._choice_row(linear.cost.size, sign, side, factors), -np.inf, LARGEST_MULTIPLIER * bound)
                for sign, side, factors, bound in choices
            ]
            answer = linear.with_binaries(binaries, rows).solve(deadline)
            if answer.x is None or answer.status is not LinearStatus.SOLVED:
                return None
            # To a mixed-integer program a binary of 1e-6 is zero, and times a large bound it is not. So the choice is
            # taken from it, and the multipliers from the linear program that is left.
            chosen = np.round(answer.x[linear.cost.size :]).reshape(-1, count)
            for sign, side, factors, bound in choices:
                closed = self._biactive[side][bound - np.array(factors) @ chosen < 0.5]
                (linear.lower if sign < 0.0 else linear.upper)[closed] = 0.0
        values = linear.solve(deadline).x
        # What the program leaves of its bounds and calls its least residual is as good as its tolerances.
        if values is None:
            return None
        within = np.clip(values, linear.lower, linear.upper)
        return self._found(kind, within[: self._least.size])

    def _least_residual(self, kind: Stationarity, most: float) -> LinearProgram:
        """Minimise what is left above and below the conditions, in sum; without the choices of a kind."""
        least, largest = self._least.copy(), self._most.copy()
        if kind is Stationarity.S:
            for columns in self._biactive:
                least[columns] = 0.0
        weighted = np.flatnonzero(self._weights)
        distances = scipy.sparse.diags_array(self._weights, format="csr")[weighted]
        conditions = scipy.sparse.vstack([self._columns, distances])
        right = np.concatenate([-self._gradient, np.zeros(weighted.size)])
        left = scipy.sparse.eye_array(right.size)
        return LinearProgram(
            np.concatenate([np.zeros(least.size), np.ones(2 * right.size)]),
            np.concatenate([least, np.zeros(2 * right.size)]),
            np.concatenate([largest, np.full(2 * right.size, most)]),
            [(scipy.sparse.hstack([conditions, left, -left], format="csr"), right, right)],
        )

    def _choice_row(self, width: int, sign: float, side: int, factors: tuple[float, ...]) -> csr_array:
        """The rows of one choice, of all biactive pairs: ``sign * side + factors @ binaries``."""
        columns = self._biactive[side]
        numbers = np.arange(columns.size)
        of_side = scipy.sparse.csr_array((np.full(columns.size, sign), (numbers, columns)), shape=(columns.size, width))
        of_binaries = [LARGEST_MULTIPLIER * factor * scipy.sparse.eye_array(columns.size) for factor in factors]
        return scipy.sparse.hstack([of_side, *of_binaries], format="csr")

    def _found(self, kind: Stationarity, values: FloatArray) -> Multipliers:
        nu, xi = np.zeros(self._program.pairs), np.zeros(self._program.pairs)
        rows = np.zeros(self._point.nlp.m)
        of_rows, _, of_a, of_b = np.split(self._point.slope * values, self._ends)
        rows[self._row_numbers], nu[self._a_pairs], xi[self._b_pairs] = of_rows, of_a, of_b
        residuals = np.concatenate([self._gradient + self._columns @ values, self._weights * values])
        return Multipliers(kind, nu, xi, rows, float(np.abs(residuals).max(initial=0.0)))


def strong_multipliers(
    program: ComplementarityProgram,
    point: Linearisation,
    branch: Branch,
    solved: PrimalDualPoint,
    sizes: FloatArray,
    reach: float = 1e-3,
) -> Multipliers | None:
    """Read strong stationarity off the multipliers of a solved branch, where their signs show it.

    Parameters
    ----------
    program : ComplementarityProgram
    point : Linearisation
    branch : Branch
        Whose nonlinear program the point solves.
    solved : PrimalDualPoint
        The same point with the solver's multipliers.
    sizes : float array, shape (n,)
        Of the variables there.
    reach : float
        A pair is biactive here if its other side is at most this large: nearly biactive pairs count as well.

    Returns
    -------
    Multipliers or None
        None says nothing: other multipliers may have the signs.
    """
    nlp = restricted(program, branch)
    if stationarity(nlp, solved, sizes) > STATIONARY:
        return None
    rows, lower, upper = solved.complete(nlp)
    # Where a row says as well that a held side is nonnegative, the solver has split the multiplier at will.
    held_pairs = tuple(
        np.flatnonzero(zero & ~sides.constant)
        for sides, zero in ((program.a, branch.a_zero), (program.b, branch.b_zero))
    )
    at_lower, at_upper = constraints_of_sides(program, point.jacobian, (held_pairs[0], held_pairs[1]))
    rows = rows.copy()
    rows[at_lower], rows[at_upper] = np.maximum(rows[at_lower], 0.0), np.minimum(rows[at_upper], 0.0)
    gradient = point.lagrangian_gradient(rows)
    multipliers = []
    for sides, held, partner in (
        (program.a, branch.a_zero & ~program.a.constant, program.b.values(point.x)),
        (program.b, branch.b_zero & ~program.b.constant, program.a.values(point.x)),
    ):
        of_bounds = np.where(sides.constant, 0.0, np.where(sides.sign > 0, lower[sides.index], upper[sides.index]))
        held_multipliers = np.where(_first_of_its_variable(sides, held), sides.slopes(gradient), 0.0)
        # Of many pairs all steps together: what a linear program would find.
        if np.minimum(held_multipliers[held & (partner <= reach)], 0.0).sum() < -STATIONARY * point.slope:
            return None
        multipliers.append(np.where(held, held_multipliers, np.where(sides.values(point.x) <= MET, of_bounds, 0.0)))
    return Multipliers(Stationarity.S, multipliers[0], multipliers[1], rows, 0.0)


def opposing_multipliers(
    program: ComplementarityProgram, point: Linearisation, branch: Branch, solved: PrimalDualPoint, reach: float
) -> FloatArray:
    """How strongly each biactive pair is held back by its branch: minus the multiplier of its held side, or 0.

    Parameters
    ----------
    program : ComplementarityProgram
    point : Linearisation
    branch : Branch
        Whose nonlinear program the point solves.
    solved : PrimalDualPoint
        The same point with the solver's multipliers.
    reach : float
        A pair is biactive if its other side is at most this large.

    Returns
    -------
    float array, shape (k,)
        Where it is positive, the objective decreases as that side becomes positive.
    """
    gradient = point.lagrangian_gradient(solved.complete(restricted(program, branch))[0])
    multipliers = np.zeros(program.pairs)
    for sides, held, partner in (
        (program.a, branch.a_zero & ~branch.b_zero, program.b.values(point.x)),
        (program.b, branch.b_zero & ~branch.a_zero, program.a.values(point.x)),
    ):
        biactive = held & ~sides.constant & (partner <= reach)
        multipliers[biactive] = np.maximum(-sides.slopes(gradient)[biactive], 0.0)
    return multipliers


def _first_of_its_variable(sides: Sides, held: BoolArray) -> BoolArray:
    """Where a variable is held at zero for several pairs, its multiplier is theirs together: the first one gets it."""
    numbers = np.flatnonzero(held)
    _, first = np.unique(sides.index[numbers], return_index=True)
    chosen = np.zeros(held.size, dtype=bool)
    chosen[numbers[first]] = True
    return chosen


def classify(
    problem: MultiplierProblem, time_limit: float = 5.0, deadline: Deadline = NO_DEADLINE
) -> Multipliers | None:
    """Find the strongest kind of stationarity that a point meets.

    Parameters
    ----------
    problem : MultiplierProblem
    time_limit : float
        Seconds for each kind.
    deadline : Deadline
        For all kinds together.

    Returns
    -------
    Multipliers or None
        Of that kind; None where even the linear program for W had no answer in time.
    """

    def find(kind: Stationarity, most: float = STATIONARY) -> Multipliers | None:
        return None if deadline.has_passed else problem.find(kind, deadline.within(time_limit), most)

    # Most points are strongly stationary, and then nothing else has to be asked.
    strong = find(Stationarity.S)
    if strong is not None and strong.residual <= STATIONARY:
        return strong
    weak = find(Stationarity.W) or find(Stationarity.W, np.inf)
    if weak is None:
        return None
    if not weak.residual <= STATIONARY:
        return replace(weak, kind=Stationarity.NONE)
    for kind in (Stationarity.M, Stationarity.C, Stationarity.A):
        found = find(kind)
        if found is not None and found.residual <= STATIONARY:
            return found
    return weak


def constraints_of_sides(
    program: ComplementarityProgram, gradients: csr_array, zero_pairs: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Constraints whose lower, and those whose upper bound only says that a zero side is nonnegative."""
    gradients = gradients.copy()
    gradients.eliminate_zeros()  # entries that are zero at this point do not count in first derivatives
    single = np.flatnonzero(np.diff(gradients.indptr) == 1)
    column, slope = gradients.indices[gradients.indptr[single]], gradients.data[gradients.indptr[single]]
    at_lower, at_upper = np.zeros(single.size, dtype=bool), np.zeros(single.size, dtype=bool)
    for sides, pairs in zip((program.a, program.b), zero_pairs, strict=True):
        for sign in (1.0, -1.0):
            of_side = np.isin(column, sides.index[pairs[sides.sign[pairs] == sign]])
            at_lower |= of_side & (sign * slope > 0)
            at_upper |= of_side & (sign * slope < 0)
    return single[at_lower], single[at_upper]
