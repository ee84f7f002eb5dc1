"""Forward simulation: what a phase does from its initial values under given controls.

Explicit differential equations are integrated by SciPy, element by element. With implicit and algebraic equations, step
maps, or pairs that determine algebraics or forces, each element is one mixed complementarity problem in the rows of the
scheme itself (`contact_steps`). Bounds and path constraints are ignored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import InitialGuessError, SimulationFailed, TrajectoryError
from pyrobocop_pyomo.modeling.undefined_values import undefined_part
from pyrobocop_pyomo.modeling.variable_values import unfixed, values_restored
from pyrobocop_pyomo.numerics import Array, Grid, Mesh
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import InitialGuess, initial_number

from .companions import companions_of
from .contact_steps import ContactSteps
from .declarations import Parameter
from .delays import MotionSoFar, past_of
from .element_integration import integrate_by_steps
from .families import guesses_by_component, names_by_component
from .horizon import real_grid
from .phase_values import make_trajectory, pairs_of_phase, read_values
from .rate_arrays import PointRates
from .record import PhaseRecord
from .simulated_unknowns import Unknowns, find_unknowns
from .stated_numbers import moving_end

# What a rule raises at values where it has none: a logarithm of a negative number, a division by zero.
_NO_VALUE = (ArithmeticError, ValueError)

_WHAT_IS_MISSING = "has no value to simulate with. Give it in the call, or an initial guess."

METHODS = ("RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA", "scheme")


@dataclass(frozen=True)
class SimulationOptions:
    """How to integrate.

    Attributes
    ----------
    method : str
        One of `scipy.integrate.solve_ivp`, or ``"scheme"``: the rows of the scheme.
    rtol, atol : float
        Tolerances of `solve_ivp`.
    unknown : sequence of str, optional
        Algebraics and controls that are to be found.
    restitution : mapping of name of a pair to number
        Coefficients of Newton's law of impact.
    most_evaluations : int, optional
        Of the right-hand sides, in all; the simulation stops beyond.
    """

    method: str = "DOP853"
    rtol: float = 1e-9
    atol: float = 1e-10
    unknown: Sequence[str] | None = None
    restitution: Mapping[str, float] = field(default_factory=dict)
    most_evaluations: int | None = None


class _TooManyEvaluations(Exception):
    """Ends an integration that would go on for long."""


def simulate(
    block: Any,
    record: PhaseRecord,
    controls: Mapping[str, InitialGuess],
    initial: Mapping[str, float],
    options: SimulationOptions,
) -> Trajectory:
    """See `PhaseActions.simulate`."""
    if options.method not in METHODS:
        raise InitialGuessError(
            f"phase '{block.name}': method {options.method!r} is unknown; choose one of {', '.join(METHODS)}."
        )
    what = f"phase '{block.name}'"
    controls, initial = (guesses_by_component(record, given, what) for given in (controls, initial))
    if options.unknown is not None:
        options = replace(options, unknown=names_by_component(record, options.unknown))
    run = _Run(block, record, controls, initial, options)
    with run.on_model():
        for i in range(record.grid.mesh.elements):
            start = run.grid.mesh.boundaries[i]
            try:
                with np.errstate(all="ignore"):
                    failure = run.element(i, options)
            except TrajectoryError:
                raise  # a rule that cannot be asked says nothing about the motion
            except _NO_VALUE as error:
                why = run.undefined(i) or _first_line(error)
                failure = run.reached or start, f"the equations have no value ({why})"
            if failure is not None:
                raise _failed(block, run, i, *failure)
            run.put_element(i)
        pairs = pairs_of_phase(block, record.grid) if run.unknowns.contact else None
        return run.trajectory(record.grid.mesh.elements, pairs)


def _first_line(error: Exception) -> str:
    text = str(error).splitlines()[0] if str(error) else type(error).__name__
    # As Pyomo says it of a variable without a value.
    return f"{text}; a simulation knows no later value" if text.startswith("No value for uninitialized") else text


def _failed(block: Any, run: _Run, element: int, time: float, reason: str) -> SimulationFailed:
    kept = f"the {element} elements before" if element else "nothing before"
    return SimulationFailed(
        f"phase '{block.name}': the simulation stopped at t = {time:g}: {reason}. Kept in error.trajectory: {kept}. "
        "Give other controls or initial values, or another method.",
        time,
        run.trajectory(element) if element else None,
    )


class _Run:
    """The values so far, per element: states at the nodes, everything else at the stages."""

    def __init__(
        self,
        block: Any,
        record: PhaseRecord,
        controls: Mapping[str, InitialGuess],
        initial: Mapping[str, float],
        options: SimulationOptions,
    ) -> None:
        self.block, self.record = block, record
        self.grid = real_grid(block, record)
        self.unknowns: Unknowns = find_unknowns(block, record, controls, options.unknown)
        self.given = given_values(block, record, controls, self.unknowns)
        self.signals = {
            name: record.nodes(name).at_points(values)[record.grid.stage_positions]
            for name, values in self.given.items()
        }
        self.parameters = {name: float(block.component(name).value) for name in record.names(Parameter)}
        self.compiled: PointRates | None = None
        self.evaluations = 0
        self.reached: float | None = None
        shape = (record.grid.mesh.elements, record.grid.scheme.stages)
        names = record.names_of_states
        self.start = initial_states(block, record, initial)
        self.states = {name: np.full((shape[0], len(record.grid.scheme.state_nodes)), np.nan) for name in names}
        self.rates = {name: np.full(shape, np.nan) for name in names}
        for name in self.unknowns.algebraics:
            self.signals[name] = np.full(shape, np.nan)
        self.ends = np.full((shape[0], len(names)), np.nan)
        if options.restitution and not self.unknowns.contact:
            raise InitialGuessError(
                f"phase '{block.name}': restitution is given, but no pair determines anything in this simulation. "
                "Leave out of controls={...} what pairs are to find, or name it in unknown=[...]."
            )
        by_rows = options.method == "scheme" or bool(
            self.unknowns.algebraics or self.unknowns.implicit or record.discrete_states
        )
        widths, restitution = self.grid.mesh.widths, options.restitution
        self.steps = ContactSteps(block, record, self.unknowns, widths, restitution) if by_rows else None

    def element(self, i: int, options: SimulationOptions) -> tuple[float, str] | None:
        """Find one element; returns time and reason of a failure."""
        if self.compiled is not None:
            return self.by_integration(i, self.compiled, options)
        assert self.steps is not None
        return self.by_rows(i, self.steps)

    def by_rows(self, i: int, steps: ContactSteps) -> tuple[float, str] | None:
        """Solve rows and pairs of one element; returns time and reason of a failure."""
        block, record, grid = self.block, self.record, self.record.grid
        if i == 0:
            steps.begin(dict(zip(record.names_of_states, self.start.tolist(), strict=True)), block)
        failure = steps.solve(i)
        if failure is not None:
            residual, where = failure
            return (
                self.grid.mesh.boundaries[i],
                f"the rows of element {i} were not solved (residual {residual:.1e} in {where})",
            )
        names = record.names_of_states
        nodes = {name: np.array([block.component(name)[time].value for time in grid.node_times[i]]) for name in names}
        ends = np.array([block.component(name)[grid.mesh.boundaries[i + 1]].value for name in names])
        for name in self.unknowns.algebraics:
            component = block.component(name)
            self.signals[name][i] = [float(value(component[time])) for time in grid.stage_times[i]]
        for name in set(names) - record.discrete_states:
            rates = block.derivative(name)
            self.rates[name][i] = [float(value(rates[time])) for time in grid.stage_times[i]]
        self._take(i, nodes, ends)
        return None

    @contextmanager
    def on_model(self) -> Iterator[None]:
        """Context in which the phase has what the simulation knows: what is given, the start, and then each element.

        Rules may read other times than their own. What has not been simulated yet has no value meanwhile.
        """
        block, record = self.block, self.record
        with values_restored(block.component_data_objects(Var)):
            if self.steps is None:
                given = make_trajectory(
                    block,
                    self.grid,
                    states={},
                    signals=self._signals_at(self.grid),
                    parameters={},
                    pairs={},
                    knot_values=self.given,
                )
                self.compiled = PointRates(
                    block, record, record.grid, self.grid, self.signals, given.piecewise_linear, self.parameters,
                    companions_of(block, record.grid.mesh.boundaries),
                )  # fmt: skip
                self.compiled.past = self.so_far = MotionSoFar(
                    record.names_of_states, past_of(given), self.grid.mesh.boundaries[0], self.start
                )
            unknown = [*record.names_of_states, *self.unknowns.algebraics]
            components = [block.component(record.nodes(name).component) for name in unknown]
            components += [block.component(f"{name}_derivative") for name in sorted(record.kept_derivatives)]
            for variable in (variable for component in components for variable in component.values()):
                variable.set_value(None, skip_validation=True)
            for name, values in self.given.items():
                self._put(record.nodes(name).variables(block), values)
            for name, number in zip(record.names_of_states, self.start.tolist(), strict=True):
                block.component(name)[record.grid.times[0]].set_value(number, skip_validation=True)
            with unfixed(self.steps.unknowns if self.steps is not None else ()):
                yield

    def put_element(self, i: int) -> None:
        """Let the phase have the values of an element."""
        if self.steps is not None:
            return  # it has them
        grid = self.record.grid
        for j, name in enumerate(self.record.names_of_states):
            variable = self.block.component(name)
            self._put([variable[time] for time in grid.node_times[i]], self.states[name][i])
            variable[grid.mesh.boundaries[i + 1]].set_value(float(self.ends[i, j]), skip_validation=True)
        at_stages = {name: self.signals[name][i] for name in self.unknowns.algebraics}
        at_stages |= {f"{name}_derivative": self.rates[name][i] for name in self.record.kept_derivatives}
        for name, values in at_stages.items():
            variable = self.block.component(name)
            self._put([variable[time] for time in grid.stage_times[i]], values)

    @staticmethod
    def _put(variables: Sequence[Any], values: Array) -> None:
        for variable, number in zip(variables, np.asarray(values).tolist(), strict=True):
            variable.set_value(number, skip_validation=True)

    def by_integration(self, i: int, rates: PointRates, options: SimulationOptions) -> tuple[float, str] | None:
        """Integrate one element with SciPy; returns time and reason of a failure."""
        scheme, names = self.record.grid.scheme, self.record.names_of_states
        width, begin = self.grid.mesh.widths[i], self.grid.mesh.boundaries[i]

        def slope(local: float, state: Array) -> Array:
            self.reached = begin + width * local
            self.evaluations += 1
            if options.most_evaluations is not None and self.evaluations > options.most_evaluations:
                raise _TooManyEvaluations
            return width * rates(i, local, state)

        rates.refresh()
        if names:
            asked = np.union1d(scheme.state_nodes, [0.0, 1.0])
            settings: dict[str, Any] = {"method": options.method, "rtol": options.rtol, "atol": options.atol}
            try:
                if self.record.delayed_names:
                    result = integrate_by_steps(
                        slope, 0.0, 1.0, self.start, self.so_far, rates.smallest_delay,
                        to_real_time=lambda local: begin + width * local, **settings,
                    )  # fmt: skip
                else:
                    result = scipy.integrate.solve_ivp(slope, (0.0, 1.0), self.start, t_eval=asked, **settings)
            except _TooManyEvaluations:
                return self.reached or begin, f"it took more than {options.most_evaluations} evaluations"
            if not result.success or not np.isfinite(result.y).all():
                reached = float(result.t[-1]) if len(result.t) else 0.0
                return begin + width * reached, f"SciPy's {options.method} gave up ({result.message})"
            if self.record.delayed_names:
                result.y = np.array([self.so_far.state(begin + width * local) for local in asked]).T
            nodes = result.y[:, np.searchsorted(asked, scheme.state_nodes)]
            nodes[:, 0] = self.start  # LSODA returns it with rounding
            self._take(i, dict(zip(names, nodes, strict=True)), result.y[:, -1])
        first = 0 if scheme.starts_on_a_stage else 1
        for k, local in enumerate(scheme.c.tolist()):
            at = rates(i, local, np.array([self.states[name][i, first + k] for name in names]))
            for name, rate in zip(names, at.tolist(), strict=True):
                self.rates[name][i, k] = rate
        return None

    def undefined(self, i: int) -> str:
        """Which part of a right-hand side has no value in an element, where it was asked last; or empty."""
        block, record = self.block, self.record
        times = record.grid.stage_times[i]
        found: list[tuple[Any, float]] = []
        for name, number in ({} if self.compiled is None else self.compiled.given).items():
            if name not in record.declarations:
                continue
            nodes = record.nodes(name)
            found += [(v, number) for t, v in zip(nodes.times, nodes.variables(block), strict=True) if t in times]
        with values_restored(variable for variable, _ in found):
            for variable, number in found:
                if not variable.fixed:
                    variable.set_value(number, skip_validation=True)
            for state, rates in record.rates.items():
                for time in record.grid.stage_times[i]:
                    part = undefined_part(rates[time]) if time in rates else None
                    if part is not None:
                        return f"{part.what}, in the right-hand side of '{state}', element {i}"
        return ""

    def _take(self, i: int, nodes: Mapping[str, Array], ends: Array) -> None:
        for name, numbers in nodes.items():
            self.states[name][i] = numbers
        self.start = self.ends[i] = np.asarray(ends)

    def trajectory(self, elements: int, pairs: Mapping[str, Array] | None = None) -> Trajectory:
        """The first elements as a trajectory."""
        grid = Grid(self.grid.scheme, Mesh(self.grid.mesh.boundaries[: elements + 1]))
        names = self.record.names_of_states
        states = {}
        for j, name in enumerate(names):
            at: dict[float, float] = {}
            for i in range(elements):
                at |= dict(zip(grid.node_times[i], self.states[name][i].tolist(), strict=True))
                at[grid.mesh.boundaries[i + 1]] = float(self.ends[i, j])
            states[name] = np.array([at[t] for t in grid.times])
        return make_trajectory(
            self.block,
            grid,
            states=states,
            signals=self._signals_at(grid),
            parameters=self.parameters,
            pairs=pairs or {},
            rates={
                name: self._at_points(grid, per_stage)
                for name, per_stage in self.rates.items()
                if name not in self.record.discrete_states
            },
            knot_values=self.given,
        )

    def _signals_at(self, grid: Grid) -> dict[str, Array]:
        return {name: self._at_points(grid, self.signals[name]) for name in self.unknowns.order}

    @staticmethod
    def _at_points(grid: Grid, per_stage: Array) -> Array:
        at: dict[float, float] = {}
        for times, values in zip(grid.stage_times, per_stage, strict=False):
            at |= dict(zip(times, values.tolist(), strict=True))
        return np.array([at[t] for t in grid.points])


def given_values(
    block: Any, record: PhaseRecord, given: Mapping[str, InitialGuess], unknowns: Unknowns
) -> dict[str, Array]:
    """Values over its nodes of everything that is not to be found: as given, or as the phase has them.

    Raises
    ------
    InitialGuessError
        When a value has the wrong length, is missing or is not finite.
    """
    values = {}
    for name in unknowns.order:
        if name not in unknowns.algebraics:
            nodes = record.nodes(name)
            if name in given:
                values[name] = nodes.from_guess(given[name], f"phase '{block.name}': '{name}'")
            else:
                values[name] = read_values(nodes.variables(block), InitialGuessError, _WHAT_IS_MISSING)
    return values


def initial_states(block: Any, record: PhaseRecord, given: Mapping[str, float]) -> Array:
    """Where the states start: as given, or as the phase holds them.

    Raises
    ------
    InitialGuessError
        When a name is no state or a value no finite number.
    """
    names = record.names_of_states
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InitialGuessError(
            f"phase '{block.name}': an initial value is given for '{unknown[0]}'; its states are "
            f"{', '.join(names) or 'none'}."
        )
    first = record.grid.times[0]
    return np.array(
        [
            initial_number(given[name], f"phase '{block.name}': initial value of '{name}'")
            if name in given
            else _start_on_model(block, record, name, first)
            for name in names
        ],
        dtype=float,
    )


def _start_on_model(block: Any, record: PhaseRecord, name: str, first: float) -> float:
    followed = moving_end(block, name, record.declarations[name], "initial")
    if followed is not None:
        return followed
    return float(read_values([block.component(name)[first]], InitialGuessError, _WHAT_IS_MISSING)[0])
