"""The best point over all branches of the pairs, each branch a nonlinear program without complementarity.

Where a problem is convex in every branch, and in every node whose pairs are partly undecided, branch and bound is
exact. Otherwise every branch is solved, from several starts.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyomo.environ as pyo
from pyomo.common.errors import InfeasibleConstraintException
from pyomo.contrib.solver.common.factory import SolverFactory

from .point_check import check_point, maximises, read_pairs

# Sides are set to zero up to this: with more equations than variables Ipopt would not even start.
SLACK = 1e-9
FEASIBLE = 1e-5


class Branching:
    """A model whose pairs can be decided one by one.

    Parameters
    ----------
    model : ConcreteModel
        Gets constraints of its own, and its pairs are deactivated.
    """

    def __init__(self, model: Any) -> None:
        self.model = model
        self.sign = -1.0 if maximises(model) else 1.0
        self.pairs = read_pairs(model)
        self.variables = [v for v in model.component_data_objects(pyo.Var) if not v.fixed]
        self.start = [v.value for v in self.variables]
        self.solves = 0
        for component in list(model.component_objects(active=True, descend_into=True)):
            if component.ctype.__name__ == "Complementarity":
                component.deactivate()
        model.branching = pyo.ConstraintList()
        self.choices = [[[self._row(*piece) for piece in branch] for branch in pair.branches()] for pair in self.pairs]
        self._all = [row for branches in self.choices for branch in branches for row in branch if row is not None]
        for row in self._all:
            row.deactivate()
        for pair in self.pairs:
            for piece in pair.hull():
                self._row(*piece)
        self._solver = SolverFactory("pyrobocop.ipopt")

    def _row(self, low: float, body: Any, high: float) -> Any:
        if low == -math.inf and high == math.inf:
            return None
        if low == high:
            low, high = low - SLACK, high + SLACK
        return self.model.branching.add((None if low == -math.inf else low, body, None if high == math.inf else high))

    def solve(self, decided: dict[int, int], start: Sequence[float | None] | None = None) -> float:
        """Objective (to be minimised) of a node: pair number -> branch; infinite where Ipopt finds nothing feasible."""
        for row in self._all:
            row.deactivate()
        for pair, branch in decided.items():
            for row in self.choices[pair][branch]:
                if row is not None:
                    row.activate()
        for variable, number in zip(self.variables, self.start if start is None else start, strict=True):
            variable.set_value(number, skip_validation=True)
        self.solves += 1
        options = {"max_iter": 500, "tol": 1e-9}
        try:
            results = self._solver.solve(
                self.model, load_solutions=False, raise_exception_on_nonoptimal_result=False, solver_options=options
            )
        except InfeasibleConstraintException:
            return math.inf
        try:
            results.solution_loader.load_vars()
        except Exception:  # no point at all: too few degrees of freedom, proven infeasible
            return math.inf
        point = check_point(self.model)  # of the rows that are active in this node
        return self.sign * point.objective if point.violation <= FEASIBLE else math.inf

    def values(self) -> list[float | None]:
        """The point on the model."""
        return [v.value for v in self.variables]


def enumerate_branches(model: Any, starts: int = 3, spread: float = 1.0, seed: int = 0) -> tuple[float, int]:
    """Solve every branch from the model's start and from perturbed ones; (best objective, number of solves)."""
    branching = Branching(model)
    random = np.random.default_rng(seed)
    first = [0.0 if number is None else number for number in branching.start]
    points = [first, *(list(np.array(first) + spread * random.standard_normal(len(first))) for _ in range(starts - 1))]
    best = math.inf
    for choice in itertools.product(*(range(len(branches)) for branches in branching.choices)):
        for point in points:
            best = min(best, branching.solve(dict(enumerate(choice)), point))
    return branching.sign * best, branching.solves


def branch_and_bound(model: Any, limit: int = 4000, gap: float = 1e-6) -> tuple[float, int]:
    """Exact for problems whose nodes are all convex; (best objective, number of solves).

    Raises
    ------
    RuntimeError
        When the tree is not exhausted within `limit` solves.
    """
    branching = Branching(model)
    best = math.inf
    waiting: list[tuple[float, dict[int, int]]] = [(-math.inf, {})]
    while waiting:
        bound, decided = waiting.pop()
        if bound >= best - gap * max(1.0, abs(best)):
            continue
        if branching.solves >= limit:
            raise RuntimeError(f"the tree is not exhausted after {limit} solves; best {best}")
        objective = branching.solve(decided)
        if objective >= best - gap * max(1.0, abs(best)):
            continue
        undecided = [i for i in range(len(branching.pairs)) if i not in decided]
        worst = max(undecided, key=lambda i: branching.pairs[i].natural(), default=None)
        violated = 0.0 if worst is None else branching.pairs[worst].natural()
        if violated <= 1e-7:
            best = objective
            continue
        children = [(objective, {**decided, worst: branch}) for branch in range(len(branching.choices[worst]))]
        waiting += _nearest_last(branching, worst, children)
        if violated <= 1e-3:  # almost complementary: the branch that it is nearest to bounds the rest
            nearest = {
                i: _nearest_last(branching, i, [(0.0, {i: b}) for b in _branches(branching, i)])[-1][1][i]
                for i in range(len(branching.pairs))
            }
            best = min(best, branching.solve(nearest))
    return branching.sign * best, branching.solves


def _branches(branching: Branching, pair: int) -> range:
    return range(len(branching.choices[pair]))


def _nearest_last(branching: Branching, pair: int, children: Iterable[Any]) -> list[Any]:
    """Depth first into the branch that the node's point violates least."""

    def violation(child: Any) -> float:
        rows = [row for row in branching.choices[pair][child[1][pair]] if row is not None]
        return -max(
            (
                max((row.lb or 0) - pyo.value(row.body), pyo.value(row.body) - (math.inf if row.ub is None else row.ub))
                for row in rows
            ),
            default=0.0,
        )

    return sorted(children, key=violation)
