"""`RateArrays`: the differential equations of a phase for all elements at once, under the controls of a trajectory.

Each rule is asked once, with variables in place of what it reads; the formulas that it gives are evaluated with arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES, ExpressionEvaluator, comparisons
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.trajectories import Trajectory

from .point_model import PointModel
from .record import PhaseRecord

_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, numpy_name) for name, numpy_name in NUMPY_NAMES.items()},
    **comparisons(np.logical_and),
    "choose": np.where,
    "call": lambda output, *arguments: np.vectorize(lambda *numbers: output.evaluate(numbers))(*arguments),
}
# Elements at which the formulas are compared with the rules, and the largest relative difference.
_SAMPLES, _AGREEMENT = 5, 1e-9


class _Formulas(PointModel):
    """What rules read are variables without values, and time is one too."""

    hold_numbers = False

    def __init__(self, block: Any, record: PhaseRecord, indices: Grid, grid: Grid) -> None:
        super().__init__(block, record, indices, grid)
        self._scratch.index_of_time = Var(initialize=0.0)
        self._scratch.clock = Var(initialize=0.0)
        self.index = self._scratch.index_of_time

    def is_index(self, key: Any) -> bool:
        return key is self.index

    def value_of(self, signal: Any) -> Any:
        found = self._of_component.get(id(signal.component))
        if found is None:
            raise TrajectoryError(f"'{signal.name}' is no variable of the phase.")
        return found

    def time_at(self, block: Any) -> Any:
        if block is not self._block:
            raise TrajectoryError(f"'{block.name}' has a time of its own.")
        return self._scratch.clock if self._record.normalised else self.index

    def rates_of(self, names: list[str]) -> list[Any]:
        """Formulas of the derivatives, in the order of the names."""
        self.forget_derivatives()
        rates = {
            self._proxy.state_name(state): plain_expressions(rate)
            for statement in self._record.statements_of("ode")
            for state, rate in statement.rule(self._proxy, self.index).items()  # type: ignore[misc]
        }
        return [rates[name] for name in names]

    def leaves(self, declared: dict[str, Any], index: Any, clock: Any) -> dict[int, Any]:
        """What stands in place of each variable, by its identity."""
        found = {id(self._values[name]): numbers for name, numbers in declared.items()}
        return found | {id(self._scratch.index_of_time): index, id(self._scratch.clock): clock}


class RateArrays:
    """Derivatives of all states by the local fraction, in all elements at once.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
        Every state has an explicit equation.
    trajectory : Trajectory
        Whose controls, algebraics and parameters are taken.
    indices : Grid
        Its grid in the time indices of the phase.
    point : PointModel
        Asks the rules one instant at a time, for comparison.

    Raises
    ------
    TrajectoryError
        When a rule gives no formula, or another one than it says at single instants.
    """

    def __init__(
        self, block: Any, record: PhaseRecord, trajectory: Trajectory, indices: Grid, point: PointModel
    ) -> None:
        self._names = record.names_of_states
        self._trajectory, self._indices = trajectory, indices
        self._widths = trajectory.grid.mesh.widths
        self._starts = np.array(trajectory.grid.mesh.boundaries[:-1])
        self._signals = {name: trajectory.element_signals(name) for name in trajectory.signals}
        self._known: dict[float, tuple[dict[str, Any], Array, Array]] = {}
        self._formulas = _Formulas(block, record, indices, trajectory.grid)
        try:
            self._rates = self._formulas.rates_of(self._names)
            self._compare(point, record)
        except PyRobocopError:
            raise
        except Exception as error:  # a rule that was written for single instants may raise anything
            raise TrajectoryError(
                f"phase '{block.name}': its equations are no formulas ({type(error).__name__}: {error})."
            ) from error

    def __call__(self, fraction: float, states: Array) -> Array:
        """Derivatives at a local fraction, of states of shape ``(n, k, N)``."""
        declared, index, clock = self._declared_at(fraction)
        declared = declared | dict(zip(self._names, states, strict=True))
        known = ExpressionEvaluator(self._formulas.leaves(declared, index, clock), _FUNCTIONS)
        rates = np.empty_like(states)
        for j, rate in enumerate(self._rates):
            rates[j] = known.of(rate) * self._widths
        return rates

    def _declared_at(self, fraction: float) -> tuple[dict[str, Any], Array, Array]:
        """Signals and parameters, time indices and times at a local fraction of every element."""
        if fraction not in self._known:
            weights = self._trajectory.grid.scheme.stage_polynomial_at([fraction])[0]
            times = self._starts + fraction * self._widths
            found: dict[str, Any] = {name: of @ weights for name, of in self._signals.items()}
            found |= {name: np.interp(times, *knots) for name, knots in self._trajectory.piecewise_linear.items()}
            found |= self._trajectory.parameters
            boundaries = np.array(self._indices.mesh.boundaries)
            self._known[fraction] = (found, boundaries[:-1] + fraction * np.diff(boundaries), times)
        return self._known[fraction]

    def _compare(self, point: PointModel, record: PhaseRecord) -> None:
        """Ask the rules for single instants, and compare."""
        fraction = 0.3717  # no scheme has a point there
        states = np.array([self._trajectory.element_states(name)[:, 0] for name in self._names])
        with np.errstate(all="ignore"):
            rates = self(fraction, states[:, None, :])[:, 0, :] / self._widths
        declared, indices, _ = self._declared_at(fraction)
        for i in np.unique(np.linspace(0, len(self._widths) - 1, _SAMPLES).astype(int)).tolist():
            point.element = i
            here = {name: float(np.broadcast_to(of, len(self._widths))[i]) for name, of in declared.items()}
            point.set_values({**here, **dict(zip(self._names, states[:, i].tolist(), strict=True))})
            point.forget_derivatives()
            stated = point.rates(record.statements_of("ode"), float(indices[i]))
            expected = np.array([stated[name] for name in self._names])
            if not (np.abs(rates[:, i] - expected) <= _AGREEMENT * (1.0 + np.abs(expected))).all():
                raise TrajectoryError("the equations say something else at single instants than for all of them.")
        point.element = None
