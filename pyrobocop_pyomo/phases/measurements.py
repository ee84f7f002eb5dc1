"""`label_measurements`: measured data of a phase, labelled as `pyomo.contrib.parmest` reads it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.core.base.expression import Expression
from pyomo.core.base.suffix import Suffix
from pyomo.core.expr import LinearExpression
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import DeclarationError
from pyrobocop_pyomo.numerics import Array

from .declarations import Parameter


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
        States, algebraics and controls that were measured; everything in the data by default.
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
    DeclarationError
        When names, times or values do not fit, or an output of the phase is labelled already.
    """
    what = f"phase '{phase.name}'"
    if phase.has_normalised_time:
        raise DeclarationError(
            f"{what}: measurements have times that are numbers; give the phase a fixed duration, start and mesh."
        )
    times, series = _read(data, what)
    names = list(series) if outputs is None else list(outputs)
    known = [name for name, declaration in phase.record.declarations.items() if not isinstance(declaration, Parameter)]
    for name in names:
        if name not in known or name not in series:
            raise DeclarationError(
                f"{what}: the output '{name}' is {'not in the data' if name in known else 'no variable of the phase'}; "
                f"the phase has {', '.join(known)}, the data {', '.join(series)}."
            )
    grid = phase.grid
    slack = 1e-9 * (grid.times[-1] - grid.times[0])
    outside = times[(times < grid.times[0] - slack) | (times > grid.times[-1] + slack)]
    if len(outside):
        raise DeclarationError(
            f"{what}: measured at t = {outside[0]:g}; the phase runs from {grid.times[0]:g} to {grid.times[-1]:g}."
        )
    parameters = phase.record.names(Parameter)
    estimated = parameters if unknown is None else list(unknown)
    for name in estimated:
        if name not in parameters:
            raise DeclarationError(
                f"{what}: '{name}' is to be estimated; its parameters are {', '.join(parameters) or 'none'}."
            )
    deviations = error if isinstance(error, Mapping) else dict.fromkeys(names, error)
    if set(deviations) != set(names):
        raise DeclarationError(f"{what}: error has {sorted(deviations)}, the outputs are {sorted(names)}.")
    for name in names:
        if phase.component(f"{name}_measured") is not None:
            raise DeclarationError(f"{what}: '{name}' is labelled already; label a model that is freshly built.")
    for suffix in ("experiment_outputs", "measurement_error", "unknown_parameters"):
        if model.component(suffix) is None:  # another phase may have been labelled
            model.add_component(suffix, Suffix(direction=Suffix.LOCAL))
    for name in names:
        predicted = Expression(times.tolist(), initialize={t: _at(phase, name, t) for t in times.tolist()})
        phase.add_component(f"{name}_measured", predicted)
        for time, measured in zip(times.tolist(), series[name].tolist(), strict=True):
            model.experiment_outputs[predicted[time]] = measured
            model.measurement_error[predicted[time]] = deviations[name]
    for name in estimated:
        variable = phase.component(name)
        model.unknown_parameters[variable] = value(variable)
    return model


def _at(phase: Any, name: str, time: float) -> Any:
    """A variable at any time, as the scheme has it between nodes."""
    nodes = phase.record.nodes(name)
    variables, weights = nodes.variables(phase), nodes.weights_at(time)
    return LinearExpression(
        linear_coefs=[weight for _, weight in weights], linear_vars=[variables[i] for i, _ in weights]
    )


def _read(data: Any, label: str) -> tuple[Array, dict[str, Array]]:
    try:
        if isinstance(data, Mapping):
            series = {name: np.asarray(samples, dtype=float) for name, samples in data.items()}
            times = series.pop("time")
        else:  # a data frame, without asking pandas what that is
            times = np.asarray(data.index, dtype=float)
            series = {str(name): np.asarray(data[name], dtype=float) for name in data.columns}
    except KeyError:
        raise DeclarationError(f"{label}: the data have no 'time'; they have {', '.join(data)}.") from None
    except (AttributeError, TypeError, ValueError) as error:
        raise DeclarationError(
            f"{label}: measurements are a data frame with times as index, or a mapping of names to numbers with the "
            f"key 'time' ({error})."
        ) from None
    for name, samples in (("time", times), *series.items()):
        if samples.shape != (len(times),) or not np.isfinite(samples).all():
            raise DeclarationError(f"{label}: the data of '{name}' are not {len(times)} finite numbers.")
    if len(np.unique(times)) != len(times):
        raise DeclarationError(f"{label}: the data have a time twice; give repeated measurements as experiments.")
    return times, series
