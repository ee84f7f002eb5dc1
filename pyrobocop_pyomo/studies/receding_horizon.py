"""`RecedingHorizon`: plan, move a little, plan again from where the system is, without building anything anew."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.diagnosis.values import named_undefined_rows
from pyrobocop_pyomo.errors import ComplementarityError, ModelError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptStatus
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.motion.safety_report import SafetyReport, joined_report
from pyrobocop_pyomo.obstacles import avoidance_blocks, containments
from pyrobocop_pyomo.obstacles.initial_checks import warn_of_clocks_that_start_anew
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray
from pyrobocop_pyomo.solving.ipopt_options import ROUGH
from pyrobocop_pyomo.solving.starts import defined_start
from pyrobocop_pyomo.trajectories import Trajectory

from .exact_pairs import ExactPairs
from .outcomes import seconds_left
from .persistent_nlp import PersistentNLP
from .shifted_warm_start import PlaceInProgram, ShiftedPlan


@dataclass(frozen=True)
class HorizonStep(Presented):
    """What one step of a receding horizon gave.

    Attributes
    ----------
    plan : Trajectory
        The new plan; its time counts from now. After a failure, the rest of the previous plan.
    status : IpoptStatus
    iterations : int
    seconds : float
        Elapsed in this step, everything included.
    ipopt_seconds : float
        Elapsed in Ipopt, functions and derivatives included.
    safety : SafetyReport or None
        On the motion of the plan, past all obstacles and inside all regions of the model; None where it has none, or
        where nothing is to be verified.
    remark : str
        What was done about an initial guess that could not be evaluated, or which expression has no value there.
    natural_residual : float or None
        Largest of the pairs in the new plan, where they are made exact; None elsewhere.
    """

    plan: Trajectory = field(repr=False, compare=False)
    status: IpoptStatus
    iterations: int
    seconds: float
    ipopt_seconds: float
    safety: SafetyReport | None = None
    remark: str = ""
    natural_residual: float | None = None

    @property
    def safe(self) -> bool | None:
        """As `SafetyReport.safe`, for the plan, old or new; None where there is no `safety`, too."""
        return None if self.safety is None else self.safety.safe

    @property
    def solved(self) -> bool:
        """Whether the plan is a new one."""
        return self.status.solved

    def _summary(self) -> str:
        safe = "" if self.safety is None else f", {self.safety.word.partition(':')[0]}"
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
    exact_pairs : bool
        Whether the relaxed problem is solved roughly, at a barrier parameter that stays, and only shows the way to the
        plan: the solution of the nearest branch, in which one side of each pair is zero. A delta of 1e-3 keeps the
        relaxed problem smooth then. Without it, plans are those of the relaxed model.

    Attributes
    ----------
    phase : PhaseBlock
    exact : ExactPairs or None
    program : PersistentNLP

    Raises
    ------
    ModelError, ComplementarityError
        When the phase is no phase of the model, starts or lasts as the optimiser likes, or has active pairs; with
        `exact_pairs`, also when the model is not relaxed by rows with lifted sides.
    """

    def __init__(
        self,
        model: Any,
        phase: PhaseBlockData,
        options: Mapping[str, Any] | None = None,
        *,
        verify: bool = True,
        exact_pairs: bool = False,
    ) -> None:
        refuse_unfit_phase(model, phase, "a receding horizon")
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
        # Where the relaxed solution only shows the way, digits are wasted on it.
        self.program = PersistentNLP(model, {**(ROUGH if exact_pairs else {}), **(options or {})})
        self.exact = ExactPairs(phase, self.program, options or {}) if exact_pairs else None
        self._made: tuple[FloatArray, FloatArray] | None = None  # the last exact plan, and the relaxed one beside it
        self._known_place: PlaceInProgram | None = None

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
            Ipopt's first barrier parameter, from the second step on: smaller is closer to the last plan. With
            `exact_pairs`, that of the relaxed problem, in all steps.
        time_limit : float, optional
            Seconds, for this step. Without a new plan by then, the rest of the previous plan is given.

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
        starts = {name: self.phase.component(name)[self.phase.initial_time] for name in state}
        last = {name: variable.value for name, variable in starts.items()}
        for name, number in state.items():
            starts[name].set_value(float(number))
        # States are zero without an initial guess, where an expression may have no value.
        remark = defined_start(self.program.model) if self.program.outcome is None else ""
        self.program.update()
        here = self.program.compiled.nlp.x_start
        ahead = self._ahead(here, last, advance)
        # The relaxed problem goes on from its own last solution, unless the values on the model were changed since:
        # from the exact plan, in which nothing acts across a gap, it would let go of what is held.
        known = self._made is not None and np.array_equal(here, self._made[0])
        start = self._ahead(self._made[1], last, advance) if self._made is not None and known else ahead
        outcome = self.program.solve(
            mu=mu, mu_target=None if self.exact is None else mu, time_limit=seconds_left(deadline), start=start
        )
        if outcome.status is IpoptStatus.INVALID_NUMBER and (undefined := named_undefined_rows(self.program.model)):
            remark = f"The initial guess could not be evaluated: {undefined}. Give another by initialize()."
        natural, runs = None, [outcome]
        if self.exact is not None and outcome.status is not IpoptStatus.INVALID_NUMBER:
            relaxed, self._made = outcome, None
            outcome, natural, runs = self.exact.made_exact(relaxed, ahead, mu, deadline)
            if outcome.status.solved:
                self.program.compiled.load_point(outcome.x)
                self._made = outcome.x, relaxed.x if relaxed.status.solved else outcome.x
        if not outcome.status.solved:
            self.program.compiled.load_point(ahead)
        found = self._place().read(outcome.x if outcome.status.solved else ahead)
        plan = self._values.trajectory(found, evaluate=False)
        safety = joined_report(block.verify() for block in self._verified) if self._verified else None
        seconds = time.perf_counter() - started
        iterations, ipopt_seconds = sum(run.iterations for run in runs), sum(run.seconds for run in runs)
        return HorizonStep(plan, outcome.status, iterations, seconds, ipopt_seconds, safety, remark, natural)

    def _ahead(self, x: FloatArray, last: Mapping[str, Any], advance: float) -> FloatArray:
        """A plan that stood on the model in the last step, from these states on, read later."""
        x = x.copy()
        if advance:
            place = self._place()
            values = place.read(x)
            for name, number in last.items():
                values[name][0] = number
            place.put(self._moved.ahead(values, advance), x)
        return x

    def _place(self) -> PlaceInProgram:
        if self._known_place is None or self._known_place.variables is not self.program.compiled.variables:
            self._known_place = PlaceInProgram(self._values, self.program.compiled.variables)
        return self._known_place

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


def refuse_unfit_phase(model: Any, phase: PhaseBlockData, what: str) -> None:
    """Refuse what cannot be solved over and over on the same grid.

    Parameters
    ----------
    model : Block
    phase : PhaseBlock
    what : str
        Solves it, for messages.

    Raises
    ------
    ModelError, ComplementarityError
        When the phase is no phase of the model, starts or lasts as the optimiser likes, or has active pairs.
    """
    if not isinstance(phase, PhaseBlockData) or phase.model() is not model.model():
        raise ModelError(f"'{getattr(phase, 'name', phase)}' is no phase of '{model.name}'.")
    if phase.has_normalised_time:
        raise ModelError(f"phase '{phase.name}': {what} needs a fixed start, a fixed duration and a fixed mesh.")
    phase.check()
    if active_sources(model):
        raise ComplementarityError(
            f"'{model.name}' has active complementarity pairs. Apply pyrobocop.relax_complementarity first, "
            f"with the delta that {what} works at."
        )
