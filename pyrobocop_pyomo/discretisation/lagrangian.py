"""The Lagrangian of a phase over time, evaluated where the mesh does not look: what the optimum misses, per element.

With costates ``lambda`` and densities ``nu`` of what else restrains the motion, polynomials through the values at the
stages, the function ::

    H = sum_j w_j l_j + lambda . (f - x') - nu . g

is integrated over each element by a rule that is far more exact than that of the mesh, and by that of the mesh. The
difference is the first part of the error. Where the mesh is free to place its controls, H is stationary in them at the
stages only: how much smaller it could be between the stages is the second part. The third are kinks: where the motion
leaves a limit inside an element, that of the mesh stays there until the boundary, and costates and slopes jump.

How much smaller the integrand of the Lagrangian could be at an instant, if the controls were free there.

A mesh places its controls at the stages, and what restrains them as well: between the stages the polynomials of the
controls neither make the integrand stationary nor meet the rows. Given the states and costates of an instant, a
quadratic model of the integrand is minimised over the controls, inside their bounds and the linearised inequalities
that they can meet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.polynomials import evaluation_matrix, gauss_rule
from pyrobocop_pyomo.phases import Control
from pyrobocop_pyomo.phases.bounds_between_points import SAMPLES, instants_to_look_at, sides_stated
from pyrobocop_pyomo.phases.element_instants import ElementInstants
from pyrobocop_pyomo.phases.reintegration import SMALLEST_SCALE
from pyrobocop_pyomo.phases.rule_formulas import RuleFormulas
from pyrobocop_pyomo.trajectories import Trajectory

from .phase_multipliers import PhaseMultipliers

# ------------------------------------------------------------------------------------------ best controls at an instant


# Of differences, relative to what changes; and below which part of the integrand a curvature counts as none.
_STEP, _FLAT = 1e-4, 1e-6
_SWEEPS = 12
# Newton's steps from one start, each followed by a look whether it made the integrand smaller.
_STEPS = 3

Values = Mapping[str, Array]


# A quadratic model of the integrand about some values of the controls: its value, slopes and curvatures.
_Model = tuple[Array, list[Array], list[list[Any]]]


def least_integrand(instants: Any, starts: Values) -> Array:
    """The least integrand inside the bounds that is found from some values of the controls.

    Parameters
    ----------
    instants : ElementInstants
        With the integrand and the limits of controls, and without rows that these can meet.
    starts : dict of name to array, shape (k, q, N)
        Controls of the answer, and where else to look from: what is no quadratic function has more than one valley.
    """
    # Between the stages a polynomial may leave its bounds; what it gains there is no gain.
    values = {name: np.clip(of, *instants.limits(name)) for name, of in starts.items()}
    level = instants.integrand(values)
    for _ in range(_STEPS):
        before, change = values, _least_change(instants, values, _model(instants, values, apart=False), [])
        for part in (1.0, 0.25):
            tried = {name: before[name] + part * of for name, of in zip(before, change, strict=True)}
            found = instants.integrand(tried)
            better = np.isfinite(found) & (found < level)
            level = np.where(better, found, level)
            values = {name: np.where(better, tried[name], of) for name, of in values.items()}
    best = np.where(np.isfinite(level), level, np.inf).min(axis=0)
    return np.where(np.isfinite(best), best, instants.integrand({name: of[0] for name, of in starts.items()}))


def least_integrand_within_rows(instants: Any, here: Values) -> Array:
    """The least value of the quadratic model of the integrand, within the linearised inequalities.

    Parameters
    ----------
    instants : ElementInstants
        With the integrand, and the limits and rows of controls.
    here : dict of name to array, shape (q, N)
        Controls of the answer.
    """
    full, _, curvature = _model(instants, here, apart=False)
    level, slope, _ = _model(instants, here, apart=True)
    gradients = []
    for name, size in zip(here, _sizes(here), strict=True):
        step = _STEP * size
        up, down = (instants.own_rows({**here, name: here[name] + change}) for change in (step, -step))
        gradients.append([(a[0] - b[0]) / (2.0 * step) for a, b in zip(up, down, strict=True)])
    rows = [(*row, [of[i] for of in gradients]) for i, row in enumerate(instants.own_rows(here))]
    change = _least_change(instants, here, (level, slope, curvature), rows)
    value = level + sum(each * of for each, of in zip(slope, change, strict=True))
    value = value + 0.5 * sum(curvature[j][k] * a * b for j, a in enumerate(change) for k, b in enumerate(change))
    return np.where(np.isfinite(value), value, full)


def _least_change(
    instants: Any, values: Values, model: _Model, rows: list[tuple[Array, Array, Array, list[Array]]]
) -> list[Array]:
    """The change of each control that minimises a model inside bounds and rows, by sweeps over the controls.

    A row is left to the other controls where this one would have to change by more than its size to meet it.
    """
    (level, slope, curvature), sizes = model, _sizes(values)
    change = [np.zeros(level.shape) for _ in values]
    limits = [[side - values[name] for side in instants.limits(name)] for name in values]
    flat = _FLAT * (_largest(level) + 1e-300)

    def of_others(slopes: list[Any], j: int) -> Any:
        return sum(slope * change[k] for k, slope in enumerate(slopes) if k != j)

    for _ in range(_SWEEPS if len(change) > 1 else 1):
        for j, (lower, upper) in enumerate(limits):
            for body, least, largest, slopes in rows:
                sides = [(side - body - of_others(slopes, j)) / slopes[j] for side in (least, largest)]
                low, high = np.fmin(*sides), np.fmax(*sides)
                low, high = np.where(low <= sizes[j], low, -np.inf), np.where(high >= -sizes[j], high, np.inf)
                lower, upper = np.maximum(lower, np.minimum(low, upper)), np.minimum(upper, np.maximum(high, lower))
            downhill = slope[j] + of_others(curvature[j], j)
            curved = curvature[j][j] > flat / sizes[j] ** 2
            newton = -downhill / np.where(curved, curvature[j][j], 1.0)
            to_bound = np.where(downhill > 0.0, lower, upper)
            linear = np.where(np.isfinite(to_bound), to_bound, 0.0)
            change[j] = np.clip(np.where(curved, newton, linear), lower, upper)
    return change


def _sizes(values: Values) -> list[Array]:
    return [SMALLEST_SCALE + _largest(of) for of in values.values()]


def _largest(of: Array) -> Array:
    """In size at all instants, of each start."""
    return np.abs(of).max(axis=(-2, -1), keepdims=True)


def _model(instants: Any, values: Values, *, apart: bool) -> _Model:
    """Value, slopes and curvatures by the given values, from differences."""
    names, steps = list(values), [_STEP * size for size in _sizes(values)]
    here = instants.integrand(values, apart=apart)

    def at(*changed: int) -> Array:
        moved = {names[j]: values[names[j]] + steps[j] for j in changed}
        return instants.integrand({**values, **moved}, apart=apart)

    count = len(names)
    slope, forward = [], []
    curvature: list[list[Any]] = [[None] * count for _ in names]
    for j, (name, step) in enumerate(zip(names, steps, strict=True)):
        up, down = at(j), instants.integrand({**values, name: values[name] - step}, apart=apart)
        slope.append((up - down) / (2.0 * step))
        curvature[j][j] = (up + down - 2.0 * here) / step**2
        forward.append(up)
    for j in range(count):
        for k in range(j):
            mixed = (at(j, k) - forward[j] - forward[k] + here) / (steps[j] * steps[k])
            curvature[j][k] = curvature[k][j] = mixed
    return here, slope, curvature


# ----------------------------------------------------------------------------------------------------------- lagrangian


# At least so much of the two parts of an element is taken not to cancel.
_NOT_CANCELLED = 0.02


class PhaseLagrangian:
    """See the module.

    Parameters
    ----------
    formulas : RuleFormulas
        Without those of other phases.
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
        formulas: RuleFormulas,
        trajectory: Trajectory,
        multipliers: PhaseMultipliers,
        weights: Sequence[float],
        sign: float,
    ) -> None:
        self._formulas, self._trajectory, self._multipliers, self._sign = formulas, trajectory, multipliers, sign
        record: Any = formulas.record
        names = [name for name in record.names_of_states if name in multipliers.costates]
        rates = self._formulas.rates_of(names) if names else []
        self._rates = dict(zip(names, rates, strict=True))
        self._integrands = [
            (weight, self._formulas.formulas_of(statement))
            for weight, statement in zip(weights, record.integrals, strict=True)
            if weight != 0.0
        ]
        self._rows = [
            (sides_stated(self._formulas, statement)[label], density) for statement, label, density in multipliers.rows
        ]
        if delayed := sorted({name for name, _ in formulas.delays} - set(trajectory.states)):
            raise TrajectoryError(f"'{delayed[0]}' is read at earlier times: what it does there later is not seen.")
        stated = [*record.statements_of("ode"), *record.integrals, *(statement for statement, _, _ in multipliers.rows)]
        self._fractions = instants_to_look_at(self._formulas, trajectory, stated)
        self._states = {name: trajectory.element_states(name) for name in trajectory.states}
        self._signals = {name: trajectory.element_signals(name) for name in trajectory.signals}
        # Values between knots that the user has placed are the same few numbers on any mesh.
        self.free = [name for name in record.names(Control) if record.declarations[name].knots is None]
        self.apart = self._rows_with(self.free)
        self.of_states = frozenset(range(len(self._rows))) - self._rows_with(self._signals)

    def _rows_with(self, names: Iterable[str]) -> frozenset[int]:
        """Places of the inequalities in which controls or algebraics of these names stand, which can meet them."""
        own = {id(self._formulas.at_instant[name]) for name in names}
        inequalities = {i: sides for i, (sides, _) in enumerate(self._rows) if sides[1] is not sides[2]}
        return frozenset(i for i, sides in inequalities.items() if not own.isdisjoint(variables_in_any(sides)))

    def errors(self, size: float) -> tuple[Array, Array, Array]:
        """What each element adds to the error of the objective, shapes ``(N,)``: with its sign, and as a bound.

        Third comes what is passed between the points, times its multipliers: the objective is too good by so much.

        Parameters
        ----------
        size : float
            Of the objective.

        Raises
        ------
        TrajectoryError
            When something has no finite value.
        """
        scheme, widths = self._trajectory.grid.scheme, self._trajectory.grid.mesh.widths
        with np.errstate(all="ignore"):
            stages = _Instants(self, scheme.c)
            if scheme.starts_on_a_stage:
                self._trajectory = replace(self._trajectory, rates=stages.rates_at_points())
                stages = _Instants(self, scheme.c)
            # A far more exact rule than that of the mesh.
            points, weights = np.polynomial.legendre.leggauss(2 * scheme.stages + 2)
            between, weights = _Instants(self, (points + 1.0) / 2.0), weights / 2.0
            here = between.integrand({})
            exact = weights @ here
            if len(self._fractions) > SAMPLES + 1:  # a rule on each part on which it hardly changes with the time
                points, shares = gauss_rule(self._fractions)
                exact = shares @ _Instants(self, points).integrand({})
            first = exact - scheme.b @ stages.integrand({})
            second = weights @ (here - between.least()) if self.free else np.zeros(len(widths))
            passed = between.passed()
            second = second + self._kinks() / widths
            # Both parts may cancel, and do for schemes of Gauss; how well is known to leading order only.
            net = first - second
            parts = np.abs(first) + np.abs(second)
            # The next order is smaller than this one by what the parts are of the element's share of the objective.
            next_order = np.clip(parts * widths.sum() / size, _NOT_CANCELLED, 1.0)
            bound = np.maximum(np.abs(net), next_order * parts)
        if not np.isfinite(bound + passed).all():
            raise TrajectoryError("The estimate has no finite value at some point between those of the mesh.")
        return widths * net, np.maximum(widths * bound, passed), passed

    def _kinks(self) -> Array:
        """What a bend over the shorter element beside each boundary saves where the motion has a kink, shape ``(N,)``.

        A slope that changes by `a` in one moment costs ``H_uu a^2 h / 12`` more than one that changes over `h`, and
        ``H_uu a`` is by how much the costate jumps. Where there is no kink both jumps, and their product, are small.
        """
        widths = np.array(self._trajectory.grid.mesh.widths)
        ends = _Instants(self, np.array([0.0, 1.0]))
        products = [
            (of[0, 1:] - of[1, :-1]) * (ends.slopes[name][0, 1:] - ends.slopes[name][1, :-1])
            for name, of in ends._costates.items()
        ]
        saved = np.abs(sum(products, np.zeros(len(widths) - 1))) * np.minimum(widths[1:], widths[:-1]) / 12.0
        return np.append(saved, 0.0)


class _Instants(ElementInstants):
    """Costates and densities beside the trajectory.

    Parameters
    ----------
    phase : PhaseLagrangian
    fractions : array, shape (q,)
    """

    def __init__(self, phase: PhaseLagrangian, fractions: Array) -> None:
        super().__init__(phase._formulas, phase._trajectory, fractions)
        self._of, multipliers = phase, phase._multipliers
        scheme, at_stages = phase._trajectory.grid.scheme, self.at_stages
        with_start = evaluation_matrix([0.0, *scheme.c], fractions) if multipliers.starts else at_stages
        self._costates = {
            name: with_start @ np.vstack([multipliers.starts[name], of.T])
            if name in multipliers.starts
            else at_stages @ of.T
            for name, of in multipliers.costates.items()
        }
        self._densities = [(excess, at_stages @ density.T) for excess, density in phase._rows]
        self._bounds = [
            (name, self.bounds(name)[side], at_stages @ density.T) for name, side, density in multipliers.bounds
        ]

    def limits(self, name: str) -> tuple[Array, Array]:
        """Least and largest value of a control at the instants."""
        lower, upper = (
            np.where(np.isfinite(of).all(axis=1), self.at_stages @ np.where(np.isfinite(of), of, 0.0).T, infinite)
            for of, infinite in zip(self._of._multipliers.room[name], (-np.inf, np.inf), strict=True)
        )
        return lower, upper

    def own_rows(self, given: Mapping[str, Array]) -> list[tuple[Array, Array, Array]]:
        """Body and bounds of the inequalities that controls can meet."""
        return self.rows(self._of.apart, given)

    def rows(self, places: Iterable[int], given: Mapping[str, Array]) -> list[tuple[Array, Array, Array]]:
        """Body and bounds of some rows."""
        sides = [side for i in places for side in self._of._rows[i][0]]
        found = self.evaluated(sides, {**self.values, **given})
        return list(zip(found[::3], found[1::3], found[2::3], strict=True))

    def limited(self) -> list[tuple[Array, Array, Array, Array]]:
        """Inequalities of states alone, declared bounds too: body, both bounds, and densities at the stages."""
        of, shape = self._of, np.zeros(self.index.shape)
        found = [
            (body, lower, upper, of._rows[i][1])
            for i, (body, lower, upper) in zip(of.of_states, self.rows(of.of_states, {}), strict=True)
            if not np.array_equal(lower, upper)
        ]
        none = np.zeros((self.index.shape[1], of._trajectory.grid.scheme.stages))
        for name in of._states:
            density = sum((of for known, _, of in self._of._multipliers.bounds if known == name), none)
            found.append((shape + self.values[name], *(shape + side for side in self.bounds(name)), density))
        return found

    def rates_at_points(self) -> dict[str, Array]:
        """What the equations say of the derivatives, where the instants are the stages."""
        rates, grid = self._of._rates, self._of._trajectory.grid
        first = np.unique(grid.stage_positions, return_index=True)[1]
        found = self.evaluated(list(rates.values()), self.values)
        return {name: of.T.ravel()[first] for name, of in zip(rates, found, strict=True)}

    def integrand(self, given: Mapping[str, Array], *, apart: bool = False) -> Array:
        """The function of the module with some values replaced, in the sign of a minimum.

        Parameters
        ----------
        given : dict of name to array
            Of controls.
        apart : bool
            Leave out the inequalities that controls can meet.
        """
        of = self._of
        values = {**self.values, **given}
        sides = [side for stated, _ in self._densities for side in stated]
        rates = [of._rates[name] for name in self._costates]
        stated = [*(integrand for _, integrand in of._integrands), *rates, *sides]
        known = iter(self.evaluated(stated, values))
        total: Array = np.zeros(self.index.shape)
        # Several values at once stand along a first axis, which the sums have then too.
        for weight, _ in of._integrands:
            total = total + weight * next(known)
        for name, costate in self._costates.items():
            total = total + costate * (next(known) - self.slopes[name])
        for i, (_, density) in enumerate(self._densities):
            body, lower, upper = next(known), next(known), next(known)
            if not (apart and i in of.apart):
                total = total - density * _beyond(body, lower, upper, of._sign * density)
        for name, bound, density in self._bounds:
            total = total - density * np.where(density == 0.0, 0.0, values[name] - bound)
        return of._sign * total

    def passed(self) -> Array:
        """Excess over inequalities of states alone, times the multipliers beside it; shape ``(N,)``.

        A multiplier of the mesh stands at a point; where the motion passes the bound between two points, that of the
        continuous problem stands there. A polynomial through the densities has both signs, and what it gives cancels.
        """
        of = self._of
        scheme, widths = of._trajectory.grid.scheme, np.array(of._trajectory.grid.mesh.widths)
        count, stages = len(widths), scheme.stages
        # The gap before each stage of the phase, and the one after the last.
        gaps = np.searchsorted(scheme.c, self.fractions)[:, None] + stages * np.arange(count)
        total = np.zeros(count)
        for body, lower, upper, density in self.limited():
            for excess, sign in ((lower - body, of._sign), (body - upper, -of._sign)):
                weights = (widths[:, None] * scheme.b * np.maximum(sign * density, 0.0)).ravel()
                beyond = np.maximum(excess, 0.0)
                mean = np.zeros(count * stages + 1)
                np.add.at(mean, gaps, beyond / np.bincount(gaps.ravel(), minlength=mean.size)[gaps])
                after = mean[1:] > mean[:-1]
                places = np.minimum((np.arange(count * stages) + after) // stages, count - 1)
                np.add.at(total, places, weights * np.maximum(mean[1:], mean[:-1]))
        return total

    def least(self) -> Array:
        """The integrand where controls are as good as the instant lets them be."""
        of, shape = self._of, self.index.shape
        here = {name: np.zeros(shape) + self.values[name] for name in of.free}
        if of.apart:
            return least_integrand_within_rows(self, here)
        # Where some control is largest or smallest in the whole plan: it may have left another valley too late.
        every = {name: of._signals[name].ravel() for name in of.free}
        places = sorted({int(place) for values in every.values() for place in (values.argmin(), values.argmax())})
        others = {name: [*of._signals[name].T, *every[name][places]] for name in of.free}
        return least_integrand(
            self, {name: np.stack([here[name], *(np.zeros(shape) + each for each in others[name])]) for name in of.free}
        )


def _beyond(body: Any, lower: Any, upper: Any, dual: Array) -> Array:
    """A row's body minus the bound that its multiplier belongs to; zero where it has none."""
    at_upper = np.isfinite(upper) & ((dual <= 0.0) | ~np.isfinite(lower))
    bound = np.where(at_upper, upper, np.where(np.isfinite(lower), lower, 0.0))
    return np.where(dual == 0.0, 0.0, body - bound)
