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

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.numerics import Array

from .data_sets import as_data_sets
from .experiments import Experiment, labelled_experiment, phase_experiment
from .output_sensitivities import OutputSensitivities


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
    """

    name: str
    variable: Any
    copies: tuple[Any, ...] = ()

    def put(self, number: float) -> None:
        """Set the value, also where it is fixed."""
        for variable in (self.variable, *self.copies):
            variable.set_value(number, skip_validation=True)


class EstimationProblem:
    """Experiments whose unknowns are found together.

    Parameters
    ----------
    model, data, parameters, own, outputs, phase, error, initial
        As for `estimate`.

    Attributes
    ----------
    model : ConcreteModel
        All experiments, with one objective: a sum of weighted squares. What was measured, and the weights, are mutable
        Params on it; so it can be given to `sweep`.
    experiments : dict of str to Experiment
        By the name of the data set.
    measurements : list of Measurement
        Of all experiments.
    unknowns : list of EstimatedNumber
    measured : array, shape (measurements,)
        NaN where it is missing.
    deviations : array, shape (measurements,)
        Standard deviations; NaN where they are not known.
    weights : array, shape (measurements,)
        Of the squared residuals: over the variance where it is known; zero where nothing was measured.
    scales : dict of str to float
        Range of the data of each output.

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
    ) -> None:
        if isinstance(parameters, str) or isinstance(own, str):
            raise EstimationError("parameters and own are lists of names; write ['mass'] for a single one.")
        with PauseGC():
            if data is None:
                given = enumerate(model if isinstance(model, (list, tuple)) else [model], start=1)
                listed = [labelled_experiment(_copy_of(each), f"set {i}", parameters, error) for i, each in given]
            else:
                further = (parameters, error, outputs, phase, initial)
                listed = [phase_experiment(_copy_of(model), each, *further) for each in as_data_sets(data)]
            if not listed:
                raise EstimationError("there are no experiments.")
            self.experiments: dict[str, Experiment] = {each.name: each for each in listed}
            self.measurements = [each for experiment in listed for each in experiment.measurements]
            self.unknowns = _unknowns(listed, own)
            self.model = self._stated(listed)
        self.deviations = np.array([each.deviation for each in self.measurements])
        self._set_data(np.array([each.measured for each in self.measurements]))
        unknowns = [unknown.variable for unknown in self.unknowns]
        self.sensitivities = OutputSensitivities(self.model, [each.predicted for each in self.measurements], unknowns)

    def _stated(self, listed: list[Experiment]) -> ConcreteModel:
        m = ConcreteModel(name="estimation")
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
        squares = (m.weight[i] * (each.predicted - m.measured[i]) ** 2 for i, each in enumerate(self.measurements))
        m.squares = Objective(expr=sum(squares))
        return m

    @contextmanager
    def simulated(self) -> Iterator[None]:
        """Context in which the unknowns are fixed where they are and the data do not count: equations remain."""
        weights = self.model.weight.extract_values()
        try:
            for unknown in self.unknowns:
                unknown.variable.fix()
            # Not by deactivating the objective: an unknown that is in an output alone would be in nothing at all.
            self.model.weight.store_values(0.0)
            yield
        finally:
            self.model.weight.store_values(weights)
            for unknown in self.unknowns:
                unknown.variable.unfix()

    def put(self, measured: Mapping[Any, Any], error: float | Mapping[str, float] | None = None) -> None:
        """Exchange what was measured; times stay as they are.

        Parameters
        ----------
        measured : mapping of output (or of data set and output) to array
            In the order of its samples; NaN where one is missing, also for outputs that are left out.
        error : number or mapping of output to number, optional
            Standard deviations, where they are other ones as well.

        Raises
        ------
        EstimationError
            When there are more or fewer numbers than before, or none.
        """
        if error is not None:
            given = error if isinstance(error, Mapping) else dict.fromkeys(self.outputs, error)
            self.deviations = np.array([float(given[each.output]) for each in self.measurements])
        numbers = np.full(len(self.measurements), np.nan)
        for key, samples in measured.items():
            places = [i for i, name in enumerate(self.output_of) if key in (name, name[1])]
            if not places or np.shape(samples) != (len(places),):
                raise EstimationError(
                    f"{key!r}: {np.size(samples)} measurements were given; the problem has {len(places)} of it."
                )
            numbers[places] = samples
        self._set_data(numbers)

    def _set_data(self, measured: Array) -> None:
        present, known = np.isfinite(measured), np.isfinite(self.deviations)
        if not present.any():
            raise EstimationError("there is no number among the measurements.")
        if known.any() and not known.all():
            unknown = self.measurements[int(known.argmin())]
            raise EstimationError(
                f"data set '{unknown.data_set}': the error of '{unknown.output}' is not given, but those of others "
                "are. Give all standard deviations, or none."
            )
        self.measured, self.weights = measured, np.where(present, 1.0 if not known.any() else self.deviations**-2, 0.0)
        self.scales, outputs = dict.fromkeys(self.outputs, 1.0), np.array([name for _, name in self.output_of])
        for output in self.outputs:
            numbers = measured[(outputs == output) & present]
            if numbers.size:
                self.scales[output] = float(np.ptp(numbers)) or max(1.0, float(np.abs(numbers).max()))
        # A common factor makes the objective the number of data where nothing is explained: so a solver's tolerances
        # mean the same whatever the units, and however small the errors.
        spread = np.array([self.scales[output] for output in outputs.tolist()])
        self.factor = float(present.sum()) / max(float((self.weights * (spread / 4) ** 2).sum()), 1e-300)
        self.model.measured.store_values(dict(enumerate(np.where(present, measured, 0.0).tolist())))
        self.model.weight.store_values(dict(enumerate((self.weights * self.factor).tolist())))

    @property
    def outputs(self) -> list[str]:
        """Names of all that was measured."""
        return list(dict.fromkeys(each.output for each in self.measurements))

    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
        return [unknown.name for unknown in self.unknowns]

    @property
    def output_of(self) -> list[tuple[str, str]]:
        """Data set and output of each measurement."""
        return [(each.data_set, each.output) for each in self.measurements]

    def estimates(self) -> Array:
        """Values of the unknowns now."""
        return np.array([unknown.variable.value for unknown in self.unknowns], dtype=float)

    def predictions(self) -> Array:
        """What the model says of each measurement now, whether it is missing or not; shape (measurements,)."""
        return np.array([float(value(each.predicted)) for each in self.measurements])


def _copy_of(given: Any) -> Any:
    """A copy of a model, or of the labelled model that an object with ``get_labeled_model`` makes."""
    model = given.get_labeled_model() if hasattr(given, "get_labeled_model") else given
    if not isinstance(model, BlockData) or not model.is_constructed():
        raise EstimationError(
            f"expected a model, found {type(model).__name__}. Where data sets need models of their own, label each "
            "with its data by rcp.label_measurements, and give a list of them without data."
        )
    return model.clone()


def _unknowns(listed: list[Experiment], own: Sequence[str]) -> list[EstimatedNumber]:
    names = list(dict.fromkeys(name for experiment in listed for name in experiment.parameters))
    whole = [name.partition("[")[0] for name in names]
    for name in own:
        if name not in (*names, *whole):
            raise EstimationError(f"own names '{name}', which is not estimated; estimated are {', '.join(names)}.")
    found, alone = [], len(listed) == 1
    for name in names:
        variables = {each.name: each.parameters[name] for each in listed if name in each.parameters}
        if not alone and (name in own or name.partition("[")[0] in own):
            found += [EstimatedNumber(f"{name} ({where})", variable) for where, variable in variables.items()]
        else:
            first, *copies = variables.values()
            found.append(EstimatedNumber(name, first, tuple(copies)))
    for experiment in listed:
        where = "" if alone else f" ({experiment.name})"
        found += [EstimatedNumber(f"{state} at start{where}", each) for state, each in experiment.starts.items()]
    return found
