"""`ExactPairs`: from the solution of a relaxed model to a point nearby whose pairs hold exactly, again and again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Limits
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint

from .ipopt_options import DEFAULT_WITH_PAIRS, POLISH, IpoptOptions
from .numeric_pairs import numeric_pairs
from .relaxed_model import RelaxedModel

# Linear programs are short: what comes next is the same problem a little later. Branches are not exchanged as
# multipliers ask for it, which was measured to cost most of a step and to leave the cost of the plans as it was.
LIMITS = Limits(polishing_iterations=200, lpec_seconds=0.5)


@dataclass(frozen=True, eq=False)
class ExactPoint:
    """Where the search ended.

    Attributes
    ----------
    outcome : IpoptOutcome
        Of the branch that was solved last, with multipliers of all rows of the relaxed model; its status is no solution
        where no branch was solved.
    natural_residual : float
        Largest of the pairs there.
    iterations : int
        Of Ipopt, in all branches.
    seconds : float
        Elapsed in Ipopt.
    """

    outcome: IpoptOutcome
    natural_residual: float
    iterations: int
    seconds: float


class ExactPairs:
    """Solves the branch nearest to a point of a relaxed model; where it has no solution, the best linearised one.

    Parameters
    ----------
    model : Block
        Relaxed, with lifted sides.
    options : mapping
        Ipopt's options for every branch.

    Raises
    ------
    ComplementarityError
        When there is not one relaxation in the model, sides are not lifted, or a penalty relaxes them.
    """

    def __init__(self, model: Any, options: Mapping[str, Any]) -> None:
        self._relaxed = RelaxedModel.of(model)
        if self._relaxed.has_penalty or not self._relaxed.lifted:
            raise ComplementarityError(
                f"'{model.name}': pairs can be made exact where rows relax them and their sides are lifted. Apply "
                "pyrobocop.relax_complementarity with a relaxation such as 'scholtes' and lift=True."
            )
        self._options = IpoptOptions(user=options, default=DEFAULT_WITH_PAIRS)

    def solve(self, compiled: CompiledModel, starts: Sequence[PrimalDualPoint], deadline: Deadline) -> ExactPoint:
        """Solve with the numbers that the compiled model has now.

        Parameters
        ----------
        compiled : CompiledModel
            Of the relaxed model.
        starts : sequence of PrimalDualPoint
            In its order, with multipliers of all its rows; tried one after the other until a branch is solved.
        deadline : Deadline
        """
        relaxed = self._relaxed
        program, rows = numeric_pairs(compiled, relaxed.lifted, relaxed.relaxing_rows, relaxed.crossed)
        runs: list[tuple[BranchPoint, IpoptOutcome]] = []

        def run(nlp: NonlinearProgram, start: PrimalDualPoint, iterations: int) -> IpoptOutcome:
            return run_ipopt(nlp, self._options.resolve(POLISH, {"max_iter": iterations}), start, deadline=deadline)

        def add(purpose: str, outcome: IpoptOutcome, found: BranchPoint, kept: bool) -> None:
            runs.append((found, outcome))

        def outcome_at(found: BranchPoint) -> IpoptOutcome | None:
            return next((outcome for point, outcome in runs if point is found), None)

        search = ActiveSetSearch(program, run, LIMITS, add, deadline)
        for start in starts:
            point = replace(start, g_multipliers=start.complete(compiled.nlp)[0][rows])
            # What a relaxed point costs says nothing here: any solved branch is better than a point of none.
            found = search.polish(replace(BranchPoint.at(program, point), objective=np.inf))
            outcome = outcome_at(found)
            if outcome is not None and outcome.status.solved and found.violation <= LIMITS.feasibility:
                break
        else:
            found, outcome = runs[-1]
            if outcome.status.solved:  # to Ipopt's tolerances, which are not those of the rows
                outcome = replace(outcome, status=IpoptStatus.INFEASIBLE)
        multipliers: FloatArray = np.zeros(compiled.nlp.m)
        multipliers[rows] = outcome.g_multipliers
        return ExactPoint(
            replace(outcome, g_multipliers=multipliers),
            found.natural_residual,
            sum(outcome.iterations for _, outcome in runs),
            sum(outcome.seconds for _, outcome in runs),
        )
