"""`PersistentNLP`: one model solved again and again, as a receding horizon does it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from pyomo.core.base.block import BlockData

from pyrobocop_pyomo.ipopt.ipopt_library import load_ipopt_library
from pyrobocop_pyomo.ipopt.ipopt_outcome import IpoptOutcome
from pyrobocop_pyomo.ipopt.ipopt_run import run_ipopt
from pyrobocop_pyomo.ipopt.suffixes import InProcessSolutionLoader
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

from .session import WARM_START_OPTIONS, OnIteration


class PersistentNLP:
    """A model that is prepared once and solved many times, each time from the last solution.

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
    >>> kept = PersistentNLP(m)
    >>> for start in (1.0, 2.0):
    ...     m.start = start
    ...     print(kept.solve().status.solved, round(m.x.value, 6))
    True 1.0
    True 2.0
    """

    def __init__(self, model: BlockData, options: Mapping[str, Any] | None = None) -> None:
        self.model = model
        self.outcome: IpoptOutcome | None = None
        self.preparations = 0
        self._library = load_ipopt_library()
        self._options = dict(options or {})
        self.prepare()

    def prepare(self) -> None:
        """Walk over the model again, whatever has changed on it; the next solve starts without multipliers."""
        self._written = CompiledModel(self.model, "vectorised")
        self.outcome = None
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
            Start with the multipliers of the last solve, if it succeeded. The point is that of the model in any case.
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
        before = self._written.nlp
        self._written.update()  # also before the first solve: numbers may have changed since the model was prepared
        if self._written.nlp is not before:
            self.outcome = None
            self.preparations += 1
        last = self.outcome if warm and self.outcome is not None and self.outcome.status.solved else None
        chosen: dict[str, Any] = {} if last is None else {**WARM_START_OPTIONS, "mu_init": mu}
        chosen |= {**self._options, **(options or {})}
        if time_limit is not None:
            chosen["max_wall_time"] = max(time_limit, 1e-3)
        self.outcome = run_ipopt(
            self._library,
            self._written.nlp,
            chosen,
            x=self._written.current_point(),
            g_multipliers=None if last is None else last.g_multipliers,
            lower_multipliers=None if last is None else last.lower_multipliers,
            upper_multipliers=None if last is None else last.upper_multipliers,
            on_iteration=on_iteration,
            output=[sys.stdout] if tee else [],
        )
        InProcessSolutionLoader(self._written, self.outcome).load_solution()
        return self.outcome
