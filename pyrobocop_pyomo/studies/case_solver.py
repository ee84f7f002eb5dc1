"""`CaseSolver`: solves one case after the other, each from the model as it was, warm where there is a neighbour."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.core.base.block import BlockData
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.complementarity import active_sources, pairs_of
from pyrobocop_pyomo.errors import KeywordError, ModelError, PyRobocopError, SolverNotFoundError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.pyomo_internals import put_bounds, stored_bounds
from pyrobocop_pyomo.modeling.variable_values import Values, VariableValues
from pyrobocop_pyomo.mpcc.active_set import Certificate
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.solving import Quality, SolveResult
from pyrobocop_pyomo.solving.ipopt_options import NEARLY_THERE
from pyrobocop_pyomo.solving.strategies import SOLVE, TIGHT

from .outcomes import Outcome, seconds_left, solve_as_given
from .sweep_cases import SweepCase, put_mapping

Put = Callable[[Any, Any], object]
Read = Callable[[Any, SolveResult], Mapping[str, Any]]

# Options of `solve` that a warm solve understands as well; with any other every case is solved cold.
WARM_OPTIONS = frozenset({"options", "tolerances", "progress"})
# From a point that solves the same model for other numbers.
NEIGHBOUR = replace(TIGHT, name="neighbour", options=NEARLY_THERE, exploration=0.0)


class ModelState(VariableValues):
    """All numbers of a model that a case may change: Params, and values, bounds and fixings of variables.

    Parameters
    ----------
    model : Block
    """

    def __init__(self, model: Any) -> None:
        super().__init__(model.component_data_objects(Var))
        # The stored bounds: the public ones are joined with the domain's.
        self._kept = [(variable, variable.fixed, stored_bounds(variable)) for variable in self.variables]
        self._params = [
            (member, member.value)
            for param in model.component_objects(Param)
            if param.mutable and not param.is_reference()
            for member in param.values()
            if member.value.__class__ in native_numeric_types or member.value is None
        ]

    def restore(self) -> None:
        """Put all back."""
        for member, number in self._params:
            is_there = member.parent_component() is not None  # a plan around obstacles may have put others in its place
            if is_there and member.value is not number and number is not None:
                member.set_value(number)
        super().restore()
        for variable, fixed, bounds in self._kept:
            variable.fixed = fixed
            put_bounds(variable, bounds)

    def write(self, values: Sequence[float | None]) -> None:
        """Give the free variables values, in the order of `variables`."""
        for variable, number in zip(self.variables, values, strict=True):
            if not variable.fixed:
                variable.set_value(number, skip_validation=True)


class CaseSolver:
    """Solves cases one by one.

    Parameters
    ----------
    source : Block or callable
        A model, or what builds one: for each case where there is no `put`, otherwise once.
    put : callable, optional
        ``put(target, data)`` puts the data of a case on the model (or on the object that the builder gave).
    read : callable, optional
        ``read(target, result)`` gives numbers to keep.
    options : mapping
        Of `solve`.

    Attributes
    ----------
    state : ModelState or None
        Of the model that all cases share, as it was; None where each has its own.
    """

    def __init__(self, source: Any, put: Put | None, read: Read | None, options: Mapping[str, Any]) -> None:
        is_model = isinstance(source, BlockData)
        self._put, self._read = put_mapping if put is None and is_model else put, read
        self._build, self._options = source, {"progress": False, **options}
        self.state: ModelState | None = None
        if self._put is not None:
            self._target = source if is_model else source()
            self.model = model_of(self._target)
            self.state = ModelState(self.model)

    def close(self) -> None:
        """Leave the model as it was."""
        if self.state is not None:
            self.state.restore()

    def put(self, data: Any) -> ModelState:
        """Make the model that of a case; returns the state before its data."""
        if self._put is None or self.state is None:
            self._target = self._build(data)
            self.model = model_of(self._target)
            return ModelState(self.model)
        self.state.restore()
        self._put(self._target, data)
        return self.state

    def solve(
        self, case: SweepCase, near: tuple[int, Values] | None, limit: float | None, *, deadline: Deadline
    ) -> Outcome:
        """Solve a case; whatever goes wrong is in the outcome.

        Parameters
        ----------
        case : SweepCase
        near : (int, list), optional
            Number of another case, and its solution.
        limit : float, optional
            Seconds for this case.
        deadline : Deadline
            Of the whole sweep.

        Returns
        -------
        Outcome

        Raises
        ------
        KeywordError, SolverNotFoundError
            When `solve` does not have an option, or there is no Ipopt: no case can be solved.
        """
        started, deadline = time.perf_counter(), deadline.within(limit)
        found: dict[str, Any] = {"result": None}  # what was solved stays so where reading it fails
        try:
            state = self.put(case.data)
            found["result"], from_neighbour = self._solve(state, near, deadline)
            found["started_from"] = near[0] if from_neighbour and near is not None else None
            found["values"] = state.read()
            if self._read is not None:
                found["numbers"] = plain_numbers(self._read(self._target, found["result"]))
        except (KeywordError, SolverNotFoundError):
            raise
        except Exception as error:  # whatever goes wrong with one case must not lose the others
            found["error"] = f"{'read: ' if 'values' in found else ''}{type(error).__name__}: {error}"
        return Outcome.of(case, seconds=time.perf_counter() - started, **found)

    def _solve(
        self, state: ModelState, near: tuple[int, Values] | None, deadline: Deadline
    ) -> tuple[SolveResult, bool]:
        initial = state.read()
        warm = None
        if near is not None and len(near[1]) == len(state.variables):
            warm = self._warm(state, near[1], deadline)
            if warm is not None and (_is_certified(warm) or warm.stop_reason.is_final):
                return warm, True
        found = state.read() if warm is not None else []
        state.write(initial)
        cold = self._solved(deadline)
        if warm is None or warm.quality is Quality.INFEASIBLE or not warm.standing.is_better_than(cold.standing):
            return cold, False
        state.write(found)
        return warm, True

    def _warm(self, state: ModelState, near: Values, deadline: Deadline) -> SolveResult | None:
        """Solve from a neighbour's solution; None where that cannot be done."""
        if not self._options.keys() <= WARM_OPTIONS or not _warm_possible(self.model):
            return None
        state.write(near)
        try:
            return self._solved(deadline, strategies=(NEIGHBOUR, SOLVE))
        except PyRobocopError:  # a cold solve says better what is wrong
            return None

    def _solved(self, deadline: Deadline, **further: Any) -> SolveResult:
        return solve_as_given(self.model, **{**self._options, **further, "time_limit": seconds_left(deadline)})


def model_of(target: Any) -> Any:
    """The model of what a builder gave: the object itself, or its attribute ``model``.

    Raises
    ------
    ModelError
        When it is neither.
    """
    found = target if isinstance(target, BlockData) else getattr(target, "model", None)
    if not isinstance(found, BlockData) or not found.is_constructed():
        raise ModelError(f"the builder returned {type(target).__name__}; expected a model, or an object with a model.")
    return found


def plain_numbers(found: Any) -> dict[str, Any]:
    """Numbers as a file and a table can keep them.

    Raises
    ------
    ModelError
        When it is no mapping of names to numbers, texts and arrays of numbers.
    """
    if not isinstance(found, Mapping):
        raise ModelError(f"read returned {type(found).__name__}; expected a mapping of names to numbers.")
    return {
        str(name): number if number is None or isinstance(number, (bool, str)) else np.asarray(number, float).tolist()
        for name, number in found.items()
    }


def _warm_possible(model: Any) -> bool:
    """Obstacles need whole plans, and a relaxation that the user applied is the user's."""
    if any(isinstance(block, (ContainmentData, ObstacleAvoidanceBlockData)) for block in model.block_data_objects()):
        return False
    return len(list(active_sources(model))) > 0 or not pairs_of(model)


def _is_certified(result: SolveResult) -> bool:
    """Whether a result needs no second opinion: optimal, and where there are pairs no branch through it descends."""
    return result.quality is Quality.OPTIMAL and (
        not result.residuals or (result.certificate is Certificate.PROVEN and result.largest_natural_residual <= 1e-6)
    )
