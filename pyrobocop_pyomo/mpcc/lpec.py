"""The linear program with complementarity constraints around a point: which direction, if any, descends?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline
from pyrobocop_pyomo.numerics import BoolArray
from pyrobocop_pyomo.numerics.linear_programs import LinearProgram, LinearStatus, Rows
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .problem import Branch, ComplementarityProgram, Linearisation, Sides, branch_with

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Descent:
    """Answer of the linear program.

    Attributes
    ----------
    step : float array, shape (n,)
        At most the trust radius in each component.
    decrease : float
        By how much the linearised objective falls along it, per unit of the trust radius; never negative.
    branch : Branch
        The one that the step leads into.
    proven : bool
        Whether no step within the trust radius does better, to the solver's tolerance.
    open_pairs : int
        Number of pairs that could choose a side.
    gain : float
        By how much the decrease exceeds the decrease in a branch, where one was given to stay in; at least 0.
    """

    step: FloatArray
    decrease: float
    branch: Branch
    proven: bool
    open_pairs: int
    gain: float


def steepest_branch(
    program: ComplementarityProgram,
    point: Linearisation,
    radius: float,
    *,
    node_limit: int,
    stay: Branch | None = None,
    least_gain: float = 0.0,
    elastic: float | None = None,
    deadline: Deadline = NO_DEADLINE,
    gap: float = 1e-6,
    on_nodes: Callable[[int], object] | None = None,
) -> Descent | None:
    """Minimise the linearised objective over the linearised feasible set within a trust region.

    ::

        min  grad f . d   s.t.  g_l <= g + J d <= g_u,  x_l <= x + d <= x_u,
                                0 <= a + a'd ⟂ b + b'd >= 0,  |d|_inf <= radius

    Every pair whose two sides are both within reach may choose. Where no direction descends as the radius shrinks, the
    point is B-stationary.

    Parameters
    ----------
    program : ComplementarityProgram
    point : Linearisation
    radius : float
        Of the trust region, in the units of the variables.
    node_limit : int
        Most nodes of the search tree: unlike seconds, the same on a busy machine. 0 for no tree, but the one choice
        that linear programs lead to: nothing is proven then.
    stay : Branch, optional
        A branch through the point: only what descends more than this one is looked for.
    least_gain : float
        By how much more, per unit of the radius.
    elastic : float, optional
        Price of violating a linearised row, per unit; needed at a point that is not feasible. By default rows hold.
    deadline : Deadline
    gap : float
        Relative distance from the optimum at which the search may stop.
    on_nodes : callable, optional
        Told how many nodes and linear programs it took.

    Returns
    -------
    Descent or None
        None where no step was found: the linearised constraints contradict each other, or time ran out.

    References
    ----------
    Nurkanovic & Leyffer (2025), A globally convergent method for computing B-stationary points of mathematical
    programs with equilibrium constraints, doi:10.48550/arXiv.2501.13835
    """
    nlp, n = point.nlp, point.nlp.n
    x = point.x
    # Lengths are measured in units of the radius: the solver's tolerances are absolute ones.
    lower = np.maximum(np.minimum((nlp.x_lower - x) / radius, 0.0), -1.0)
    upper = np.minimum(np.maximum((nlp.x_upper - x) / radius, 0.0), 1.0)
    a, b = np.maximum(program.a.values(x), 0.0) / radius, np.maximum(program.b.values(x), 0.0) / radius
    nearest = branch_with(program, a <= b) if stay is None else stay
    within = (np.maximum(a, b) <= 1.0) & ~program.a.constant & ~program.b.constant
    for sides, zero, values in ((program.a, nearest.a_zero, a), (program.b, nearest.b_zero, b)):
        fixed = zero & ~within & ~sides.constant
        to_zero = np.clip(-sides.sign[fixed] * values[fixed], -1.0, 1.0)
        lower[sides.index[fixed]] = upper[sides.index[fixed]] = to_zero
    open_pairs = np.flatnonzero(within)

    matrix, rows_lower, rows_upper = _rows(point, radius, loose=elastic is not None)
    slack = matrix.shape[0] if elastic is not None else 0
    if slack:
        slacks = [sign * scipy.sparse.eye_array(slack, format="csr") for sign in (1.0, -1.0)]
        matrix = scipy.sparse.block_array([[matrix, *slacks]], format="csr")
    linear = LinearProgram(
        # Whatever the unit of the objective is: the solver's tolerances of costs are absolute ones, too.
        np.concatenate([point.gradient, np.full(2 * slack, elastic or 0.0)]) / point.slope,
        np.concatenate([lower, np.zeros(2 * slack)]),
        np.concatenate([upper, np.full(2 * slack, np.inf)]),
        [(matrix, rows_lower, rows_upper)],
    )
    open_a, open_b = (
        _open_sides(sides, values, open_pairs, linear) for sides, values in ((program.a, a), (program.b, b))
    )
    choices = _SideChoices(linear, open_a, open_b)
    staying, ceiling = 0.0, np.inf
    is_held = stay is not None and open_pairs.size > 0
    if stay is not None and is_held:
        # Where rounding keeps any step from it, there is still the step of length zero.
        staying = min(0.0, choices.held(stay.a_zero[open_pairs], stay.b_zero[open_pairs], deadline)[1])
        ceiling = staying - least_gain / point.slope
    optimum, chosen, proven, nodes = choices.best(nearest.a_zero[open_pairs], ceiling, deadline, node_limit, gap)
    if on_nodes is not None:
        on_nodes(nodes)
    if optimum is None:
        if stay is None or not is_held:
            return None
        return Descent(np.zeros(n), -staying * point.slope, stay, proven, open_pairs.size, 0.0)
    step = optimum[:n]
    a_zero = nearest.a_zero.copy()
    a_zero[open_pairs] = chosen
    cost = float(point.gradient @ step)
    return Descent(
        radius * step,
        max(0.0, -cost),
        branch_with(program, a_zero),
        proven,
        open_pairs.size,
        max(0.0, staying * point.slope - cost) if is_held else 0.0,
    )


class _SideChoices(NamedTuple):
    """A linear program whose bounds keep the sides of pairs nonnegative, and one of each pair is to be zero."""

    linear: LinearProgram
    a: Sides
    b: Sides

    def held(self, a_zero: BoolArray, b_zero: BoolArray, deadline: Deadline) -> tuple[FloatArray | None, float]:
        """The optimum with these sides held at zero, and its cost: infinite where there is none."""
        lower, upper = self.linear.lower.copy(), self.linear.upper.copy()
        for sides, zero in ((self.a, a_zero), (self.b, b_zero)):
            # One column may be a side of several pairs: zero of the one may be far from zero of the other.
            np.maximum.at(lower, sides.index[zero], sides.offset[zero])
            np.minimum.at(upper, sides.index[zero], sides.offset[zero])
        x = self.linear.solve(deadline, bounds=(lower, upper)).x
        return x, np.inf if x is None else float(self.linear.cost @ x)

    def best(
        self, nearest: BoolArray, ceiling: float, deadline: Deadline, node_limit: int, gap: float
    ) -> tuple[FloatArray | None, BoolArray, bool, int]:
        """The least cost below a ceiling: its point, whether a is zero there, whether that is proven, and the nodes.

        `nearest` is returned where there is none. A tree is searched only where the choice that linear programs lead to
        may be farther from the optimum than the gap.
        """
        relaxed = self.linear.solve(deadline)
        if relaxed.x is None:
            return None, nearest, relaxed.status is LinearStatus.INFEASIBLE, relaxed.nodes
        bound = float(self.linear.cost @ relaxed.x)
        if not bound < ceiling:
            return None, nearest, True, relaxed.nodes
        x, chosen, nodes = self._decided_in_steps(relaxed.x, nearest, ceiling, deadline)
        cost = np.inf if x is None else float(self.linear.cost @ x)
        is_near = x is not None and cost - bound <= gap * abs(cost)
        if is_near or not node_limit:
            return x, chosen, is_near, nodes
        program = self._with_binaries(ceiling)
        while True:
            answer = program.solve(deadline, node_limit, gap)
            nodes += answer.nodes
            if answer.x is None:
                return None, nearest, answer.status is LinearStatus.INFEASIBLE, nodes
            chosen = answer.x[-nearest.size :] > 0.5
            # To a mixed-integer program 1e-6 is zero. So the choice is taken from it, and the point from a linear
            # program; where that is not below the ceiling, the other choices are left, if they are few.
            x, cost = self.held(chosen, ~chosen, deadline)
            if cost < ceiling:
                return x, chosen, answer.status is LinearStatus.SOLVED, nodes
            if answer.status is not LinearStatus.SOLVED or 2**nearest.size > node_limit:
                return None, nearest, False, nodes
            program = program.without_binaries(chosen)

    def _decided_in_steps(
        self, x: FloatArray, nearest: BoolArray, ceiling: float, deadline: Deadline
    ) -> tuple[FloatArray | None, BoolArray, int]:
        """A choice below a ceiling: its point, whether a is zero there, and how many linear programs it took.

        From the optimum without any choice on, the smaller sides are held at zero of half of the pairs that are not met
        there, those in which one side is the smallest part of the other. Where that leaves no point, the first of them
        is held on its other side instead.
        """
        a_zero, b_zero = np.zeros((2, nearest.size), dtype=bool)
        programs = 1
        while True:
            a, b = self.a.values(x), self.b.values(x)
            smaller, larger = np.minimum(a, b), np.maximum(a, b)
            unmet = np.flatnonzero(smaller > MET)
            if not unmet.size:
                chosen = np.where(larger <= MET, nearest, a <= b)
                return x, (chosen | a_zero) & ~b_zero, programs
            decided = unmet[np.argsort(smaller[unmet] / larger[unmet], kind="stable")][: (unmet.size + 1) // 2]
            is_a, first = a[decided] <= b[decided], np.arange(nearest.size) == decided[0]
            other = (a_zero, b_zero | first) if is_a[0] else (a_zero | first, b_zero)
            held = a_zero.copy(), b_zero.copy()
            held[0][decided[is_a]] = held[1][decided[~is_a]] = True
            for a_zero, b_zero in (held, other):
                candidate, cost = self.held(a_zero, b_zero, deadline)
                programs += 1
                if candidate is not None and cost < ceiling:
                    x = candidate
                    break
            else:
                return None, nearest, programs

    def _with_binaries(self, ceiling: float) -> LinearProgram:
        """One binary y per pair: ``a <= a_max (1 - y)`` and ``b <= b_max y``; and points of a lower cost only."""
        linear, count = self.linear, self.a.index.size
        below_ceiling = scipy.sparse.csr_array(np.append(linear.cost, np.zeros(count))[None])
        rows: list[Rows] = [(below_ceiling, -np.inf, ceiling)]
        for sides, factor, right in ((self.a, 1.0, 1.0), (self.b, -1.0, 0.0)):
            farthest = np.where(sides.sign > 0.0, linear.upper[sides.index], linear.lower[sides.index])
            room = np.maximum(sides.sign * (farthest - sides.offset), 0.0)
            slope = scipy.sparse.csr_array(
                (sides.sign, (np.arange(count), sides.index)), shape=(count, linear.cost.size)
            )
            below = scipy.sparse.hstack([slope, scipy.sparse.diags_array(factor * room)], format="csr")
            rows.append((below, -np.inf, right * room + sides.sign * sides.offset))
        return linear.with_binaries(count, rows)


def _open_sides(sides: Sides, values: FloatArray, pairs: NDArray[np.intp], linear: LinearProgram) -> Sides:
    """The sides of pairs that may choose, in the variables of the linear program."""
    column = sides.index[pairs]
    zero = np.clip(-sides.sign[pairs] * values[pairs], linear.lower[column], linear.upper[column])
    return Sides(column, sides.sign[pairs], zero)


def _rows(point: Linearisation, radius: float, *, loose: bool) -> tuple[csr_array, FloatArray, FloatArray]:
    """Linearised rows that some step can reach, with bounds that a zero step meets unless slacks will do it."""
    lower, upper = (point.nlp.g_lower - point.rows) / radius, (point.nlp.g_upper - point.rows) / radius
    if not loose:
        lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    farthest = abs(point.jacobian).sum(axis=1)
    kept = np.flatnonzero((lower > -farthest) | (upper < farthest))
    return point.jacobian[kept], lower[kept], upper[kept]
