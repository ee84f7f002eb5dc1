"""The motion that equations and pairs make under the controls of a trajectory, step by step.

Steps of a Radau scheme are halved until two halves say the same as the whole, and all pairs are on the same side at all
of their stages. Where contact opens, closes or slips, the shortest steps are implicit Euler ones, which take an impact
as it comes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.numerics import Array, Scheme, radau
from pyrobocop_pyomo.numerics.flows import Flows
from pyrobocop_pyomo.numerics.mixed_complementarity import (
    ComplementarityValues,
    MixedComplementarity,
    solve_mixed_complementarity,
)
from pyrobocop_pyomo.trajectories import Trajectory

from .bounds_between_points import SAMPLES
from .rate_arrays import RateArrays

_radau = cache(radau)


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
    rates : RateArrays
        With the unknowns left to the steps.
    scales : array, shape (n,)
        Sizes of the states.
    tolerance : float
        Of the states at the end of a step, relative to the scales.
    most_steps : int
        To be solved in all, before the motion counts as one that cannot be followed: contact chatters.
    halvings : int
        How often the width of a part is halved at most.
    """

    def __init__(
        self,
        rates: RateArrays,
        scales: Array,
        tolerance: float,
        most_steps: int,
        halvings: int = 8,
    ) -> None:
        self._rates, self._scales, self._tolerance = rates, scales, tolerance
        self._equations = rates.equations
        self._halvings, self._left = halvings, most_steps
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
            if self._equations.pairs and self._before is None:
                little = 2.0**-self._halvings * parts[1]
                self._before = self._step(i, parts[0], little, state, _radau(1), thorough=True)
            for begin, end in pairwise(parts.tolist()):
                following = self._advance(i, begin, end, state, self._halvings)
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
        whole = whole or self._step(i, begin, end, state, _radau(3))
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

    def _take(self, i: int, *steps: _Step) -> Array:
        if self._equations.pairs and not steps[-1].is_determined():
            raise TrajectoryError(f"{self._at(i, steps[-1].begin)} pairs and controls leave open what happens.")
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
        system = _StepSystem(self._rates, i, begin, end, state, scheme, self._scales)
        problem = system.problem()
        tolerance = 1e-9 if thorough else 1e-12
        found = solve_mixed_complementarity(problem, system.start(before or self._before), tolerance, thorough=thorough)
        states, unknowns = system.parts(found.point)
        values = problem.evaluate(found.point)
        little = 1e-8 * max(1.0, float(np.abs(found.point).max()))
        sides = _sides(problem, values, len(self._equations.pairs), little)
        # A residual that is small beside a large force need not be small beside the states.
        left = np.abs(values.rows[: states.size].reshape(len(state), -1))
        solved = found.residual <= 1e-9 and bool((left <= self._tolerance * self._scales[:, None]).all())
        is_determined = partial(system.is_determined, problem, values, little)
        return _Step(scheme, begin, end, np.vstack([state, states]), unknowns, sides, solved, is_determined)


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


class _StepSystem:
    """The equations of one step in the states and unknowns at its stages, stage by stage."""

    def __init__(
        self, rates: RateArrays, i: int, begin: float, end: float, state: Array, scheme: Scheme, scales: Array
    ) -> None:
        self._rates, self._state, self._scheme, self._scales = rates, state, scheme, scales
        self._length = rates.widths[i] * (end - begin)
        self._given = rates.in_element(i, begin + (end - begin) * scheme.c)
        self._keys = rates.keys
        self._known: tuple[Array, ComplementarityValues] | None = None

    def start(self, before: _Step | None) -> Array:
        """Where to search from: the state stays, unknowns are those of the step before, or of the plan."""
        stages, n = self._scheme.stages, len(self._state)
        unknowns = np.array([self._given[key] for key in self._keys[n:]]).reshape(-1, stages)
        if before is not None:
            unknowns = np.repeat(before.unknowns[:, -1:], stages, axis=1)
        return np.vstack([np.repeat(self._state[:, None], stages, axis=1), unknowns]).T.ravel()

    def parts(self, point: Array) -> tuple[Array, Array]:
        """States at the stages, shape ``(s, n)``, and unknowns there, shape ``(m, s)``."""
        of_stages, n = point.reshape(self._scheme.stages, -1), len(self._state)
        return of_stages[:, :n], of_stages[:, n:].T

    def problem(self) -> MixedComplementarity:
        """All rows and pairs of all stages."""
        pairs = self._rates.equations.pairs
        lower, upper, either = (
            np.repeat([getattr(pair, name) for pair in pairs], self._scheme.stages)
            for name in ("lower", "upper", "either")
        )
        return MixedComplementarity(self._values, lower.astype(float), upper.astype(float), either.astype(bool))

    def _values(self, point: Array) -> ComplementarityValues:
        if self._known is None or not np.array_equal(point, self._known[0]):
            self._known = point.copy(), self._evaluated(point)
        return self._known[1]

    def _evaluated(self, point: Array) -> ComplementarityValues:
        stages, n = self._scheme.stages, len(self._state)
        at = point.reshape(stages, -1).T
        steps = 1e-7 * (np.append(self._scales, np.ones(len(at) - n))[:, None] + np.abs(at))
        varied = np.repeat(at[:, None], len(at) + 1, axis=1)
        for j, step in enumerate(steps):
            varied[j, j + 1] += step
        found = self._rates.everything({**self._given, **dict(zip(self._keys, varied, strict=True))}, varied.shape[1:])
        values, slopes = found[:, 0], (found[:, 1:] - found[:, :1]) / steps
        # Equations of a stage read that stage alone; the scheme ties their states together.
        jacobian = np.zeros((len(values), stages, stages, len(at)))
        jacobian[:, range(stages), range(stages)] = slopes.transpose(0, 2, 1)
        values[:n] = (self._scheme.D @ np.vstack([self._state, at[:n].T])).T - self._length * values[:n]
        jacobian[:n] *= -self._length
        for j in range(n):
            jacobian[j, :, :, j] += self._scheme.D[:, 1:]
        whole = jacobian.reshape(len(values), stages, -1)
        count = len(self._rates.equations.pairs)
        cuts = [len(values) - 2 * count, len(values) - count]
        rows, body, other = (part.ravel() for part in np.split(values, cuts))
        by_row, by_body, by_other = (part.reshape(-1, len(point)) for part in np.split(whole, cuts))
        return ComplementarityValues(rows, body, other, by_row, by_body, by_other)

    def is_determined(self, problem: MixedComplementarity, values: ComplementarityValues, little: float) -> bool:
        """Whether nothing that the equations leave free moves a state; forces may be shared in many ways."""
        for matrix in problem.matrices(values, little):
            sizes = np.abs(matrix).max(axis=1, keepdims=True)
            _, singular, directions = np.linalg.svd(matrix / np.where(sizes > 0, sizes, 1.0))
            free = directions[singular <= 1e-11 * singular[0]].reshape(-1, self._scheme.stages, len(self._keys))
            if not (np.abs(free[:, :, : len(self._state)]) <= 1e-6 * self._length).all():
                return False
        return True


def stepped_flows(
    rates: RateArrays, trajectory: Trajectory, fractions: Array, scales: Array, first: Array | None
) -> Flows:
    """Every element from where the trajectory starts it, and the motion from the first start on.

    Parameters
    ----------
    rates : RateArrays
        With the unknowns left to the steps.
    trajectory : Trajectory
    fractions : array, shape (k,)
        Where in each element states are wanted; where rules change quickly no step goes over one of them.
    scales : array, shape (n,)
    first : array, shape (n,), or None
        Where the whole motion starts; by default where the trajectory does.

    Raises
    ------
    TrajectoryError
        When contacts cannot be followed.
    """
    starts = np.array([trajectory.element_states(name)[:, 0] for name in trajectory.states]).T
    parts = fractions if len(fractions) > SAMPLES + 1 else np.array([0.0, 1.0])
    tolerance = 1e-6 if rates.equations.needs_steps else 1e-8
    most_steps = 2000 + 10 * len(starts) * (len(parts) - 1)
    steps = ElementSteps(rates, scales, tolerance, most_steps)
    whole = [steps.through(0, starts[0] if first is None else first, parts, fractions)]
    for i in range(1, len(starts)):
        whole.append(steps.through(i, whole[-1][-1], parts, fractions))
    local, steps = [], ElementSteps(rates, scales, tolerance, most_steps)
    for i, start in enumerate(starts):
        if (np.abs(start - whole[i][0]) <= tolerance * scales).all():
            local.append(whole[i])
            continue
        steps.start_anew()
        local.append(steps.through(i, start, parts, fractions))
    carried = np.array(whole)
    return Flows(fractions, np.array(local), carried if np.isfinite(carried).all() else None)
