"""The explicit equations of a phase and the pose of a body as functions of arrays, solved for what gives a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.motion.expression_values import ExpressionValues
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.families import equations_by_component

Residual = Callable[[dict[str, Array]], Array]

SAMPLES = 300
# Step of difference quotients, relative to the size of a quantity.
DIFFERENCE = 1e-6
NEWTON_STEPS = 12


class BodyEquations:
    """The explicit equations of a phase and the pose of a body, as functions of arrays.

    Parameters
    ----------
    block : ObstacleAvoidanceBlockData
    phase : PhaseBlockData
    body : str

    Attributes
    ----------
    time : float
        At which the expressions below were asked for.
    rates : dict of str to expression
        By the name of the state.
    pose : Pose
    pose_states : list of str
        What the pose reads of the phase.
    place : list of str or None
        The variables that are x and y of the pose; None where an expression is.
    """

    def __init__(self, block: Any, phase: Any, body: str) -> None:
        record = phase.record
        self.time = time = next(iter(phase.points))
        self.rates: dict[str, Any] = {
            phase.state_name(state): plain_entry(rate)
            for statement in record.statements_of("ode")
            for state, rate in equations_by_component(record, statement(phase, time), statement.name).items()
        }
        self.pose: Pose = block.motion.pose_at_node(block.record.scene.bodies[body].pose, time, name=body)
        names = [*record.names_of_states, *record.names_of_signals]
        self._variables = {name: phase.component(name)[time] for name in names}
        self._name = {id(variable): name for name, variable in self._variables.items()}
        self.pose_states = self._read(self.pose.entries)
        self.place = [
            self._name.get(id(entry)) if getattr(entry, "is_variable_type", bool)() else None
            for entry in self.pose.translation
        ]

    def _read(self, expressions: Sequence[Any]) -> list[str]:
        """Names of what expressions read of the phase, in the order of declaration."""
        found = {
            id(variable)
            for expression in expressions
            if hasattr(expression, "is_expression_type")
            for variable in variables_in(expression, include_fixed=True)
        }
        return [name for name, variable in self._variables.items() if id(variable) in found]

    def inputs(self, states: Sequence[str]) -> list[str]:
        """What the rates of some states read."""
        return self._read([self.rates[name] for name in states])

    def evaluated(self, expressions: Sequence[Any], values: dict[str, Array], count: int) -> Array:
        """Values of expressions, ``(count, len(expressions))``."""
        known = ExpressionValues({id(self._variables[name]): column for name, column in values.items()})
        return np.array([np.broadcast_to(known.of(each), count) for each in expressions], dtype=float).T

    def pose_values(self, values: dict[str, Array], count: int) -> Array:
        """x, y and angle, ``(count, 3)``."""
        return self.evaluated([*self.pose.translation, self.pose.angles[0]], values, count)

    def sampled(self, generator: np.random.Generator) -> dict[str, Array]:
        """Random values of all that matters, often at their bounds."""
        values = {}
        for name in dict.fromkeys([*self.pose_states, *self.inputs(self.pose_states)]):
            low, high = self._variables[name].bounds
            low, high = (-1.0 if high is None else high - 2.0) if low is None else low, high
            high = low + 2.0 if high is None else high
            column = generator.uniform(low, high, SAMPLES)
            if name not in self.pose_states:
                at_bound = generator.random(SAMPLES) < 0.5
                column[at_bound] = generator.choice([low, high], SAMPLES)[at_bound]
            values[name] = column
        return values

    def pose_jacobian(self, values: dict[str, Array], count: int) -> Array:
        """Derivatives of x, y and angle by the states that they read, ``(count, 3, states)``."""
        columns = []
        for name in self.pose_states:
            step = DIFFERENCE * np.maximum(1.0, np.abs(values[name]))
            ahead, behind = values | {name: values[name] + step}, values | {name: values[name] - step}
            columns.append((self.pose_values(ahead, count) - self.pose_values(behind, count)) / (2.0 * step)[:, None])
        return np.stack(columns, axis=2)

    def velocities(self, values: dict[str, Array]) -> Array:
        """Velocities of the body in its own frame, ``(samples, 3)``: along its two axes, and its turn."""
        rates = self.evaluated([self.rates[name] for name in self.pose_states], values, SAMPLES)
        world = np.einsum("kij,kj->ki", self.pose_jacobian(values, SAMPLES), rates)
        angle = self.pose_values(values, SAMPLES)[:, 2]
        cosine, sine = np.cos(angle), np.sin(angle)
        return np.column_stack([
            cosine * world[:, 0] + sine * world[:, 1], cosine * world[:, 1] - sine * world[:, 0], world[:, 2],
        ])  # fmt: skip

    def states_and_controls(self, target: Array, rates: Array, times: Array) -> dict[str, Array] | None:
        """Values over time with which the body has the poses and velocities given; None where there are none.

        States of the pose follow from the poses, then what their rates read, then what the rates of these read.
        """
        count = len(times)
        known = {name: np.full(count, float(self._variables[name].value or 0.0)) for name in self.pose_states}
        known = self._solved(self.pose_states, known, lambda values: self.pose_values(values, count) - target, count)
        error = self.pose_values(known, count) - target
        if not np.abs(error).max() <= 1e-6 * max(1.0, float(np.abs(target).max())):
            return None
        wanted: Array = np.asarray(
            np.linalg.solve(self.pose_jacobian(known, count), rates[:, :, None])[:, :, 0], dtype=np.float64
        )
        layer = self.pose_states
        while True:
            unknown = [name for name in self.inputs(layer) if name not in known]
            if not unknown:
                return known
            known |= {name: np.full(count, self._middle(name)) for name in unknown}
            known = self._solved(unknown, known, self._rates_less(layer, wanted), count)
            layer = [name for name in unknown if name in self.rates]
            wanted = np.column_stack([np.gradient(known[name], times) for name in layer]) if layer else np.zeros(0)

    def _rates_less(self, states: Sequence[str], wanted: Array) -> Callable[[dict[str, Array]], Array]:
        expressions = [self.rates[name] for name in states]
        return lambda values: self.evaluated(expressions, values, len(wanted)) - wanted

    def _middle(self, name: str) -> float:
        """A value to start from: off zero, where a car at rest would not feel its steering."""
        low, high = self._variables[name].bounds
        return within_bounds(0.0, self._variables[name]) if low is None or high is None else 0.6 * high + 0.4 * low

    def _solved(
        self, unknown: Sequence[str], values: dict[str, Array], residual: Residual, count: int
    ) -> dict[str, Array]:
        """Damped least squares for some columns, at all times at once, within the bounds of the variables."""
        for _ in range(NEWTON_STEPS):
            error = residual(values)
            columns = []
            for name in unknown:
                step = DIFFERENCE * np.maximum(1.0, np.abs(values[name]))
                columns.append((residual(values | {name: values[name] + step}) - error) / step[:, None])
            slopes = np.stack(columns, axis=2)
            gradient = np.einsum("kij,ki->kj", slopes, error)
            square = np.einsum("kij,kil->kjl", slopes, slopes)
            damping = 1e-9 * (1.0 + np.einsum("kii->k", square))
            move = np.linalg.solve(square + damping[:, None, None] * np.eye(len(unknown)), gradient[:, :, None])
            values = dict(values)
            for k, name in enumerate(unknown):
                low, high = self._variables[name].bounds
                low, high = -np.inf if low is None else low, np.inf if high is None else high
                values[name] = np.clip(values[name] - move[:, k, 0], low, high)
        return values
