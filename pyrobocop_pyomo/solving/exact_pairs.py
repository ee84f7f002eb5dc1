"""`ExactPairs`: from a point of a relaxed model to one nearby whose pairs hold exactly, again and again."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.modeling.activity import deactivate
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.mpcc.active_set import BranchPoint
from pyrobocop_pyomo.mpcc.branch import Branch, nearest_branch, restricted
from pyrobocop_pyomo.mpcc.linearisation import Linearisation
from pyrobocop_pyomo.mpcc.multipliers import opposing_multipliers
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram, PrimalDualPoint

from .ipopt_options import DEFAULT_WITH_PAIRS, POLISH, IpoptOptions
from .numeric_pairs import numeric_pairs
from .relaxed_model import RelaxedModel

# Violation of rows beyond which a branch counts as not solved.
FEASIBLE = 1e-6
# Branches that multipliers ask for: most there may be, what of them counts, relative to the gradient, at which size of
# the other side, and by how much the objective has to become smaller. Without the last, degenerate pairs, of which all
# sides are zero, would change places in every step.
EXCHANGES, ASKING, BIACTIVE, GAIN = 3, 1e-6, 1e-6, 1e-4
# A branch takes 5 to 15 iterations near its solution; one without a solution is left soon.
ITERATIONS = 100


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

    @property
    def delta(self) -> Any:
        """The mutable parameter of the relaxation."""
        return self._relaxed.delta

    @contextlib.contextmanager
    def stated(self) -> Iterator[None]:
        """Pairs are active for a moment, as they were stated: a simulation solves them."""
        sources = list({id(pair.source): pair.source for pair in self._relaxed.pairs}.values())
        for source in sources:
            source.activate()
        try:
            yield
        finally:
            deactivate(sources)

    def start_lifted(self) -> None:
        """Give generated variables the values of what they stand for."""
        self._relaxed.start_lifted()

    def solve(self, compiled: CompiledModel, start: PrimalDualPoint, deadline: Deadline) -> ExactPoint:
        """Solve the branch nearest to a point, with the numbers that the compiled model has now, and better ones.

        Where both sides of a pair are zero and the multiplier of the held one says that the other branch is better,
        that one is solved as well, as long as the objective becomes clearly smaller. It promises nothing: certificates
        are what `solve` gives.

        Parameters
        ----------
        compiled : CompiledModel
            Of the relaxed model.
        start : PrimalDualPoint
            In its order, with multipliers of all its rows.
        deadline : Deadline
        """
        relaxed, dual = self._relaxed, start.complete(compiled.nlp)[0]
        program, rows = numeric_pairs(compiled, relaxed.lifted, relaxed.relaxing_rows, relaxed.crossed)
        start, branch, runs = (
            replace(start, g_multipliers=dual[rows]),
            nearest_branch(program, start.x),
            list[IpoptOutcome](),
        )
        best: tuple[IpoptOutcome, BranchPoint] | None = None
        for _ in range(1 + EXCHANGES):
            outcome = self._solved(restricted(program, branch), start, deadline)
            found = BranchPoint.at(program, outcome.point)
            if outcome.status.solved and found.violation > FEASIBLE:
                outcome = replace(outcome, status=IpoptStatus.INFEASIBLE)
            runs.append(outcome)
            if best is not None and not (outcome.status.solved and _clearly_better(found, best[1])):
                break
            best = outcome, found
            if not outcome.status.solved:
                break
            point = Linearisation.at(program.nlp, found.x)
            scale = max(1.0, float(np.abs(point.gradient).max(initial=0.0)))
            asking = opposing_multipliers(program, point, branch, outcome.point, BIACTIVE) > ASKING * scale
            if not asking.any():
                break
            branch, start = Branch(branch.a_zero ^ asking, branch.b_zero ^ asking), outcome.point
        assert best is not None
        outcome, found = best
        multipliers: FloatArray = np.zeros(compiled.nlp.m)
        multipliers[rows] = outcome.g_multipliers
        return ExactPoint(replace(outcome, g_multipliers=multipliers), found.natural_residual, runs)

    def _solved(self, nlp: NonlinearProgram, start: PrimalDualPoint, deadline: Deadline) -> IpoptOutcome:
        options = self._options.resolve(POLISH, {"max_iter": ITERATIONS})
        return run_ipopt(nlp, options, replace(start, x=np.clip(start.x, nlp.x_lower, nlp.x_upper)), deadline=deadline)


def _clearly_better(found: BranchPoint, best: BranchPoint) -> bool:
    return found.objective < best.objective - GAIN * max(1e-8, abs(best.objective))
