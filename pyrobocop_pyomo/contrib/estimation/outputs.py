"""Outputs of a phase at any time: states, algebraics, controls, indexed Expressions and rules, as expressions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pyomo.core.base.expression import Expression

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.phases import Parameter
from pyrobocop_pyomo.phases.nodes import Nodes, StageNodes, StateNodes
from pyrobocop_pyomo.templates.slots import Item, NamedItem, Place, Slot
from pyrobocop_pyomo.templates.template import Template


class PhaseOutputs:
    """What can be measured on a phase, at any time within it.

    Parameters
    ----------
    phase : PhaseBlock
    outputs : sequence of str, mapping or None
        Names; or a mapping from names to rules ``rule(phase, t)`` or to names of indexed Expressions.

    Attributes
    ----------
    given : dict of str to rule or str
        Those that were asked for; empty where the data decide.

    Raises
    ------
    EstimationError
        When times are no numbers on the phase, or there is no such output.
    """

    def __init__(self, phase: Any, outputs: Any) -> None:
        self._phase, self._what = phase, f"phase '{phase.name}'"
        if phase.record.normalised:
            raise EstimationError(
                f"{self._what}: measurements have times that are numbers; give it a fixed start and duration."
            )
        if outputs is not None and not isinstance(outputs, (Mapping, list, tuple)):
            raise EstimationError(
                f"outputs is {outputs!r}; expected a list of names, or a mapping of names to rules or Expressions."
            )
        names = outputs or ()
        given = dict(names) if isinstance(names, Mapping) else {name: name for name in names}
        self.given: dict[str, Any] = {name: Template(of) if callable(of) else of for name, of in given.items()}
        for name, given in self.given.items():
            if not callable(given):
                self.at(name, phase.grid.mesh.boundaries[0])  # says what there is

    def at(self, name: str, time: float) -> Any:
        """The output at a time, as the polynomials of the scheme have it there.

        Raises
        ------
        EstimationError
            When the output does not exist, the time is outside of the phase, or its rule cannot be asked there.
        """
        start, *_, end = self._phase.grid.mesh.boundaries
        slack = NEGLIGIBLE * (end - start)
        if not start - slack <= time <= end + slack:
            raise EstimationError(
                f"{self._what}: '{name}' was measured at t = {time:g}; the phase runs from {start:g} to {end:g}."
            )
        time = min(max(time, start), end)
        given = self.given.get(name, name)
        if callable(given):
            return self._by_rule(name, given, time)
        found = self.interpolated(given, time)
        if found is None:
            known = [*self._phase.record.names_of_states, *self._phase.record.names_of_signals]
            raise EstimationError(
                f"{self._what}: the output '{name}' is no state, algebraic or control, no Expression over its times, "
                f"and no rule was given for it in outputs=. The phase has {', '.join(known)}."
            )
        return found

    def interpolated(self, name: str, time: float) -> Any:
        """What the polynomials make of a declared name or an indexed Expression; None where there is none."""
        found = self._values(name)
        return None if found is None else sum(weight * found[1][i] for i, weight in found[0].weights_at(time))

    def _values(self, name: str) -> tuple[Nodes, Sequence[Any]] | None:
        """Where the values of a name are in time, and its variables or expressions there."""
        record, component = self._phase.record, self._phase.component(name)
        if name in record.declarations and not isinstance(record.declarations[name], Parameter):
            nodes: Nodes = record.nodes(name)
            return nodes, nodes.variables(self._phase)
        if getattr(component, "ctype", None) is Expression and component.is_indexed():
            for nodes in (StateNodes(name, record.grid), StageNodes(name, record.grid)):
                if set(nodes.times) == set(component):
                    return nodes, [component[t] for t in nodes.times]
        return None

    def _at_time(self, slot: Slot, time: float) -> Any:
        """What the polynomials have in the place of what a rule reads."""
        found = None
        if isinstance(slot, Item) and slot.rest == (None,) and slot.component.parent_block() is self._phase:
            found = self.interpolated(slot.component.local_name, time)
        if found is None and isinstance(slot, NamedItem):
            return slot.formulas(EstimationError).at(lambda inner: self._at_time(inner, time))
        return slot.on_model(Place(self._phase, time)) if found is None else found

    def _by_rule(self, name: str, rule: Any, time: float) -> Any:
        formulas = rule.formulas(self._phase)
        if formulas is None:
            raise EstimationError(
                f"{self._what}: the rule of the output '{name}' cannot be asked at t = {time:g}. It has to be made of "
                "Pyomo's functions, and not to know the time as a number: pyo.sin(t) for math.sin(t), no 'if' on t."
            )
        found = formulas.at(lambda slot: self._at_time(slot, time))
        if not hasattr(found, "is_expression_type"):
            raise EstimationError(
                f"{self._what}: the rule of the output '{name}' returned {found!r}; expected an expression in the "
                "variables of the phase."
            )
        model = self._phase.model()
        strangers = [variable.name for variable in variables_in(found) if variable.model() is not model]
        if strangers:
            raise EstimationError(
                f"{self._what}: the rule of the output '{name}' reads '{strangers[0]}' of another model. Let it read "
                "variables through its first argument, since each data set has a model of its own."
            )
        return found
