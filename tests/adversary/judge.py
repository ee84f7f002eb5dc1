"""An independent judge of answers: rows by ``pyo.value``, optimality by the executable of Ipopt through Pyomo."""

from math import inf, isfinite
from typing import Any

import numpy as np
import pyomo.environ as pyo
from pyomo.common.collections import ComponentMap
from pyomo.common.errors import ApplicationError
from pyomo.core.base.var import VarData
from pyomo.core.expr.calculus.derivatives import Modes, differentiate
from pyomo.core.expr.visitor import identify_variables

import pyrobocop_pyomo as rcp

FEASIBLE = 1e-4  # of the size of a row's terms
BETTER = 1e-4  # of the size of the objective
BESIDE = 0.05  # of the size of each variable, from the answer
MOST_OF_A_BOUND = 1e6  # what is larger stands for no bound
OPTIONS = {"nlp_scaling_method": "user-scaling", "max_iter": 200, "max_cpu_time": 5, "mu_init": 1e-4}


class Judge:
    """What is wrong with the values of a model as an answer to it. The model is of no other use afterwards.

    Parameters
    ----------
    model : ConcreteModel
    """

    def __init__(self, model: pyo.ConcreteModel) -> None:
        self._model = model
        (self._objective,) = model.component_data_objects(pyo.Objective, active=True)
        self._rows = list(model.component_data_objects(pyo.Constraint, active=True))
        self._pairs = [(pair.a, pair.b) for pair in rcp.active_pairs(model)]
        found = dict.fromkeys(id(v) for expression in self._expressions() for v in _variables(expression))
        self._variables = [v for v in model.component_data_objects(pyo.Var) if found.pop(id(v), 0) is None]
        self._foreign = len(found)
        self._sizes = self._sizes_of_variables()

    def complaint(self, size: float, seed: int) -> str | None:
        """Why the answer is none, in words; None where nothing speaks against it.

        Parameters
        ----------
        size : float
            What the objective is to be compared with where it is smaller itself.
        seed : int
            Of the points beside the answer.
        """
        if self._foreign:
            return f"{self._foreign} variables are not on the model"
        if any(v.value is None or not isfinite(v.value) for v in self._variables):
            return "a variable has no finite value"
        worst, name = self._violation()
        if not worst <= FEASIBLE:
            return f"{name} is violated by {worst:.1e} of its size"
        return self._better_point(max(size, abs(pyo.value(self._objective))), worst, seed)

    # ------------------------------------------------------------------------------------ feasibility

    def _expressions(self) -> list[Any]:
        return [
            self._objective.expr,
            *(row.body for row in self._rows),
            *(side for pair in self._pairs for side in pair),
        ]

    def _sizes_of_variables(self) -> ComponentMap:
        """The largest value or bound of all that are declared together; rounding beside the others is no size."""
        largest: dict[int, float] = {}
        for v in self._variables:
            bounds = [abs(b) for b in (v.lb, v.ub) if b is not None and abs(b) < MOST_OF_A_BOUND]
            key = id(v.parent_component())
            largest[key] = max([largest.get(key, 0.0), abs(v.value or 0.0), *bounds])
        least = 1e-9 * max(largest.values(), default=1.0) or 1.0  # less is below the tolerance of any solver
        return ComponentMap((v, max(least, largest[id(v.parent_component())])) for v in self._variables)

    def _size(self, expression: Any, *numbers: float | None) -> float:
        """Of the terms of an expression, to first order, and of the numbers that it is compared with."""
        variables = list(_variables(expression)) if not isinstance(expression, (int, float)) else []
        if isinstance(expression, VarData):
            gradient = [1.0]
        else:
            gradient = differentiate(expression, wrt_list=variables, mode=Modes.reverse_numeric) if variables else []
        terms = [abs(slope) * self._sizes[v] for slope, v in zip(gradient, variables, strict=True)]
        return float(sum(terms) + sum(abs(number) for number in numbers if number)) or 1.0

    def _violation(self) -> tuple[float, str]:
        """The largest violation, relative to its row's size, and where it is."""
        worst = (0.0, "nothing")
        for v in self._variables:
            worst = max(worst, (_outside(v.value, v.lb, v.ub) / self._sizes[v], f"a bound of {v.name}"))
        for row in self._rows:
            outside = _outside(pyo.value(row.body), row.lb, row.ub)
            if outside > 0.0:
                worst = max(worst, (outside / self._size(row.body, row.lb, row.ub), row.name))
        for i, sides in enumerate(self._pairs):
            a, b = (pyo.value(side) / self._size(side) for side in sides)
            worst = max(worst, (max(-a, -b, min(a, b)), f"pair {i}"))
        return worst

    # ------------------------------------------------------------------------------------ optimality

    def _better_point(self, size: float, violation: float, seed: int) -> str | None:
        """What a point beside the answer is better by, if one is."""
        model, free = self._model, [v for v in self._variables if not v.fixed]
        sign = 1.0 if self._objective.sense == pyo.minimize else -1.0
        start, here = [v.value for v in free], sign * pyo.value(self._objective)
        if not free:
            return None
        self._restrict_to_the_branch()
        model.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
        model.scaling_factor[self._objective] = 1.0 / size if size > 0.0 else 1.0
        for row in self._rows:
            model.scaling_factor[row] = 1.0 / self._size(row.body, row.lb, row.ub)
        for v, value in zip(free, start, strict=True):
            model.scaling_factor[v] = 1.0 / self._sizes[v]
            reach = BESIDE * self._sizes[v]
            v.setlb(max(-inf if v.lb is None else min(v.lb, value), value - reach))
            v.setub(min(inf if v.ub is None else max(v.ub, value), value + reach))
        random = np.random.default_rng(seed)
        for attempt in range(2):
            for v, value in zip(free, start, strict=True):
                moved = value + attempt * BESIDE * self._sizes[v] * random.uniform(-0.5, 0.5)
                v.set_value(min(max(moved, v.lb), v.ub), skip_validation=True)
            if not self._solved_by_the_executable():
                continue
            gained = here - sign * pyo.value(self._objective)
            if gained > BETTER * size and self._violation()[0] <= max(violation, 1e-6):
                return f"a point beside the answer is better by {gained:.1e}, of {size:.1e}"
        return None

    def _restrict_to_the_branch(self) -> None:
        """Replace each pair by the side that is zero, as far as the answer shows it, and the sign of the other."""
        model = self._model
        for component in list(model.component_data_objects(rcp.Complementarity, active=True)):
            component.deactivate()
        model.branch_of_the_judge = pyo.ConstraintList()
        for a, b in self._pairs:
            zero, other = (a, b) if pyo.value(a) / self._size(a) <= pyo.value(b) / self._size(b) else (b, a)
            for side, limits in ((zero, (0.0, max(0.0, pyo.value(zero)))), (other, (0.0, None))):
                if not isinstance(side, (int, float)) and any(True for _ in _variables(side, fixed=False)):
                    self._rows.append(model.branch_of_the_judge.add((limits[0], side, limits[1])))
        self._pairs = []

    def _solved_by_the_executable(self) -> bool:
        solver = pyo.SolverFactory("ipopt")
        solver.options.update(OPTIONS)
        try:
            found = solver.solve(self._model, load_solutions=False)
        except (
            ValueError,
            RuntimeError,
            ArithmeticError,
            ApplicationError,
        ):  # what cannot be written has no better point
            return False
        if found.solver.termination_condition != pyo.TerminationCondition.optimal:
            return False
        self._model.solutions.load_from(found)
        return True


def _variables(expression: Any, fixed: bool = True) -> Any:
    return () if isinstance(expression, (int, float)) else identify_variables(expression, include_fixed=fixed)


def _outside(number: float, lower: float | None, upper: float | None) -> float:
    """Distance from an interval; infinite for NaN."""
    if number != number:
        return inf
    return max(0.0, -inf if lower is None else lower - number, -inf if upper is None else number - upper)
