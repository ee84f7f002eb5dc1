"""From models and data to experiments: a model each, with what was measured on it as expressions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap, ComponentSet
from pyomo.core.base.objective import Objective
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.optional_imports import parmest_models
from pyrobocop_pyomo.phases import Control, Parameter, phases_of
from pyrobocop_pyomo.phases.nodes import IntervalNodes

from .data_sets import DataSet, Series
from .outputs import PhaseOutputs


@dataclass(frozen=True, eq=False)
class Measurement:
    """One measured number and what the model says of it.

    Attributes
    ----------
    data_set : str
    output : str
    time : float
        NaN where it has none.
    predicted : Pyomo expression
    measured : float
        NaN where it is missing.
    deviation : float
        Standard deviation; NaN where it is not known.
    """

    data_set: str
    output: str
    time: float
    predicted: Any
    measured: float
    deviation: float


@dataclass(eq=False)
class Experiment:
    """A model with measurements.

    Attributes
    ----------
    name : str
    model : Block
        A copy, whose objective is switched off.
    phase : PhaseBlock or None
        That was measured; None for a model that is labelled.
    measurements : list of Measurement
    parameters : dict of name to VarData
        What is to be estimated, by the name that the user knows it by.
    starts : dict of state name to VarData
        Values at the start that are to be estimated, too.
    """

    name: str
    model: Any
    phase: Any
    measurements: list[Measurement]
    parameters: dict[str, Any]
    starts: dict[str, Any]

    def __post_init__(self) -> None:
        if not any(np.isfinite(each.measured) for each in self.measurements):
            raise EstimationError(f"{self.name}: there is nothing measured in it.")
        for objective in self.model.component_data_objects(Objective, active=True):
            objective.deactivate()
        for member in self.parameters.values():
            if member.value is None:
                raise EstimationError(f"'{member.name}': has no value to start from. Give it an initial guess.")
            member.unfix()


def labelled_experiment(model: Any, name: str, parameters: Sequence[str] | None, error: Any) -> Experiment:
    """An experiment from a model with the labels of parmest.

    Parameters
    ----------
    model : Block
        A copy that may be changed.
    name : str
    parameters, error
        As for `estimate`.

    Raises
    ------
    EstimationError
        When labels are missing or make no sense.
    """
    for label in ("experiment_outputs", "unknown_parameters"):
        suffix = model.component(label)
        if suffix is None or suffix.ctype is not Suffix or not len(suffix):
            raise EstimationError(
                f"{name}: the model '{model.name}' has no suffix '{label}' with entries. A labelled model has "
                "experiment_outputs and unknown_parameters; a phase is measured by data=."
            )
    unknown = [component.name for component in model.unknown_parameters]
    params = [component.name for component in model.unknown_parameters if component.ctype is not Var]
    if params:
        model = parmest_models.convert_params_to_vars(model, params, fix_vars=False)
    errors = model.component("measurement_error") or ComponentMap()
    measurements = []
    for component, given in model.experiment_outputs.items():
        index, output, time = component.index(), component.name, np.nan
        if isinstance(index, (int, float)) and not isinstance(index, bool):  # one number is taken for the time
            output, time = component.parent_component().name, float(index)
        deviation = errors.get(component)
        deviation = error if deviation is None and isinstance(error, (int, float)) else deviation
        if deviation is not None and not float(deviation) > 0.0:
            raise EstimationError(
                f"{name}: the measurement_error of '{component.name}' is {deviation!r}, not positive."
            )
        numbers = (np.nan if each is None else float(value(each)) for each in (given, deviation))
        measurements.append(Measurement(name, output, time, component, *numbers))
    wanted = unknown if parameters is None else parameters
    return Experiment(
        name, model, None, measurements, variables_named(model, model, wanted, f"{name}: '{model.name}'"), {}
    )


def phase_experiment(
    model: Any, data: DataSet, parameters: Sequence[str] | None, error: Any, outputs: Any, phase: Any, initial: Any
) -> Experiment:
    """An experiment from a model with a phase, and data.

    Parameters
    ----------
    model : Block
        A copy that may be changed.
    data : DataSet
    parameters, error, outputs, phase, initial
        As for `estimate`.

    Raises
    ------
    EstimationError
        When data, outputs, inputs or parameters do not fit.
    """
    phase, what = _measured_phase(model, phase), f"data set '{data.name}'"
    measurable, controls = PhaseOutputs(phase, outputs), phase.record.names(Control)
    applied = [name for name in data.series if name in controls and name not in {**data.inputs, **measurable.given}]
    inputs = {**data.inputs, **{name: data.series[name] for name in applied}}
    names = list(measurable.given) or [name for name in data.series if name not in applied]
    measurements = []
    for name, rows in data.samples(names, error).items():
        for time, *numbers in rows.tolist():
            measurements.append(Measurement(data.name, name, time, measurable.at(name, time), *numbers))
    _apply_inputs(phase, inputs, what)
    starts = _free_starts(phase, initial, data.initial, what)
    _guess_from(phase, {name: data.series[name] for name in names if name in data.series})
    declared = phase.record.names(Parameter)
    wanted = [name for name in declared if not phase.component(name).fixed] if parameters is None else parameters
    if not wanted:
        raise EstimationError(
            f"phase '{phase.name}': has no free rcp.Parameter. Name what is to be estimated by parameters=."
        )
    unknown = variables_named(model, phase, wanted, what)
    for name in declared:
        if phase.component(name) not in ComponentSet(unknown.values()):
            phase.component(name).fix()  # known, where others are named
    return Experiment(data.name, model, phase, measurements, unknown, starts)


def _measured_phase(model: Any, phase: Any) -> Any:
    """The phase of a model that was measured: by its name, by that which it is a copy of, or the only one."""
    phases = {each.name: each for each in phases_of(model)}
    name = getattr(phase, "name", phase)
    if name is None and len(phases) == 1:
        (name,) = phases
    if name not in phases:
        raise EstimationError(
            f"'{model.name}': has no phase '{name}'; say by phase= which one was measured of "
            f"{', '.join(phases) or 'none'}. A model without phases is labelled by the suffixes experiment_outputs and "
            "unknown_parameters."
        )
    return phases[name]


def variables_named(model: Any, block: Any, names: Sequence[Any], label: str) -> dict[str, Any]:
    """The variables behind the names of parameters, by their own names.

    Raises
    ------
    EstimationError
        When there is none of a name on the block or the model.
    """
    found: dict[str, Any] = {}
    for name in (getattr(each, "name", each) for each in names):
        component = block.component(name)
        component = model.find_component(name) if component is None else component
        if component is None:
            known = [
                each.local_name for each in block.component_objects(Var, descend_into=False) if not each.is_indexed()
            ]
            raise EstimationError(f"{label}: there is no parameter '{name}'; there are {', '.join(known) or 'none'}.")
        if component.ctype is not Var:
            raise EstimationError(
                f"{label}: '{name}' is a {type(component).__name__}; only variables can be estimated. Declare it as "
                "rcp.Parameter or as a Var."
            )
        is_indexed = component.is_indexed()
        found |= {f"{name}[{i}]": each for i, each in component.items()} if is_indexed else {name: component}
    return found


def _apply_inputs(phase: Any, inputs: Mapping[str, Any], what: str) -> None:
    """Fix controls at what was applied."""
    controls = phase.record.names(Control)
    for name, given in inputs.items():
        label = f"{what}: the input '{name}'"
        if name not in controls:
            raise EstimationError(
                f"{label} is no control of phase '{phase.name}'; it has {', '.join(controls) or 'none'}."
            )
        nodes = phase.record.nodes(name)
        if isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) == 1:
            times, values = (np.asarray(each, dtype=float) for each in given)
            known = np.isfinite(values)
            if times.shape != values.shape or not known.any() or (np.diff(times) <= 0.0).any():
                raise EstimationError(f"{label} needs as many values as times, and times that increase.")
            start, *_, end = phase.grid.mesh.boundaries
            begins, ends = (
                start if isinstance(nodes, IntervalNodes) else min(nodes.sample_times),
                max(nodes.sample_times),
            )
            slack = 1e-9 * (end - start)
            if times[known][0] > begins + slack or times[known][-1] < ends - slack:
                raise EstimationError(
                    f"{label} is known from t = {times[known][0]:g} to {times[known][-1]:g}, but is needed from "
                    f"{begins:g} to {ends:g}. Give it over the whole phase, or as a function of time."
                )
            given = partial(np.interp, xp=times[known], fp=values[known])
        for variable, number in zip(nodes.variables(phase), nodes.from_guess(given, label).tolist(), strict=True):
            variable.fix(number, skip_validation=True)
    for name in controls:
        if not all(variable.fixed for variable in phase.record.nodes(name).variables(phase)):
            raise EstimationError(
                f"{what}: nothing says what the control '{name}' of phase '{phase.name}' was. Give it as a column of "
                "the data or by DataSet(inputs=...), fix it on the model, or declare it as an Algebraic if equations "
                "determine it."
            )


def _free_starts(phase: Any, initial: Any, known: Mapping[str, float], label: str) -> dict[str, Any]:
    """Start values that are to be estimated: what the model leaves free, and the requested ones; others are set."""
    first = {name: phase.component(name)[phase.time.first()] for name in phase.record.names_of_states}
    if initial in ("known", "estimated"):
        asked = [name for name in first if initial == "estimated" and name not in known]
    elif isinstance(initial, Sequence) and not isinstance(initial, str):
        asked = list(initial)
    else:
        raise EstimationError(f"initial = {initial!r}; expected 'known', 'estimated' or names of states.")
    for name in (*asked, *known):
        if name not in first or not np.isfinite(float(known.get(name, 0.0))):
            what = f"initial names '{name}'" if name in asked else f"the initial value of '{name}' is {known[name]!r}"
            raise EstimationError(f"{label}: {what}; expected finite numbers for states: {', '.join(first)}.")
    for name, number in known.items():
        first[name].fix(float(number), skip_validation=True)
    for name in asked:
        first[name].unfix()
    return {name: variable for name, variable in first.items() if not variable.fixed}


def _guess_from(phase: Any, series: Mapping[str, Series]) -> None:
    """Start measured states and algebraics from their measurements."""
    for name in (*phase.record.names_of_states, *phase.record.names_of_signals):
        times, values = series.get(name, (np.zeros(0), np.zeros(0)))
        known = np.flatnonzero(np.isfinite(values))
        if known.size:
            order = known[np.argsort(times[known], kind="stable")]
            phase.initialize({name: partial(np.interp, xp=times[order], fp=values[order])})
