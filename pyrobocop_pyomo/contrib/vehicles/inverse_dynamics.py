"""What drives states of a phase along given courses: its explicit equations, over arrays, are solved for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.contrib.robots.configuration_space import columns_of, names_read
from pyrobocop_pyomo.contrib.robots.least_squares import damped_least_squares
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.phases.families import equations_by_component

Columns = dict[str, Array]

SAMPLES = 300


class InverseDynamics:
    """The explicit equations of a phase, solved for what its states are driven by.

    Parameters
    ----------
    phase : PhaseBlockData

    Attributes
    ----------
    time : float
        At which the expressions below were asked for.
    rates : dict of str to expression
        By the name of the state.
    variables : dict of str to Var
        States, algebraics and controls at that time.
    """

    def __init__(self, phase: Any) -> None:
        record = phase.record
        self.time = time = next(iter(phase.points))
        self.rates: dict[str, Any] = {
            phase.state_name(state): plain_entry(rate)
            for statement in record.statements_of("ode")
            for state, rate in equations_by_component(record, statement(phase, time), statement.name).items()
        }
        names = [*record.names_of_states, *record.names_of_signals]
        self.variables = {name: phase.component(name)[time] for name in names}

    def read(self, expressions: Sequence[Any]) -> list[str]:
        """Names of what expressions read of the phase, in the order of declaration."""
        return names_read(expressions, self.variables)

    def inputs(self, states: Sequence[str]) -> list[str]:
        """What the rates of some states read."""
        return self.read([self.rates[name] for name in states])

    def evaluated(self, expressions: Sequence[Any], values: Columns, count: int) -> Array:
        """Values of expressions, ``(count, len(expressions))``."""
        leaves = {id(self.variables[name]): column for name, column in values.items()}
        return columns_of(ExpressionSteps(expressions), leaves, count)

    def sampled(self, states: Sequence[str], generator: np.random.Generator) -> Columns:
        """Random values of states and of all that their rates read, the latter often at their bounds."""
        values = {}
        for name in dict.fromkeys([*states, *self.inputs(states)]):
            low, high = self.variables[name].bounds
            low, high = (-1.0 if high is None else high - 2.0) if low is None else low, high
            high = low + 2.0 if high is None else high
            column = generator.uniform(low, high, SAMPLES)
            if name not in states:
                at_bound = generator.random(SAMPLES) < 0.5
                column[at_bound] = generator.choice([low, high], SAMPLES)[at_bound]
            values[name] = column
        return values

    def driven(self, states: Sequence[str], known: Columns, wanted: Array, times: Array) -> Columns:
        """Values over time of all that makes states follow given courses, as well as bounds allow.

        Parameters
        ----------
        states : sequence of str
        known : dict of str to (k,) array
            The courses of the states, and of whatever else is known.
        wanted : (k, len(states)) array
            Rates of the states.
        times : (k,) array

        Returns
        -------
        dict of str to (k,) array
            What is known, then what the rates of the states read, then what the rates of these read.
        """
        layer = list(states)
        while True:
            unknown = [name for name in self.inputs(layer) if name not in known]
            if not unknown:
                return known
            known = known | {name: np.full(len(times), self._middle(name)) for name in unknown}
            expressions = [self.rates[name] for name in layer]
            known = self.solved(unknown, known, expressions, wanted)
            layer = [name for name in unknown if name in self.rates]
            wanted = np.column_stack([np.gradient(known[name], times) for name in layer]) if layer else np.zeros(0)

    def solved(self, unknown: Sequence[str], values: Columns, expressions: Sequence[Any], wanted: Array) -> Columns:
        """Values with some columns changed so that expressions have the wanted values, ``(k, len(expressions))``."""
        bounds = [self.variables[name].bounds for name in unknown]
        low = np.array([-np.inf if bound[0] is None else bound[0] for bound in bounds])
        high = np.array([np.inf if bound[1] is None else bound[1] for bound in bounds])

        def residual(points: Array) -> Array:
            columns = dict(zip(unknown, points.T, strict=True))
            return self.evaluated(expressions, values | columns, len(wanted)) - wanted

        start = np.column_stack([values[name] for name in unknown])
        found = damped_least_squares(residual, start, low, high)
        return values | dict(zip(unknown, found.T, strict=True))

    def _middle(self, name: str) -> float:
        """A value to start from: off zero, where a car at rest would not feel its steering."""
        low, high = self.variables[name].bounds
        return within_bounds(0.0, self.variables[name]) if low is None or high is None else 0.6 * high + 0.4 * low
