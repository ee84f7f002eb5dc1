"""From models and data to experiments: a model each, with what was measured on it as expressions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentSet
from pyomo.core.base.block import BlockData
from pyomo.core.base.objective import Objective
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.optional_imports import parmest_models
from pyrobocop_pyomo.phases import Control, Parameter, phases_of
from pyrobocop_pyomo.phases.nodes import IntervalNodes

from .data_sets import DataSet, deviations_of
from .outputs import PhaseOutputs, measured_phase

LABELS = ("experiment_outputs", "unknown_parameters", "measurement_error")


@dataclass(frozen=True, eq=False)
class Measurement:
    """One measured number and what the model says of it.

    Attributes
    ----------
    output : str
    time : float
        NaN where it has none.
    predicted : Pyomo expression
    measured : float
        NaN where it is missing.
    deviation : float or None
        Standard deviation; None where it is not known.
    """

    output: str
    time: float
    predicted: Any
    measured: float
    deviation: float | None


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
    parameters : dict of name to list of VarData
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


@dataclass(frozen=True)
class ExperimentPlan:
    """What is required of all experiments alike; see `estimate`."""

    parameters: Sequence[str] | None = None
    outputs: Any = None
    phase: Any = None
    error: Any = None
    initial: str | Sequence[str] = "known"
    guess_from_data: bool = True


def labelled_experiment(model: Any, name: str, plan: ExperimentPlan) -> Experiment:
    """An experiment from a model with the labels of parmest.

    Parameters
    ----------
    model : Block
        A copy that may be changed.
    name : str
    plan : ExperimentPlan

    Raises
    ------
    EstimationError
        When labels are missing or make no sense.
    """
    for label in LABELS[:2]:
        suffix = model.component(label)
        if suffix is None or suffix.ctype is not Suffix or not len(suffix):
            raise EstimationError(
                f"{name}: the model '{model.name}' has no suffix '{label}' with entries. A labelled model has "
                "experiment_outputs and unknown_parameters; a phase is measured by data=."
            )
    unknown = [component.name for component in model.unknown_parameters]
    wanted = unknown if plan.parameters is None else list(plan.parameters)
    params = [component.name for component in model.unknown_parameters if not _is_variable(component)]
    if params:
        model = parmest_models.convert_params_to_vars(model, params, fix_vars=False)
    errors = model.component("measurement_error")
    measurements = []
    for component, given in model.experiment_outputs.items():
        output, time = _output_label(component)
        deviation = None if errors is None else errors.get(component)
        deviation = plan.error if deviation is None and isinstance(plan.error, (int, float)) else deviation
        if deviation is not None and not float(deviation) > 0.0:
            raise EstimationError(
                f"{name}: the measurement_error of '{component.name}' is {deviation!r}, not positive."
            )
        several = given if isinstance(given, Iterable) and not isinstance(given, str) else [given]
        for number in several:
            measured = np.nan if number is None else float(value(number))
            deviation = None if deviation is None else float(deviation)
            measurements.append(Measurement(output, time, component, measured, deviation))
    parameters = {}
    for one in wanted:
        parameters.update(_members(model, model, one, f"{name}: model '{model.name}'"))
    return _experiment(name, model, None, measurements, parameters, {})


def phase_experiment(model: Any, data: DataSet, plan: ExperimentPlan) -> Experiment:
    """An experiment from a model with a phase, and data.

    Parameters
    ----------
    model : Block
        A copy that may be changed.
    data : DataSet
    plan : ExperimentPlan

    Raises
    ------
    EstimationError
        When data, outputs, inputs or parameters do not fit.
    """
    phase = measured_phase(model, plan.phase, phases_of(model))
    outputs = PhaseOutputs(phase, plan.outputs)
    what = f"data set '{data.name}'"
    if data.error is None and plan.error is not None:
        data = _with_error(data, plan.error)
    series = dict(data.series)
    inputs = {**data.inputs}
    controls = phase.record.names(Control)
    if outputs.names is None:
        # A control among the data was applied, unless it is said to be an output.
        for control in controls:
            if control in series and control not in inputs:
                inputs[control] = series.pop(control)
        names = list(series)
    else:
        names = outputs.names
        for column in [column for column in series if column not in names]:
            if column in controls and column not in inputs:
                inputs[column] = series[column]
    for name in names:
        if name not in series:
            if plan.outputs is not None and any(name in data.series for name in names):
                continue  # another data set may have it
            raise EstimationError(f"{what}: has no data of '{name}'; it has {', '.join(data.series)}.")
        if not outputs.knows(name):
            outputs.at(name, phase.grid.mesh.boundaries[0])  # says what there is
    _apply_inputs(phase, inputs, what)
    _set_starts(phase, data, what)
    measurements = []
    for name in names:
        if name not in series:
            continue
        times, values = series[name]
        deviations = deviations_of(data, name, len(values))
        for i, (time, measured) in enumerate(zip(times.tolist(), values.tolist(), strict=True)):
            deviation = None if deviations is None else float(deviations[i])
            measurements.append(Measurement(name, time, outputs.at(name, time), measured, deviation))
    if isinstance(data.error, Mapping):
        unknown = [name for name in data.error if name not in series]
        if unknown:
            raise EstimationError(f"{what}: has an error for '{unknown[0]}', but no data of it.")
    if plan.guess_from_data:
        _guess_from(phase, series)
    declared = phase.record.names(Parameter)
    wanted = plan.parameters
    if wanted is None:
        wanted = [name for name in declared if not phase.component(name).fixed]
        if not wanted:
            raise EstimationError(
                f"phase '{phase.name}': has no free rcp.Parameter. Name what is to be estimated by parameters=."
            )
    parameters: dict[str, Any] = {}
    for one in wanted:
        parameters.update(_members(model, phase, one, what))
    for name in declared:
        if phase.component(name) not in ComponentSet(parameters.values()):
            phase.component(name).fix()  # known, where others are named
    starts = _free_starts(phase, plan.initial, data, what)
    return _experiment(data.name, model, phase, measurements, parameters, starts)


def _experiment(
    name: str,
    model: Any,
    phase: Any,
    measurements: list[Measurement],
    parameters: dict[str, Any],
    starts: dict[str, Any],
) -> Experiment:
    if not any(np.isfinite(each.measured) for each in measurements):
        raise EstimationError(f"{name}: there is nothing measured in it.")
    for objective in model.component_data_objects(Objective, active=True):
        objective.deactivate()
    for member in parameters.values():
        if member.value is None:
            raise EstimationError(f"'{member.name}': has no value to start from. Give it an initial guess.")
        member.unfix()
    return Experiment(name, model, phase, measurements, parameters, starts)


def _is_variable(component: Any) -> bool:
    return component.ctype is Var


def _output_label(component: Any) -> tuple[str, float]:
    """Name and time of a labelled output: its index is the time where it is one number."""
    index = component.index()
    if isinstance(index, (int, float)) and not isinstance(index, bool):
        return component.parent_component().name, float(index)
    return component.name, np.nan


def _members(model: Any, block: Any, name: Any, label: str) -> dict[str, Any]:
    """The variables behind the name of a parameter, by their own names."""
    if not isinstance(name, str):
        name = getattr(name, "name", name)
    component = block.component(name) if isinstance(name, str) else None
    component = model.find_component(name) if component is None and isinstance(name, str) else component
    if component is None:
        known = [each.local_name for each in block.component_objects(Var, descend_into=False) if not each.is_indexed()]
        raise EstimationError(f"{label}: there is no parameter '{name}'; there are {', '.join(known) or 'none'}.")
    if component.ctype is not Var:
        raise EstimationError(
            f"{label}: '{name}' is a {type(component).__name__}; only variables can be estimated. Declare it as "
            "rcp.Parameter or as a Var."
        )
    if not component.is_indexed():
        return {name: component}
    return {f"{name}[{index}]": member for index, member in component.items()}


def _with_error(data: DataSet, error: Any) -> DataSet:
    if isinstance(error, Mapping):
        error = {name: each for name, each in error.items() if name in data.series}
    return DataSet(data.measurements, error=error, inputs=data.inputs, initial=data.initial, name=data.name)


def _apply_inputs(phase: Any, inputs: Mapping[str, Any], what: str) -> None:
    """Fix controls at what was applied."""
    controls = phase.record.names(Control)
    for name, given in inputs.items():
        if name not in controls:
            raise EstimationError(
                f"{what}: the input '{name}' is no control of phase '{phase.name}'; it has "
                f"{', '.join(controls) or 'none'}."
            )
        nodes = phase.record.nodes(name)
        label = f"{what}: the input '{name}'"
        if isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) == 1:
            times, values = (np.asarray(each, dtype=float) for each in given)
            known = np.isfinite(values)
            if times.shape != values.shape or not known.any() or (np.diff(times) <= 0.0).any():
                raise EstimationError(f"{label} needs as many values as times, and times that increase.")
            ends = phase.grid.mesh.boundaries
            slack = 1e-9 * (ends[-1] - ends[0])
            begins = ends[0] if isinstance(nodes, IntervalNodes) else min(nodes.sample_times)
            if times[known][0] > begins + slack or times[known][-1] < max(nodes.sample_times) - slack:
                raise EstimationError(
                    f"{label} is known from t = {times[known][0]:g} to {times[known][-1]:g}, but is needed from "
                    f"{begins:g} to {max(nodes.sample_times):g}. Give it over the whole phase, or as a function of "
                    "time."
                )
            given = nodes.from_samples(np.interp(nodes.sample_times, times[known], values[known]))
        for variable, number in zip(nodes.variables(phase), nodes.from_guess(given, label).tolist(), strict=True):
            variable.fix(number, skip_validation=True)
    free = [
        name
        for name in controls
        if name not in inputs and any(not variable.fixed for variable in phase.record.nodes(name).variables(phase))
    ]
    if free:
        raise EstimationError(
            f"{what}: nothing says what the control '{free[0]}' of phase '{phase.name}' was. Give it as a column of "
            "the data or by DataSet(inputs=...), fix it on the model, or declare it as an Algebraic if equations "
            "determine it."
        )


def _set_starts(phase: Any, data: DataSet, label: str) -> None:
    states = phase.record.names_of_states
    for name, number in data.initial.items():
        if name not in states:
            raise EstimationError(
                f"{label}: the initial value of '{name}' is for no state; there are {', '.join(states)}."
            )
        if not np.isfinite(float(number)):
            raise EstimationError(f"{label}: the initial value of '{name}' is {number!r}.")
        phase.component(name)[phase.time.first()].fix(float(number), skip_validation=True)


def _free_starts(phase: Any, initial: Any, data: DataSet, label: str) -> dict[str, Any]:
    """Start values that are to be estimated: those that the model leaves free, and those that are requested."""
    states = phase.record.names_of_states
    if initial == "estimated":
        asked = [name for name in states if name not in data.initial]
    elif initial == "known":
        asked = []
    elif isinstance(initial, Sequence) and not isinstance(initial, str):
        asked = list(initial)
    else:
        raise EstimationError(f"initial = {initial!r}; expected 'known', 'estimated' or names of states.")
    found = {}
    for name in asked:
        if name not in states:
            raise EstimationError(f"{label}: initial names '{name}', which is no state; there are {', '.join(states)}.")
    for name in states:
        variable = phase.component(name)[phase.time.first()]
        if name in asked:
            variable.unfix()
        if not variable.fixed:
            found[name] = variable
    return found


def _guess_from(phase: Any, series: Mapping[str, Any]) -> None:
    """Start measured states and algebraics from their measurements."""
    names = [*phase.record.names_of_states, *phase.record.names_of_signals]
    for name in names:
        if name not in series:
            continue
        times, values = series[name]
        known = np.isfinite(values)
        if not known.any():
            continue
        order = np.argsort(times[known], kind="stable")
        nodes = phase.record.nodes(name)
        guess = np.interp(nodes.times, times[known][order], values[known][order])
        for variable, number in zip(nodes.variables(phase), guess.tolist(), strict=True):
            if not variable.fixed:
                lower, upper = variable.bounds
                number = number if lower is None else max(number, lower)
                variable.set_value(number if upper is None else min(number, upper), skip_validation=True)


def model_of_experiment(given: Any) -> Any:
    """The labelled model of an object with ``get_labeled_model``, as a copy; or a copy of a model.

    Raises
    ------
    EstimationError
    """
    if hasattr(given, "get_labeled_model"):
        found = given.get_labeled_model()
        if not isinstance(found, BlockData):
            raise EstimationError(
                f"{type(given).__name__}.get_labeled_model() returned {type(found).__name__}, no model."
            )
        given = found
    if not isinstance(given, BlockData) or not given.is_constructed():
        raise EstimationError(f"expected a model, found {type(given).__name__}.")
    return given.clone()
