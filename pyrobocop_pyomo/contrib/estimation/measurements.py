"""`label_measurements`: measured data of a phase, labelled as `pyomo.contrib.parmest` reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.core.base.expression import Expression
from pyomo.core.base.suffix import Suffix

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.phases import Parameter

from .data_sets import DataSet
from .experiments import variables_named
from .outputs import PhaseOutputs


def label_measurements(
    model: Any,
    phase: Any,
    data: Any,
    *,
    outputs: Sequence[str] | None = None,
    error: float | Mapping[str, float] | None = None,
    unknown: Sequence[str] | None = None,
) -> Any:
    """Label a model with measurements of one of its phases: the last step of an experiment's ``get_labeled_model``.

    Called for several phases of a model, it adds to the labels.

    Makes the suffixes ``experiment_outputs``, ``measurement_error`` and ``unknown_parameters`` on the model, and on the
    phase an expression ``<name>_measured[time]`` per output: the scheme's polynomial at the times of the data,
    which need not be those of the grid.

    Parameters
    ----------
    model : ConcreteModel
        Where parmest looks for the suffixes.
    phase : PhaseBlock
        With a fixed start and duration. Times of the data are those of the phase.
    data : DataFrame or dict of str to array
        A frame has the times as its index, a dict under the key ``"time"``. Several outputs share the times, as parmest
        expects.
    outputs : sequence of str, optional
        What was measured, as for `estimate`; everything in the data by default.
    error : number or dict of str to number, optional
        Standard deviation of the measurements; unknown to parmest by default.
    unknown : sequence of str, optional
        Parameters of the phase to estimate; all of them by default. One that a link shares is named for one phase only.

    Returns
    -------
    model
        The same, so that it can be returned.

    Raises
    ------
    EstimationError
        When names, times or values do not fit, or an output of the phase is labelled already.
    """
    what, measurable = f"phase '{phase.name}'", PhaseOutputs(phase, outputs)
    measured = DataSet(data, error, name=phase.name)
    names = list(measurable.given) or list(measured.series)
    unknown = phase.record.names(Parameter) if unknown is None else unknown
    parameters = variables_named(model, phase, unknown, what)
    samples, predicted = measured.samples(names), {}
    for name in names:
        if phase.component(f"{name}_measured") is not None:
            raise EstimationError(f"{what}: '{name}' is labelled already; label a model that is freshly built.")
        times, values, _ = samples[name].T if name in samples else np.full((3, 1), np.nan)
        if not np.isfinite(values).all() or len(np.unique(times)) != len(times):
            raise EstimationError(
                f"{what}: the data of '{name}' are missing or have a time twice; parmest takes a number at each time. "
                "Give repeated measurements as experiments."
            )
        predicted[name] = Expression(times.tolist(), initialize={t: measurable.at(name, t) for t in times.tolist()})
    for suffix in ("experiment_outputs", "measurement_error", "unknown_parameters"):
        if model.component(suffix) is None:  # another phase may have been labelled
            model.add_component(suffix, Suffix(direction=Suffix.LOCAL))
    for name, expressions in predicted.items():
        phase.add_component(f"{name}_measured", expressions)
        for time, number, deviation in samples[name].tolist():
            model.experiment_outputs[expressions[time]] = number
            model.measurement_error[expressions[time]] = None if np.isnan(deviation) else deviation
    for variable in parameters.values():
        model.unknown_parameters[variable] = variable.value
    return model
