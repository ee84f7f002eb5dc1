"""Outputs of a phase at any time: states, algebraics, controls, indexed Expressions and rules, as expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
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
    given : list of str
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
        self.given = list(outputs or ())
        self._rules: dict[str, Any] = {}
        for name, of in (outputs if isinstance(outputs, Mapping) else {}).items():
            self._rules[name] = Template(of if callable(of) else self._rule_of(of))

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
        if name not in self._rules:
            self._rules[name] = Template(self._rule_of(name))
        return self._by_rule(name, self._rules[name], time)

    def _rule_of(self, name: str) -> Callable[[Any, Any], Any]:
        """What says a declared name or an indexed Expression at each time."""
        component = self._phase.component(name)
        if component is None or not component.is_indexed():
            known = [*self._phase.record.names_of_states, *self._phase.record.names_of_signals]
            raise EstimationError(
                f"{self._what}: the output '{name}' is no state, algebraic or control, no Expression over its times, "
                f"and no rule was given for it in outputs=. The phase has {', '.join(known)}."
            )
        return lambda b, t: b.component(name)[t]

    def _at_time(self, slot: Slot, time: float) -> Any:
        """What the polynomials have in the place of what a rule reads."""
        if isinstance(slot, NamedItem):
            return slot.formulas(EstimationError).at(lambda inner: self._at_time(inner, time))
        if isinstance(slot, Item) and slot.rest == (None,) and slot.component.parent_block() is self._phase:
            name, record = slot.component.local_name, self._phase.record
            if name in record.declarations:
                nodes = record.nodes(name)
                variables = nodes.variables(self._phase)
                return sum(weight * variables[i] for i, weight in nodes.weights_at(time))
        return slot.on_model(Place(self._phase, time))

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
                "variables through its first argument, since models are copied."
            )
        return found
