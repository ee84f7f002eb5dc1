"""The Lagrangian of a phase over time, evaluated where the mesh does not look: what the optimum misses, per element.

With costates ``lambda`` and densities ``nu`` of what else restrains the motion, polynomials through the values at the
stages, the function ::

    H = sum_j w_j l_j + lambda . (f - x') - nu . g

is integrated over each element by a rule that is far more exact than that of the mesh, and by that of the mesh. The
difference is the first part of the error. Where the mesh is free to place its controls, H is stationary in them at the
stages only: how much smaller it could be between the stages is the second part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_nodes import ExpressionEvaluator
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.lagrange import differentiation_matrix, evaluation_matrix
from pyrobocop_pyomo.phases import Control
from pyrobocop_pyomo.phases.companions import indices_of
from pyrobocop_pyomo.phases.rate_arrays import ARRAY_FUNCTIONS, RuleFormulas
from pyrobocop_pyomo.phases.record import labelled_rows
from pyrobocop_pyomo.trajectories import Trajectory

from .phase_multipliers import PhaseMultipliers

# Of differences by controls, relative to their size; and below which part of H over that a curvature counts as none.
_STEP, _FLAT = 1e-4, 1e-6
_SMALLEST = 1e-3
# At most so much of two parts is taken to cancel.
_CANCELLED = 0.1
_SWEEPS = 12


class PhaseLagrangian:
    """See the module.

    Parameters
    ----------
    phase : PhaseBlock
    trajectory : Trajectory
    multipliers : PhaseMultipliers
    weights : sequence of float
        Of the integrals that the phase has handed out.
    sign : float
        1 where the objective is minimised, -1 where it is maximised.

    Raises
    ------
    TrajectoryError
        When a rule gives no formula that holds at all times.
    """

    def __init__(
        self,
        phase: Any,
        trajectory: Trajectory,
        multipliers: PhaseMultipliers,
        weights: Sequence[float],
        sign: float,
    ) -> None:
        record = phase.record
        self._record, self._trajectory, self._multipliers, self._sign = record, trajectory, multipliers, sign
        self._indices = indices_of(record, trajectory.grid)
        self._formulas = RuleFormulas(phase, record, self._indices, trajectory.grid)
        names = [name for name in record.names_of_states if name in multipliers.costates]
        self._rates = dict(zip(names, self._formulas.rates_of(names, derivatives=True), strict=True))
        self._integrands = [
            (weight, self._formulas.formula_of(statement))
            for weight, statement in zip(weights, record.integrals, strict=True)
            if weight != 0.0
        ]
        self._rows = [
            (_excess(labelled_rows(statement.kind, self._formulas.formula_of(statement)).get(label)), density)
            for statement, label, density in multipliers.rows
        ]
        self._states = {name: trajectory.element_states(name) for name in trajectory.states}
        self._signals = {name: trajectory.element_signals(name) for name in trajectory.signals}
        self._controls = [name for name in record.names(Control) if name in self._signals]

    def errors(self) -> Array:
        """What each element adds to the error of the objective, shape ``(N,)``; not negative.

        Raises
        ------
        TrajectoryError
            When something has no finite value.
        """
        scheme, widths = self._trajectory.grid.scheme, self._trajectory.grid.mesh.widths
        points, weights = np.polynomial.legendre.leggauss(2 * scheme.stages + 2)
        exact, weights = (points + 1.0) / 2.0, weights / 2.0
        with np.errstate(all="ignore"):
            stages = _Instants(self, scheme.c)
            between = _Instants(self, exact, stages.rates() if scheme.starts_on_a_stage else {})
            if scheme.starts_on_a_stage:
                stages = _Instants(self, scheme.c, stages.rates())
            first = weights @ between.hamiltonian({}) - scheme.b @ stages.hamiltonian({})
            second = weights @ between.gain() if self._controls else np.zeros(len(widths))
        # Both parts may cancel, and do for schemes of Gauss; how well is known to leading order only.
        net = np.abs(self._sign * first - second)
        found = widths * np.maximum(net, _CANCELLED * (np.abs(first) + np.abs(second)))
        if not np.isfinite(found).all():
            raise TrajectoryError("the equations have no finite value between the points.")
        return np.asarray(found, dtype=np.float64)


class _Instants:
    """All elements at some local fractions; arrays have the shape ``(q, N)``.

    Parameters
    ----------
    phase : PhaseLagrangian
    fractions : array, shape (q,)
    rates : mapping of state name to array, shape (s, N)
        Derivatives at the stages, where the values of a state do not determine its polynomial.
    """

    def __init__(self, phase: PhaseLagrangian, fractions: Array, rates: Mapping[str, Array] | None = None) -> None:
        self._of = phase
        trajectory, multipliers = phase._trajectory, phase._multipliers
        scheme, mesh = trajectory.grid.scheme, trajectory.grid.mesh
        self._at_stages = at_stages = scheme.stage_polynomial_at(fractions)
        starts = np.array(mesh.boundaries[:-1])
        times = starts + fractions[:, None] * mesh.widths
        places = np.array(phase._indices.mesh.boundaries)
        self._index = places[:-1] + fractions[:, None] * np.diff(places)
        self._clock = times
        values: dict[str, Any] = {name: scheme.state_at(fractions) @ of.T for name, of in phase._states.items()}
        values |= {name: at_stages @ of.T for name, of in phase._signals.items()}
        values |= {name: np.interp(times, *knots) for name, knots in trajectory.piecewise_linear.items()}
        slopes = differentiation_matrix(scheme.state_nodes, fractions)
        self._slopes = {name: slopes @ of.T / mesh.widths for name, of in phase._states.items()}
        for name, at in (rates or {}).items():
            values[name] = phase._states[name][:, 0] + mesh.widths * (scheme.increments_at(fractions) @ at)
            self._slopes[name] = at_stages @ at
        self._values = {**values, **trajectory.parameters}
        with_start = evaluation_matrix([0.0, *scheme.c], fractions) if multipliers.starts else at_stages
        self._costates = {
            name: with_start @ np.vstack([multipliers.starts[name], of.T])
            if name in multipliers.starts
            else at_stages @ of.T
            for name, of in multipliers.costates.items()
        }
        self._densities = [(excess, at_stages @ density.T) for excess, density in phase._rows]
        self._bounds = [
            (name, self._bound(name, side), at_stages @ density.T) for name, side, density in multipliers.bounds
        ]

    def _bound(self, name: str, side: int) -> Any:
        """A declared bound of a state or algebraic at the instants."""
        declaration = self._of._record.declarations[name]
        none = (-np.inf, np.inf)[side]
        if not callable(declaration.bounds):
            bound = declaration.bounds_at(0.0, name)[side]
            return none if bound is None else float(bound)
        found = [declaration.bounds_at(time, name)[side] for time in self._index.ravel().tolist()]
        return np.array([none if bound is None else bound for bound in found], dtype=float).reshape(self._index.shape)

    def _room(self, name: str) -> tuple[Array, Array]:
        """By how much a control may change at the instants, down and up."""
        lower, upper = (
            np.where(np.isfinite(of).all(axis=1), self._at_stages @ np.where(np.isfinite(of), of, 0.0).T, infinite)
            for of, infinite in zip(self._of._multipliers.room[name], (-np.inf, np.inf), strict=True)
        )
        return lower - self._values[name], upper - self._values[name]

    def rates(self) -> dict[str, Array]:
        """What the equations say of the derivatives."""
        known = self._evaluator(self._values)
        return {name: np.zeros(self._index.shape) + known(rate) for name, rate in self._of._rates.items()}

    def _evaluator(self, values: Mapping[str, Any]) -> Any:
        leaves = self._of._formulas.leaves(values, self._index, self._clock, self._slopes)
        return ExpressionEvaluator(leaves, ARRAY_FUNCTIONS).of

    def hamiltonian(self, changes: Mapping[str, Any]) -> Array:
        """The function of the module, with some controls changed."""
        of = self._of
        values = self._values | {name: self._values[name] + change for name, change in changes.items()}
        known = self._evaluator(values)
        total = np.zeros(self._index.shape)
        for weight, integrand in of._integrands:
            total += weight * known(integrand)
        for name, costate in self._costates.items():
            total += costate * (known(of._rates[name]) - self._slopes[name])
        for (body, lower, upper), density in self._densities:
            total -= density * _beyond(known(body), known(lower), known(upper), of._sign * density)
        for name, bound, density in self._bounds:
            total -= density * np.where(density == 0.0, 0.0, values[name] - bound)
        return total

    def gain(self) -> Array:
        """How much smaller (where the objective is maximised: larger) controls inside their bounds make it."""
        of, sign = self._of, self._of._sign
        names = of._controls
        here = sign * self.hamiltonian({})
        sizes = [_SMALLEST + float(np.abs(self._values[name]).max()) for name in names]
        steps = [_STEP * size for size in sizes]
        slope, curvature, forward = [], {}, []
        for j, (name, step) in enumerate(zip(names, steps, strict=True)):
            up, down = (sign * self.hamiltonian({name: change}) for change in (step, -step))
            slope.append((up - down) / (2.0 * step))
            curvature[j, j] = (up + down - 2.0 * here) / step**2
            forward.append(up)
        for j in range(len(names)):
            for k in range(j):
                both = sign * self.hamiltonian({names[j]: steps[j], names[k]: steps[k]})
                curvature[j, k] = curvature[k, j] = (both - forward[j] - forward[k] + here) / (steps[j] * steps[k])
        change = [np.zeros(here.shape) for _ in names]
        room = [self._room(name) for name in names]
        flat = [_FLAT * (np.abs(here).max() + 1e-300) / size**2 for size in sizes]
        for _ in range(_SWEEPS if len(names) > 1 else 1):
            for j, (lower, upper) in enumerate(room):
                downhill = slope[j] + sum(curvature[j, k] * change[k] for k in range(len(names)) if k != j)
                curved = curvature[j, j] > flat[j]
                newton = -downhill / np.where(curved, curvature[j, j], 1.0)
                to_bound = np.where(downhill > 0.0, lower, upper)
                linear = np.where(np.isfinite(to_bound), to_bound, 0.0)
                change[j] = np.clip(np.where(curved, newton, linear), lower, upper)
        wanted = dict(zip(names, change, strict=True))
        gained = here - sign * self.hamiltonian(wanted)
        halfway = here - sign * self.hamiltonian({name: 0.5 * part for name, part in wanted.items()})
        found = np.where(np.abs(halfway) > np.abs(gained), halfway, gained)
        return np.asarray(np.where(np.isfinite(found), found, np.nan_to_num(gained)), dtype=np.float64)


def _excess(row: Any) -> tuple[Any, Any, Any]:
    """Body and bounds of a row, in the orientation that Pyomo gives it."""
    infinite = (-np.inf, np.inf)
    if isinstance(row, tuple):
        if len(row) == 2:
            return _oriented(row[0], row[1], equal=True)
        lower, body, upper = row
        return body, infinite[0] if lower is None else lower, infinite[1] if upper is None else upper
    if not isinstance(row, RelationalExpression):
        return row, 0.0, 0.0  # an equation that was stated as an expression which is zero
    if len(row.args) == 3:
        lower, body, upper = row.args
        return body, lower, upper
    return _oriented(*row.args, equal=not hasattr(row, "strict"))


def _oriented(left: Any, right: Any, *, equal: bool) -> tuple[Any, Any, Any]:
    if not _varies(left):
        return right, left, left if equal else np.inf
    if not _varies(right):
        return left, right if equal else -np.inf, right
    return left - right, 0.0 if equal else -np.inf, 0.0


def _varies(expression: Any) -> bool:
    return expression.__class__ not in native_numeric_types and bool(expression.is_potentially_variable())


def _beyond(body: Any, lower: Any, upper: Any, dual: Array) -> Array:
    """A row's body minus the bound that its multiplier belongs to; zero where it has none."""
    at_upper = np.isfinite(upper) & ((dual <= 0.0) | ~np.isfinite(lower))
    bound = np.where(at_upper, upper, np.where(np.isfinite(lower), lower, 0.0))
    return np.where(dual == 0.0, 0.0, body - bound)
