"""`label_measurements`: measured data of a phase, labelled as `pyomo.contrib.parmest` reads it.

Outputs of a phase at any time: states, algebraics, controls, indexed Expressions and rules, as expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.core.base.expression import Expression
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.optional_imports import pandas
from pyrobocop_pyomo.phases import Control, Parameter
from pyrobocop_pyomo.templates.slots import Item, NamedItem, Place, Slot
from pyrobocop_pyomo.templates.template import Template

# -------------------------------------------------------------------------------------------------------------- outputs


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
        output = formulas.at(lambda slot: self._at_time(slot, time))
        if not hasattr(output, "is_expression_type"):
            raise EstimationError(
                f"{self._what}: the rule of the output '{name}' returned {output!r}; expected an expression in the "
                "variables of the phase."
            )
        model = self._phase.model()
        strangers = [variable.name for variable in variables_in(output) if variable.model() is not model]
        if strangers:
            raise EstimationError(
                f"{self._what}: the rule of the output '{name}' reads '{strangers[0]}' of another model. Let it read "
                "variables through its first argument, since models are copied."
            )
        return output


# ----------------------------------------------------------------------------------------------------------- estimation


LABELS = ("experiment_outputs", "measurement_error", "unknown_parameters")


def label_measurements(
    model: Any,
    phase: Any,
    data: Any,
    *,
    outputs: Any = None,
    error: float | Mapping[str, float] | None = None,
    unknown: Sequence[Any] | None = None,
) -> Any:
    """Label a model with measurements of one of its phases: the last step of an experiment's ``get_labeled_model``.

    Called again, for other outputs or another phase of the model, it adds to the labels.

    Makes the suffixes ``experiment_outputs``, ``measurement_error`` and ``unknown_parameters`` on the model, and on the
    phase an expression ``<name>_measured[time]`` per output: the scheme's polynomial at the times of the data,
    which need not be times of the grid.

    Parameters
    ----------
    model : ConcreteModel
        Where `estimate` and parmest look for the suffixes.
    phase : PhaseBlock
        With a fixed start and duration, and controls that are fixed at what was applied. Times of the data are those of
        the phase.
    data : DataFrame or mapping
        A frame has the times as its index. Of a mapping pandas makes a frame: the times are under ``"time"``, or each
        output is a Series with times of its own. NaN stands for what is missing; `estimate` knows what to do with it,
        parmest expects all outputs at each time.
    outputs : list of str, or mapping of str to rule or to name of an Expression, optional
        What was measured: states, algebraics, controls, Expressions indexed by the times of the phase, or rules
        ``rule(phase, t)``; by default all columns of the data.
    error : number or mapping of output to number, optional
        Standard deviation of the measurements; not known by default.
    unknown : list of str or Var, optional
        What is to be estimated: names of parameters or variables, such as values at the start. All free parameters of
        the phase by default. Equations of the model say what the others are, or they are fixed.

    Returns
    -------
    model
        The same, so that it can be returned.

    Raises
    ------
    EstimationError
        When names, times or values do not fit, a control is free, or an output of the phase is labelled already.
    """
    where, measurable = f"phase '{phase.name}'", PhaseOutputs(phase, outputs)
    for name in phase.record.names(Control):
        if not all(variable.fixed for variable in phase.record.nodes(name).variables(phase)):
            raise EstimationError(
                f"{where}: nothing says what the control '{name}' was. Give it its values by initialize(), and fix() "
                "it; or declare it as an Algebraic if equations determine it."
            )
    frame = _table(data, where)
    names = measurable.given or list(frame.columns)
    errors = error if isinstance(error, Mapping) else dict.fromkeys(names, error)
    for given in (names, errors):
        if missing := [name for name in given if name not in frame.columns]:
            raise EstimationError(f"{where}: there are no data of '{missing[0]}', but of {', '.join(frame.columns)}.")
    deviations = {name: _deviation(errors.get(name), f"{where}: the error of '{name}'") for name in names}
    if unknown is None:
        declared = [each for name in phase.record.names(Parameter) for each in phase.component(name).values()]
        variables = [variable for variable in declared if not variable.fixed]
    else:
        variables = [variable for each in unknown for variable in _variables_named(model, phase, each, where)]
    predicted = {}
    for name in names:
        if phase.component(f"{name}_measured") is not None:
            raise EstimationError(f"{where}: '{name}' is labelled already; label a model that is freshly built.")
        times = frame[name].dropna().index.tolist()
        if len(set(times)) != len(times):
            raise EstimationError(
                f"{where}: the data of '{name}' have a time twice; a model has one value at each time. Give repeated "
                "measurements as experiments."
            )
        predicted[name] = Expression(times, initialize={t: measurable.at(name, t) for t in times})
    for label in LABELS:
        if model.component(label) is None:
            model.add_component(label, Suffix(direction=Suffix.LOCAL))
    for name, expressions in predicted.items():
        phase.add_component(f"{name}_measured", expressions)
        for time, number in frame[name].dropna().items():
            model.experiment_outputs[expressions[time]] = number
            model.measurement_error[expressions[time]] = deviations[name]
    model.unknown_parameters.update((variable, variable.value) for variable in variables)
    return model


def _table(data: Any, label: str) -> Any:
    """The data as a frame with the times as its index."""
    try:
        frame = pandas.DataFrame(data)
        if "time" in frame:
            frame = frame.set_index("time")
        elif not hasattr(data, "columns") and not all(isinstance(each, pandas.Series) for each in data.values()):
            raise ValueError("there are no times; give the key 'time', or each output as a Series")
        frame = frame.astype(float).set_axis(frame.index.astype(float))
    except (AttributeError, TypeError, ValueError) as error:
        raise EstimationError(
            f"{label}: expected a data frame with the times as its index, or a mapping from 'time' and outputs to "
            f"numbers: {error}."
        ) from None
    bad = ~np.isfinite(frame.index) | np.isinf(frame).any(axis=1)
    if bad.any():
        raise EstimationError(f"{label}: the data are infinite at t = {frame.index[bad][0]:g}; a missing value is NaN.")
    return frame


def _deviation(given: Any, label: str) -> float | None:
    if given is not None and not (isinstance(given, (int, float)) and 0.0 < given < np.inf):
        raise EstimationError(f"{label} is {given!r}; expected a standard deviation, a positive number.")
    return given


def _variables_named(model: Any, phase: Any, given: Any, label: str) -> list[Any]:
    """The variables behind the name of a parameter of a phase, or of a variable of the model."""
    name = getattr(given, "name", given)
    component = phase.component(name)
    component = model.find_component(name) if component is None else component
    if component is None or component.ctype is not Var:
        known = ", ".join(phase.record.names(Parameter))
        raise EstimationError(f"{label}: there is no variable '{name}' to estimate; its parameters are {known}.")
    return [*component.values()] if component.is_indexed() else [component]
