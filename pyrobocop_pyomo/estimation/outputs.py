"""Outputs of a phase at any time: states, algebraics, controls, indexed Expressions and rules, as expressions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pyomo.core.base.expression import Expression
from pyomo.core.expr import LinearExpression

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.rule_proxies import Signal, Signals
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.phases import Parameter
from pyrobocop_pyomo.phases.nodes import Nodes, StageNodes, StateNodes

# Relative to the duration: times of data are often rounded.
_SLACK = 1e-9


class PhaseOutputs:
    """What can be measured on a phase, at any time within it.

    Parameters
    ----------
    phase : PhaseBlock
    outputs : sequence of str, mapping or None
        Names; or a mapping from names to rules ``rule(phase, t)`` or to names of indexed Expressions.

    Raises
    ------
    EstimationError
        When times are not numbers on the phase, or an output does not exist.
    """

    def __init__(self, phase: Any, outputs: Any) -> None:
        self._phase, self._what = phase, f"phase '{phase.name}'"
        if phase.record.normalised:
            raise EstimationError(
                f"{self._what}: measurements have times that are numbers; give it a fixed start and duration."
            )
        self._given: dict[str, Any] = {}
        if isinstance(outputs, Mapping):
            self._given = {str(name): given for name, given in outputs.items()}
        elif isinstance(outputs, Sequence) and not isinstance(outputs, str):
            self._given = {str(name): str(name) for name in outputs}
        elif outputs is not None:
            raise EstimationError(
                f"outputs is {outputs!r}; expected a list of names, or a mapping of names to rules or Expressions."
            )
        for name, given in self._given.items():
            if not callable(given):
                self._nodes(name, given)

    @property
    def names(self) -> list[str] | None:
        """Those that were asked for; None where the data decide."""
        return list(self._given) or None

    def knows(self, name: str) -> bool:
        """Whether there is such an output."""
        return name in self._given or self._find(name) is not None

    def at(self, name: str, time: float) -> Any:
        """The output at a time, as the polynomials of the scheme have it there.

        Raises
        ------
        EstimationError
            When the output does not exist, the time is outside of the phase, or its rule cannot be asked there.
        """
        boundaries = self._phase.grid.mesh.boundaries
        slack = _SLACK * (boundaries[-1] - boundaries[0])
        if not boundaries[0] - slack <= time <= boundaries[-1] + slack:
            raise EstimationError(
                f"{self._what}: '{name}' was measured at t = {time:g}; the phase runs from {boundaries[0]:g} to "
                f"{boundaries[-1]:g}."
            )
        time = min(max(time, boundaries[0]), boundaries[-1])
        given = self._given.get(name, name)
        if callable(given):
            return self._by_rule(name, given, time)
        component, nodes = self._nodes(name, given)
        if component is None:
            variables = nodes.variables(self._phase)
            weights = nodes.weights_at(time)
            return LinearExpression(
                linear_coefs=[weight for _, weight in weights], linear_vars=[variables[i] for i, _ in weights]
            )
        return sum(weight * component[nodes.times[i]] for i, weight in nodes.weights_at(time))

    def _nodes(self, name: str, given: Any) -> tuple[Any, Nodes]:
        """The indexed Expression of an output, or None for a declared one, and where its values live."""
        found = self._find(given)
        if found is None:
            known = [*self._phase.record.names_of_states, *self._phase.record.names_of_signals]
            raise EstimationError(
                f"{self._what}: the output '{name}' is no state, algebraic or control, no Expression over its times, "
                f"and no rule was given for it in outputs=. The phase has {', '.join(known)}."
            )
        return found

    def _find(self, given: Any) -> tuple[Any, Nodes] | None:
        record = self._phase.record
        if isinstance(given, str):
            if given in record.declarations and not isinstance(record.declarations[given], Parameter):
                return None, record.nodes(given)
            given = self._phase.component(given)
        if getattr(given, "ctype", None) is not Expression or not given.is_indexed():
            return None
        if given.parent_block() is not self._phase:
            # A model was copied since: the same name there.
            given = self._phase.component(given.local_name)
        for nodes in (StateNodes(given.local_name, record.grid), StageNodes(given.local_name, record.grid)):
            if set(nodes.times) == set(given):
                return given, nodes
        return None

    def _by_rule(self, name: str, rule: Any, time: float) -> Any:
        signals = _AtTime(self, time)
        try:
            found = rule(signals.proxy_of(self._phase), time)
        except EstimationError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {error}".splitlines()[0]
            raise EstimationError(
                f"{self._what}: the rule of the output '{name}' cannot be asked at t = {time:g} ({reason}). It has to "
                "read variables through its first argument, and to be made of Pyomo's functions."
            ) from error
        if isinstance(found, (int, float)) or not hasattr(found, "is_expression_type"):
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


class _AtTime(Signals):
    """Signals of the phase as the polynomials have them at one time."""

    def __init__(self, outputs: PhaseOutputs, time: float) -> None:
        self._outputs, self.index = outputs, time

    def is_index(self, key: Any) -> bool:
        """By value: the time is a number here."""
        return isinstance(key, (int, float)) and key == self.index

    def value_of(self, signal: Signal) -> Any:
        """The interpolated variable."""
        phase = self._outputs._phase
        name = signal.component.local_name
        if signal.component.parent_block() is phase and len(signal.keys) == 1 and self._outputs._find(name):
            component, nodes = self._outputs._nodes(name, name)
            values = component if component is not None else dict(zip(nodes.times, nodes.variables(phase), strict=True))
            return sum(weight * values[nodes.times[i]] for i, weight in nodes.weights_at(self.index))
        return signal.component[signal.key_at(self.index)]

    def time_at(self, block: Any) -> Any:
        """The time itself: the phase is in real time."""
        return self.index


def measured_phase(model: Any, phase: Any, phases: Sequence[Any]) -> Any:
    """The phase of a model that was measured.

    Parameters
    ----------
    model : Block
    phase : PhaseBlock, str or None
        The phase, of this model or of one that it is a copy of, or its name; None where there is one only.
    phases : sequence of PhaseBlock
        Those of the model.

    Raises
    ------
    EstimationError
    """
    if phase is None:
        if len(phases) != 1:
            raise EstimationError(
                f"'{model.name}': has {len(phases)} phases; say by phase= which one was measured."
                if phases
                else f"'{model.name}': has no phase and no labels. Label what was measured by the suffixes "
                "experiment_outputs and unknown_parameters, or state a PhaseBlock."
            )
        return phases[0]
    name = phase if isinstance(phase, str) else phase.name
    found = model.find_component(name)
    if not any(found is each for each in phases):
        raise EstimationError(
            f"'{model.name}': has no phase '{name}'; it has {', '.join(each.name for each in phases) or 'none'}."
        )
    return found
