"""A phase at one instant, so that the user's rules can be evaluated anywhere and with any values.

The rules were written for a phase: ``rule(phase, t)`` reads ``phase.x[t]``. Here they get a proxy of the phase
(`modeling.rule_proxies`), and read variables that hold the values of one instant; their results are then evaluated.
This checks a trajectory by the equations as stated, not by the rows that were built from them.

At the points of the phase's own grid there is nothing to imitate: a rule can be asked of the phase itself, which has
the values of the instant meanwhile. What it gives there is what it says, however it is written. Between the points
`rules_between_points` compares the two before anything is believed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import native_numeric_types, value
from pyomo.core.expr.relational_expr import EqualityExpression

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.lent_items import in_place_of_nodes, variables_read
from pyrobocop_pyomo.modeling.rule_proxies import BlockProxy, Signal, Signals
from pyrobocop_pyomo.modeling.shared_nodes import NodeValues
from pyrobocop_pyomo.modeling.time_index import point_of
from pyrobocop_pyomo.modeling.variable_families import VariableFamily
from pyrobocop_pyomo.numerics import Grid

from .companions import Companion, companions_of
from .declarations import Parameter
from .delays import delay_as_number, history_value, inside_of_its_element
from .families import equations_by_component
from .nodes import StageNodes, StateNodes
from .record import PhaseRecord, PreviousStates, Statement, labelled_rows


class PointModel(Signals):
    """Values of everything declared at one instant; what is not declared is read from the phase itself.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    indices, grid : Grid
        The same grid in the phase's time indices and in real time, for rules that read the time, the start or the
        duration.
    companions : sequence of Companion
        Other phases, which rules may read at the same instant; at points of the grid all others are read as they are.

    Attributes
    ----------
    element : int or None
        The element that instants belong to; None for the one that ends there, where two meet.
    asks_phase : bool
        Whether rules are evaluated on the phase itself at the points of its grid, instead of a proxy of it. Whoever
        sets it has put the values at all other times on the model, and puts back what was there.
    past : callable or None
        ``past(name, time)``: values at earlier real times, for delays; those on the model by default.
    smallest_delay : float
        Of those that rules have asked for and that are positive.
    """

    error = TrajectoryError

    def __init__(
        self, block: Any, record: PhaseRecord, indices: Grid, grid: Grid, companions: Sequence[Companion] = ()
    ) -> None:
        self._block = block
        self._record = record
        self._scratch = scratch = ConcreteModel()  # Pyomo holds parents by weak references: keep the owner alive
        scratch.declared = Var(list(record.declarations))
        scratch.derivatives = Var(record.names_of_states)
        self._values = dict(scratch.declared.items())
        self._derivatives = dict(scratch.derivatives.items())
        self._of_component = {id(block.component(name)): variable for name, variable in self._values.items()}
        self._forgotten: set[str] = set()
        self._indices, self._boundaries = indices.mesh.boundaries, grid.mesh.boundaries
        self.index = np.nan
        self._proxy = _PhaseProxy(block, self, grid)
        self.element: int | None = None
        self._lent = [
            (block.component(name), self._values[name]) for name in [*record.names_of_states, *record.names_of_signals]
        ]
        self._companions = tuple(companions)
        self._read_by: dict[int, tuple[Companion, ...]] = {}
        self.asks_phase = False
        self._at_nodes = GridVariables(block, record)
        self._moved: list[tuple[Any, float | None, bool]] = []
        self._known_rules: set[int] = set()
        self.past: Callable[[str, float], float] | None = None
        self.smallest_delay = np.inf

    @property
    def at_instant(self) -> Mapping[str, Any]:
        """The variables that hold the values of the instant, by the name of what is declared."""
        return self._values

    # ---------------------------------------------------------------- what rules read

    def is_index(self, key: Any) -> bool:
        """Any equal number is the same instant of the phase."""
        key = point_of(key)
        return key.__class__ in native_numeric_types and key == self.index

    def value_of(self, signal: Signal) -> Any:
        """The variable that holds a value of the instant."""
        found = self._of_component.get(id(signal.component))
        return signal.component[signal.key_at(self.index)] if found is None else found

    def scalar(self, component: Any) -> Any:
        """A parameter of the phase, by its value here."""
        return self._of_component.get(id(component), component)

    def proxy_of(self, block: Any) -> BlockProxy:
        """The proxy of a block."""
        return self._proxy if block is self._block else BlockProxy(block, self)

    def time_at(self, block: Any) -> Any:
        """Real time of the instant."""
        if block is not self._block:
            return block.time_at(self.index)
        return float(np.interp(self.index, self._indices, self._boundaries)) if self._record.normalised else self.index

    def delayed_value(self, component: Any, t: Any, delay: Any) -> Any:
        """The number that a variable over time was a while ago."""
        if component.parent_block() is not self._block:
            return component.delayed(t, delay)
        return self._past_value(component.local_name, t, delay)

    def _past_value(self, name: str, t: Any, delay: Any) -> Any:
        what = f"phase '{self._block.name}': '{name}'"
        number = delay_as_number(delay, what)
        if number == 0.0 and self.is_index(t):
            return self._values[name]
        if self.past is None:
            raise TrajectoryError(f"{what} is read at an earlier time, which is not known here.")
        now = (
            float(np.interp(point_of(t), self._indices, self._boundaries))
            if self._record.normalised
            else float(point_of(t))
        )
        self.smallest_delay = min(self.smallest_delay, number) if number > 0.0 else self.smallest_delay
        start, end = self._boundaries[0], self._boundaries[-1]
        time = now - number + inside_of_its_element(self._boundaries, now, self.element)
        known = getattr(self._record.declarations[name], "history", None) is not None
        if time < (start if known else start - 1e-9 * (end - start)):
            return float(value(history_value(self._record, name, time, what, number, t)))
        return self.past(name, time)

    def derivative(self, name: str) -> Any:
        """The variable that holds the derivative of a state."""
        if name in self._forgotten:
            raise TrajectoryError(f"the rules read the derivative of '{name}', which is known at the grid only.")
        return self._derivatives[name]

    # ---------------------------------------------------------------- what is evaluated

    def index_at(self, time: float) -> float:
        """The index of a real time: what `time_at` undoes."""
        if not self._record.normalised:
            return time
        return float(np.interp(time, self._boundaries, self._indices))

    def set_values(self, values: Mapping[str, float], derivatives: Mapping[str, float] | None = None) -> None:
        """Hold other values: those of the instant that is evaluated next."""
        for name, number in values.items():
            self._values[name].set_value(float(number), skip_validation=True)
        for name, number in (derivatives or {}).items():
            self._derivatives[name].set_value(float(number), skip_validation=True)
        self._forgotten -= set(derivatives or ())

    def forget_derivatives(self) -> None:
        """Refuse to give derivatives until new values are set."""
        self._forgotten = set(self._derivatives)

    def set_bounds(self, time: float) -> None:
        """Give the variables the bounds of a time: pairs may mean a variable's own bound."""
        for name, declaration in self._record.declarations.items():
            lower, upper = declaration.bounds_at(time, name)
            self._values[name].setlb(lower)
            self._values[name].setub(upper)

    def result_of(self, statement: Statement, time: float, *more: Any) -> Any:
        """The result of a rule at a time index, and of what else it is given.

        Raises
        ------
        TrajectoryError
            When the rule is lost, or reads the model otherwise than through its first argument.
        """
        if statement.rule is None:
            raise TrajectoryError(
                f"phase '{self._block.name}': the rule '{statement.name}' did not survive pickling. Define it at "
                "the top level of a module."
            )
        time = float(time)  # Pyomo makes no formulas of NumPy's numbers
        self.index = time
        self._move_nodes(time)
        of_phase = self.asks_phase and self._at_nodes.has(time)
        read = self._read_by.get(id(statement), self._companions)
        self._record.delay_reader = None if self.past is None else self._past_value
        home = self._block if of_phase else self._proxy
        t = self._record.index_for_rule(home, time, f"phase '{self._block.name}': '{statement.name}'")
        try:
            if of_phase:
                result = self._plain(statement, statement(home, t, *more))
            else:
                for other in read:
                    other.set_instant(*self._place(time))
                with in_place_of_nodes(chain(self._lent, *(other.lent for other in read)), time):
                    result = self._plain(statement, statement(home, t, *more))
        except (KeyError, IndexError) as error:
            raise TrajectoryError(
                f"phase '{self._block.name}': the rule '{statement.name}' cannot be asked at t = {time:g} ({error}). "
                "Read variables at t itself and through its first argument, not through the model."
            ) from error
        finally:
            self._record.delay_reader = None
        if of_phase:
            if id(statement) not in self._known_rules:
                self.refuse_foreign(statement, variables_read(result))
                self._known_rules.add(id(statement))
        elif id(statement) not in self._read_by:
            variables = variables_read(result) if self._companions else []
            self._read_by[id(statement)] = tuple(other for other in self._companions if other.is_read_in(variables))
        return result

    def _plain(self, statement: Statement, result: Any) -> Any:
        if isinstance(result, Mapping) and statement.kind in ("ode", "step map"):
            what = f"phase '{self._block.name}': {statement.kind} '{statement.name}'"
            result = equations_by_component(self._record, result, what)
        return plain_expressions(result)

    def _move_nodes(self, time: float) -> None:
        """Let the phase's own variables at a time hold the instant too, for rules that got hold of them some way."""
        if self._moved:
            self.leave_nodes()
        if not self._at_nodes.has(time):
            return
        for name, variable in self._at_nodes.at(time):
            source = self._values.get(name)
            if source is None:
                state = name.removesuffix("_derivative")
                number = None if state in self._forgotten else self._derivatives[state].value
            else:
                number = source.value
            self._moved.append((variable, variable.value, variable.stale))
            variable.set_value(number, skip_validation=True)

    def leave_nodes(self) -> None:
        """Put back what the phase's own variables had before the last instant."""
        for variable, number, stale in self._moved:
            variable.set_value(number, skip_validation=True)
            variable.stale = stale
        self._moved.clear()

    def keys_at(self, time: float) -> frozenset[int]:
        """Identities of the phase's own variables at a point of its grid."""
        return frozenset(id(variable) for _, variable in self._at_nodes.at(time))

    def name_of(self, keys: frozenset[int]) -> str:
        """The first of the phase's own variables with one of these identities."""
        return next(f"'{variable.name}'" for variable in self._at_nodes.variables if id(variable) in keys)

    def read_elsewhere(self, statement: Statement, time: float, *more: Any) -> frozenset[int]:
        """The phase's own states and signals that a rule reads at other times than the one that it is evaluated at."""
        variables = variables_read(self.result_of(statement, time, *more))
        self.refuse_foreign(statement, variables)
        return frozenset(key for key in map(id, variables) if key in self._at_nodes.keys) - self.keys_at(time)

    def refuse_foreign(self, statement: Statement, variables: Sequence[Any]) -> None:
        """Refuse what belongs to another model: the one that this is a copy of, or an instant of long ago.

        Raises
        ------
        TrajectoryError
            Naming the rule and the variable.
        """
        own = {id(self._block.model()), id(self._scratch), *(id(other.scratch) for other in self._companions)}
        for variable in variables:
            component = variable.parent_component()
            if component is None or component.parent_block() is None or id(component.model()) not in own:
                raise TrajectoryError(
                    f"phase '{self._block.name}': the rule '{statement.name}' reads '{variable.local_name}' of another "
                    "model, such as the one that this is a copy of, or keeps what it read before. Read variables "
                    "through its first argument."
                )

    def _place(self, time: float) -> tuple[int, float]:
        """Element of a time index, and the place within it."""
        starts, element = self._indices, self.element
        if element is None:
            element = min(max(int(np.searchsorted(starts, time, side="left")) - 1, 0), len(starts) - 2)
        return element, (time - starts[element]) / (starts[element + 1] - starts[element])

    def rates(self, statements: list[Statement], time: float) -> dict[str, float]:
        """Derivatives that odes state, at a time index."""
        known = NodeValues()
        return {
            self._proxy.state_name(state): float(known.of(rate))
            for statement in statements
            for state, rate in self.result_of(statement, time).items()
        }

    def next_states(self, statements: list[Statement], time: float, previous: Mapping[str, float]) -> dict[str, float]:
        """Values at the end of an element by step maps, from those at its start and those that are set."""
        known = NodeValues()
        return {
            self._proxy.state_name(state): float(known.of(following))
            for statement in statements
            for state, following in self.result_of(
                statement,
                time,
                PreviousStates(
                    f"phase '{self._block.name}': step map '{statement.name}'", previous, self._record.families
                ),
            ).items()
        }


class _PhaseProxy(BlockProxy):
    """Proxy of the phase, whose start and duration are those of a trajectory."""

    def __init__(self, block: Any, point: PointModel, grid: Grid) -> None:
        super().__init__(block, point)
        self._point = point
        self.start = grid.mesh.boundaries[0]
        self.duration = grid.mesh.boundaries[-1] - grid.mesh.boundaries[0]

    def derivative(self, state: Any) -> Any:
        """The derivative of a state, as `PhaseBlock.derivative` gives it."""
        if isinstance(state, str) and state in self._block.record.families:
            state = getattr(self, state)
        if isinstance(state, VariableFamily):
            return state.of_each(self.derivative)
        return _Derivative(self._point.derivative(self.state_name(state)))

    def state_name(self, state: Any) -> str:
        """Name of a state given by its proxy or its name."""
        return state if isinstance(state, str) else state.local_name


class _Derivative:
    """One variable at every index."""

    def __init__(self, variable: Any) -> None:
        self._variable = variable

    def __getitem__(self, t: float) -> Any:
        return self._variable


class GridVariables:
    """The variables of a phase that live at its points of time: states, algebraics, collocated controls, derivatives.

    Attributes
    ----------
    variables : list of VarData
    keys : frozenset of int
        Identities of them all.
    """

    def __init__(self, block: Any, record: PhaseRecord) -> None:
        names = [*record.names_of_states, *record.names_of_signals]
        names = [name for name in names if isinstance(record.nodes(name), (StateNodes, StageNodes))]
        names += [f"{name}_derivative" for name in sorted(record.kept_derivatives)]
        self._components = {name: dict(block.component(name).items()) for name in names}
        self._times = frozenset(record.grid.times)
        self.variables = [variable for items in self._components.values() for variable in items.values()]
        self.keys = frozenset(map(id, self.variables))

    def has(self, time: float) -> bool:
        """Whether a time index is one of the grid."""
        return time in self._times

    def at(self, time: float) -> list[tuple[str, Any]]:
        """Names and variables at a time index; none off the grid."""
        if time not in self._times:
            return []
        return [(name, items[time]) for name, items in self._components.items() if time in items]


class PointEquations:
    """The stated equations at one instant, as numbers: rates of explicit states and residuals of the rest.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    indices, grid : Grid
        The same grid in time indices and in real time.
    parameters : mapping of name to number, optional
        As the phase holds them by default.
    """

    def __init__(
        self,
        block: Any,
        record: PhaseRecord,
        indices: Grid,
        grid: Grid,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self._point = PointModel(block, record, indices, grid, companions_of(block, indices.mesh.boundaries))
        self._odes = record.statements_of("ode")
        self._steps = record.statements_of("step map")
        self._residuals = record.statements_of("residual")
        own = {name: block.component(name).value for name in record.names(Parameter)}
        self.parameters = {name: float(number) for name, number in {**own, **(parameters or {})}.items()}
        self._point.set_values(self.parameters)

    @property
    def point(self) -> PointModel:
        """The instant that is evaluated."""
        return self._point

    def index_at(self, time: float) -> float:
        """The time index of a real time."""
        return self._point.index_at(time)

    def enter(self, element: int) -> None:
        """The instants that are evaluated from now on are of this element."""
        self._point.element = element

    def rates(
        self, time: float, values: Mapping[str, float], slopes: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Derivatives that odes state, at a time index; slopes are those of the other states."""
        self._point.forget_derivatives()  # those of an instant before would be read as if they were of this one
        self._point.set_values(values, slopes)
        return self._point.rates(self._odes, time)

    def next_states(self, time: float, previous: Mapping[str, float]) -> dict[str, float]:
        """Values at the element end by the step maps, at the values last set."""
        return self._point.next_states(self._steps, time, previous)

    def residuals(self, time: float, slopes: Mapping[str, float]) -> list[float]:
        """Left minus right side of each residual equation, at the values last set and all the slopes."""
        self._point.set_values({}, slopes)
        known = NodeValues()
        return [
            _signed(row, known)
            for statement in self._residuals
            for row in labelled_rows("residual", self._point.result_of(statement, time)).values()
        ]


def _signed(row: Any, known: NodeValues) -> float:
    if isinstance(row, EqualityExpression):
        left, right = row.args
        return float(known.of(left)) - float(known.of(right))
    if isinstance(row, tuple):
        return float(known.of(row[0])) - float(known.of(row[1]))
    return float(known.of(row))
