"""`RuleFormulas`: what the rules of a phase say at all times, as formulas of everything declared at one instant.

The rules were written for a phase: ``rule(phase, t)`` reads ``phase.x[t]``. Their templates get a proxy of the phase
(`modeling.rule_proxies`), and variables without values stand for what they read, time among them. Whoever asks gives
these numbers, arrays, or bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.expression_nodes import NUMPY_NAMES, comparisons
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.rule_proxies import BlockProxy, Signal, Signals
from pyrobocop_pyomo.modeling.variable_families import VariableFamily
from pyrobocop_pyomo.numerics import Array, Grid

from .asked_by_point import refuse_asked_by_point
from .companions import Companion
from .declarations import UNBOUNDED
from .delays import SAME_TIME, Past, delay_as_number, history_value
from .families import equations_by_component
from .record import PhaseRecord, PreviousStates, Statement

# What functions and comparisons mean where expressions are evaluated with arrays.
ARRAY_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, numpy_name) for name, numpy_name in NUMPY_NAMES.items()},
    **comparisons(np.logical_and),
    "choose": np.where,
    "call": lambda output, *arguments: output.evaluate_arrays(arguments),
}


class RuleFormulas(Signals):
    """Asks rules for formulas that hold at all times; what is not declared is read from the phase itself.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    indices, grid : Grid
        The same grid in the phase's time indices and in real time.
    companions : sequence of Companion
        Other phases, which rules may read at the same instant.

    Attributes
    ----------
    at_instant : dict of name to VarData
        What stands for everything that is declared.
    index, clock : VarData
        What stands for the time index, and for the time.
    blocks_read : set of int
        Identities of the phases that rules have read so far.
    """

    error = TrajectoryError

    def __init__(
        self, block: Any, record: PhaseRecord, indices: Grid, grid: Grid, companions: Sequence[Companion] = ()
    ) -> None:
        self._block, self._record, self.companions = block, record, tuple(companions)
        self._scratch = scratch = ConcreteModel()  # Pyomo holds parents by weak references: keep the owner alive
        scratch.declared = Var(list(record.declarations))
        scratch.derivatives, scratch.previous = Var(record.names_of_states), Var(record.names_of_states)
        scratch.delayed = Var(AnyIndex, dense=False)
        scratch.index_of_time, scratch.clock = Var(), Var()
        self.at_instant = dict(scratch.declared.items())
        self._derivatives: dict[str, Any] | None = dict(scratch.derivatives.items())
        self._standing_for = {id(block.component(name)): variable for name, variable in self.at_instant.items()}
        self._standing_for |= {id(of): variable for other in companions for of, variable in other.lent}
        self._indices, self._boundaries = indices.mesh.boundaries, grid.mesh.boundaries
        self.index, self.clock = scratch.index_of_time, scratch.clock
        self._proxy = _PhaseProxy(block, self, grid)
        self.blocks_read: set[int] = set()

    # ---------------------------------------------------------------- what rules read

    def value_of(self, signal: Signal) -> Any:
        """The variable that stands for a signal."""
        found = self._standing_for.get(id(signal.component))
        if found is None:
            raise TrajectoryError(f"'{signal.name}' is no variable of the phase: no rule says it at all times.")
        self.blocks_read.add(id(signal.component.parent_block()))
        return found

    def scalar(self, component: Any) -> Any:
        """A parameter of the phase, by what stands for it."""
        return self._standing_for.get(id(component), component)

    def proxy_of(self, block: Any) -> BlockProxy:
        """The proxy of a block."""
        return self._proxy if block is self._block else BlockProxy(block, self)

    def time_at(self, block: Any) -> Any:
        """The variable that stands for real time."""
        if block is not self._block:
            raise TrajectoryError(f"'{block.name}' has a time of its own.")
        return self.clock if self._record.normalised else self.index

    def delayed_value(self, component: Any, t: Any, delay: Any) -> Any:
        """The variable that stands for a value a while ago."""
        what = f"'{component.name}'"
        if component.parent_block() is not self._block or not self.is_index(t):
            raise TrajectoryError(f"{what} is read a while before another time than the rule's own.")
        number = delay_as_number(delay, what)
        return self._scratch.delayed[component.local_name, number] if number else self._standing_for[id(component)]

    def derivative(self, name: str) -> Any:
        """The variable that stands for the derivative of a state."""
        if self._derivatives is None:
            raise TrajectoryError(f"the rules read the derivative of '{name}', which is known at the grid only.")
        return self._derivatives[name]

    # ---------------------------------------------------------------- what they say

    def formulas_of(self, statement: Statement, entries: Callable[[Any], Any] = plain_expressions) -> Any:
        """What a rule gives at any time.

        Parameters
        ----------
        statement : Statement
        entries : callable
            Makes of what the rule returned what is wanted.

        Raises
        ------
        TrajectoryError
            When it gives no formula.
        """
        what = f"phase '{self._block.name}': {statement.kind} '{statement.name}'"
        more = self._more(statement)
        refuse_asked_by_point(self._block, [statement], *more)
        with failures_as(TrajectoryError, f"{what} is no formula that holds at all times"):
            return entries(statement(self._proxy, self.index, *more))

    def gives_formulas(self, statement: Statement) -> bool:
        """Whether a rule holds at all times, and reads nothing whose values between the points are not known."""
        try:
            self.formulas_of(statement, lambda result: None)
        except TrajectoryError:
            return False
        return True

    def _more(self, statement: Statement) -> tuple[Any, ...]:
        if statement.kind != "step map":
            return ()
        what = f"phase '{self._block.name}': step map '{statement.name}'"
        return (PreviousStates(what, dict(self._scratch.previous.items()), self._record.families),)

    def by_state(self, statement: Statement) -> dict[str, Any]:
        """What an ode or a step map gives, by the names of the states."""
        what = f"{statement.kind} '{statement.name}'"
        given = self.formulas_of(statement, lambda result: equations_by_component(self._record, result, what))
        return {self._proxy.state_name(state): plain_expressions(of) for state, of in given.items()}

    def rates_of(self, names: list[str], *, derivatives: bool = False) -> list[Any]:
        """Formulas of the derivatives, in the order of the names; those that rules read only where they are known."""
        known = self._derivatives
        rates: dict[str, Any] = {}
        try:
            self._derivatives = known if derivatives else None
            for statement in self._record.statements_of("ode"):
                rates |= self.by_state(statement)
        finally:
            self._derivatives = known
        return [rates[name] for name in names]

    def set_bounds(self, time: float) -> None:
        """Give the variables the bounds of a time: pairs may mean a variable's own bound."""
        for name, declaration in self._record.declarations.items():
            lower, upper = declaration.bounds_at(time, name) if declaration.knows_bounds_at(time) else UNBOUNDED
            self.at_instant[name].setlb(lower)
            self.at_instant[name].setub(upper)

    # ---------------------------------------------------------------- what stands in place of the variables

    @property
    def variables(self) -> list[Any]:
        """Everything that stands for something in the formulas, of other phases as well."""
        found = [variable for of in self._scratch.component_objects(Var) for variable in of.values()]
        return [*found, *(variable for other in self.companions for _, variable in other.lent)]

    def leaves(
        self,
        declared: Mapping[str, Any],
        index: Any,
        clock: Any,
        slopes: Mapping[str, Any] | None = None,
        previous: Mapping[str, Any] | None = None,
    ) -> dict[int, Any]:
        """What stands in place of each variable, by its identity.

        Parameters
        ----------
        declared, slopes, previous : mapping of name to numbers
            Of everything that is declared, of derivatives, and of states where the element starts.
        index, clock : numbers
        """
        found = {id(self.at_instant[name]): numbers for name, numbers in declared.items()}
        for component, given in ((self._scratch.derivatives, slopes), (self._scratch.previous, previous)):
            found |= {id(component[name]): numbers for name, numbers in (given or {}).items()}
        return found | {id(self.index): index, id(self.clock): clock}

    def of_companions(self, fractions: Array) -> dict[int, Array]:
        """What other phases that rules have read are at local fractions, shape ``(q, N)``, by what stands for it."""
        read = [other for other in self.companions if id(other.phase) in self.blocks_read]
        return {key: of.T for other in read for key, of in other.values_at(fractions).items()}

    @property
    def delays(self) -> list[tuple[str, float]]:
        """What rules have read at earlier times, and how much earlier."""
        return list(self._scratch.delayed)

    def delayed_numbers(self, past: Past, times: Array, widths: Array, fraction: float) -> dict[int, Array]:
        """Numbers of what rules have read at earlier times than these, by the identity of what stands for it.

        Parameters
        ----------
        past : callable
            ``past(name, times)``: values from the start of the phase on.
        times, widths : array
            At the fraction of elements with these widths.
        fraction : float
        """
        start, end = self._boundaries[0], self._boundaries[-1]
        found = {}
        for (name, delay), variable in self._scratch.delayed.items():
            # A hair inside of each element: history ends, and all but states may jump, where they meet.
            inside = times - delay + SAME_TIME * (0.5 - fraction) * widths
            earlier = times - delay if name in self._record.names_of_states else inside
            has_history = getattr(self._record.declarations[name], "history", None) is not None
            before = inside < (start if has_history else start - 1e-9 * (end - start))
            numbers = np.empty(len(times))
            if not before.all():
                numbers[~before] = past(name, earlier[~before])
            for i in np.flatnonzero(before).tolist():
                stated = history_value(self._record, name, float(inside[i]), f"'{name}'", delay)
                numbers[i] = float(value(stated))
            found[id(variable)] = numbers
        return found


class _PhaseProxy(BlockProxy):
    """Proxy of the phase, whose start and duration are those of a trajectory."""

    def __init__(self, block: Any, formulas: RuleFormulas, grid: Grid) -> None:
        super().__init__(block, formulas)
        self._formulas = formulas
        self.start = grid.mesh.boundaries[0]
        self.duration = grid.mesh.boundaries[-1] - grid.mesh.boundaries[0]

    def derivative(self, state: Any) -> Any:
        """The derivative of a state, as `PhaseBlock.derivative` gives it."""
        if isinstance(state, str) and state in self._block.record.families:
            state = getattr(self, state)
        if isinstance(state, VariableFamily):
            return state.of_each(self.derivative)
        return _Derivative(self._formulas.derivative(self.state_name(state)))

    def state_name(self, state: Any) -> str:
        """Name of a state given by its proxy or its name."""
        return state if isinstance(state, str) else state.local_name


class _Derivative:
    """One variable at every index."""

    def __init__(self, variable: Any) -> None:
        self._variable = variable

    def __getitem__(self, t: float) -> Any:
        return self._variable
