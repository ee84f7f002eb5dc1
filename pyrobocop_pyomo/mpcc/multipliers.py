"""Looking for multipliers at a point: are there any with the signs that a kind of stationarity asks for?

Multipliers are a matter of existence. Where they are not unique, those of a solver prove nothing by their signs, so
they are looked for among all: by a linear program for W and S, with a binary or two per biactive pair for M, C and A.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, PrimalDualPoint
from pyrobocop_pyomo.programs.stationarity import stationarity

from .branch import Branch, restricted
from .linear_programs import LinearProgram, LinearStatus
from .linearisation import Linearisation
from .multiplier_columns import active_bounds, active_rows, residual_columns, row_activity, rows_of_sides, side_columns
from .problem import ComplementarityProgram, Sides
from .stationarity import Multipliers, Stationarity

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Multipliers beyond this multiple of the objective's gradient are taken for none at all: the constraints there are
# as good as dependent, and a mixed-integer program could not tell such a number from its own tolerance.
LARGEST_MULTIPLIER = 1e5
# What multipliers may leave of the stationarity conditions, relative to what has to balance.
STATIONARY = 1e-5
# Multipliers that leave no more than this part of the tolerance need not be the best ones.
NEARLY = 0.1


class MultiplierProblem:
    """The conditions that multipliers have to meet at one point.

    Parameters
    ----------
    program : ComplementarityProgram
    point : Linearisation
        At a feasible point.
    biactive_tolerance : float
        A side of at most this size counts as zero.
    active_tolerance : float
        A row or bound this close may have a multiplier; its distance times the multiplier is a residual as well.
    """

    def __init__(
        self,
        program: ComplementarityProgram,
        point: Linearisation,
        biactive_tolerance: float = 1e-6,
        active_tolerance: float = 1e-2,
    ) -> None:
        # With an objective whose slope is 1: the tolerances of linear programs are absolute.
        self._program, self._point = program, replace(point, gradient=point.gradient / point.slope)
        self._slope = point.slope
        self.pairs, self.rows = program.pairs, point.nlp.m
        a, b = program.a.values(point.x), program.b.values(point.x)
        a_zero, b_zero = a <= biactive_tolerance, b <= biactive_tolerance
        self._a_pairs = np.flatnonzero(a_zero & ~program.a.constant)
        self._b_pairs = np.flatnonzero(b_zero & ~program.b.constant)
        self.biactive = np.flatnonzero(a_zero & b_zero & ~program.a.constant & ~program.b.constant)
        activity = row_activity(program, point, (self._a_pairs, self._b_pairs), active_tolerance)
        # Columns come in five blocks, each twice: positive parts, then negative parts. One more column is the largest
        # residual, which is minimised.
        blocks = [
            active_rows(point, activity),
            active_bounds(program, point, (self._a_pairs, self._b_pairs), active_tolerance),
            side_columns(program.a, self._a_pairs, point.nlp.n),
            side_columns(program.b, self._b_pairs, point.nlp.n),
            residual_columns(point.nlp.n),
        ]
        self._columns = scipy.sparse.block_array([[block.columns for block in blocks[:-1]]], format="csr")
        self._weights = np.concatenate([block.weight for block in blocks[:-1]])
        columns = [sign * block.columns for block in blocks for sign in (1.0, -1.0)]
        self._matrix = scipy.sparse.block_array([[*columns, scipy.sparse.csr_array((point.nlp.n, 1))]], format="csr")
        parts = [part for block in blocks for part in (block.positive, block.negative)]
        self._upper = np.append(np.minimum(np.concatenate(parts), LARGEST_MULTIPLIER), np.inf)
        weights = np.concatenate([block.weight for block in blocks for _ in range(2)])
        weighted = np.flatnonzero(weights)
        numbers = np.arange(weighted.size)
        self._residuals = scipy.sparse.csr_array(
            (
                np.concatenate([weights[weighted], -np.ones(weighted.size)]),
                (np.tile(numbers, 2), np.concatenate([weighted, np.full(weighted.size, weights.size)])),
            ),
            shape=(weighted.size, weights.size + 1),
        )
        sizes = np.cumsum([0, *(block.weight.size for block in blocks for _ in range(2))])
        self._parts = [slice(start, end) for start, end in itertools.pairwise(sizes)]
        self._row_numbers = np.flatnonzero(activity.active)

    def find(self, kind: Stationarity, deadline: Deadline = NO_DEADLINE) -> Multipliers | None:
        """Look for the multipliers of a kind that leave the least residual; None where none are found in time."""
        asked, right, binaries, upper = self._signs(kind)
        if binaries:
            values = self._with_choices(asked, right, binaries, upper, deadline)
            if values is None:
                return None
            # To a mixed-integer program a binary of 1e-6 is zero, and times a large bound it is not. So the choice is
            # taken from it, and the multipliers from the linear program that is left.
            width = upper.size
            room = right - asked[:, width:] @ np.round(values[width:])
            closed = np.unique(asked[np.flatnonzero(room < 0.5 * LARGEST_MULTIPLIER), :width].nonzero()[1])
            upper[closed] = 0.0
        values = replace(self._linear, upper=upper).solve(deadline).x
        if values is None:
            return None
        signed = [values[self._parts[2 * i]] - values[self._parts[2 * i + 1]] for i in range(4)]
        return self._found(kind, signed, float(values[-1]))

    def find_nearly(self, kind: Stationarity, deadline: Deadline = NO_DEADLINE) -> Multipliers | None:
        """Look for the multipliers of W or S that leave the least sum of residuals; None where HiGHS gives none.

        The dual of that program is the steepest step within the cone of what is active, which has as many columns as
        there are variables, and takes a fraction of the time. Where its residual is small enough, nothing is left to be
        asked; where it is not, others may have a smaller largest one.
        """
        _, _, binaries, upper = self._signs(kind)
        assert not binaries, "choices of signs have no dual"
        positive, negative = (np.concatenate([upper[part] for part in self._parts[first:8:2]]) for first in (0, 1))
        steps = LinearProgram(
            self._point.gradient,
            -np.ones(self._point.nlp.n),
            np.ones(self._point.nlp.n),
            [
                (
                    self._columns.T.tocsr(),
                    np.where(negative > 0.0, -self._weights, -np.inf),
                    np.where(positive > 0.0, self._weights, np.inf),
                )
            ],
        )
        answer = steps.solve_with_duals(deadline)
        if answer is None:
            return None
        found = np.clip(-answer[1], -negative, positive)
        residuals = np.concatenate([self._point.gradient + self._columns @ found, self._weights * found])
        ends = np.cumsum([0, *(part.stop - part.start for part in self._parts[:8:2])])
        signed = [found[start:end] for start, end in itertools.pairwise(ends)]
        return self._found(kind, signed, float(np.abs(residuals).max(initial=0.0)))

    def _with_choices(
        self, asked: csr_array, right: FloatArray, binaries: int, upper: FloatArray, deadline: Deadline
    ) -> FloatArray | None:
        """Minimise the largest residual, where signs ask for choices."""
        linear = self._linear
        wider = [
            (scipy.sparse.block_array([[matrix, scipy.sparse.csr_array((matrix.shape[0], binaries))]]), *sides)
            for matrix, *sides in linear.rows
        ]
        answer = LinearProgram(
            np.concatenate([linear.cost, np.zeros(binaries)]),
            np.zeros(upper.size + binaries),
            np.concatenate([upper, np.ones(binaries)]),
            [*wider, (asked, -np.inf, right)],
            np.arange(upper.size + binaries) >= upper.size,
        ).solve(deadline)
        return answer.x if answer.status is LinearStatus.SOLVED else None

    @functools.cached_property
    def _linear(self) -> LinearProgram:
        """What all kinds have in common: they differ by the bounds of multipliers."""
        largest = np.zeros(self._upper.size)
        largest[-1] = 1.0
        return LinearProgram(
            largest,
            np.zeros(self._upper.size),
            self._upper,
            [(self._matrix, -self._point.gradient, -self._point.gradient), (self._residuals, -np.inf, 0.0)],
        )

    def _found(self, kind: Stationarity, signed: list[FloatArray], residual: float) -> Multipliers:
        nu, xi = np.zeros(self._program.pairs), np.zeros(self._program.pairs)
        rows = np.zeros(self._point.nlp.m)
        of_rows, _, of_a, of_b = (self._slope * part for part in signed)
        rows[self._row_numbers], nu[self._a_pairs], xi[self._b_pairs] = of_rows, of_a, of_b
        return Multipliers(kind, nu, xi, rows, residual)

    def _signs(self, kind: Stationarity) -> tuple[csr_array, FloatArray, int, FloatArray]:
        """The signs that a kind asks for: ``matrix @ unknowns <= right``, number of binaries, bounds of the others."""
        nu = [np.searchsorted(self._a_pairs, self.biactive) + self._parts[i].start for i in (4, 5)]
        xi = [np.searchsorted(self._b_pairs, self.biactive) + self._parts[i].start for i in (6, 7)]
        upper = self._upper.copy()
        count, bound, width = self.biactive.size, LARGEST_MULTIPLIER, self._upper.size
        if kind is Stationarity.S:
            upper[nu[1]] = upper[xi[1]] = 0.0
        # Each rule: parts that add up, binaries with their factors, right-hand side; per biactive pair.
        first, second = width + np.arange(count), width + count + np.arange(count)
        rules: dict[Stationarity, list[tuple[list[np.ndarray], list[tuple[np.ndarray, float]], float]]] = {
            # One binary: 1 asks for nu >= 0, 0 for xi >= 0.
            Stationarity.A: [([nu[1]], [(first, bound)], bound), ([xi[1]], [(first, -bound)], 0.0)],
            # One binary: 1 asks for both >= 0, 0 for both <= 0.
            Stationarity.C: [
                *[([part], [(first, bound)], bound) for part in (nu[1], xi[1])],
                *[([part], [(first, -bound)], 0.0) for part in (nu[0], xi[0])],
            ],
            # Two binaries: the first asks for nu = 0, the second for xi = 0, neither for both >= 0.
            Stationarity.M: [
                (nu, [(first, bound)], bound),
                (xi, [(second, bound)], bound),
                ([nu[1], xi[1]], [(first, -bound), (second, -bound)], 0.0),
            ],
        }
        asked = rules.get(kind, [])
        binaries = count * {Stationarity.A: 1, Stationarity.C: 1, Stationarity.M: 2}.get(kind, 0)
        entries = [
            (rule * count + np.arange(count), columns, np.full(count, factor))
            for rule, (parts, with_binaries, _) in enumerate(asked)
            for columns, factor in [*((part, 1.0) for part in parts), *with_binaries]
        ]
        shape = (len(asked) * count, width + binaries)
        if not entries:
            return scipy.sparse.csr_array(shape), np.empty(0), 0, upper
        rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        right = np.repeat([limit for _, _, limit in asked], count)
        return scipy.sparse.csr_array((values, (rows, columns)), shape=shape), right, binaries, upper


def strong_multipliers(
    program: ComplementarityProgram,
    point: Linearisation,
    branch: Branch,
    solved: PrimalDualPoint,
    sizes: FloatArray,
    reach: float = 1e-3,
    tolerance: float = 1e-6,
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
    tolerance : float
        Of what counts as zero.

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
    at_lower, at_upper = rows_of_sides(program, point, (held_pairs[0], held_pairs[1]))
    rows = rows.copy()
    rows[at_lower], rows[at_upper] = np.maximum(rows[at_lower], 0.0), np.minimum(rows[at_upper], 0.0)
    gradient = point.lagrangian_gradient(rows)
    found = []
    for sides, held, partner in (
        (program.a, branch.a_zero & ~program.a.constant, program.b.values(point.x)),
        (program.b, branch.b_zero & ~program.b.constant, program.a.values(point.x)),
    ):
        of_bounds = np.where(sides.constant, 0.0, np.where(sides.sign > 0, lower[sides.index], upper[sides.index]))
        held_multipliers = np.where(_first_of_its_variable(sides, held), sides.slopes(gradient), 0.0)
        # Of many pairs all steps together: what a linear program would find.
        if np.minimum(held_multipliers[held & (partner <= reach)], 0.0).sum() < -STATIONARY * point.slope:
            return None
        found.append(np.where(held, held_multipliers, np.where(sides.values(point.x) <= tolerance, of_bounds, 0.0)))
    return Multipliers(Stationarity.S, found[0], found[1], rows, 0.0)


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
    found = np.zeros(program.pairs)
    for sides, held, partner in (
        (program.a, branch.a_zero & ~branch.b_zero, program.b.values(point.x)),
        (program.b, branch.b_zero & ~branch.a_zero, program.a.values(point.x)),
    ):
        biactive = held & ~sides.constant & (partner <= reach)
        found[biactive] = np.maximum(-sides.slopes(gradient)[biactive], 0.0)
    return found


def _first_of_its_variable(sides: Sides, held: BoolArray) -> BoolArray:
    """Where a variable is held at zero for several pairs, its multiplier is theirs together: the first one gets it."""
    numbers = np.flatnonzero(held)
    _, first = np.unique(sides.index[numbers], return_index=True)
    chosen = np.zeros(held.size, dtype=bool)
    chosen[numbers[first]] = True
    return chosen


def classify(
    problem: MultiplierProblem, tolerance: float = STATIONARY, time_limit: float = 5.0, deadline: Deadline = NO_DEADLINE
) -> Multipliers | None:
    """Find the strongest kind of stationarity that a point meets.

    Parameters
    ----------
    problem : MultiplierProblem
    tolerance : float
        Largest residual, relative to the objective's gradient.
    time_limit : float
        Seconds for each kind.
    deadline : Deadline
        For all kinds together.

    Returns
    -------
    Multipliers or None
        Of that kind; None where even the linear program for W had no answer in time.
    """

    def find(kind: Stationarity) -> Multipliers | None:
        return None if deadline.has_passed else problem.find(kind, deadline.within(time_limit))

    # Most points are strongly stationary, and then nothing else has to be asked.
    strong = None if deadline.has_passed else problem.find_nearly(Stationarity.S, deadline.within(time_limit))
    if strong is None or not strong.residual <= NEARLY * tolerance:
        strong = find(Stationarity.S)
    if strong is not None and strong.residual <= tolerance:
        return strong
    weak = find(Stationarity.W)
    if weak is None:
        return None
    if not weak.residual <= tolerance:
        return replace(weak, kind=Stationarity.NONE)
    for kind in (Stationarity.M, Stationarity.C, Stationarity.A):
        found = find(kind)
        if found is not None and found.residual <= tolerance:
            return found
    return weak
