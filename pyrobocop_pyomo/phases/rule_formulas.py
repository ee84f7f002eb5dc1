"""`RuleFormulas`: what the rules of a phase say at all times, as formulas of everything declared at one instant.

Variables without values stand for what the templates of the rules read, time among them. Whoever asks gives these
numbers, arrays, or bounds.

Rules that have to know the time as a number: they were asked at each point of the mesh while the model was built.

What they say at other times nobody has looked at. Such a phase keeps its mesh, and its errors between the points are
not known.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.expression_nodes import ARRAY_FUNCTIONS
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.row_violations import undefined_part
from pyrobocop_pyomo.modeling.shared_nodes import variables_in_any
from pyrobocop_pyomo.numerics import Array, Grid
from pyrobocop_pyomo.templates.slots import Always, Clock, Derivative, Item, NamedItem, Place, Slot, Time
from pyrobocop_pyomo.trajectories import Trajectory

from .coupled_phases import indices_of
from .declarations import FunctionOfTime
from .delays import SAME_TIME, Delayed, Past, ValueAt, delay_as_number, history_value
from .families import equations_by_component
from .phase_values import PhaseValues
from .record import PhaseRecord, Previous, PreviousStates, Statement

# --------------------------------------------------------------------------------------------- rules that know the time


def asked_by_point(phase: Any) -> str | None:
    """The first rule of a phase, or function for a history, that is no template, in words; None where all are.

    Parameters
    ----------
    phase : PhaseBlock
    """
    record = phase.record
    found = next((each for each in record.rules if not each.rule.is_template(phase)), None)
    if found is not None:
        return _in_words(phase, found)
    return next((reason for name in record.declarations if (reason := _history_by_point(phase, name))), None)


def _history_by_point(phase: Any, name: str) -> str | None:
    """Why what a name was before the start is not known at any time, in words; None where it is."""
    declaration = phase.record.declarations[name]
    history = getattr(declaration, "history", None)
    if not isinstance(history, FunctionOfTime) or not history.is_asked_by_point:
        return None
    return _reason(phase, f"the function for the history of '{name}' (declared at {declaration.declared_at})")


def _in_words(phase: Any, statement: Statement) -> str:
    code = getattr(statement.rule.rule, "__code__", None)
    line = "" if code is None else f" ({Path(code.co_filename).name}:{code.co_firstlineno})"
    return _reason(phase, f"the rule of its {statement.kind} '{statement.name}'{line}")


def _reason(phase: Any, what: str) -> str:
    return (
        f"phase '{phase.name}': {what} has to know the time as a number, and was asked at the points of the mesh: what "
        "it says between them is not known. Write pyo.Expr_if for a branch, rcp.Table for data over time, pyo.sin for "
        "math.sin, x.delayed(t, delay) for an earlier time."
    )


def read_inside_elements(phase: Any) -> str | None:
    """The times inside elements at which statements read values, in words; None where all are element boundaries.

    Parameters
    ----------
    phase : PhaseBlock
    """
    boundaries = phase.grid.mesh.boundaries
    inside = [time for time in sorted(phase.record.named_times) if time not in boundaries]
    if not inside:
        return None
    more = f" and at {len(inside) - 1} times more" if len(inside) > 1 else ""
    return (
        f"Statements read values of phase '{phase.name}' at t = {inside[0]:g}{more}, inside of elements, where the "
        "polynomial is less exact than at their ends. Make these times element boundaries: PhaseBlock(mesh=...)."
    )


# -------------------------------------------------------------------------------------------------------- rule formulas


def shown_by_name(formula: object) -> str:
    """A formula, or a text about formulas, with the names of what is declared."""
    return re.sub(r"declared\[([^]]*)\]", r"'\1'", str(formula))


class RuleFormulas:
    """Makes formulas that hold at all times of the templates of rules.

    Parameters
    ----------
    block : PhaseBlock
    grid : Grid
        Of a trajectory, in real time.
    coupled : sequence of PhaseBlock
        Other phases, which rules may read at the same instant; see `coupled_phases_of`.

    Attributes
    ----------
    at_instant : dict of name to VarData
        What stands for everything that is declared.
    index, clock : VarData
        What stands for the time index, and for the time.
    grid : Grid
    indices : Grid
        The grid in the phase's time indices.
    block : PhaseBlock
    record : PhaseRecord
    instants : dict of Statement to array
        Where in the elements rules are looked at, as far as it was asked.
    """

    def __init__(self, block: Any, grid: Grid, coupled: Sequence[Any] = ()) -> None:
        record: PhaseRecord = block.record
        self.block, self.record, self._coupled = block, record, list(coupled)
        self._trajectories: dict[int, Trajectory] = {}
        self.instants: dict[Statement, Array] = {}
        self._scratch = scratch = ConcreteModel()  # Pyomo holds parents by weak references: keep the owner alive
        # Made when read: of delayed values and other phases they say what rules have read.
        for kind in ("declared", "derivatives", "previous", "delayed", "beside", "times"):
            scratch.add_component(kind, Var(AnyIndex, dense=False))
        self.at_instant = {name: scratch.declared[name] for name in record.declarations}
        for name, declaration in record.declarations.items():  # a side of a pair may be a variable's own bound
            lower, upper = declaration.bounds_at(0.0, name)
            self.at_instant[name].setlb(lower)
            self.at_instant[name].setub(upper)
        self._standing_for = {id(block.component(name)): variable for name, variable in self.at_instant.items()}
        self.indices, self.grid, boundaries = indices_of(record, grid), grid, grid.mesh.boundaries
        # Of the trajectory, whatever the phase has now.
        self._horizon = {
            id(block.start): boundaries[0],
            id(block.duration): boundaries[-1] - boundaries[0],
        }
        self.index, self.clock = scratch.times["index"], scratch.times["clock"]
        self._steps: dict[tuple[int, ...], tuple[Any, ExpressionSteps]] = {}
        self._named: dict[NamedItem, Any] = {}
        self._said: dict[Statement, Any] = {}

    # ---------------------------------------------------------------- what rules read

    def read(self, slot: Slot) -> Any:
        """What stands for what a rule reads.

        Raises
        ------
        TrajectoryError
            When it is not known between the points of the grid.
        """
        component = slot.component
        if isinstance(slot, Always):
            return self._horizon.get(id(component), self._standing_for.get(id(component), component))
        if isinstance(slot, Time) or (isinstance(slot, Clock) and component is self.block):
            return self.clock if self.record.normalised else self.index
        if isinstance(slot, NamedItem):
            if slot not in self._named:
                self._named[slot] = slot.formulas(TrajectoryError)
            return self._named[slot].at(self.read)
        if isinstance(slot, Item) and slot.rest == (None,):
            if id(component) in self._standing_for:
                return self._standing_for[id(component)]
            home = component.parent_block()
            if home in self._coupled and component.local_name in home.record.declarations:
                return self._scratch.beside[self._coupled.index(home), component.local_name]
        if isinstance(slot, Delayed) and component.parent_block() is self.block:
            if (reason := _history_by_point(self.block, component.local_name)) is not None:
                raise TrajectoryError(reason)
            number = delay_as_number(slot.rest[0], f"'{component.name}'")
            own = self._standing_for[id(component)]
            return self._scratch.delayed[component.local_name, number] if number else own
        if isinstance(slot, Derivative) and component.parent_block() is self.block:
            return self._scratch.derivatives[component.local_name]
        if isinstance(slot, Previous):
            return self._scratch.previous[slot.rest[1]]
        if isinstance(slot, ValueAt):
            return slot.on_model(Place(self.block, None))
        if isinstance(slot, Clock):
            raise TrajectoryError(f"'{component.name}' has a time of its own.")
        what = slot.name if isinstance(slot, Item) else f"{type(slot).__name__} of {component.name}"
        raise TrajectoryError(f"'{what}' is known at the points of the grid only: no rule says it at all times.")

    def derivative(self, name: str) -> Any:
        """The variable that stands for the derivative of a state."""
        return self._scratch.derivatives[name]

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
        more: tuple[Any, ...] = ()
        if statement.kind == "step map":
            previous = {name: self._scratch.previous[name] for name in self.record.names_of_states}
            more = (PreviousStates(statement.label(self.block), previous, self.record.families),)
        with failures_as(TrajectoryError, f"{statement.label(self.block)} is no formula that holds at all times"):
            if statement not in self._said:
                formulas: Any = statement.rule.formulas(self.block, *more)
                if formulas is None:
                    raise TrajectoryError(_in_words(self.block, statement))
                self._said[statement] = formulas.at(self.read)
            return entries(self._said[statement])

    def gives_formulas(self, statement: Statement) -> bool:
        """Whether a rule holds at all times, and reads nothing whose values between the points are not known."""
        try:
            self.formulas_of(statement, lambda result: None)
        except TrajectoryError:
            return False
        return True

    def by_state(self, statement: Statement) -> dict[str, Any]:
        """What an ode or a step map gives, by the names of the states."""
        what = f"{statement.kind} '{statement.name}'"
        given = self.formulas_of(statement, lambda result: equations_by_component(self.record, result, what))
        return {self.block.state_name(state): plain_expressions(of) for state, of in given.items()}

    def rates_of(self, names: list[str]) -> list[Any]:
        """Formulas of the derivatives, in the order of the names."""
        rates: dict[str, Any] = {}
        for statement in self.record.statements_of("ode"):
            rates |= self.by_state(statement)
        return [rates[name] for name in names]

    # ---------------------------------------------------------------- what stands in place of the variables

    def values(self, expressions: Sequence[Any], leaves: Mapping[int, Any]) -> list[Any]:
        """Formulas with arrays, or numbers, in place of the variables, by their identities; their steps are kept."""
        key = tuple(map(id, expressions))
        if key not in self._steps:
            # The first keeps the ids.
            self._steps[key] = list(expressions), ExpressionSteps(expressions, refuse=self._no_formula)
        return self._steps[key][1].evaluate_at(leaves, ARRAY_FUNCTIONS)

    def _no_formula(self, node: Any, reason: str) -> TrajectoryError:
        return TrajectoryError(
            f"phase '{self.block.name}': a rule has '{node}', which {reason} and has no value between the points of "
            "the mesh. Read states and controls through the phase that the rule is given as its first argument."
        )

    def undefined_part(self, expression: Any, leaves: Mapping[int, float]) -> str:
        """Which part of a formula has no value with numbers in place of the variables, in words; empty for none."""
        for variable in (variable for of in self._scratch.component_objects(Var) for variable in of.values()):
            variable.set_value(leaves.get(id(variable)), skip_validation=True)
        part = undefined_part(expression)
        return "" if part is None else shown_by_name(part.what)

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
        found |= {id(self.derivative(name)): numbers for name, numbers in (slopes or {}).items()}
        found |= {id(self._scratch.previous[name]): numbers for name, numbers in (previous or {}).items()}
        return found | {id(self.index): index, id(self.clock): clock}

    def of_coupled_phases(self, fractions: Array) -> dict[int, Array]:
        """What other phases that rules have read are at local fractions, shape ``(q, N)``, by what stands for it."""
        if not len(self._scratch.beside):
            return {}
        values: dict[int, dict[str, Array]] = {}
        for number in dict.fromkeys(number for number, _ in self._scratch.beside):
            with suppress(TrajectoryError):  # nothing is known where the model has no values
                if number not in self._trajectories:
                    self._trajectories[number] = PhaseValues(self._coupled[number]).trajectory(evaluate=False)
                values[number] = self._trajectories[number].element_polynomials(fractions)
        read = self._scratch.beside.items() if values else ()
        return {id(of): values[number][name].T for (number, name), of in read if name in values.get(number, ())}

    @property
    def delays(self) -> list[tuple[str, float]]:
        """What rules have read at earlier times, and how much earlier."""
        return list(self._scratch.delayed)

    def delays_in(self, expressions: Sequence[Any]) -> list[tuple[str, float]]:
        """What formulas hold at earlier times, and how much earlier."""
        held = variables_in_any(expressions) if self._scratch.delayed else {}
        return [delay for delay, variable in self._scratch.delayed.items() if id(variable) in held]

    def delayed_numbers(
        self, delays: Sequence[tuple[str, float]], past: Past, times: Array, widths: Array, fractions: Array
    ) -> dict[int, Array]:
        """Numbers of what rules have read at earlier times than these, by the identity of what stands for it.

        Parameters
        ----------
        delays : sequence of (name, delay)
            What is read, of what rules have read so far.
        past : callable
            ``past(name, times)``: values from the start of the phase on.
        times, widths, fractions : array
            At these fractions of elements with these widths; they make one shape.
        """
        start, end = self.grid.mesh.boundaries[0], self.grid.mesh.boundaries[-1]
        found = {}
        for name, delay in delays:
            # A hair inside of each element: history ends, and all but states may jump, where they meet.
            inside = times - delay + SAME_TIME * (0.5 - fractions) * widths
            earlier = times - delay if name in self.record.names_of_states else inside
            has_history = getattr(self.record.declarations[name], "history", None) is not None
            before = inside < (start if has_history else start - 1e-9 * (end - start))
            numbers = np.empty(times.shape)
            if not before.all():
                numbers[~before] = past(name, earlier[~before])
            asked = inside[before].tolist()
            numbers[before] = [float(value(history_value(self.record, name, at, f"'{name}'", delay))) for at in asked]
            found[id(self._scratch.delayed[name, delay])] = numbers
        return found
