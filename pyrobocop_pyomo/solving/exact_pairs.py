"""`ExactPairs`: from a point of a relaxed model to one nearby whose pairs hold exactly, again and again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import ComplementarityError
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome, IpoptStatus
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.mpcc.active_set import BranchPoint
from pyrobocop_pyomo.mpcc.branch import nearest_branch, restricted
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, PrimalDualPoint

from .ipopt_options import DEFAULT_WITH_PAIRS, POLISH, IpoptOptions
from .numeric_pairs import numeric_pairs
from .relaxed_model import RelaxedModel

# Violation of rows beyond which a branch counts as not solved.
FEASIBLE = 1e-6
# A branch takes 5 to 15 iterations near its solution; one without a solution is left soon.
ITERATIONS = 100


class ExactPairs:
    """Solves the branch nearest to a point of a relaxed model.

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

    def solve(self, compiled: CompiledModel, start: PrimalDualPoint, deadline: Deadline) -> tuple[IpoptOutcome, float]:
        """Solve the branch nearest to a point, with the numbers that the compiled model has now.

        Branches are not exchanged as multipliers ask for it, which was measured to take most of a step of a receding
        horizon and to leave the costs of its plans as they were.

        Parameters
        ----------
        compiled : CompiledModel
            Of the relaxed model.
        start : PrimalDualPoint
            In its order, with multipliers of all its rows.
        deadline : Deadline

        Returns
        -------
        IpoptOutcome
            With multipliers of all rows of the relaxed model; not solved where rows are violated.
        float
            Largest natural residual of the pairs.
        """
        relaxed = self._relaxed
        program, rows = numeric_pairs(compiled, relaxed.lifted, relaxed.relaxing_rows, relaxed.crossed)
        nlp = restricted(program, nearest_branch(program, start.x))
        multipliers: FloatArray = start.complete(compiled.nlp)[0]
        begun = replace(start, x=np.clip(start.x, nlp.x_lower, nlp.x_upper), g_multipliers=multipliers[rows])
        options = self._options.resolve(POLISH, {"max_iter": ITERATIONS})
        outcome = run_ipopt(nlp, options, begun, deadline=deadline)
        found = BranchPoint.at(program, outcome.point)
        if outcome.status.solved and found.violation > FEASIBLE:
            outcome = replace(outcome, status=IpoptStatus.INFEASIBLE)
        multipliers = np.zeros(compiled.nlp.m)
        multipliers[rows] = outcome.g_multipliers
        return replace(outcome, g_multipliers=multipliers), found.natural_residual
