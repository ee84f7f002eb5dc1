"""`ExactPairs`: from a plan with relaxed pairs to one nearby whose pairs hold exactly, again and again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel
from pyrobocop_pyomo.errors import ComplementarityError, PyRobocopError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.modeling.activity import deactivate
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Limits
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint
from pyrobocop_pyomo.solving.ipopt_options import DEFAULT_WITH_PAIRS, POLISH, IpoptOptions
from pyrobocop_pyomo.solving.numeric_pairs import numeric_pairs

from .outcomes import seconds_left
from .persistent_nlp import PersistentNLP

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
        begin = BranchPoint.at(program, replace(start, g_multipliers=start.complete(compiled.nlp)[0][rows]))
        found = search.polish(begin, only_nearest=True)
        if found is begin:
            failed = IpoptStatus.INFEASIBLE if runs[-1].status.solved else runs[-1].status
            outcome = replace(runs[-1], status=failed)
        else:
            outcome = ends[id(found)][1]
            better = search.exchange(found, MET) if outcome.status.solved else found
            if ends[id(better)][1].status.solved:
                found, outcome = ends[id(better)]
        multipliers: FloatArray = np.zeros(compiled.nlp.m)
        multipliers[rows] = outcome.g_multipliers
        return replace(outcome, g_multipliers=multipliers), found.natural_residual
