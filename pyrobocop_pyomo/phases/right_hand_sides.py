"""The right-hand sides of a phase under the controls of a trajectory, by the formulas of its rules.

They are evaluated with arrays, for all elements at once or for one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
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
    farthest : array, shape (n,)
        Sizes of states beyond which a motion counts as one that has left the finite numbers.

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
        self.farthest = np.full(len(self._names), np.inf)
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

    # ---------------------------------------------------------------- at some fractions of elements

    def values(
        self, expressions: Sequence[Any], fractions: Array, states: Array, elements: slice = slice(None)
    ) -> Array:
        """Formulas at local fractions of some elements, times the widths of these.

        Parameters
        ----------
        expressions : sequence of v expressions
        fractions : array, shape (q,)
        states : array, shape (n, k, E, q)
            For ``k`` variants.
        elements : slice
            Of ``E`` elements; all of them by default.

        Returns
        -------
        array, shape (v, k, E, q)
        """
        leaves = self._planned(fractions, elements) | dict(zip(self.keys, states, strict=False))
        if self._unknowns:
            leaves |= dict(zip(self._unknowns, self._determined(leaves, states.shape[1:]), strict=True))
        self._last = leaves
        return stacked(self._formulas.values(expressions, leaves), states.shape[1:]) * self.widths[elements, None]

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

    def in_element(self, i: int, fractions: Array) -> dict[int, Any]:
        """What stands in place of each variable at some places of an element, as planned; arrays ``(q, 1)``."""
        planned = self._planned(fractions, slice(i, i + 1))
        return {key: of.T if np.ndim(of) else of for key, of in planned.items()}

    def everything(self, leaves: Mapping[int, Any], at: Array) -> Array:
        """Rates, rows and both sides of all pairs, shape ``(v, ..)``, at states and unknowns (w, ..)."""
        return stacked(self._everything({**leaves, **dict(zip(self.keys, at, strict=True))}), at.shape[1:])

    def times_at(self, fraction: float) -> Array:
        """Real times at a local fraction of every element."""
        return np.asarray(self._starts + fraction * self.widths)

    def _planned(self, fractions: Array, elements: slice) -> dict[int, Any]:
        """Everything but the states as planned, shape ``(E, q)``."""
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

    # ---------------------------------------------------------------- along a motion

    def at(self, elements: slice, fraction: float, states: Array) -> Array:
        """Derivatives by the local fraction at one fraction of some elements, shape ``(n, k, E)`` as the states.

        Raises
        ------
        FloatingPointError
            Where one has no value.
        """
        self._evaluations += 1
        self.reached = self._starts[elements][0] + fraction * self.widths[elements][0]
        if self._evaluations > self.most_evaluations:
            raise TooManyEvaluations
        rates = self.values(self.equations.rates, np.array([fraction]), states[..., None], elements)[..., 0]
        is_far = (np.abs(states) > self.farthest[:, None, None]).any()
        if is_far or not np.isfinite(rates).all():  # SciPy would look for a step without end
            raise FloatingPointError("a rate has no value")
        return rates

    def through(
        self,
        elements: slice,
        states: Array,
        parts: Array,
        fractions: Array,
        so_far: MotionSoFar | None = None,
        **options: Any,
    ) -> tuple[Array, str]:
        """The motion through some elements side by side, by SciPy.

        Parameters
        ----------
        elements : slice
        states : array, shape (n, k, E)
            Where each of them starts, for k variants.
        parts : array
            From 0 to 1: no step goes across one of them.
        fractions : array, shape (q,)
        so_far : MotionSoFar, optional
            Learns the motion of one element part by part, so short that what is delayed is known by then.
        **options
            Of `scipy.integrate.solve_ivp`.

        Returns
        -------
        states : array, shape (n, k, E, q)
            At the fractions; infinite from where SciPy gave up.
        why : str
            What SciPy said then.

        Raises
        ------
        TrajectoryError
            When a delay is too short to go on.
        """
        begin, width, shape = self._starts[elements][0], float(self.widths[elements][0]), states.T.shape
        if options["method"] == "LSODA":  # elements know nothing of each other
            options |= dict.fromkeys(("lband", "uband"), len(states) - 1)

        def slope(fraction: float, at: Array) -> Array:
            return self.at(elements, fraction, at.reshape(shape).T).T.ravel()

        longest = np.inf if so_far is None else self.smallest_delay / width
        if longest < _SHORTEST_PART:
            raise TrajectoryError(
                f"a delay is shorter than {_SHORTEST_PART:g} of the element that starts at {begin:g}: the method of "
                "steps does not get on."
            )
        found, state = np.full((len(fractions), *shape), np.inf), states.T.ravel()
        for first, last in pairwise(parts.tolist()):
            while first < last:
                end = last if last - first < 1.001 * longest else first + longest
                result = scipy.integrate.solve_ivp(slope, (first, end), state, dense_output=True, **options)
                state = result.y[:, -1]
                if not result.success or not np.isfinite(state).all():
                    self.reached = begin + width * float(result.t[-1])
                    return found.T, str(result.message)
                inside = (fractions >= first) & (fractions <= end)
                if inside.any():
                    found[inside] = result.sol(fractions[inside]).T.reshape(-1, *shape)
                if so_far is not None:
                    so_far.append(begin + width * end, partial(_at_time, result.sol, begin, width))
                first = end
        return found.T, ""

    def roughly(self, state: Array, fractions: Array) -> Array:
        """The motion through all elements, by a step of the classical Runge-Kutta method from fraction to fraction.

        Parameters
        ----------
        state : array, shape (n,)
            At the start.
        fractions : array, shape (q,)
            From 0 to 1.

        Returns
        -------
        array, shape (E, q, n)
        """
        between = 0.5 * (fractions[1:] + fractions[:-1])
        places, shape = np.sort(np.append(fractions, between)), (len(self.widths), 2 * len(fractions) - 1)
        planned = {
            key: np.broadcast_to(of, shape).tolist() if np.ndim(of) else of
            for key, of in self._planned(places, slice(None)).items()
        }

        def slope(i: int, place: int, at: Array) -> Array:
            leaves = {key: of[i][place] if isinstance(of, list) else of for key, of in planned.items()}
            leaves |= dict(zip(self.keys, at.tolist(), strict=False))
            return self.widths[i] * np.array(self._formulas.values(self.equations.rates, leaves), dtype=float)

        found = np.empty((len(self.widths), len(fractions), len(state)))
        for i in range(len(self.widths)):
            found[i, 0] = state
            for k, length in enumerate(np.diff(fractions).tolist()):
                first = slope(i, 2 * k, state)
                second = slope(i, 2 * k + 1, state + 0.5 * length * first)
                third = slope(i, 2 * k + 1, state + 0.5 * length * second)
                fourth = slope(i, 2 * k + 2, state + length * third)
                found[i, k + 1] = state = state + length / 6.0 * (first + 2.0 * (second + third) + fourth)
        return found

    def undefined(self) -> str:
        """Which part of a right-hand side has no value where they were evaluated last, in words; empty for none."""
        for name, rate in zip(self._names, self.equations.rates, strict=True):
            part = self._formulas.undefined_part(rate, {key: float(np.ravel(of)[0]) for key, of in self._last.items()})
            if part:
                return f"{part}, in the right-hand side of '{name}'"
        return ""


def _at_time(solution: Callable[[float], Array], begin: float, width: float, time: float) -> Array:
    return solution((time - begin) / width)
