"""`RecedingHorizon`: plan, move a little, plan again from where the system is, without building anything anew.

`ExactPairs`: from a plan with relaxed pairs to one nearby whose pairs hold exactly, again and again.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel
from pyrobocop_pyomo.diagnosis.values import named_undefined_rows
from pyrobocop_pyomo.errors import ComplementarityError, ModelError, PyRobocopError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.modeling.activity import deactivate
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.motion.safety_report import SafetyReport, joined_report
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Limits
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.obstacles import avoidance_blocks, containments
from pyrobocop_pyomo.obstacles.initial_checks import warn_of_clocks_that_start_anew
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint
from pyrobocop_pyomo.solving.ipopt_options import DEFAULT_WITH_PAIRS, POLISH, ROUGH, IpoptOptions
from pyrobocop_pyomo.solving.numeric_pairs import numeric_pairs
from pyrobocop_pyomo.solving.starts import defined_start
from pyrobocop_pyomo.trajectories import Trajectory

from .outcomes import seconds_left
from .persistent_nlp import PersistentNLP, PlaceInProgram, ShiftedPlan

# ---------------------------------------------------------------------------------------------------------- exact pairs


# Where no branch near the relaxed solution has a solution, delta is divided by this, until it is so small.
DELTA_DIVISOR, SMALLEST_DELTA = 10.0, 1e-7
# A branch takes 5 to 15 iterations near its solution; one without a solution is left soon.
LIMITS = Limits(exchanges=3, polishing_iterations=100)


class ExactPoint(NamedTuple):
    """Where the search ended.

    Attributes
    ----------
    outcome : IpoptOutcome
        Of the last branch, with multipliers of all rows of the relaxed model; not solved where rows are violated.
    natural_residual : float or None
        Largest of the pairs; None where no branch was solved.
    runs : list of IpoptOutcome
        All of them, that of the relaxed problem first.
    """

    outcome: IpoptOutcome
    natural_residual: float | None
    runs: list[IpoptOutcome]


class ExactPairs:
    """Solves the branch nearest to a point of a relaxed model, and better ones that its multipliers ask for.

    Parameters
    ----------
    phase : PhaseBlock
    program : PersistentNLP
        Of its model, which is relaxed, with lifted sides.
    options : mapping
        Ipopt's options for every branch.

    Raises
    ------
    ComplementarityError
        When there is not one relaxation in the model, sides are not lifted, or a penalty relaxes them.
    """

    def __init__(self, phase: Any, program: PersistentNLP, options: Mapping[str, Any]) -> None:
        self._phase, self._program = phase, program
        self._relaxed = RelaxedModel.of(program.model)
        if self._relaxed.has_penalty or not self._relaxed.lifted:
            raise ComplementarityError(
                f"'{program.model.name}': pairs can be made exact where rows relax them and their sides are lifted. "
                "Apply pyrobocop.relax_complementarity with a relaxation such as 'scholtes' and lift=True."
            )
        self._options = IpoptOptions(user=options, default=DEFAULT_WITH_PAIRS)

    def made_exact(self, relaxed: IpoptOutcome, ahead: FloatArray, mu: float, deadline: Deadline) -> ExactPoint:
        """Solve the branch that one of several starts leads to.

        Parameters
        ----------
        relaxed : IpoptOutcome
            Of the relaxed problem.
        ahead : float array
            The last plan.
        mu : float
            Barrier parameter of relaxed problems.
        deadline : Deadline
        """
        delta, runs = self._relaxed.delta, [relaxed]
        usual = delta.value
        try:
            for start in self._starts(runs, ahead, mu, deadline):
                outcome, natural = self._branch(start, runs, deadline)
                if outcome.status.solved:
                    return ExactPoint(outcome, natural, runs)
                if outcome.status is IpoptStatus.INTERRUPTED or deadline.has_passed:
                    break
        finally:
            delta.set_value(usual)
        return ExactPoint(outcome, None, runs)

    def _starts(
        self, runs: list[IpoptOutcome], ahead: FloatArray, mu: float, deadline: Deadline
    ) -> Iterator[PrimalDualPoint]:
        """The relaxed solution, the last plan, a simulation of its controls, relaxed solutions of smaller delta.

        A large delta keeps the relaxed problem smooth, but where a plan has to change a lot, forces that act across
        small gaps lead to branches without a solution: then delta becomes smaller, as it does from a cold start. A
        simulation meets rows and pairs wherever there is no other limit, so that its branch has a solution.
        """
        relaxed, delta = runs[0], self._relaxed.delta
        if relaxed.status.solved:
            yield relaxed.point
        yield replace(relaxed.point, x=ahead)
        if not relaxed.status.solved:
            yield from self._simulated(ahead)
        while (smaller := delta.value / DELTA_DIVISOR) >= SMALLEST_DELTA:
            delta.set_value(smaller)
            target = min(mu, smaller)
            runs.append(self._program.solve(mu=target, mu_target=target, time_limit=seconds_left(deadline)))
            yield runs[-1].point
        if relaxed.status.solved:
            yield from self._simulated(ahead)

    def _simulated(self, ahead: FloatArray) -> Iterator[PrimalDualPoint]:
        """What the controls of a plan do from the measured state; nothing where that cannot be found."""
        compiled = self._program.compiled
        compiled.load_point(ahead)
        sources = list({id(pair.source): pair.source for pair in self._relaxed.pairs}.values())
        try:
            for source in sources:  # as they were stated: the simulation solves them
                source.activate()
            self._phase.initialize(self._phase.simulate(method="scheme"))
        except PyRobocopError:
            return
        finally:
            deactivate(sources)
        self._relaxed.start_lifted()
        zeros = np.zeros(compiled.nlp.n)
        yield PrimalDualPoint(compiled.current_point(), np.zeros(compiled.nlp.m), zeros, zeros)

    def _branch(
        self, start: PrimalDualPoint, runs: list[IpoptOutcome], deadline: Deadline
    ) -> tuple[IpoptOutcome, float]:
        """Solve the branch nearest to a point, with the numbers that the program has now, and better ones.

        Where both sides of a pair are zero and the multiplier of the held one says that the other branch is better,
        that one is solved as well, as long as the objective becomes no larger. It promises nothing: certificates are
        what `solve` gives.
        """
        compiled, relaxed = self._program.compiled, self._relaxed
        program, rows = numeric_pairs(compiled, relaxed.lifted, relaxed.relaxing_rows, relaxed.crossed)
        ends: dict[int, tuple[BranchPoint, IpoptOutcome]] = {}

        def solve(nlp: NonlinearProgram, start: PrimalDualPoint, iterations: int) -> IpoptOutcome:
            options = self._options.resolve(POLISH, {"max_iter": iterations})
            runs.append(run_ipopt(nlp, options, start, deadline=deadline))
            return runs[-1]

        def note(purpose: str, outcome: IpoptOutcome, found: BranchPoint, kept: bool) -> None:
            ends[id(found)] = found, outcome

        search = ActiveSetSearch(program, solve, LIMITS, note, deadline)
        multipliers: FloatArray = np.array(start.complete(compiled.nlp)[0])
        multipliers[rows] = 0.0
        begin = BranchPoint.at(program, replace(start, g_multipliers=multipliers))
        found = search.polish(begin, only_nearest=True)
        if found is begin:
            failed = IpoptStatus.INFEASIBLE if runs[-1].status.solved else runs[-1].status
            outcome = replace(runs[-1], status=failed)
        else:
            outcome = ends[id(found)][1]
            better = search.exchange(found, MET) if outcome.status.solved else found
            if ends[id(better)][1].status.solved:
                found, outcome = ends[id(better)]
        return outcome, found.natural_residual


# ----------------------------------------------------------------------------------------------------- receding horizon


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
