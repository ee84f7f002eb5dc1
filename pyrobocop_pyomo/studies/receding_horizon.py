"""`RecedingHorizon`: plan, move a little, plan again from where the system is, without building anything anew."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.diagnosis.undefined_rows import named_undefined_rows
from pyrobocop_pyomo.errors import ComplementarityError, ModelError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.motion.safety_report import SafetyReport, joined_report
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.obstacles.clocks import warn_of_clocks_that_start_anew
from pyrobocop_pyomo.phases import Parameter, PhaseBlockData
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.planning.safe_planning import avoidance_blocks, containments
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray
from pyrobocop_pyomo.solving.persistent_nlp import PersistentNLP
from pyrobocop_pyomo.solving.starts import defined_start
from pyrobocop_pyomo.trajectories import Trajectory

from .outcomes import seconds_left
from .shifted_warm_start import PlaceInProgram, ShiftedPlan

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class HorizonStep(Presented):
    """What one step of a receding horizon gave.

    Attributes
    ----------
    make_plan : callable
        Makes the `plan`.
    status : IpoptStatus
    iterations : int
    seconds : float
        Elapsed in this step, everything included but the making of `plan`.
    ipopt_seconds : float
        Elapsed in Ipopt, functions and derivatives included.
    safety : SafetyReport or None
        On the motion of the plan, past all obstacles and inside all regions of the model; None where it has none, or
        where nothing is to be verified.
    remark : str
        What was done about an initial guess that could not be evaluated, or which expression has no value there.
    """

    make_plan: Callable[[], Trajectory] = field(repr=False, compare=False)
    status: IpoptStatus
    iterations: int
    seconds: float
    ipopt_seconds: float
    safety: SafetyReport | None = None
    remark: str = ""

    @cached_property
    def plan(self) -> Trajectory:
        """The new plan; its time counts from now. After a failure, what is left of the plan before."""
        return self.make_plan()

    @property
    def safe(self) -> bool | None:
        """Whether all clearances are proven for the plan, old or new; None where there is no `safety`."""
        return None if self.safety is None else self.safety.safe

    @property
    def solved(self) -> bool:
        """Whether the plan is a new one."""
        return self.status.solved

    def _summary(self) -> str:
        safe = "" if self.safe is None else f", {'safe' if self.safe else 'NOT SAFE'}"
        remark = f". {self.remark}" if self.remark else ""
        return f"{'solved' if self.solved else self.status.name.lower()}, {self.iterations} iterations{safe}{remark}"


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
    verify : bool
        Whether each plan is proven to keep its clearances, where the model has an `ObstacleAvoidanceBlock` or a
        `Containment`. The time that it takes counts in ``seconds``.

    Raises
    ------
    ModelError, ComplementarityError
        When the phase is no phase of the model, starts or lasts as the optimiser likes, or has active pairs.
    """

    def __init__(
        self, model: Any, phase: PhaseBlockData, options: Mapping[str, Any] | None = None, *, verify: bool = True
    ) -> None:
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
        self._values = PhaseValues(phase)
        blocks = avoidance_blocks(model)
        for block in blocks:
            free = block.component_data_objects(Var)
            if any(variable.value is None for variable in free):
                block.initialize()
        warn_of_clocks_that_start_anew(blocks)
        self._verified = [*blocks, *containments(model)] if verify else []
        self._moved = ShiftedPlan(phase, self._values)
        self._program = PersistentNLP(model, options)
        self._place: PlaceInProgram | None = None

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
        before: dict[str, Array] = {}
        starts = {name: self.phase.component(name)[self.phase.initial_time] for name in state}
        last = {name: variable.value for name, variable in starts.items()}
        for name, number in state.items():
            starts[name].set_value(float(number))

        def moved(here: FloatArray) -> FloatArray:
            """The last plan, as it was when it was made, later."""
            place = self._place_in_program()
            before.update(place.read(here))
            if not advance:
                return here
            for name, number in last.items():
                before[name][0] = number
            before.update(self._moved.ahead(before, advance))
            x = here.copy()
            place.put(before, x)
            return x

        outcome = self._program.solve(mu=mu, time_limit=seconds_left(deadline), moved=moved)
        remark = ""
        if outcome.status is IpoptStatus.INVALID_NUMBER and self._program.state is None:
            # Nothing was solved yet: the initial guess is at fault, such as states that are zero without one.
            remark = self._move_to_defined_start()
            if remark:
                outcome = self._program.solve(mu=mu, time_limit=seconds_left(deadline), moved=moved)
            else:
                remark = self._undefined()
        if outcome.status.solved:
            plan = self._plan(self._place_in_program().read(outcome.x))
        else:
            self._values.set(before)
            plan = self._plan(self._values.read())
        safety = joined_report(block.verify() for block in self._verified) if self._verified else None
        seconds = time.perf_counter() - started
        return HorizonStep(plan, outcome.status, outcome.iterations, seconds, outcome.seconds, safety, remark)

    def _move_to_defined_start(self) -> str:
        """As `solve` does it; what was done, or nothing where no such start is found."""
        remark = defined_start(self._program.model)
        if remark:
            logger.info("phase '%s': %s", self.phase.name, remark)
        return remark

    def _undefined(self) -> str:
        undefined = named_undefined_rows(self._program.model)
        return undefined and f"The initial guess could not be evaluated: {undefined}. Give another by initialize()."

    def _place_in_program(self) -> PlaceInProgram:
        if self._place is None or self._place.variables is not self._program.variables:
            self._place = PlaceInProgram(self._values, self._program.variables)
        return self._place

    def _plan(self, values: dict[str, Array]) -> Callable[[], Trajectory]:
        """Makes a trajectory of values; most controllers use a few numbers of a plan."""
        make = partial(self._values.trajectory, values, evaluate=False)
        if not self.phase.record.names(Parameter):
            return make
        plan = make()  # their values are read from the model
        return lambda: plan

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
