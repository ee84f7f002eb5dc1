"""`RateArrays`: the differential equations of a phase for all elements at once, under the controls of a trajectory.

The templates of the rules are evaluated with arrays.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.expression_nodes import ExpressionEvaluator
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.modeling.straight_line import StraightLine
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.trajectories import Trajectory

from .delays import SAME_TIME, delay_as_number, history_value
from .families import equations_by_component
from .instant_rules import ARRAY_FUNCTIONS, formulas_by_instant
from .point_model import GridVariables, PointModel
from .record import PhaseRecord, Statement

LOGGER = logging.getLogger(__name__)

# Parts of the horizon at which rules that have to know the time are evaluated for what they read.
_SAMPLED = (0.03, 0.24, 0.51, 0.77, 0.96)


class RuleFormulas(PointModel):
    """Asks rules for formulas that hold at all times: what rules read are variables without values, and time is one.

    Rules that have to know the time as a number are evaluated at each instant, where that is allowed.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    indices, grid : Grid
        The same grid in the phase's time indices and in real time.
    by_instant : bool
        Whether rules may be asked at single instants.

    Attributes
    ----------
    asks_by_instant : bool
        Whether one was.
    """

    hold_numbers = False

    def __init__(self, block: Any, record: PhaseRecord, indices: Grid, grid: Grid, *, by_instant: bool = False) -> None:
        super().__init__(block, record, indices, grid)
        self._scratch.index_of_time = Var()
        self._scratch.clock = Var()
        self.index = self._scratch.index_of_time
        self._by_instant = by_instant
        self.asks_by_instant = False
        self._samples = np.quantile(self._indices, _SAMPLED).tolist()

    def is_index(self, key: Any) -> bool:
        """Whether a key is the time of the formulas."""
        return key is self.index

    def value_of(self, signal: Any) -> Any:
        """The variable that stands for a signal."""
        found = self._of_component.get(id(signal.component))
        if found is None:
            raise TrajectoryError(f"'{signal.name}' is no variable of the phase.")
        return found

    def delayed_value(self, component: Any, t: Any, delay: Any) -> Any:
        """Refused: what was earlier is no function of what is now."""
        raise TrajectoryError(f"'{component.name}' is read at earlier times, which other elements have.")

    def time_at(self, block: Any) -> Any:
        """The variable that stands for real time."""
        if block is not self._block:
            raise TrajectoryError(f"'{block.name}' has a time of its own.")
        if self.index is not self._scratch.index_of_time:
            return self.clock_at(self.index)
        return self._scratch.clock if self._record.normalised else self.index

    def rates_of(self, names: list[str], *, derivatives: bool = False) -> list[Any]:
        """Formulas of the derivatives, in the order of the names; those that rules read only where they are known."""
        if not derivatives:
            self.forget_derivatives()
        rates: dict[str, Any] = {}
        for statement in self._record.statements_of("ode"):
            rates |= self.asked(statement, partial(self._rates, statement))
        return [rates[name] for name in names]

    def _rates(self, statement: Statement, result: Any) -> dict[str, Any]:
        """What an ode returned, by the names of the states."""
        equations = equations_by_component(self._record, result, f"ode '{statement.name}'")
        return {self._proxy.state_name(state): plain_expressions(rate) for state, rate in equations.items()}

    def asked(self, statement: Statement, entries: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """What a rule gives at any time, entry by entry.

        Parameters
        ----------
        statement : Statement
        entries : callable
            From what the rule returned to expressions by name; the same names at all times.
        """
        if statement.is_template(self._block):
            return entries(statement(self._proxy, self.index))
        if not self._by_instant or statement.rule is None:
            raise TrajectoryError(f"'{statement.name}' has to know the time as a number.")
        self.asks_by_instant = True
        names: list[str] = []

        def at(time: float) -> list[Any]:
            self.index = time
            try:
                found = entries(statement(self._proxy, self._record.index_for_rule(self._proxy, time, statement.name)))
            finally:
                self.index = self._scratch.index_of_time
            names[:] = names or list(found)
            return [found[name] for name in names]

        variables = [*self._values.values(), *self._derivatives.values()]
        formulas = formulas_by_instant(at, self._samples, self.index, variables)
        return dict(zip(names, formulas, strict=True))

    def variables(self, names: Sequence[str]) -> list[Any]:
        """What stands for these names, for the time index and for the time."""
        return [*(self._values[name] for name in names), self._scratch.index_of_time, self._scratch.clock]

    def clock_at(self, index: float) -> float:
        """Real time of a time index."""
        return float(np.interp(index, self._indices, self._boundaries)) if self._record.normalised else index

    def formula_of(self, statement: Statement) -> Any:
        """What a rule gives at any time, as `formulas_of`."""
        return self.formulas_of(statement, lambda result: {"": plain_expressions(result)})[""]

    def formulas_of(self, statement: Statement, entries: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """What a rule gives at any time, entry by entry as `asked`.

        Raises
        ------
        TrajectoryError
            When it gives no formula.
        """
        try:
            return self.asked(statement, entries)
        except Exception as error:  # a rule that was written for single instants may raise anything
            raise TrajectoryError(
                f"phase '{self._block.name}': {statement.kind} '{statement.name}' is no formula that holds at all "
                f"times ({type(error).__name__}: {error})."
            ) from error

    def leaves(
        self, declared: Mapping[str, Any], index: Any, clock: Any, slopes: Mapping[str, Any] | None = None
    ) -> dict[int, Any]:
        """What stands in place of each variable, by its identity; slopes in place of derivatives that rules read."""
        found = {id(self._values[name]): numbers for name, numbers in declared.items()}
        found |= {id(self._derivatives[name]): numbers for name, numbers in (slopes or {}).items()}
        return found | {id(self._scratch.index_of_time): index, id(self._scratch.clock): clock}


class PointRates:
    """The differential equations of a phase at one instant after the other, as one function without expressions.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
        Every state has an explicit equation.
    indices, grid : Grid
        The same grid in time indices and in real time.
    parameters : mapping of name to number

    Raises
    ------
    TrajectoryError
        When the rules give no formula for all times, or one that reads the phase at given points.
    """

    def __init__(
        self, block: Any, record: PhaseRecord, indices: Grid, grid: Grid, parameters: Mapping[str, float]
    ) -> None:
        self._parameters = dict(parameters)
        self._formulas = formulas = RuleFormulas(block, record, indices, grid)
        self._names = record.names_of_states
        self._inputs = [*record.declarations]
        try:
            rates = formulas.rates_of(self._names)
            self._evaluate = StraightLine(rates, formulas.variables(self._inputs))
        except PyRobocopError:
            raise
        except Exception as error:  # a rule that was written for single instants may raise anything
            raise TrajectoryError(f"phase '{block.name}': its equations are no formulas ({error}).") from error
        own = GridVariables(block, record).keys
        if any(id(other) in own for other in self._evaluate.others):
            raise TrajectoryError(f"phase '{block.name}': its equations read the phase at given points.")

    def refresh(self) -> None:
        """Read again what is no signal of the phase."""
        self._evaluate.refresh()

    def __call__(self, index: float, values: Mapping[str, float]) -> dict[str, float]:
        """Derivatives at a time index, given the states, the signals and the parameters."""
        values = {**self._parameters, **values}
        given = [values[name] for name in self._inputs]
        rates = self._evaluate(*given, index, self._formulas.clock_at(index))
        if any(isinstance(rate, complex) for rate in rates):
            raise ValueError("a rate is no real number")
        return dict(zip(self._names, map(float, rates), strict=True))


def compiled_rates(block: Any, record: PhaseRecord, grid: Grid, parameters: Mapping[str, float]) -> PointRates | None:
    """`PointRates` of the phase on its own grid with given parameters; None where the rules give no formulas."""
    try:
        return PointRates(block, record, record.grid, grid, parameters)
    except PyRobocopError as error:
        LOGGER.debug("%s", error)
        return None


class FormulasWithDelays(RuleFormulas):
    """What rules read at earlier times are variables as well, whose numbers a trajectory gives."""

    def __init__(self, block: Any, record: PhaseRecord, indices: Grid, grid: Grid, *, by_instant: bool = False) -> None:
        super().__init__(block, record, indices, grid, by_instant=by_instant)
        self._scratch.delayed = Var(AnyIndex, dense=False)

    def delayed_value(self, component: Any, t: Any, delay: Any) -> Any:
        """The variable that stands for a value a while ago."""
        what = f"'{component.name}'"
        if self.index is not self._scratch.index_of_time:
            raise TrajectoryError(f"{what} is read at earlier times by a rule that has to know the time as a number.")
        if component.parent_block() is not self._block or not self.is_index(t):
            raise TrajectoryError(f"{what} is read a while before another time than the rule's own.")
        return self._scratch.delayed[component.local_name, delay_as_number(delay, what)]

    @property
    def delayed_variables(self) -> list[Any]:
        """What stands for values at earlier times."""
        return list(self._scratch.delayed.values())

    @property
    def delayed_names(self) -> set[str]:
        """What rules have read at earlier times."""
        return {name for name, _ in self._scratch.delayed}

    def delayed_numbers(self, trajectory: Trajectory, times: Array, widths: Array, fraction: float) -> dict[int, Array]:
        """Numbers for these variables at times in all elements, by their identity."""
        if not len(self._scratch.delayed):
            return {}
        start, end = self._boundaries[0], self._boundaries[-1]
        found = {}
        for (name, delay), variable in self._scratch.delayed.items():
            # A hair inside of each element: what is delayed may jump where they meet.
            earlier = times - delay + SAME_TIME * (0.5 - fraction) * widths
            numbers = np.array(trajectory(np.clip(earlier, start, end))[name], dtype=float)
            if getattr(self._record.declarations[name], "history", None) is not None:
                for i in np.flatnonzero(earlier < start).tolist():
                    before = history_value(self._record, name, float(earlier[i]), f"'{name}'", delay)
                    numbers[i] = float(value(before))
            found[id(variable)] = numbers
        return found


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
    integrals : sequence of Statement
        Whose integrands follow the states: what they gain over the local fraction.
    by_instant : bool
        Whether rules that have to know the time as a number are evaluated at each instant; exact integrations ask for
        many of them.

    Notes
    -----
    What is delayed is taken from the trajectory, as controls are.

    Raises
    ------
    TrajectoryError
        When a rule gives no formula.
    """

    def __init__(
        self,
        block: Any,
        record: PhaseRecord,
        trajectory: Trajectory,
        indices: Grid,
        integrals: Sequence[Statement] = (),
        *,
        by_instant: bool = False,
    ) -> None:
        self._names, self._phase = record.names_of_states, block.name
        self._trajectory, self._indices = trajectory, indices
        self._widths = trajectory.grid.mesh.widths
        self._starts = np.array(trajectory.grid.mesh.boundaries[:-1])
        self._signals = {name: trajectory.element_signals(name) for name in trajectory.signals}
        self._known: dict[float, tuple[dict[str, Any], Array, Array]] = {}
        self._formulas = FormulasWithDelays(block, record, indices, trajectory.grid, by_instant=by_instant)
        self._delayed: dict[float, dict[int, Array]] = {}
        try:
            self._rates = self._formulas.rates_of(self._names)
            self._rates += [self._formulas.formula_of(statement) for statement in integrals]
        except PyRobocopError:
            raise
        except Exception as error:  # a rule that was written for single instants may raise anything
            raise TrajectoryError(
                f"phase '{block.name}': its equations are no formulas ({type(error).__name__}: {error})."
            ) from error
        self._compiled = self._compile([*record.declarations])

    def _compile(self, declared: Sequence[str]) -> tuple[StraightLine, list[int]] | None:
        """The rates as one function of arrays, and whose; None where they read what a walk has to judge."""
        inputs = [*self._formulas.variables(declared), *self._formulas.delayed_variables]
        try:
            line = StraightLine(self._rates, inputs, ARRAY_FUNCTIONS)
        except ValueError:
            return None
        return None if line.others else (line, [id(variable) for variable in inputs])

    def reads_any(self, names: Iterable[str]) -> bool:
        """Whether a derivative depends on one of these at the same time."""
        read = variables_in_any(self._rates)
        return any(id(variable) in read for variable in self._formulas.variables([*names])[:-2])

    def __call__(self, fraction: float, states: Array) -> Array:
        """Derivatives at a local fraction, of states of shape ``(n, k, N)``, those of integrals among them."""
        declared, index, clock = self._declared_at(fraction)
        declared = declared | dict(zip(self._names, states[: len(self._names)], strict=True))
        leaves = self._formulas.leaves(declared, index, clock)
        if fraction not in self._delayed:
            numbers = self._formulas.delayed_numbers(self._trajectory, clock, self._widths, fraction)
            self._delayed[fraction] = numbers
        leaves |= self._delayed[fraction]
        rates = np.empty_like(states)
        if self._compiled is not None:
            evaluate, inputs = self._compiled
            for j, rate in enumerate(evaluate(*(leaves.get(key) for key in inputs))):
                rates[j] = rate * self._widths
            return rates
        known = ExpressionEvaluator(leaves, ARRAY_FUNCTIONS, self._no_formula)
        for j, rate in enumerate(self._rates):
            rates[j] = known.of(rate) * self._widths
        return rates

    def at_instants(self, fraction: float, states: Array) -> Array:
        """Derivatives by real time at a local fraction of all elements, of states of shape ``(n, N)``."""
        return np.asarray(self(fraction, states[:, None, :])[:, 0, :] / self._widths, dtype=float)

    def _no_formula(self, node: Any, reason: str) -> TrajectoryError:
        return TrajectoryError(
            f"phase '{self._phase}': a rule has '{node}', which {reason} and has no value between the points of "
            "the mesh. Read states and controls through the phase that the rule is given as its first argument."
        )

    @property
    def asks_by_instant(self) -> bool:
        """Whether a rule is evaluated at each instant, which takes its time."""
        return self._formulas.asks_by_instant

    def _declared_at(self, fraction: float) -> tuple[dict[str, Any], Array, Array]:
        """Signals and parameters, time indices and times at a local fraction of every element."""
        if fraction not in self._known:
            weights = self._trajectory.grid.scheme.stage_polynomial_at([fraction])[0]
            times = self._starts + fraction * self._widths
            found: dict[str, Any] = {name: of @ weights for name, of in self._signals.items()}
            found |= {name: np.interp(times, *knots) for name, knots in self._trajectory.piecewise_linear.items()}
            found |= self._trajectory.parameters
            boundaries = np.array(self._indices.mesh.boundaries)
            # A hair inside of each element: what rules say by the time may jump where they meet.
            place = fraction + (SAME_TIME * (0.5 - fraction) if self.asks_by_instant else 0.0)
            self._known[fraction] = (found, boundaries[:-1] + place * np.diff(boundaries), times)
        return self._known[fraction]
