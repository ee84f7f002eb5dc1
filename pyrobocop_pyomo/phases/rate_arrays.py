"""The differential equations of a phase under the controls of a trajectory: for all elements at once, or at an instant.

The templates of the rules are evaluated with arrays (`RateArrays`), or as one function of floats (`PointRates`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_nodes import FLOAT_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps, number_of
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.trajectories import Trajectory

from .companions import Companion
from .delays import Past, past_of
from .instant_equations import InstantEquations
from .record import PhaseRecord, Statement
from .rule_formulas import RuleFormulas


class PointRates:
    """The differential equations of a phase at one instant after the other, as one function without expressions.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
        Every state has an explicit equation.
    indices, grid : Grid
        The same grid in time indices and in real time.
    signals : mapping of name to array, shape (N, s)
        Algebraics and controls at the stages.
    knots : mapping of name to array, shape (2, knots)
        Times and values of the piecewise linear controls.
    parameters : mapping of name to number
    companions : sequence of Companion

    Attributes
    ----------
    past : callable
        ``past(name, times)`` gives values at earlier times, where rules read such.
    smallest_delay : float
        Of those that are positive.
    given : dict of name to float
        What was asked last.

    Raises
    ------
    TrajectoryError
        When the rules give no formula for all times.
    """

    past: Past

    def __init__(
        self,
        block: Any,
        record: PhaseRecord,
        indices: Grid,
        grid: Grid,
        signals: Mapping[str, Array],
        knots: Mapping[str, Array],
        parameters: Mapping[str, float],
        companions: Sequence[Companion] = (),
    ) -> None:
        self._indices, self._grid, self._names = indices.mesh.boundaries, grid, record.names_of_states
        self._signals, self._knots, self._parameters = signals, knots, parameters
        self._formulas = formulas = RuleFormulas(block, record, indices, grid, companions)
        rates = formulas.rates_of(self._names)
        with failures_as(TrajectoryError, f"phase '{block.name}': its equations are no formulas"):
            steps = ExpressionSteps(rates)
            self._evaluate, self._leaves = steps.function(FLOAT_FUNCTIONS), steps.leaves
        own = {id(variable) for variable in formulas.variables}
        self._others = [leaf for leaf in steps.leaves if id(leaf.node) not in own]
        self._known: dict[int, float] = {}
        self.smallest_delay = min((delay for _, delay in formulas.delays if delay > 0.0), default=np.inf)
        self.given: dict[str, float] = {}

    def refresh(self) -> None:
        """Read again what is no signal of the phase."""
        self._known = {id(leaf.node): number_of(leaf) for leaf in self._others}

    def __call__(self, element: int, local: float, states: Array) -> Array:
        """Derivatives of all states at a local fraction of an element."""
        boundaries = self._grid.mesh.boundaries
        width = boundaries[element + 1] - boundaries[element]
        clock = boundaries[element] + local * width
        index = self._indices[element] + local * (self._indices[element + 1] - self._indices[element])
        weights = self._grid.scheme.stage_polynomial_at([local])[0]
        given = {name: float(weights @ of[element]) for name, of in self._signals.items()}
        given |= {name: float(np.interp(clock, *of)) for name, of in self._knots.items()}
        self.given = {**self._parameters, **given, **dict(zip(self._names, states.tolist(), strict=True))}
        leaves = self._known | self._formulas.leaves(self.given, index, clock)
        for key, of in self._formulas.of_companions(np.array([local])).items():
            leaves[key] = float(of[0, element])
        if self._formulas.delays:
            once = np.array([clock]), np.array([width])
            delayed = self._formulas.delayed_numbers(self.past, *once, local)
            leaves |= {key: float(of[0]) for key, of in delayed.items()}
        rates = self._evaluate([leaves.get(id(leaf.node)) for leaf in self._leaves])
        if any(isinstance(rate, complex) for rate in rates):
            raise ValueError("a rate is no real number")
        return np.array(rates, dtype=float)


class RateArrays:
    """Derivatives of all states by the local fraction, in all elements at once.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    trajectory : Trajectory
        Whose controls and parameters are taken. Algebraics are taken from it where nothing determines them, or the
        motion does not depend on them; elsewhere they are found at each instant, from there.
    indices : Grid
        Its grid in the time indices of the phase.
    integrals : sequence of Statement
        Whose integrands follow the states: what they gain over the local fraction.
    companions : sequence of Companion
        Other phases that rules may read, as planned.
    in_steps : bool
        Whether the unknowns are left to whoever follows the motion step by step, as contacts ask for.

    Attributes
    ----------
    equations : InstantEquations
    widths : array, shape (N,)
        Of the elements in real time.

    Notes
    -----
    What is delayed is taken from the trajectory, as controls are.

    Raises
    ------
    TrajectoryError
        When a rule gives no formula, or instants alone do not determine the motion.
    """

    def __init__(
        self,
        block: Any,
        record: PhaseRecord,
        trajectory: Trajectory,
        indices: Grid,
        integrals: Sequence[Statement] = (),
        companions: Sequence[Companion] = (),
        *,
        in_steps: bool = False,
    ) -> None:
        self._names, self._phase = record.names_of_states, block.name
        self._trajectory, self._indices = trajectory, indices
        self.widths = trajectory.grid.mesh.widths
        self._signals = {name: trajectory.element_signals(name) for name in trajectory.signals}
        self._known: dict[float, dict[int, Any]] = {}
        self._formulas = RuleFormulas(block, record, indices, trajectory.grid, companions)
        with failures_as(TrajectoryError, f"phase '{block.name}': its equations are no formulas"):
            self.equations = InstantEquations(block, record, self._formulas)
            gained = [self._formulas.formulas_of(statement) for statement in integrals]
        if self.equations.unknowns and self._formulas.delays:
            raise TrajectoryError(
                f"phase '{block.name}': rules read earlier times, and equations determine "
                f"{', '.join(self.equations.unknowns)}; such a motion cannot be followed."
            )
        if self.equations.needs_steps and not in_steps:
            raise TrajectoryError(
                f"phase '{block.name}': its motion depends on contacts, or on hidden conditions, which single instants "
                "do not tell."
            )
        pairs = self.equations.pairs
        stated = [*self.equations.rows, *(pair.body for pair in pairs), *(pair.other for pair in pairs)]
        self._rates = partial(self._formulas.values, [*self.equations.rates, *gained])
        self._asked = partial(self._formulas.values, stated)
        nodes = {name: trajectory.element_states(name) for name in self._names}
        # Mean derivatives of the plan in each element: where the search for those begins that no ode states.
        self._slopes = {name: (of[:, -1] - of[:, 0]) / self.widths for name, of in nodes.items()}
        self._unknowns = [id(variable) for variable in self.equations.unknowns.values()]
        # What stands for states and unknowns.
        self.keys = [*(id(self._formulas.at_instant[name]) for name in self._names), *self._unknowns]
        self._inverse: Array | None = None

    def __call__(self, fraction: float, states: Array) -> Array:
        """Derivatives at a local fraction, of states of shape ``(n, k, N)``, those of integrals among them."""
        leaves = self._leaves(fraction, states)
        if self._unknowns:
            leaves |= dict(zip(self._unknowns, self._determined(fraction, leaves, states.shape[1:]), strict=True))
        return _stacked(self._rates(leaves), states.shape[1:]) * self.widths

    def _leaves(self, fraction: float, states: Array) -> dict[int, Any]:
        """What stands in place of each variable at a local fraction of all elements; as planned, but for the states."""
        return self._given(fraction) | dict(zip(self.keys, states[: len(self._names)], strict=False))

    def _determined(self, fraction: float, leaves: dict[int, Any], shape: tuple[int, ...]) -> Array:
        """The unknowns by Newton's method from the plan, shape ``(m, k, N)``; NaN where it finds none.

        Variants of a state are close to each other: one inverse serves all of them, as long as it gets on.
        """
        found = _stacked([leaves[key] for key in self._unknowns], shape)
        before, inverse = np.inf, self._inverse
        for _ in range(30):
            left = self._rows_at(leaves, found)
            if inverse is None:
                inverse = self._inverse_at(leaves, found)
            change = np.einsum("nab,bkn->akn", inverse, left)
            found = found - change
            sizes = (np.abs(change) / (1.0 + np.abs(found))).max(axis=0)
            size = float(sizes.max())
            if not size > 1e-13 or (before <= 1e-10 and size > 0.2 * before):
                break
            inverse = None if size > 0.2 * before or not np.isfinite(size) else inverse
            before = size
        self._inverse = inverse
        return np.where(sizes <= 1e-9, found, np.nan)

    def _rows_at(self, leaves: Mapping[int, Any], unknowns: Array) -> Array:
        at = {**leaves, **dict(zip(self._unknowns, unknowns, strict=True))}
        return _stacked(self._asked(at), unknowns.shape[1:])

    def _inverse_at(self, leaves: Mapping[int, Any], unknowns: Array) -> Array:
        """Of the derivatives of all rows by all unknowns in the first variant, shape ``(N, m, m)``."""
        first = {key: leaf[:1] if np.ndim(leaf) == 2 else leaf for key, leaf in leaves.items()}
        steps = 1e-7 * (1.0 + np.abs(unknowns[:, 0]))
        varied = np.repeat(unknowns[:, :1], len(steps) + 1, axis=1)
        for j, step in enumerate(steps):
            varied[j, j + 1] += step
        rows = self._rows_at(first, varied)
        slopes = (rows[:, 1:] - rows[:, :1]) / steps
        try:
            return np.asarray(np.linalg.inv(slopes.transpose(2, 0, 1)), dtype=np.float64)
        except np.linalg.LinAlgError:
            return np.full(slopes.transpose(2, 0, 1).shape, np.nan)

    def in_element(self, i: int, fractions: Array) -> dict[int, Any]:
        """What stands in place of each variable at some places of one element, as planned; arrays of their shape."""
        places = [self._given(fraction) for fraction in fractions.tolist()]
        return {key: np.array([of[i] if np.ndim(of := at[key]) else of for at in places]) for key in places[0]}

    def everything(self, leaves: Mapping[int, Any], shape: tuple[int, ...]) -> Array:
        """Derivatives by real time, rows and both sides of all pairs, one after the other."""
        return _stacked([*self._rates(leaves), *self._asked(leaves)], shape)

    def times_at(self, fraction: float) -> Array:
        """Real times at a local fraction of every element."""
        return np.asarray(np.array(self._trajectory.grid.mesh.boundaries[:-1]) + fraction * self.widths)

    def _given(self, fraction: float) -> dict[int, Any]:
        """Everything but the states as planned, at a local fraction of every element."""
        if fraction not in self._known:
            weights = self._trajectory.grid.scheme.stage_polynomial_at([fraction])[0]
            times = self.times_at(fraction)
            found: dict[str, Any] = {name: of @ weights for name, of in self._signals.items()}
            found |= {name: np.interp(times, *knots) for name, knots in self._trajectory.piecewise_linear.items()}
            found |= self._trajectory.parameters
            boundaries = np.array(self._indices.mesh.boundaries)
            index = boundaries[:-1] + fraction * np.diff(boundaries)
            leaves = self._formulas.leaves(found, index, times, self._slopes)
            leaves |= self._formulas.delayed_numbers(past_of(self._trajectory), times, self.widths, fraction)
            leaves |= {key: of[0] for key, of in self._formulas.of_companions(np.array([fraction])).items()}
            self._known[fraction] = leaves
        return self._known[fraction]


def _stacked(values: Sequence[Any], shape: tuple[int, ...]) -> Array:
    """Numbers and arrays as one array, each of a shape."""
    found = np.empty((len(values), *shape))
    for row, of in zip(found, values, strict=True):
        row[...] = of
    return found
