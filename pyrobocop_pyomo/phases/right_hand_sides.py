"""The right-hand sides of a phase under the controls of a trajectory, by the formulas of its rules.

They are evaluated with arrays for all elements at once, or with floats at an instant of one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_nodes import FLOAT_FUNCTIONS
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.trajectories import Trajectory

from .delays import MotionSoFar, Past, past_of
from .instant_equations import InstantEquations
from .rule_formulas import RuleFormulas
from .step_equations import differences, stacked

# Relative to an element: shorter delays would take too many steps.
_SHORTEST_PART = 1e-5


class TooManyEvaluations(Exception):
    """Ends an integration that would go on for long."""


class RightHandSides:
    """Derivatives of all states, and what else is stated at an instant.

    Parameters
    ----------
    formulas : RuleFormulas
    trajectory : Trajectory
        Whose controls and parameters are taken. Algebraics are taken from it where nothing determines them, or the
        motion does not depend on them; elsewhere they are found at each instant, from there.
    equations : InstantEquations
        Of the formulas.
    further : sequence of expression
        Formulas that `values` evaluates as well.

    Attributes
    ----------
    equations : InstantEquations
    widths : array, shape (N,)
        Of the elements in real time.
    are_delayed : bool
        Whether the equations read earlier times.
    past : callable
        ``past(name, times)`` gives values at earlier times, where rules read such: those of the trajectory at first.
    most_evaluations : float
        Of `at`, before `TooManyEvaluations` is raised.
    reached : float
        The time at which `at` was evaluated last.

    Raises
    ------
    TrajectoryError
        When a rule gives no formula, or rules read earlier times and more is to be found than states.
    """

    def __init__(
        self, formulas: RuleFormulas, trajectory: Trajectory, equations: InstantEquations, further: Sequence[Any] = ()
    ) -> None:
        self._formulas, self._names, self._trajectory = formulas, formulas.record.names_of_states, trajectory
        self.widths = trajectory.grid.mesh.widths
        of_signals = [trajectory.element_signals(name) for name in trajectory.signals]
        self._signals = np.array(of_signals).reshape(-1, len(self.widths), trajectory.grid.scheme.stages)
        self._known: dict[bytes, dict[int, Any]] = {}
        self._floats: dict[float, list[dict[int, float]]] = {}
        meshes = trajectory.grid.mesh, formulas.indices.mesh
        self._starts, self._indices = (np.array(mesh.boundaries[:-1]) for mesh in meshes)
        self._index_widths = np.array(formulas.indices.mesh.widths)
        self.equations, pairs = equations, equations.pairs
        stated = [*equations.rows, *(pair.body for pair in pairs), *(pair.other for pair in pairs)]
        of_equations = formulas.delays_in([*equations.rates, *stated])
        self.are_delayed = bool(of_equations)
        if self.equations.unknowns and of_equations:
            raise TrajectoryError(
                f"phase '{formulas.block.name}': rules read earlier times, and equations determine "
                f"{', '.join(self.equations.unknowns)}; such a motion cannot be followed."
            )
        self._delays = [*of_equations, *formulas.delays_in(further)]
        self.past: Past = past_of(trajectory)
        self.most_evaluations, self.reached, self._evaluations = np.inf, self._starts[0], 0
        self.smallest_delay = min((delay for _, delay in of_equations if delay > 0.0), default=np.inf)
        self._stated = partial(formulas.values, stated)
        self._everything = partial(formulas.values, [*self.equations.rates, *stated])
        # Mean derivatives of the plan in each element: where the search for those begins that no ode states.
        nodes = {name: trajectory.element_states(name) for name in trajectory.states}
        self._slopes = {name: (of[:, -1:] - of[:, :1]) / self.widths[:, None] for name, of in nodes.items()}
        self._unknowns = [id(variable) for variable in self.equations.unknowns.values()]
        # What stands for states and unknowns.
        self.keys = [*(id(formulas.at_instant[name]) for name in self._names), *self._unknowns]
        self._inverses: dict[tuple[int, ...], Array | None] = {}
        self._last: dict[int, Any] = {}

    # ---------------------------------------------------------------- for all elements

    def __call__(self, fractions: Array, states: Array) -> Array:
        """Derivatives by local fractions, shape ``(n, k, N, q)``, of states of that shape."""
        return self.values(self.equations.rates, fractions, states)

    def values(self, expressions: Sequence[Any], fractions: Array, states: Array) -> Array:
        """Formulas at local fractions with states of shape ``(n, k, N, q)``, times the widths of the elements."""
        leaves = self._given(fractions) | dict(zip(self.keys, states, strict=False))
        if self._unknowns:
            leaves |= dict(zip(self._unknowns, self._determined(leaves, states.shape[1:]), strict=True))
        return stacked(self._formulas.values(expressions, leaves), states.shape[1:]) * self.widths[:, None]

    def _determined(self, leaves: dict[int, Any], shape: tuple[int, ...]) -> Array:
        """The unknowns by Newton's method from the plan, shape ``(m, k, N, q)``; NaN where it finds none.

        Variants of a state are close to each other: one inverse serves all of them, as long as it gets on.
        """
        found = stacked([leaves[key] for key in self._unknowns], shape)
        before, inverse = np.inf, self._inverses.get(shape[1:])
        for _ in range(30):
            left = stacked(self._stated({**leaves, **dict(zip(self._unknowns, found, strict=True))}), found.shape[1:])
            if inverse is None:
                inverse = self._inverse_at(leaves, found)
            change = np.einsum("nqab,bknq->aknq", inverse, left)
            found = found - change
            sizes = (np.abs(change) / (1.0 + np.abs(found))).max(axis=0)
            size = float(sizes.max())
            if not size > 1e-13 or (before <= 1e-10 and size > 0.2 * before):
                break
            inverse = None if size > 0.2 * before or not np.isfinite(size) else inverse
            before = size
        self._inverses[shape[1:]] = inverse
        return np.where(sizes <= 1e-9, found, np.nan)

    def _inverse_at(self, leaves: Mapping[int, Any], unknowns: Array) -> Array:
        """Of the derivatives of all rows by all unknowns in the first variant, shape ``(N, q, m, m)``."""
        first = {key: leaf[:1] if np.ndim(leaf) == 3 else leaf for key, leaf in leaves.items()}

        def evaluate(varied: Array) -> Array:
            return stacked(self._stated({**first, **dict(zip(self._unknowns, varied, strict=True))}), varied.shape[1:])

        slopes = differences(evaluate, unknowns[:, 0], 1.0)[1].transpose(2, 3, 0, 1)
        try:
            return np.asarray(np.linalg.inv(slopes), dtype=np.float64)
        except np.linalg.LinAlgError:
            return np.full(slopes.shape, np.nan)

    def in_element(self, i: int, fractions: Array, start: Array) -> dict[int, Any]:
        """What stands in place of each variable at some places of an element, as planned; arrays ``(q, 1)``."""
        found = {key: of[i][:, None] if np.ndim(of) else of for key, of in self._given(fractions).items()}
        return found | self._formulas.at_starts(dict(zip(self._names, start.tolist(), strict=True)))

    def everything(self, leaves: Mapping[int, Any], at: Array) -> Array:
        """Rates, rows and both sides of all pairs, shape ``(v, ..)``, at states and unknowns (w, ..)."""
        return stacked(self._everything({**leaves, **dict(zip(self.keys, at, strict=True))}), at.shape[1:])

    def times_at(self, fraction: float) -> Array:
        """Real times at a local fraction of every element."""
        return np.asarray(self._starts + fraction * self.widths)

    def _given(self, fractions: Array) -> dict[int, Any]:
        """Everything but the states as planned, at local fractions of every element, shape ``(N, q)``."""
        if len(fractions) == 1:
            return self._planned(fractions, slice(None))  # of SciPy's steps, each of which is another one
        key = fractions.tobytes()
        if key not in self._known:
            self._known[key] = self._planned(fractions, slice(None))
        return self._known[key]

    def _planned(self, fractions: Array, elements: slice) -> dict[int, Any]:
        trajectory, widths = self._trajectory, self.widths[elements, None]
        weights = trajectory.grid.scheme.stage_polynomial_at(fractions)
        times = self._starts[elements, None] + fractions * widths
        found: dict[str, Any] = dict(zip(trajectory.signals, self._signals[:, elements] @ weights.T, strict=True))
        found |= {name: np.interp(times, *knots) for name, knots in trajectory.piecewise_linear.items()}
        found |= trajectory.parameters
        index = self._indices[elements, None] + fractions * self._index_widths[elements, None]
        slopes = {name: of[elements] for name, of in self._slopes.items()}
        leaves = self._formulas.leaves(found, index, times, slopes)
        leaves |= self._formulas.delayed_numbers(self._delays, self.past, times, widths, fractions)
        beside = self._formulas.of_coupled_phases(fractions)
        return leaves | {key: of.T[elements] for key, of in beside.items()}

    # ---------------------------------------------------------------- in one element

    def at(self, i: int, fraction: float, states: Array, *, of_all: bool = False) -> Array:
        """Derivatives of all states by real time at a local fraction of one element.

        Parameters
        ----------
        i : int
        fraction : float
        states : array, shape (n,)
        of_all : bool
            Whether the same fraction is one of all elements: what is planned there is read at once, and kept.
        """
        self._evaluations += 1
        self.reached = self._starts[i] + fraction * self.widths[i]
        if self._evaluations > self.most_evaluations:
            raise TooManyEvaluations
        if of_all and not self._delays:
            if fraction not in self._floats:
                self._floats[fraction] = _by_element(self._given(np.array([fraction])), len(self.widths))
            planned = self._floats[fraction][i]
        else:
            [planned] = _by_element(self._planned(np.array([fraction]), slice(i, i + 1)), 1)
        leaves = planned | dict(zip(self.keys, states.tolist(), strict=True))
        self._last = leaves
        rates = self._formulas.values(self.equations.rates, leaves, FLOAT_FUNCTIONS)
        if any(isinstance(rate, complex) for rate in rates):
            raise ValueError("a rate is no real number")
        return np.array(rates, dtype=float)

    def through(
        self, i: Any, state: Array, parts: Array, fractions: Array, so_far: MotionSoFar | None = None, **options: Any
    ) -> tuple[Array, str]:
        """The motion through one element by SciPy.

        Parameters
        ----------
        i : int or None
            None for all elements side by side, each from its own start.
        state : array, shape (n,)
            Where it starts; of all elements, one after the other.
        parts : array
            From 0 to 1: no step goes across one of them.
        fractions : array, shape (k,)
        so_far : MotionSoFar, optional
            Learns the motion part by part, so short that what is delayed is known by then.
        **options
            Of `scipy.integrate.solve_ivp`.

        Returns
        -------
        states : array, shape (k, n)
            At the fractions; infinite from where SciPy gave up.
        why : str
            What SciPy said then.

        Raises
        ------
        TrajectoryError
            When a delay is too short to go on.
        """
        begin, width = self._starts[i or 0], float(self.widths[i or 0])

        def slope(fraction: float, at: Array) -> Array:
            if i is not None:
                return width * self.at(i, fraction, at)
            states = at.reshape(len(self.widths), -1).T[:, None, :, None]
            rates = self(np.array([fraction]), states)[:, 0, :, 0].T.ravel()
            if not np.isfinite(rates).all():  # SciPy would look for a step without end
                raise FloatingPointError("a rate has no value")
            return rates

        longest = np.inf if so_far is None else self.smallest_delay / width
        if longest < _SHORTEST_PART:
            raise TrajectoryError(
                f"a delay is shorter than {_SHORTEST_PART:g} of the element that starts at {begin:g}: the method of "
                "steps does not get on."
            )
        found = np.full((len(fractions), len(state)), np.inf)
        for first, last in pairwise(parts.tolist()):
            while first < last:
                end = last if last - first < 1.001 * longest else first + longest
                result = scipy.integrate.solve_ivp(slope, (first, end), state, dense_output=True, **options)
                state = result.y[:, -1]
                if not result.success or not np.isfinite(state).all():
                    self.reached = begin + width * float(result.t[-1])
                    return found, str(result.message)
                inside = (fractions >= first) & (fractions <= end)
                if inside.any():
                    found[inside] = result.sol(fractions[inside]).T
                if so_far is not None:
                    so_far.append(begin + width * end, partial(_at_time, result.sol, begin, width))
                first = end
        return found, ""

    def roughly_through(self, i: int, state: Array, fractions: Array) -> Array:
        """The motion through one element by a step of the classical Runge-Kutta method between two fractions.

        Parameters
        ----------
        i : int
        state : array, shape (n,)
            At the first fraction.
        fractions : array, shape (k,)

        Returns
        -------
        array, shape (k, n)
        """
        states, slope = [state], partial(self.at, i, of_all=True)
        for before, after in pairwise(fractions.tolist()):
            width, middle = float(self.widths[i]) * (after - before), (before + after) / 2
            first = slope(before, state)
            second = slope(middle, state + 0.5 * width * first)
            third = slope(middle, state + 0.5 * width * second)
            fourth = slope(after, state + width * third)
            state = state + width / 6.0 * (first + 2.0 * (second + third) + fourth)
            states.append(state)
        return np.array(states)

    def undefined(self) -> str:
        """Which part of a right-hand side has no value where they were evaluated last, in words; empty for none."""
        for name, rate in zip(self._names, self.equations.rates, strict=True):
            part = self._formulas.undefined_part(rate, self._last)
            if part:
                return f"{part}, in the right-hand side of '{name}'"
        return ""


def _by_element(given: Mapping[int, Any], count: int) -> list[dict[int, float]]:
    """What is given at one place of some elements, as numbers of each of them."""
    columns = [(np.zeros((count, 1)) + of)[:, 0].tolist() for of in given.values()]
    return [dict(zip(given, numbers, strict=True)) for numbers in zip(*columns, strict=True)]


def _at_time(solution: Callable[[float], Array], begin: float, width: float, time: float) -> Array:
    return solution((time - begin) / width)
