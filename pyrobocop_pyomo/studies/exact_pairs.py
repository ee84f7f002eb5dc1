"""`ExactPairs`: from a point of a relaxed model to one nearby whose pairs hold exactly, again and again."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from pyrobocop_pyomo.complementarity.relaxed_model import RelaxedModel
from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.modeling.activity import deactivate
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.mpcc.active_set import ActiveSetSearch, BranchPoint, Limits
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import NonlinearProgram, PrimalDualPoint
from pyrobocop_pyomo.solving.ipopt_options import DEFAULT_WITH_PAIRS, POLISH, IpoptOptions
from pyrobocop_pyomo.solving.numeric_pairs import numeric_pairs

# A branch takes 5 to 15 iterations near its solution; one without a solution is left soon.
LIMITS = Limits(exchanges=3, polishing_iterations=100)


class ExactPoint(NamedTuple):
    """Where the search ended.

    Attributes
    ----------
    outcome : IpoptOutcome
        With multipliers of all rows of the relaxed model; not solved where rows are violated.
    natural_residual : float
        Largest of the pairs.
    runs : list of IpoptOutcome
        All of them.
    """

    outcome: IpoptOutcome
    natural_residual: float
    runs: list[IpoptOutcome]


class ExactPairs:
    """Solves the branch nearest to a point of a relaxed model, and better ones that its multipliers ask for.

    Parameters
    ----------
    model : Block
        Relaxed, with lifted sides.
    options : mapping
        Ipopt's options for every branch.

    Attributes
    ----------
    relaxed : RelaxedModel

    Raises
    ------
    ComplementarityError
        When there is not one relaxation in the model, sides are not lifted, or a penalty relaxes them.
    """

    def __init__(self, model: Any, options: Mapping[str, Any]) -> None:
        self.relaxed = RelaxedModel.of(model)
        if self.relaxed.has_penalty or not self.relaxed.lifted:
            raise ComplementarityError(
                f"'{model.name}': pairs can be made exact where rows relax them and their sides are lifted. Apply "
                "pyrobocop.relax_complementarity with a relaxation such as 'scholtes' and lift=True."
            )
        self._options = IpoptOptions(user=options, default=DEFAULT_WITH_PAIRS)

    @contextlib.contextmanager
    def stated(self) -> Iterator[None]:
        """Pairs are active for a moment, as they were stated: a simulation solves them."""
        sources = list({id(pair.source): pair.source for pair in self.relaxed.pairs}.values())
        for source in sources:
            source.activate()
        try:
            yield
        finally:
            deactivate(sources)

    def solve(self, compiled: CompiledModel, start: PrimalDualPoint, deadline: Deadline) -> ExactPoint:
        """Solve the branch nearest to a point, with the numbers that the compiled model has now, and better ones.

        Where both sides of a pair are zero and the multiplier of the held one says that the other branch is better,
        that one is solved as well, as long as the objective becomes no larger. It promises nothing: certificates are
        what `solve` gives.

        Parameters
        ----------
        compiled : CompiledModel
            Of the relaxed model.
        start : PrimalDualPoint
            In its order, with multipliers of all its rows.
        deadline : Deadline
        """
        relaxed = self.relaxed
        program = numeric_pairs(compiled, relaxed.lifted, relaxed.relaxing_rows, relaxed.crossed)
        runs: list[IpoptOutcome] = []
        ends: dict[int, tuple[BranchPoint, IpoptOutcome]] = {}

        def solve(nlp: NonlinearProgram, start: PrimalDualPoint, iterations: int) -> IpoptOutcome:
            options = self._options.resolve(POLISH, {"max_iter": iterations})
            runs.append(run_ipopt(nlp, options, start, deadline=deadline))
            return runs[-1]

        def note(purpose: str, outcome: IpoptOutcome, found: BranchPoint, kept: bool) -> None:
            ends[id(found)] = found, outcome

        search = ActiveSetSearch(program, solve, LIMITS, note, deadline)
        begin = BranchPoint.at(program, program.start(start))
        found = search.polish(begin)
        if found is begin:
            failed = IpoptStatus.INFEASIBLE if runs[-1].status.solved else runs[-1].status
            outcome = replace(runs[-1], status=failed)
        else:
            outcome = ends[id(found)][1]
            better = search.exchange(found, MET) if outcome.status.solved else found
            if ends[id(better)][1].status.solved:
                found, outcome = ends[id(better)]
        return ExactPoint(outcome, found.natural_residual, runs)
