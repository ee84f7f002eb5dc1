"""`PersistentNLP`: one model solved again and again, as a receding horizon does it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.programs.compiled_model import CompiledModel
from pyrobocop_pyomo.programs.nonlinear_program import PrimalDualPoint

from .ipopt_options import IpoptOptions, warm_start
from .session import OnIteration


class PersistentNLP:
    """A model that is prepared once and solved many times, each time from the last solution.

    A solve that fails leaves its last point on the model, but does not spoil the next one: that starts from the last
    solution again, unless the values on the model were changed in between.

    Between two solves, change what is a number: values of fixed variables, mutable Params, bounds, values of
    variables. What changes the structure (fixing, unfixing, adding, deactivating) makes the next solve prepare the
    model again and start it cold; rows that were inactive and are activated one by one within an active component
    are not noticed: call `prepare` then.

    Parameters
    ----------
    model : Block
        Continuous, with at most one active objective. Complementarity has to be relaxed before.
    options : mapping, optional
        Ipopt's options for every solve.

    Attributes
    ----------
    model : Block
    outcome : IpoptOutcome or None
        The last one, with multipliers in Ipopt's signs.
    preparations : int
        How often the model was prepared: 1 as long as only numbers changed.

    Raises
    ------
    ModelError
        When the model is not continuous, has several objectives or no free variables.
    SolverNotFoundError
        When CasADi or an Ipopt library is missing.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> from pyrobocop_pyomo.solving import PersistentNLP
    >>> m = pyo.ConcreteModel()
    >>> m.start, m.x = pyo.Param(initialize=1.0, mutable=True), pyo.Var(initialize=0.0)
    >>> m.cost = pyo.Objective(expr=(m.x - m.start) ** 2)
    >>> nlp = PersistentNLP(m)
    >>> for start in (1.0, 2.0):
    ...     m.start = start
    ...     print(nlp.solve().status.solved, round(m.x.value, 6))
    True 1.0
    True 2.0
    """

    def __init__(self, model: BlockData, options: Mapping[str, Any] | None = None) -> None:
        self.model = model
        self.preparations = 0
        self._options = dict(options or {})
        self.prepare()

    def prepare(self) -> None:
        """Walk over the model again, whatever has changed on it; the next solve starts without multipliers."""
        self._compiled = CompiledModel(self.model, "vectorised")
        self._forget()

    def _forget(self) -> None:
        """A model of another structure has another program: multipliers of the old one mean nothing there."""
        self.outcome: IpoptOutcome | None = None
        self._solved: IpoptOutcome | None = None
        self.preparations += 1

    def solve(
        self,
        options: Mapping[str, Any] | None = None,
        *,
        warm: bool = True,
        mu: float = 1e-4,
        time_limit: float | None = None,
        tee: bool = False,
        on_iteration: OnIteration | None = None,
    ) -> IpoptOutcome:
        """Solve with the numbers that stand on the model now, and put the last point on it.

        Parameters
        ----------
        options : mapping, optional
            Ipopt's options for this solve; they win over those of the model and of the warm start.
        warm : bool
            Start with the multipliers of the last solve that succeeded, from the point on the model; where that is
            still the last point of a solve that failed, from the last solution.
        mu : float
            Ipopt's first barrier parameter in a warm start: the smaller, the closer to the last solution.
        time_limit : float, optional
            Seconds.
        tee : bool
            Show Ipopt's log.
        on_iteration : callable, optional
            Called with the record of each iteration; stops Ipopt by returning False.

        Returns
        -------
        IpoptOutcome
            Whatever stopped Ipopt; ask ``outcome.status.solved``.

        Raises
        ------
        ModelError
            When the model makes no sense any more.
        InfeasibleConstraintException
            When a row without free variables contradicts itself.
        """
        before = self._compiled.nlp
        self._compiled.update()  # also before the first solve: numbers may have changed since the model was prepared
        if self._compiled.nlp is not before:
            self._forget()
        start = PrimalDualPoint(self._compiled.current_point())
        purpose: dict[str, Any] = {}
        if warm and self._solved is not None:
            failed = self.outcome is not self._solved
            if failed and self.outcome is not None and np.array_equal(start.x, self.outcome.x):
                start = PrimalDualPoint(self._solved.x)
            start = replace(self._solved.point, x=start.x)
            purpose = warm_start(mu)
        layers = IpoptOptions(user={**self._options, **(options or {})}, default={})
        self.outcome = run_ipopt(
            self._compiled.nlp,
            layers.resolve(purpose),
            start,
            deadline=Deadline.after(time_limit),
            on_iteration=on_iteration,
            output=[sys.stdout] if tee else [],
        )
        if self.outcome.status.solved:
            self._solved = self.outcome
        InProcessSolutionLoader(self._compiled, self.outcome).load_solution()
        return self.outcome
