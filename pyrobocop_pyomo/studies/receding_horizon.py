"""`RecedingHorizon`: plan, move a little, plan again from where the system is, without building anything anew."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.errors import ComplementarityError, ModelError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.phases import Algebraic, Control, Parameter, PhaseBlockData
from pyrobocop_pyomo.phases.controls import knots_of, variables_name
from pyrobocop_pyomo.phases.declarations import is_held
from pyrobocop_pyomo.solving.persistent_nlp import PersistentNLP
from pyrobocop_pyomo.trajectories import Trajectory

from .outcomes import seconds_left

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HorizonStep:
    """What one step of a receding horizon gave.

    Attributes
    ----------
    plan : Trajectory
        The new plan; its time counts from now. After a failure, what is left of the plan before.
    status : IpoptStatus
    iterations : int
    seconds : float
        Elapsed in this step, everything included.
    ipopt_seconds : float
        Elapsed in Ipopt, functions and derivatives included.
    """

    plan: Trajectory
    status: IpoptStatus
    iterations: int
    seconds: float
    ipopt_seconds: float

    @property
    def solved(self) -> bool:
        """Whether the plan is a new one."""
        return self.status.solved


class RecedingHorizon:
    """A planning problem that is solved over and over while its initial state moves on.

    The model is prepared once. Each step puts the measured state where the phase starts, moves the last plan ahead as
    the initial guess, and solves warm from the last multipliers; nothing is rebuilt, and no file is written.

    Parameters
    ----------
    model : ConcreteModel
        With its pairs relaxed, if it has any: apply ``pyrobocop.relax_complementarity`` with the delta to work at.
    phase : PhaseBlock
        The phase that starts now; every state whose value is measured has ``State(initial=...)``.
    options : mapping, optional
        Ipopt's options.

    Raises
    ------
    ModelError, ComplementarityError
        When the phase is no phase of the model, starts or lasts as the optimiser likes, or has active pairs.
    """

    def __init__(self, model: Any, phase: PhaseBlockData, options: Mapping[str, Any] | None = None) -> None:
        if not isinstance(phase, PhaseBlockData) or phase.model() is not model.model():
            raise ModelError(f"'{getattr(phase, 'name', phase)}' is no phase of '{model.name}'.")
        if phase.has_normalised_time:
            raise ModelError(
                f"phase '{phase.name}': a receding horizon needs a fixed start, a fixed duration and a fixed mesh."
            )
        phase.check()
        if active_sources(model):
            raise ComplementarityError(
                f"'{model.name}' has active complementarity pairs. Apply pyrobocop.relax_complementarity first, "
                "with the delta that the controller works at."
            )
        self.phase = phase
        self._fixed = {name for name in phase.record.names_of_states if phase.component(name)[phase.initial_time].fixed}
        self._values = _Values(phase)
        self._program = PersistentNLP(model, options)

    def step(
        self, state: Mapping[str, float], advance: float = 0.0, *, mu: float = 1e-4, time_limit: float | None = None
    ) -> HorizonStep:
        """Plan from a measured state.

        Parameters
        ----------
        state : mapping of state name to float
            Where the system is now: a value for each state with a fixed initial value.
        advance : float
            How long ago the last plan was made, in the time of the phase: its rest is the initial guess.
        mu : float
            Ipopt's first barrier parameter, from the second step on: smaller is closer to the last plan.
        time_limit : float, optional
            Seconds, for this step. Without a new plan by then, what is left of the plan before is given.

        Returns
        -------
        HorizonStep

        Raises
        ------
        ModelError
            When states are missing, unknown or not finite, or advance is negative.
        """
        started, deadline = time.perf_counter(), Deadline.after(time_limit)
        self._check(state, advance)
        before = self._values.shift(advance) if advance else self._values.snapshot()
        for name, number in state.items():
            self.phase.component(name)[self.phase.initial_time].set_value(float(number))
        outcome = self._program.solve(mu=mu, time_limit=seconds_left(deadline))
        if not outcome.status.solved:
            self._values.restore(before)
        plan = self._values.plan()
        seconds = time.perf_counter() - started
        return HorizonStep(plan, outcome.status, outcome.iterations, seconds, outcome.seconds)

    def _check(self, state: Mapping[str, float], advance: float) -> None:
        what = f"phase '{self.phase.name}'"
        for name in sorted(self._fixed ^ set(state)):
            fact = "has no value in the measured state" if name in self._fixed else "has no fixed initial value"
            raise ModelError(f"{what}: '{name}' {fact}; needed are {', '.join(sorted(self._fixed))}.")
        for name, number in state.items():
            if not np.isfinite(number):
                raise ModelError(f"{what}: the measured '{name}' is {number}.")
        if not 0 <= advance <= self.phase.duration:
            raise ModelError(f"{what}: advance = {advance!r}; expected a time between 0 and {self.phase.duration:g}.")


@dataclass(frozen=True)
class _Source:
    """The variables behind one name, and the times at which they live."""

    name: str
    variables: list[Any]
    times: Array


class _Values:
    """All values of a phase as arrays: read, moved ahead in time, and written, without evaluating an expression."""

    def __init__(self, phase: PhaseBlockData) -> None:
        self._phase, self._grid, record = phase, phase.grid, phase.record
        times, points = np.array(self._grid.times), np.array(self._grid.points)
        self._states = [self._source(name, name, times) for name in record.names_of_states]
        self._signals = [self._source(name, name, points) for name in record.names(Algebraic)]
        self._derivatives = [
            self._source(f"{name}_derivative", f"{name}_derivative", points) for name in sorted(record.kept_derivatives)
        ]
        self._held: list[_Source] = []
        self._linear: list[_Source] = []
        for name in record.names(Control):
            control = record.declarations[name]
            assert isinstance(control, Control)
            holder = variables_name(name, control)
            if control.parametrization == "collocated":
                self._signals.append(self._source(name, holder, points))
                continue
            knots = np.array(knots_of(record, control, f"'{phase.name}.{name}'"))
            if is_held(control):
                self._held.append(self._source(name, holder, (knots[1:] + knots[:-1]) / 2))
            else:
                self._linear.append(self._source(name, holder, knots))
        # The interval of a held control at each collocation point.
        self._interval = {
            source.name: np.searchsorted(
                knots_of(record, record.declarations[source.name], source.name)[1:],  # type: ignore[arg-type]
                [self._grid.mesh.boundaries[self._grid.element_of[t] + 1] for t in self._grid.points],
            )
            for source in self._held
        }

    def _source(self, name: str, component: str, times: Array) -> _Source:
        return _Source(name, list(self._phase.component(component).values()), times)

    def _read(self, source: _Source) -> Array:
        return np.array([variable.value for variable in source.variables], dtype=float)

    def plan(self, with_derivatives: bool = False) -> Trajectory:
        """The values as a trajectory."""
        signals = {source.name: self._read(source) for source in self._signals}
        signals |= {source.name: self._read(source)[self._interval[source.name]] for source in self._held}
        linear = {source.name: np.array([source.times, self._read(source)]) for source in self._linear}
        signals |= {name: np.interp(self._grid.points, *knots) for name, knots in linear.items()}
        if with_derivatives:
            signals |= {source.name: self._read(source) for source in self._derivatives}
        return Trajectory(
            name=self._phase.name,
            grid=self._grid,
            states={source.name: self._read(source) for source in self._states},
            signals=signals,
            parameters={name: self._phase.component(name).value for name in self._phase.record.names(Parameter)},
            pairs={},
            linear=linear,
            held=frozenset(source.name for source in self._held),
            phase=self._phase,
        )

    def shift(self, advance: float) -> list[Array]:
        """Move all values ahead in time, the last ones standing beyond the plan's end; a snapshot of the result."""
        plan = self.plan(with_derivatives=True)
        at: dict[bytes, Any] = {}
        moved = []
        for source in self._all:
            times = np.minimum(source.times + advance, self._grid.mesh.boundaries[-1])
            key = times.tobytes()
            if key not in at:
                at[key] = plan(times)
            moved.append(at[key][source.name])
        self.restore(moved)
        return moved

    def snapshot(self) -> list[Array]:
        """Everything, to come back to."""
        return [self._read(source) for source in self._all]

    def restore(self, snapshot: list[Array]) -> None:
        """Come back."""
        for source, values in zip(self._all, snapshot, strict=True):
            for variable, number in zip(source.variables, values.tolist(), strict=True):
                if not variable.fixed:
                    variable.set_value(number, skip_validation=True)

    @property
    def _all(self) -> list[_Source]:
        return [*self._states, *self._signals, *self._held, *self._linear, *self._derivatives]
