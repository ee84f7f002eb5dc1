"""Steps of a scheme in which equations, and contacts, are solved together with the states.

Each step is one small mixed complementarity problem, and takes an impact as it comes. `ElementSteps` follows a motion
by steps of a Radau scheme, halved until two halves say the same as the whole, and all pairs are on the same side
at all of their stages. Where contact opens, closes or slips, the shortest steps are implicit Euler ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array, Scheme, radau
from pyrobocop_pyomo.numerics.mixed_complementarity import (
    ComplementarityValues,
    MixedComplementarity,
    solve_mixed_complementarity,
)

from .right_hand_sides import RightHandSides
from .step_equations import StepEquations, differences, stacked, values_by

_radau = cache(radau)


class StepSystem:
    """The equations of one step: a scheme's rows at its nodes, and what is stated at its stages.

    Parameters
    ----------
    scheme : Scheme
    equations : InstantEquations or StepEquations
        At one of the stages: there are as many at all of them.
    length : float
        Of the step in real time.
    start : array, shape (n,)
        The states where it starts.
    known : array, shape (m, q)
        Unknowns at the first stages, where another step has found them.
    maps : array of bool, shape (n,), optional
        Which states have their next value in place of a derivative.

    Attributes
    ----------
    length : float
    stages_solved : int
        Those at which unknowns are to be found.
    """

    def __init__(
        self, scheme: Scheme, equations: Any, length: float, start: Array, known: Array | None = None, maps: Any = False
    ) -> None:
        self._scheme, self._pairs, self._start, self.length = scheme, equations.pairs, start, length
        self._known = np.zeros((len(equations.unknowns), 0)) if known is None else known
        self._lengths = np.where(maps, 1.0, length) * np.ones(len(start))
        self._steps = np.kron(scheme.D[:, 1:], np.eye(len(start)))
        # What is mapped does not go on from its start.
        self._mapped = scheme.D[:, :1] * np.where(maps, start, 0.0)
        self.stages_solved = scheme.stages - self._known.shape[1]
        self._kept: tuple[Array, ComplementarityValues] | None = None
        self._sizes: float | Array = 1.0

    def point_from(self, states: Array, unknowns: ArrayLike) -> Array:
        """A point to search from: the same states (n,) and unknowns (m,) everywhere."""
        return np.concatenate([np.tile(states, len(self._scheme.D)), np.tile(unknowns, self.stages_solved)])

    def parts(self, point: Array) -> tuple[Array, Array]:
        """States at the nodes, shape ``(nodes, n)``, and unknowns at the stages, shape ``(m, s)``; of k points too."""
        n, many = len(self._start), point.shape[1:]
        start, known = (np.tile(of.reshape(*of.shape, *(1 for _ in many)), many) for of in (self._start, self._known))
        nodes = np.concatenate([start, point[: len(self._steps)]]).reshape(len(self._scheme.D) + 1, n, *many)
        found = point[len(self._steps) :].reshape(self.stages_solved, len(known), *many)
        return nodes, np.concatenate([known, found.swapaxes(0, 1)], axis=1)

    def problem(self) -> MixedComplementarity:
        """All rows and pairs of all stages."""
        lower, upper, either = (
            np.repeat([getattr(pair, name) for pair in self._pairs], self.stages_solved)
            for name in ("lower", "upper", "either")
        )
        return MixedComplementarity(self.values, lower.astype(float), upper.astype(float), either.astype(bool))

    def is_determined(self, problem: MixedComplementarity, values: ComplementarityValues, little: float) -> bool:
        """Whether nothing that the equations leave free moves a state; forces may be shared in many ways."""
        for matrix in problem.matrices(values, little):
            sizes = np.abs(matrix).max(axis=1, keepdims=True)
            _, singular, directions = np.linalg.svd(matrix / np.where(sizes > 0, sizes, 1.0))
            free = directions[singular <= 1e-11 * singular[0], : len(self._steps)]
            if not (np.abs(free) <= 1e-6 * self._lengths.max()).all():
                return False
        return True

    def at_stages(self, points: Array) -> Array:
        """Rates, rows and both sides of all pairs at the stages, shape ``(v, s, k)``, of k points (size, k)."""
        raise NotImplementedError

    def values(self, point: Array) -> ComplementarityValues:
        """Everything at a point."""
        if self._kept is None or not np.array_equal(point, self._kept[0]):
            self._kept = point.copy(), self._evaluated(point)
        return self._kept[1]

    def rates(self, point: Array) -> Array:
        """Derivatives of the states at the stages, shape ``(n, s)``."""
        self.values(point)
        return self._rates_kept

    def _evaluated(self, point: Array) -> ComplementarityValues:
        n, count, stages, size = len(self._start), len(self._pairs), self._scheme.stages, len(point)
        found = differences(lambda points: self.at_stages(points).reshape(-1, size + 1), point, self._sizes)
        values, slopes = found[0].reshape(-1, stages), found[1].reshape(-1, stages, size)
        self._rates_kept = rates = values[:n]
        F, lengths = self._scheme.F, self._lengths
        states = self._scheme.D @ self.parts(point)[0] - self._mapped - F @ rates.T * lengths
        by = np.tensordot(F, slopes[:n], (1, 1)) * -lengths[:, None]
        by = by.reshape(len(self._steps), size)
        by[:, : len(self._steps)] += self._steps
        skipped = stages - self.stages_solved
        values, slopes = values[n:, skipped:], slopes[n:, skipped:]
        ends = [0, len(values) - 2 * count, len(values) - count, len(values)]
        rows, body, other = (values[begin:end].ravel() for begin, end in pairwise(ends))
        by_row, by_body, by_other = (slopes[begin:end].reshape(-1, size) for begin, end in pairwise(ends))
        return ComplementarityValues(
            np.concatenate([states.ravel(), rows]), body, other, np.concatenate([by, by_row]), by_body, by_other
        )


class FormulaStep(StepSystem):
    """A step by the formulas of rules, which are the same at all stages.

    Parameters
    ----------
    rates : RightHandSides
    i : int
        Its element.
    begin, end : float
        Where in the element it starts and ends.
    sizes : array, shape (n + m,)
        Of states and unknowns.
    start, scheme
        As for `StepSystem`.
    """

    def __init__(
        self, rates: RightHandSides, i: int, begin: float, end: float, start: Array, scheme: Scheme, sizes: Array
    ) -> None:
        super().__init__(scheme, rates.equations, float(rates.widths[i]) * (end - begin), start)
        self._rates, self._sizes = rates, self.point_from(*np.split(sizes, [len(start)]))
        self._given = rates.in_element(i, begin + (end - begin) * scheme.c)

    @property
    def planned(self) -> Array:
        """The unknowns as planned at the stages, shape ``(m, s)``."""
        keys = self._rates.keys[len(self._start) :]
        return stacked([self._given[key] for key in keys], (self._scheme.stages, 1))[..., 0]

    def at_stages(self, points: Array) -> Array:
        """As for `StepSystem`."""
        nodes, unknowns = self.parts(points)
        first = 0 if self._scheme.starts_on_a_stage else 1
        states = nodes[first : first + self._scheme.stages].swapaxes(0, 1)
        return self._rates.everything(self._given, np.concatenate([states, unknowns]))


class RowStep(StepSystem):
    """A step by the rows that a phase has at the points of an element; they may read all of its values.

    Parameters
    ----------
    equations : sequence of StepEquations
        At each stage.
    nodes : sequence of VarData
        The states at all nodes but the start, one node after the other.
    length, start, scheme, **options
        As for `StepSystem`.
    """

    def __init__(
        self, equations: Sequence[StepEquations], nodes: Sequence[Any], length: float, start: Array, scheme: Scheme,
        **options: Any,
    ) -> None:  # fmt: skip
        super().__init__(scheme, equations[0], length, start, **options)
        solved = equations[len(equations) - self.stages_solved :]
        variables = [*nodes, *(variable for of in solved for variable in of.unknowns.values())]
        self._at = values_by(
            [
                each
                for of in equations
                for sides in (of.rates, of.rows, [pair.body for pair in of.pairs], [pair.other for pair in of.pairs])
                for each in sides
            ],
            variables,
        )

    def at_stages(self, points: Array) -> Array:
        """As for `StepSystem`."""
        return self._at(points).reshape(self._scheme.stages, -1, points.shape[1]).swapaxes(0, 1)


@dataclass(frozen=True, eq=False)
class _Step:
    """States at the nodes of a step, unknowns at its stages, and which equations of its pairs hold at all stages."""

    scheme: Scheme
    begin: float
    end: float
    nodes: Array
    unknowns: Array
    sides: NDArray[np.int64]
    solved: bool
    is_determined: Callable[[], bool]


class ElementSteps:
    """Follows the motion of a phase through one element after the other.

    Parameters
    ----------
    rates : RightHandSides
        With the unknowns left to the steps.
    scales : array, shape (n,)
        Sizes of the states.
    tolerance : float
        Of the states at the end of a step, relative to the scales.
    most_steps : int
        To be solved in all, before the motion counts as one that cannot be followed: contact chatters.
    """

    def __init__(self, rates: RightHandSides, scales: Array, tolerance: float, most_steps: int) -> None:
        self._rates, self._scales, self._tolerance = rates, scales, tolerance
        self._equations = rates.equations
        # How often the width of a part is halved at most.
        self._halvings, self._left = 8, most_steps
        self._before: _Step | None = None
        self._path: list[_Step] = []

    def start_anew(self) -> None:
        """What follows is another motion."""
        self._before = None

    def through(self, i: int, state: Array, parts: Array, fractions: Array) -> Array:
        """States at fractions of an element, shape ``(k, n)``; infinite where the motion is not followed.

        Parameters
        ----------
        i : int
        state : array, shape (n,)
            Where it starts.
        parts : array
            Ends of the longest steps, from 0 to 1.
        fractions : array, shape (k,)

        Raises
        ------
        TrajectoryError
            When contacts cannot be solved, or leave open what happens.
        """
        found = np.full((len(fractions), len(state)), np.inf)
        if not (np.abs(state) < 1e6 * self._scales).all():
            return found
        self._path = []
        with np.errstate(all="ignore"):
            whole = None
            if self._equations.pairs and self._before is None:
                whole = self._step(i, parts[0], parts[1], state, _radau(3))
                if whole.solved:
                    self._refuse_what_is_left_open(i, whole)
                little = 2.0**-self._halvings * parts[1]
                self._before = self._step(i, parts[0], little, state, _radau(1), thorough=True)
            for begin, end in pairwise(parts.tolist()):
                following, whole = self._advance(i, begin, end, state, self._halvings, whole), None
                if following is None:
                    return found
                state = following
        for step in self._path:
            inside = (fractions >= step.begin) & (fractions <= step.end)
            places = (fractions[inside] - step.begin) / (step.end - step.begin)
            found[inside] = step.scheme.state_at(places) @ step.nodes
        return found

    def _advance(
        self, i: int, begin: float, end: float, state: Array, halvings: int, whole: _Step | None = None
    ) -> Array | None:
        """The state at the end of a part, which may have been tried in one step; None where there is no motion."""
        if self._left < 0:
            return None
        middle, first = 0.5 * (begin + end), None
        if whole is None or not whole.solved:
            whole = self._step(i, begin, end, state, _radau(3))
        if whole.solved:
            first = self._step(i, begin, middle, state, _radau(3))
            second = self._step(i, middle, end, first.nodes[-1], _radau(3), first)
            alike = self._same_sides(whole, first, second)
            inside = whole.scheme.state_at([0.5])[0] @ whole.nodes - first.nodes[-1]
            # Polynomials are less exact inside a step than at its end.
            apart = np.maximum(np.abs(second.nodes[-1] - whole.nodes[-1]), 1e-2 * np.abs(inside)) / self._scales
            close = apart.max() <= self._tolerance or halvings == 0
            if first.solved and second.solved and alike and close:
                return self._take(i, first, second)
        if halvings > 0:
            half = self._advance(i, begin, middle, state, halvings - 1, first)
            return None if half is None else self._advance(i, middle, end, half, halvings - 1)
        step = self._step(i, begin, end, state, _radau(1), thorough=True)
        if step.solved:
            return self._take(i, step)
        if self._equations.pairs:
            raise TrajectoryError(f"{self._at(i, begin)} no contact forces were found that meet equations and pairs.")
        return None

    def _at(self, i: int, fraction: float) -> str:
        time = float(self._rates.times_at(fraction)[i])
        return f"under the plan's controls the motion goes on to t = {time:g}, from where on"

    def _refuse_what_is_left_open(self, i: int, step: _Step) -> None:
        if not step.is_determined():
            raise TrajectoryError(f"{self._at(i, step.begin)} pairs and controls leave open what happens.")

    def _take(self, i: int, *steps: _Step) -> Array:
        if self._equations.pairs:
            self._refuse_what_is_left_open(i, steps[-1])
        self._path += steps
        self._before = steps[-1]
        return steps[-1].nodes[-1]

    def _same_sides(self, *steps: _Step) -> bool:
        return bool(np.bitwise_and.reduce([step.sides for step in (self._before, *steps) if step is not None]).all())

    def _step(
        self,
        i: int,
        begin: float,
        end: float,
        state: Array,
        scheme: Scheme,
        before: _Step | None = None,
        *,
        thorough: bool = False,
    ) -> _Step:
        """Solve one step of a scheme."""
        self._left -= 1
        sizes = np.append(self._scales, np.ones(len(self._equations.unknowns)))
        system = FormulaStep(self._rates, i, begin, end, state, scheme, sizes)
        before, problem = before or self._before, system.problem()
        guess = system.point_from(state, (system.planned if before is None else before.unknowns)[:, -1])
        tolerance = 1e-9 if thorough else 1e-12
        found = solve_mixed_complementarity(problem, guess, tolerance, thorough=thorough)
        nodes, unknowns = system.parts(found.point)
        values = system.values(found.point)
        little = 1e-8 * max(1.0, float(np.abs(found.point).max()))
        sides = _sides(problem, values, len(self._equations.pairs), little)
        # A residual that is small beside a large force need not be small beside the states, or sides of pairs.
        left = np.abs(problem.residuals(values))
        of_states, of_pairs = left[: nodes[1:].size].reshape(-1, len(state)), left[len(values.rows) :]
        is_small = (of_states <= self._tolerance * self._scales).all() and (of_pairs <= self._tolerance).all()
        solved = found.residual <= 1e-9 and bool(is_small)
        is_determined = partial(system.is_determined, problem, values, little)
        return _Step(scheme, begin, end, nodes, unknowns, sides, solved, is_determined)


def _sides(
    problem: MixedComplementarity, values: ComplementarityValues, pairs: int, little: float
) -> NDArray[np.int64]:
    """For each pair the equations that hold at all stages, as bits: at the lower bound, between, at the upper one."""
    at_lower = np.abs(values.body - problem.lower) <= little
    at_lower &= problem.either | (values.other >= -little)
    at_upper = (np.abs(values.body - problem.upper) <= little) & (values.other <= little)
    between = np.abs(values.other) <= little
    bits = (at_lower + 2 * between + 4 * at_upper).astype(np.int64)
    return np.bitwise_and.reduce(bits.reshape(pairs, len(bits) // max(pairs, 1)), axis=1)


def stepped_motions(
    rates: RightHandSides, starts: Array, parts: Array, fractions: Array, scales: Array, first: Array
) -> tuple[Array, Array | None]:
    """The motion of every element from its own start, and that from the first start on, by steps.

    Parameters
    ----------
    rates : RightHandSides
        With the unknowns left to the steps.
    starts : array, shape (n, N)
    parts : array
        Ends of the longest steps, from 0 to 1.
    fractions : array, shape (k,)
        Where in each element states are wanted.
    scales : array, shape (n,)
    first : array, shape (n,)
        Where the whole motion starts.

    Returns
    -------
    array, shape (n, N, k)
        Each element from its own start.
    array, shape (n, N, k), or None
        From the first start on; None where that could not be followed, or left the finite numbers.

    Raises
    ------
    TrajectoryError
        When contacts cannot be followed.
    """
    tolerance, most_steps = 1e-6, 2000 + 10 * len(starts.T) * (len(parts) - 1)
    steps = ElementSteps(rates, scales, tolerance, most_steps)
    whole = [steps.through(0, first, parts, fractions)]
    for i in range(1, len(starts.T)):
        whole.append(steps.through(i, whole[-1][-1], parts, fractions))
    local, steps = [], ElementSteps(rates, scales, tolerance, most_steps)
    for i, start in enumerate(starts.T):
        if (np.abs(start - whole[i][0]) <= tolerance * scales).all():
            local.append(whole[i])
            continue
        steps.start_anew()
        local.append(steps.through(i, start, parts, fractions))
    carried = np.array(whole).transpose(2, 0, 1)
    return np.array(local).transpose(2, 0, 1), carried if np.isfinite(carried).all() else None
