"""`EstimationProblem`: several experiments as one model with a sum of squares, whose data may be exchanged."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import ConstraintList
from pyomo.core.base.objective import Objective
from pyomo.core.base.param import Param
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Reals
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.modeling.variable_values import VariableValues
from pyrobocop_pyomo.numerics import Array

from .data_sets import as_data_sets
from .experiments import (
    LABELS,
    Experiment,
    ExperimentPlan,
    Measurement,
    labelled_experiment,
    model_of_experiment,
    phase_experiment,
)
from .output_sensitivities import OutputSensitivities

CRITERIA = ("least squares", "normalised rmse")


@dataclass(frozen=True, eq=False)
class EstimatedNumber:
    """A number that is estimated.

    Attributes
    ----------
    name : str
        Of a parameter; with the data set behind it, where each has its own.
    variable : VarData
        Of the first experiment that has it.
    copies : tuple of VarData
        Of the others, held equal to it.
    kind : {"shared", "own", "start"}
    """

    name: str
    variable: Any
    copies: tuple[Any, ...]
    kind: str

    def put(self, number: float) -> None:
        """Set the value, also where it is fixed."""
        for variable in (self.variable, *self.copies):
            variable.set_value(number, skip_validation=True)


class EstimationProblem:
    """Experiments whose unknowns are found together.

    Parameters
    ----------
    model, data, parameters, own, outputs, phase, error, initial, criterion, guess_from_data
        As for `estimate`.

    Attributes
    ----------
    model : ConcreteModel
        All experiments, with one objective: a sum of weighted squares. What was measured, and the weights, are mutable
        Params on it; so it can be given to `sweep`.
    experiments : dict of str to Experiment
        By the name of the data set.
    measurements : list of (str, Measurement)
        Of all experiments, each with the name of its own.
    unknowns : list of EstimatedNumber

    Raises
    ------
    EstimationError
        When model, data, outputs or parameters do not fit.
    """

    def __init__(
        self,
        model: Any,
        data: Any = None,
        *,
        parameters: Sequence[str] | None = None,
        own: Sequence[str] = (),
        outputs: Any = None,
        phase: Any = None,
        error: Any = None,
        initial: str | Sequence[str] = "known",
        criterion: str = "least squares",
        guess_from_data: bool = True,
    ) -> None:
        if criterion not in CRITERIA:
            raise EstimationError(f"criterion = {criterion!r}; expected {' or '.join(map(repr, CRITERIA))}.")
        if isinstance(parameters, str) or isinstance(own, str):
            raise EstimationError("parameters and own are lists of names; write ['mass'] for a single one.")
        _check_error(error)
        self.criterion = criterion
        plan = ExperimentPlan(parameters, outputs, phase, error, initial, guess_from_data)
        with PauseGC():
            listed = _experiments(model, data, plan)
            self.experiments: dict[str, Experiment] = {each.name: each for each in listed}
            self.measurements: list[tuple[str, Measurement]] = [
                (experiment.name, each) for experiment in listed for each in experiment.measurements
            ]
            self.unknowns = _unknowns(listed, list(own))
            self._build(listed)
        self.sensitivities = OutputSensitivities(
            self.model,
            [each.predicted for _, each in self.measurements],
            [unknown.variable for unknown in self.unknowns],
        )

    def _build(self, listed: list[Experiment]) -> None:
        self.model = m = ConcreteModel(name="estimation")
        for experiment in listed:
            name = unique_component_name(m, re.sub(r"\W", "_", experiment.name))
            m.add_component(name, experiment.model)  # as it is: rules hold on to their model
        m.shared = ConstraintList()
        for unknown in self.unknowns:
            for copy in unknown.copies:
                copy.set_value(unknown.variable.value, skip_validation=True)
                m.shared.add(copy == unknown.variable)
        numbers = range(len(self.measurements))
        m.measured = Param(numbers, initialize=0.0, mutable=True, within=Reals)
        m.weight = Param(numbers, initialize=0.0, mutable=True, within=Reals)
        m.squares = Objective(
            expr=sum(
                m.weight[i] * (each.predicted - m.measured[i]) ** 2 for i, (_, each) in enumerate(self.measurements)
            )
        )
        self._names = [(name, each.output) for name, each in self.measurements]
        self.deviations = np.array(
            [np.nan if each.deviation is None else each.deviation for _, each in self.measurements]
        )
        self.put(np.array([each.measured for _, each in self.measurements]))

    @contextmanager
    def simulated(self) -> Iterator[None]:
        """Context in which the unknowns are fixed where they are and the data do not count: equations remain."""
        weights = [self.model.weight[i].value for i in self.model.weight]
        try:
            for unknown in self.unknowns:
                unknown.variable.fix()
            # Not by deactivating the objective: an unknown that is in an output alone would be in nothing at all.
            for i in self.model.weight:
                self.model.weight[i] = 0.0
            yield
        finally:
            for i, weight in zip(self.model.weight, weights, strict=True):
                self.model.weight[i] = weight
            for unknown in self.unknowns:
                unknown.variable.unfix()

    # ---------------------------------------------------------------- data

    def put(self, measured: Any, error: float | Mapping[str, float] | None = None) -> None:
        """Exchange what was measured; times stay as they are.

        Parameters
        ----------
        measured : array, or mapping of output (or of data set and output) to array
            In the order of `measurements`; of an output, in the order of its samples. NaN where it is missing.
        error : number or mapping of output to number, optional
            Standard deviations, where they are other ones as well.

        Raises
        ------
        EstimationError
            When there are more or fewer numbers than before, or none.
        """
        numbers = self._flat(measured)
        if error is not None:
            given = error if isinstance(error, Mapping) else dict.fromkeys(self.outputs, error)
            self.deviations = np.array([float(given[output]) for _, output in self._names])
        self.measured = numbers
        present = np.isfinite(numbers)
        if not present.any():
            raise EstimationError("there is no number among the measurements.")
        self.weights, self.scales = self._weights(numbers, present)
        normalised = self._normalised(numbers, present)
        for i, (number, weight) in enumerate(zip(numbers.tolist(), normalised.tolist(), strict=True)):
            self.model.measured[i] = number if number == number else 0.0
            self.model.weight[i] = weight

    def _flat(self, measured: Any) -> Array:
        count = len(self.measurements)
        if not isinstance(measured, Mapping):
            numbers = np.array(measured, dtype=float)
            if numbers.shape != (count,):
                raise EstimationError(f"{numbers.size} measurements were given; the problem has {count}.")
            return numbers
        numbers = np.full(count, np.nan)
        for key, given in measured.items():
            places = [i for i, (name, output) in enumerate(self._names) if key in (output, (name, output))]
            values = np.asarray(given, dtype=float)
            if not places or values.shape != (len(places),):
                raise EstimationError(
                    f"{key!r}: {values.size} measurements were given; the problem has {len(places)} of it."
                )
            numbers[places] = values
        return numbers

    def _weights(self, numbers: Array, present: Array) -> tuple[Array, dict[str, float]]:
        """Weights of the squared residuals, and the range of the data of each output."""
        scales = {}
        weights = np.zeros(len(numbers))
        for output in self.outputs:
            places = np.array([each == output for _, each in self._names]) & present
            if not places.any():
                scales[output] = 1.0
                continue
            span = float(np.ptp(numbers[places]))
            scales[output] = span if span > 0.0 else max(1.0, float(np.abs(numbers[places]).max()))
            if self.criterion == "normalised rmse":
                weights[places] = 1.0 / (places.sum() * scales[output] ** 2)
        if self.criterion == "normalised rmse":
            return weights / len(self.outputs), scales
        known = np.isfinite(self.deviations)
        if known.any() and not known.all():
            name, output = self._names[int(np.flatnonzero(~known)[0])]
            raise EstimationError(
                f"data set '{name}': the error of '{output}' is not given, but those of others are. Give all standard "
                "deviations, or none, or use criterion='normalised rmse'."
            )
        weights[present] = 1.0 if not known.any() else 1.0 / self.deviations[present] ** 2
        return weights, scales

    def _normalised(self, numbers: Array, present: Array) -> Array:
        """The weights in the objective: a common factor makes it the number of data where nothing is explained.

        So a solver's tolerances mean the same whatever the units, and however small the errors.
        """
        spread = np.array([self.scales[output] for _, output in self._names])
        total = float((self.weights * (spread / 4) ** 2)[present].sum())
        self.factor = float(present.sum()) / max(total, 1e-300)
        return self.weights * self.factor

    @property
    def outputs(self) -> list[str]:
        """Names of all that was measured."""
        return list(dict.fromkeys(output for _, output in self._names))

    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
        return [unknown.name for unknown in self.unknowns]

    @property
    def output_of(self) -> list[tuple[str, str]]:
        """Data set and output of each measurement."""
        return list(self._names)

    @property
    def has_pairs(self) -> bool:
        """Whether there is complementarity in it."""
        return any(True for _ in active_sources(self.model))

    def estimates(self) -> Array:
        """Values of the unknowns now."""
        return np.array([unknown.variable.value for unknown in self.unknowns], dtype=float)

    def predictions(self) -> Array:
        """What the model says of each measurement now, whether it is missing or not; shape (measurements,)."""
        return np.array([float(value(each.predicted)) for _, each in self.measurements])

    def values(self) -> VariableValues:
        """Of all variables."""
        return VariableValues.of_all(self.model)


def _check_error(error: Any) -> None:
    for number in error.values() if isinstance(error, Mapping) else [error]:
        if number is not None and np.ndim(number) == 0:
            usable = isinstance(number, (int, float, np.floating, np.integer)) and not isinstance(number, bool)
            if not usable or not 0.0 < float(number) < float("inf"):
                raise EstimationError(f"error = {error!r}; a standard deviation is a positive number.")


def _experiments(model: Any, data: Any, plan: ExperimentPlan) -> list[Experiment]:
    """One experiment per data set, or per labelled model."""
    if data is None:
        given = list(model) if isinstance(model, Sequence) and not isinstance(model, str) else [model]
        if not given:
            raise EstimationError("there are no experiments.")
        if any(
            callable(each) and not hasattr(each, "get_labeled_model") and not isinstance(each, BlockData)
            for each in given
        ):
            raise EstimationError("a function that builds models needs data: give one item of data= for each model.")
        return [
            labelled_experiment(model_of_experiment(each), f"set {number}", plan)
            for number, each in enumerate(given, start=1)
        ]
    if isinstance(model, BlockData):
        return [phase_experiment(model_of_experiment(model), each, plan) for each in as_data_sets(data)]
    if not callable(model):
        raise EstimationError(f"expected a model or a function that builds one, found {type(model).__name__}.")
    found = []
    sets = as_data_sets(data)
    originals = _originals(data)
    for each, original in zip(sets, originals, strict=True):
        built = model(original)
        if not isinstance(built, BlockData) or not built.is_constructed():
            raise EstimationError(f"data set '{each.name}': the builder returned {type(built).__name__}, no model.")
        if all(built.component(label) is not None for label in LABELS[:2]):
            found.append(labelled_experiment(built, each.name, plan))
        else:
            found.append(phase_experiment(built, each, plan))
    return found


def _originals(data: Any) -> list[Any]:
    """The data as the user gave them, for a builder."""
    sets = as_data_sets(data)
    if len(sets) == 1 and not (isinstance(data, Sequence) and not isinstance(data, str)):
        inner = isinstance(data, Mapping) and set(data) == {sets[0].name}
        return list(data.values()) if inner else [data]
    return list(data.values()) if isinstance(data, Mapping) else list(data)


def _unknowns(listed: list[Experiment], own: list[str]) -> list[EstimatedNumber]:
    names = list(dict.fromkeys(name for experiment in listed for name in experiment.parameters))
    for name in own:
        if not any(each == name or each.startswith(f"{name}[") for each in names):
            raise EstimationError(f"own names '{name}', which is not estimated; estimated are {', '.join(names)}.")
    found = []
    alone = len(listed) == 1
    for name in names:
        variables = [(each.name, each.parameters[name]) for each in listed if name in each.parameters]
        if not alone and any(name == each or name.startswith(f"{each}[") for each in own):
            found += [EstimatedNumber(f"{name} ({where})", variable, (), "own") for where, variable in variables]
        else:
            found.append(
                EstimatedNumber(name, variables[0][1], tuple(variable for _, variable in variables[1:]), "shared")
            )
    for experiment in listed:
        for state, variable in experiment.starts.items():
            where = "" if alone else f" ({experiment.name})"
            found.append(EstimatedNumber(f"{state} at start{where}", variable, (), "start"))
    return found
