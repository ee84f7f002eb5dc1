"""`MovingHorizon`: the present state from the last few samples, again and again, without building anything anew."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from numbers import Real
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import EstimationError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.variable_values import put_values
from pyrobocop_pyomo.mpcc.problem import Linearisation
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases import Control, Parameter, PhaseBlockData
from pyrobocop_pyomo.phases.nodes import IntervalNodes
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.wrapped_programs import QuadraticCost
from pyrobocop_pyomo.studies.persistent_nlp import PersistentNLP, ShiftedPlan
from pyrobocop_pyomo.studies.receding_horizon import refuse_unfit_phase

from .measurements import PhaseOutputs

# Of the variance in the prior: the arrival cost knows nothing more exactly, so that rounding does not decide its sign.
SMALLEST_VARIANCE = 1e-10


@dataclass(frozen=True)
class HorizonEstimate(Presented):
    """What one step of a moving horizon gave.

    Attributes
    ----------
    state : dict of state name to float
        At the time of the last sample. After a failed solve it is predicted from the estimate before.
    parameters : dict of name to float
        The free parameters of the phase.
    status : IpoptStatus
    iterations : int
    seconds : float
        Elapsed in this step, everything included but the making of `covariance`.
    make_covariance : callable
        Makes the `covariance`.
    """

    state: dict[str, float]
    parameters: dict[str, float]
    status: IpoptStatus
    iterations: int
    seconds: float
    make_covariance: Callable[[], Array] = field(repr=False, compare=False)

    @property
    def solved(self) -> bool:
        """Whether the estimate is a new one."""
        return self.status.solved

    @cached_property
    def covariance(self) -> Array:
        """Of the states and the parameters behind them, in the order of `state` and `parameters`, shape (n, n)."""
        return self.make_covariance()

    @property
    def standard_errors(self) -> dict[str, float]:
        """Of states and parameters, by name."""
        errors = np.sqrt(np.diag(self.covariance)).tolist()
        return dict(zip([*self.state, *self.parameters], errors, strict=True))

    def _summary(self) -> str:
        known = ", ".join(f"{name} = {number:.4g}" for name, number in {**self.state, **self.parameters}.items())
        return f"{known} ({'solved' if self.solved else self.status.name.lower()}, {self.iterations} iterations)"


class MovingHorizon:
    """An estimation problem that is solved over and over while measurements arrive.

    The phase is the window: its end is the present, and each sample moves it on by one sampling interval. The model is
    prepared once; each step changes numbers only. Earlier measurements are summed up in a mean and a
    covariance of states and parameters where the window starts, the arrival cost. When the window moves, both are
    moved by the formulas of the extended Kalman filter, linearised at the last estimate. While the window is not yet
    full, it stands still, and what follows the last sample does not count.

    Parameters
    ----------
    model : ConcreteModel
        Is changed: its objectives are deactivated, initial states become free, and one block is added.
    phase : PhaseBlock
        The window: equal elements, and piecewise constant controls with a value for each of them.
    error : mapping of output to float
        Standard deviations of measured quantities: states, algebraics, Expressions over time, or names in `outputs`.
    prior : mapping of name to float
        Standard deviations of all states at the first sample, and of all free parameters. Their means are the values
        on the model.
    noise : mapping of control name to float, optional
        Controls that are disturbances: unknown, with mean zero and this standard deviation in each element. All other
        controls are inputs, given in each step.
    outputs : mapping of str to rule or to name of an Expression, optional
        As for `label_measurements`.
    elements_per_sample : int
        From one sample to the next.
    options : mapping, optional
        Ipopt's options.

    Raises
    ------
    ModelError, ComplementarityError
        When the phase is no phase of the model, starts or lasts as the optimiser likes, or has active pairs.
    EstimationError
        When names are missing or unknown, deviations are not positive, or phase and sampling do not fit.

    References
    ----------
    Rao, Rawlings & Mayne (2003), Constrained state estimation for nonlinear discrete-time systems: stability and
    moving horizon approximations, doi:10.1109/TAC.2002.808470
    """

    def __init__(
        self,
        model: Any,
        phase: PhaseBlockData,
        *,
        error: Mapping[str, float],
        prior: Mapping[str, float],
        noise: Mapping[str, float] | None = None,
        outputs: Mapping[str, Any] | None = None,
        elements_per_sample: int = 1,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        refuse_unfit_phase(model, phase, "a moving horizon")
        self.phase, self._what, self._elements = phase, f"phase '{phase.name}'", elements_per_sample
        record, noise = phase.record, noise or {}
        self._refuse_unfit_window()
        parameters = [name for name in record.names(Parameter) if not phase.component(name).fixed]
        self._states, self._names = record.names_of_states, [*record.names_of_states, *parameters]
        self._inputs = [name for name in record.names(Control) if name not in noise]
        self._measures, self._times = list(error), phase.grid.mesh.boundaries[::elements_per_sample]
        deviations = self._deviations("prior", prior, self._names, all_of_them=True)
        self._output_weights = self._deviations("error", error, self._measures) ** -2
        noise_weights = self._deviations("noise", noise, record.names(Control)) ** -2
        measurable = PhaseOutputs(phase, outputs)
        predicted = [measurable.at(name, sample) for sample in self._times for name in self._measures]

        for objective in model.component_data_objects(Objective, active=True):
            objective.deactivate()
        estimated = [phase.component(name)[phase.initial_time] for name in self._states]
        estimated += [phase.component(name) for name in parameters]
        for variable in estimated:
            variable.unfix()
        self._values = PhaseValues(phase)
        for name in record.names(Control):
            for variable in self._values.variables[name]:
                variable.set_value(0.0 if name in noise or variable.value is None else variable.value)
                variable.fixed = name not in noise
        # Rows make variables of the outputs: all costs are squares of variables, as numbers that change in each step.
        added = Block(concrete=True)
        model.add_component(unique_component_name(model, f"measured_on_{phase.local_name}"), added)
        added.output = Var(range(len(predicted)), initialize=lambda b, i: value(predicted[i], exception=False))
        added.row = Constraint(range(len(predicted)), rule=lambda b, i: b.output[i] == predicted[i])

        self._place: dict[int, int] = {}  # of each variable among the variables of the cost
        variables, times = list[Any](), list[float]()
        for variable, moment in self._timed(estimated, added.output):
            if not variable.fixed and id(variable) not in self._place:
                self._place[id(variable)] = len(variables)
                variables.append(variable)
                times.append(moment)
        self._moments = np.array(times)
        self._cost = QuadraticCost(variables, dense=len(estimated))
        self._outputs = self._places(added.output.values()).reshape(len(self._times), len(self._measures))
        self._noise = [
            (self._places(self._values.variables[name]), weight)
            for name, weight in zip(noise, noise_weights.tolist(), strict=True)
        ]
        self._mean = np.array([variable.value for variable in estimated], dtype=float)
        self._covariance, self._prior = np.diag(deviations**2), np.outer(deviations, deviations)
        self._measured = np.full(self._outputs.shape, np.nan)
        self._newest = -1  # which sample of the window
        self._moved = ShiftedPlan(phase, self._values)
        self._program = PersistentNLP(model, options, quadratic=self._cost)

    def step(
        self,
        measured: Mapping[str, float | None] | None = None,
        inputs: Mapping[str, float] | None = None,
        *,
        mu: float = 1e-4,
        time_limit: float | None = None,
    ) -> HorizonEstimate:
        """Take in the next sample, and estimate the state at its time.

        Parameters
        ----------
        measured : mapping of output to float
            A measurement that is left out, None or NaN is missing.
        inputs : mapping of control name to float
            The inputs since the sample before; not to be given with the first sample.
        mu : float
            Ipopt's first barrier parameter, from the second step on.
        time_limit : float, optional
            Seconds, for the solve.

        Returns
        -------
        HorizonEstimate

        Raises
        ------
        EstimationError
            When outputs are unknown or infinite, inputs are missing, unknown or not finite, or equations leave
            variables undetermined. The sample is then not taken in.
        """
        started = time.perf_counter()
        self.add(measured, inputs)
        program, cost = self._program, self._cost
        program.update()
        start, ahead = program.compiled.current_point(), self._rows_ahead()
        stated, seen = program.compiled.nlp, program.program
        seen.g_lower = np.where(ahead, -np.inf, stated.g_lower)
        seen.g_upper = np.where(ahead, np.inf, stated.g_upper)
        cost.diagonal[:], cost.linear[:], cost.dense[:] = self._squares(self._newest)
        outcome = program.solve(mu=mu, time_limit=time_limit)
        if not outcome.status.solved:
            program.compiled.load_point(start)
        self._hold_ahead()
        places = self._places_at(self._newest)
        estimates = dict(zip(self._names, [cost.variables[place].value for place in places], strict=True))
        states = {name: estimates.pop(name) for name in self._states}
        made = self._linearised(self._newest, places)
        seconds = time.perf_counter() - started
        return HorizonEstimate(states, estimates, outcome.status, outcome.iterations, seconds, lambda: made()[1])

    def add(
        self, measured: Mapping[str, float | None] | None = None, inputs: Mapping[str, float] | None = None
    ) -> None:
        """Take in the next sample without an estimate, where several arrive at once; arguments as for `step`."""
        known = {} if measured is None else {name: number for name, number in measured.items() if number is not None}
        sample = self._numbers("measured", known, self._measures)
        needed = self._inputs if self._newest >= 0 else []
        applied = self._numbers("inputs", inputs or {}, needed)
        if np.isinf(sample).any() or not np.isfinite(applied).all():
            raise EstimationError(
                f"{self._what}: measured {measured} and inputs {inputs}; expected finite measurements, or NaN where "
                f"one is missing, and a finite number for each of the inputs {', '.join(needed) or '(none)'}."
            )
        if self._newest + 1 < len(self._times):
            self._newest += 1
        else:
            self._move_on()
        self._measured[self._newest] = sample
        end = self._newest * self._elements
        for name, number in zip(needed, applied.tolist(), strict=True):
            put_values(self._values.variables[name][end - self._elements : end], [number] * self._elements)

    def _move_on(self) -> None:
        """Let the window start one sample later; its first sample goes into the arrival cost."""
        self._mean, covariance = self._linearised(0, self._places_at(1))()
        variances, directions = np.linalg.eigh(covariance / self._prior)
        self._covariance = (directions * np.maximum(variances, SMALLEST_VARIANCE)) @ directions.T * self._prior
        moved = self._moved.ahead(self._values.read(), self._times[1] - self._times[0])
        self._values.set(moved)
        for name in self._inputs:
            put_values(self._values.variables[name], moved[name].tolist())
        self._measured[:-1] = self._measured[1:]

    def _hold_ahead(self) -> None:
        """Let all that follows the last sample start from its values there."""
        held = self._values.read()
        for name, numbers in held.items():
            last = bisect_right(self._values.nodes[name].times, self._times[self._newest]) - 1
            numbers[last + 1 :] = numbers[max(last, 0)]
        self._values.set(held)

    def _squares(self, last: int) -> tuple[Array, Array, Array]:
        """Diagonal, linear part and dense block of the cost with the measurements up to a sample."""
        diagonal, linear = np.zeros(self._moments.size), np.zeros(self._moments.size)
        for places, weight in self._noise:
            diagonal[places] = weight
        seen = np.isfinite(self._measured) & (np.arange(len(self._times)) <= last)[:, None]
        diagonal[self._outputs] = np.where(seen, self._output_weights, 0.0)
        linear[self._outputs] = np.where(seen, -self._output_weights * self._measured, 0.0)
        for place in np.flatnonzero(self._are_ahead()).tolist():  # what nothing else ties to a value
            diagonal[place], linear[place] = 1.0, -self._cost.variables[place].value
        information = np.linalg.inv(self._covariance)
        linear[: self._mean.size] = -information @ self._mean
        return diagonal, linear, (information + information.T) / 2

    def _are_ahead(self) -> NDArray[np.bool_]:
        """Which variables of the cost are later than the last sample."""
        return self._moments > self._times[self._newest]

    def _columns(self) -> NDArray[np.intp]:
        """Where the variables of the cost stand in the program."""
        column_of = {id(variable): column for column, variable in enumerate(self._program.compiled.variables)}
        return np.array([column_of[id(variable)] for variable in self._cost.variables], dtype=np.intp)

    def _rows_ahead(self) -> NDArray[np.bool_]:
        """Which rows of the program read variables later than the last sample."""
        program = self._program.compiled.nlp
        ahead, rows = np.zeros(program.n, dtype=bool), np.zeros(program.m, dtype=bool)
        ahead[self._columns()[self._are_ahead()]] = True
        of_entries, columns = program.jacobian_structure
        rows[of_entries[ahead[columns]]] = True
        return rows

    def _linearised(self, last: int, places: NDArray[np.intp]) -> Callable[[], tuple[Array, Array]]:
        """Gives mean and covariance at the values that the model has now, with the measurements up to a sample."""
        self._program.update()
        compiled = self._program.compiled
        at = Linearisation.at(compiled.nlp, compiled.current_point())
        rows = (compiled.nlp.g_lower == compiled.nlp.g_upper) & ~self._rows_ahead()
        jacobian = at.jacobian[rows]
        right_side = jacobian @ at.x - at.rows[rows] + compiled.nlp.g_lower[rows]
        return partial(_gaussian, self._what, self._squares(last), self._columns(), jacobian, right_side, places)

    def _timed(self, estimated: Sequence[Any], outputs: Any) -> Iterator[tuple[Any, float]]:
        """Variables with their times, first the variables of the arrival cost."""
        yield from ((variable, -np.inf) for variable in estimated)
        for name, nodes in self._values.nodes.items():
            yield from zip(self._values.variables[name], nodes.times, strict=True)
        for i, variable in outputs.items():
            yield variable, self._times[i // len(self._measures)]

    def _places(self, variables: Iterable[Any]) -> NDArray[np.intp]:
        return np.array([self._place[id(variable)] for variable in variables], dtype=np.intp)

    def _places_at(self, sample: int) -> NDArray[np.intp]:
        """Of the states at a sample, and of the parameters."""
        components = map(self.phase.component, self._names)
        return self._places(each[self._times[sample]] if each.is_indexed() else each for each in components)

    # ---------------------------------------------------------------- what is refused

    def _refuse_unfit_window(self) -> None:
        record, mesh = self.phase.record, self.phase.grid.mesh
        for name in record.names_of_states:
            state: Any = record.declarations[name]
            if state.final is not None or not isinstance(state.initial, (Real, NoneType)):
                raise EstimationError(
                    f"{self._what}: '{name}' has initial={state.initial!r} and final={state.final!r}; the state of a "
                    "moving horizon has no final value, and its initial one is a number, the mean of its prior."
                )
        for name in record.names(Control):
            nodes = record.nodes(name)
            if not isinstance(nodes, IntervalNodes) or len(nodes.times) != mesh.elements:
                raise EstimationError(
                    f"{self._what}: the control '{name}' has no value for each element. Declare it with "
                    "parametrization='piecewise_constant', without knots."
                )
        if record.delayed_names:
            raise EstimationError(f"{self._what}: a moving horizon cannot look back to {record.delayed_names}.")
        fits = isinstance(self._elements, int) and self._elements > 0 and mesh.elements % self._elements == 0
        if not fits or np.ptp(mesh.widths) > 1e-9 * mesh.widths.max():
            raise EstimationError(
                f"{self._what}: elements_per_sample = {self._elements!r}, and {mesh.elements} elements between "
                f"{mesh.widths.min():g} and {mesh.widths.max():g} wide; expected elements of one width, and a whole "
                "number of samples in the window."
            )

    def _numbers(self, label: str, given: Mapping[str, float], names: Sequence[str]) -> Array:
        """Numbers by name as an array, NaN where one is missing."""
        for name in given:
            if name not in names:
                raise EstimationError(
                    f"{self._what}: {label} has '{name}'; expected are {', '.join(names) or 'no names'}."
                )
        try:
            return np.array([float(given.get(name, np.nan)) for name in names])
        except (TypeError, ValueError):
            raise EstimationError(f"{self._what}: {label} is {given!r}; expected a number for each name.") from None

    def _deviations(
        self, label: str, given: Mapping[str, float], names: Sequence[str], *, all_of_them: bool = False
    ) -> Array:
        numbers = self._numbers(label, given, names)
        wanted = [names.index(name) for name in (names if all_of_them else given)]
        for place in wanted:
            if not 0.0 < numbers[place] < np.inf:
                raise EstimationError(
                    f"{self._what}: {label} of '{names[place]}' is {given.get(names[place])}; expected a standard "
                    "deviation, a positive number."
                )
        return numbers[wanted]


def _gaussian(
    label: str,
    squares: tuple[Array, Array, Array],
    columns: NDArray[np.intp],
    jacobian: Any,
    right_side: Array,
    places: NDArray[np.intp],
) -> tuple[Array, Array]:
    """Mean and covariance of some variables of a cost of squares with linear equations between all variables.

    Parameters
    ----------
    label : str
        For messages.
    squares : diagonal, linear and dense arrays
        The cost: ``linear @ v + v @ Q @ v / 2``, where Q has the dense block for its first variables.
    columns : int array
        Where the variables of the cost stand among all variables.
    jacobian : sparse array
        Of the equations.
    right_side : array
    places : int array
        Of the variables among the variables of the cost.

    Raises
    ------
    EstimationError
        When equations and cost leave variables undetermined.
    """
    diagonal, linear, dense = squares
    rows, n = jacobian.shape
    first, second = (columns[each.ravel()] for each in np.indices(dense.shape))
    where = np.concatenate([columns, first]), np.concatenate([columns, second])
    quadratic = scipy.sparse.csr_array((np.concatenate([diagonal, dense.ravel()]), where), shape=(n, n))
    system = scipy.sparse.block_array([[quadratic, jacobian.T], [jacobian, None]], format="csc")
    right = np.zeros((n + rows, 1 + places.size))
    right[columns, 0], right[n:, 0] = -linear, right_side
    right[columns[places], np.arange(1, 1 + places.size)] = 1.0
    try:
        solved = scipy.sparse.linalg.splu(system).solve(right)[columns[places]]
    except RuntimeError:  # SciPy's way to say: exactly singular
        raise EstimationError(
            f"{label}: states and measurements leave variables of the window undetermined. State an equation for each "
            "algebraic, and declare as disturbances (noise=) what is unknown."
        ) from None
    covariance = solved[:, 1:]
    return solved[:, 0], (covariance + covariance.T) / 2
