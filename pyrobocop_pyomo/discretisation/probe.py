"""`DiscretisationProbe`: the values and multipliers of an answer, from which its errors are estimated on demand.

And path constraints that hold at the points of the mesh and not between them: a thin obstacle, a pole.

What a model states beside its phases: at the points of a mesh, where on another mesh it restrains another motion,
and in the integrals that phases have handed out.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from typing import Any

import numpy as np
from pyomo.common.gc_manager import PauseGC
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective, maximize
from pyomo.core.base.param import Param
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.calculus.derivatives import Modes, differentiate
from pyomo.core.expr.calculus.diff_with_pyomo import DifferentiationException
from pyomo.core.expr.numeric_expr import NegationExpression, SumExpression
from pyomo.dae import ContinuousSet

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.continuous.structure import open_sets, spots
from pyrobocop_pyomo.errors import PyRobocopError, TrajectoryError
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.row_violations import value_of_sum
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement, variables_in_any
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.numerics.tables import tables_continued
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.phases import Control, phases_of
from pyrobocop_pyomo.phases.bounds_between_points import (
    BoundPassed,
    bounds_passed,
    lowest_value,
    rows_passed,
    sentence_on_bounds,
    sides_stated,
)
from pyrobocop_pyomo.phases.coupled_phases import coupled_phases_of, put_on_model
from pyrobocop_pyomo.phases.equations import INTEGRALS
from pyrobocop_pyomo.phases.phase_values import PhaseValues
from pyrobocop_pyomo.phases.record import Statement
from pyrobocop_pyomo.phases.reintegration import reintegrate
from pyrobocop_pyomo.phases.rule_formulas import RuleFormulas, asked_by_point, read_inside_elements
from pyrobocop_pyomo.trajectories import Trajectory

from .estimates import SMALL_MOTION_ERROR, DiscretisationEstimate, PhaseEstimate, size_of_objective
from .lagrangian import PhaseLagrangian
from .phase_multipliers import PhaseMultipliers, RowMultipliers, phase_multipliers

# ---------------------------------------------------------------------------------------------------- beside the phases


def stated_at_points(model: Any, phases: Sequence[Any], found: RowMultipliers, size: float) -> str:
    """Why costates do not tell the error of the objective; empty where they do.

    They know the rows of phases. Planes between shapes, a user's own rows, bounds of rates and costs that are sums over
    points restrain the motion where the mesh looks, and nowhere else. What is stated at the ends of phases, or at a few
    element boundaries, is the same on any mesh, and so are costs of data at boundaries that were chosen for them.

    Parameters
    ----------
    model : Block
    phases : sequence of PhaseBlock
    found : RowMultipliers
    size : float
        Of the objective.
    """
    inside, at_boundaries = _variables_at_points(phases)
    most = max(2, min(phase.grid.mesh.elements for phase in phases) - 1)
    # Per unit of a row: smaller multipliers are what a barrier leaves of rows that restrain nothing.
    least = MET * size
    chosen = frozenset[float]().union(*(phase.record.chosen_times for phase in phases))
    for goal in model.component_data_objects(Objective, active=True):
        read = _read([goal.expr], phases)
        if read & inside or len({at_boundaries[key] for key in read & at_boundaries.keys()} - chosen) >= most:
            return f"'{goal.name}' reads points of the mesh, which are others on a finer one: state it as an integral."
    for component, rows in rows_beside(model, phases):
        read = _read([row.body for row in rows if abs(found.of_row(row)) > least], phases)
        if read & inside or (read & at_boundaries.keys() and len(component) >= most):
            home = component.parent_block()
            name = (home if isinstance(home, ObstacleAvoidanceBlockData) else component).name
            return f"'{name}' restrains the motion at points of the mesh only: compare with more elements."
    for phase in phases:
        for name in sorted(phase.record.kept_derivatives):
            keys = [id(rate) for rate in phase.component(f"{name}_derivative").values()]
            if any(abs(side.get(key, 0.0)) > least for side in (found.lower, found.upper) for key in keys):
                return (
                    f"bounds of the derivative of '{name}' hold at points of the mesh only: compare with more elements."
                )
    return ""


def rows_beside(model: Any, phases: Sequence[Any]) -> Iterator[tuple[Any, list[Any]]]:
    """Constraints that costates do not account for, each with its active rows."""
    accounted = {id(phase.component(name)) for phase in phases for name in _known_to_costates(phase.record)}
    for component in model.component_objects(Constraint, active=True):
        if id(component) not in accounted:
            yield component, [row for row in component.values() if row.active]


def motion_beside_phases(model: Any, phases: Sequence[Any]) -> Iterator[str]:
    """What moves in a model without a phase that states how, and what to do; a sentence for each."""
    sets = list(model.component_objects(ContinuousSet, active=True))
    undiscretised = open_sets(list(spots(model)))
    for domain in sets:
        if id(domain) not in undiscretised:
            yield (
                f"what moves along '{domain.name}' has no estimate. Compare with a discretisation of twice as many "
                "elements, or state the motion in an rcp.PhaseBlock."
            )
    if not (phases or sets):
        for block in blocks_of_kind(model, ObstacleAvoidanceBlockData):
            yield f"'{block.name}' stands on points, and no equation says what moves between them."


def _known_to_costates(record: Any) -> Iterator[str]:
    """Names of the rows that make states follow their equations, of what was stated at all times, and over knots."""
    kinds = ("equation", "collocation", "continuity", "step")
    yield from (f"{name}_{kind}" for name in record.names_of_states for kind in kinds)
    yield from (statement.name for statement in record.statements)
    # Knots that the user has placed are the same on any mesh.
    yield from (f"{name}_rate" for name in record.names(Control) if record.declarations[name].knots is not None)


def _variables_at_points(phases: Sequence[Any]) -> tuple[set[int], dict[int, float]]:
    """Ids of the variables of phases inside elements, and of those at boundaries between elements with the time."""
    inside: set[int] = set()
    at_boundaries: dict[int, float] = {}
    for phase in phases:
        record = phase.record
        first, *others, last = record.grid.mesh.boundaries
        between = set(others)
        for name in (*record.names_of_states, *record.names_of_signals):
            nodes = record.nodes(name)
            for time, variable in zip(nodes.times, nodes.variables(phase), strict=True):
                if time in between:
                    at_boundaries[id(variable)] = time
                elif time not in (first, last) and getattr(record.declarations[name], "knots", None) is None:
                    inside.add(id(variable))
    return inside, at_boundaries


def _read(expressions: Sequence[Any], phases: Sequence[Any]) -> set[int]:
    """Ids of the variables that expressions hold, but for those of integrals."""
    integrals = {id(member) for phase in phases for member in (phase.component(INTEGRALS) or {}).values()}
    return set(variables_in_any(expressions, leaves=integrals))


def integral_weights(model: Any, phases: Sequence[Any], found: RowMultipliers) -> dict[int, list[float]]:
    """Change of the Lagrangian per unit of each integral, by the identity of the phase.

    Parameters
    ----------
    model : Block
    phases : sequence of PhaseBlock
    found : RowMultipliers
    """
    members = {
        id(phase): [phase.component(INTEGRALS)[k] for k in range(1, len(phase.record.integrals) + 1)]
        for phase in phases
    }
    wanted = {id(member) for of_phase in members.values() for member in of_phase}
    if not wanted:
        return {id(phase): [] for phase in phases}
    terms = [(1.0, data.expr) for data in model.component_data_objects(Objective, active=True)]
    # What is in integrals is not looked through.
    for _, rows in rows_beside(model, phases):
        if not wanted.isdisjoint(variables_in_any([row.body for row in rows], leaves=wanted)):
            terms += [(-found.of_row(row), row.body) for row in rows if found.of_row(row) != 0.0]
    reading = [term for term in terms if not wanted.isdisjoint(variables_in_any([term[1]], leaves=wanted))]
    every = [member for of_phase in members.values() for member in of_phase]
    scratch = ConcreteModel()
    scratch.gained = Var(range(len(every)), initialize=list(map(value_of_sum, every)))
    gained = list(scratch.gained.values())
    in_their_place = NodeReplacement(dict(zip(map(id, every), gained, strict=True)))
    total = np.zeros(len(every))
    for weight, expression in reading:
        slopes = differentiate(in_their_place.of(expression), wrt_list=gained, mode=Modes.reverse_numeric)
        total += weight * np.array(slopes)
    by_member = dict(zip(map(id, every), total.tolist(), strict=True))
    return {key: [by_member[id(member)] for member in of_phase] for key, of_phase in members.items()}


# ---------------------------------------------------------------------------------------------------------------- probe


logger = logging.getLogger(__name__)

# A state that stays at zero has a size too.
_SMALLEST_SCALE = 1e-6


class DiscretisationProbe:
    """What an answer says of its own mesh.

    Parameters
    ----------
    model : Block
        Holding the answer. What is read of it is read now; the rules of its phases are evaluated when errors are.
    multipliers : callable
        Gives `RowMultipliers`, or None.
    objective : float
        Of the answer.
    scale : float or None
        Of the objective; see `size_of_objective`.
    """

    def __init__(
        self, model: Any, multipliers: Callable[[], RowMultipliers | None], objective: float, scale: float | None
    ) -> None:
        self._objective, self._size = objective, size_of_objective(objective, scale)
        self._found: DiscretisationEstimate | None = None
        self._phases: list[_Captured] = []
        phases = phases_of(model)
        self._model = model if phases else None  # which phases know weakly, and which a study may have let go
        self._beside = list(motion_beside_phases(model, phases))
        self._inputs: list[tuple[Any, Any]] = []
        if phases:
            with PauseGC():  # many small objects, all of which live on
                self._inputs = [(datum, datum.value) for datum in _data_of(model)]
                self._capture(model, phases, multipliers)

    def _capture(self, model: Any, phases: list[Any], multipliers: Callable[[], RowMultipliers | None]) -> None:
        weights, known, why = {}, multipliers(), "the solver gave no multipliers."
        goals = list(model.component_data_objects(Objective, active=True))
        sign = -1.0 if any(goal.sense == maximize for goal in goals) else 1.0
        # What no free variable moves is the same on any mesh.
        constant = all(variable.fixed for variable in variables_in_any([goal.expr for goal in goals]).values())
        if known is not None and not constant:
            try:
                weights = integral_weights(model, phases, known)
                why = stated_at_points(model, phases, known, self._size)
                known = None if why else known
            except (PyRobocopError, ArithmeticError, ValueError, TypeError, DifferentiationException) as error:
                known, why = None, str(error)
        for phase in phases:
            try:
                captured = _Captured(phase, known, weights.get(id(phase), []), sign, why, constant=constant)
                self._phases.append(captured)
            # TypeError: rows of steps, and components that were renamed, are not where a phase has them.
            except (PyRobocopError, ArithmeticError, ValueError, LookupError, TypeError) as error:
                self._beside.append(f"phase '{phase.name}': {_said(error)}")

    def error(self) -> DiscretisationEstimate:
        """The errors, estimated when they are requested first."""
        if self._found is None:
            with tables_continued(), ExitStack() as stack:
                for datum, number in self._inputs:  # with which it was solved: a study has put others since
                    stack.callback(datum.set_value, datum.value)
                    datum.set_value(number)
                errors = {captured.phase.name: captured.error(self._size) for captured in self._phases}
            self._found = DiscretisationEstimate(self._objective, errors, tuple(self._beside), self._size)
            self._phases, self._inputs, self._model = [], [], None  # what was captured is not needed any more
        return self._found

    def __getstate__(self) -> dict[str, Any]:
        self.error()  # with it goes what was captured: a pickle holds no model
        return dict(self.__dict__)


def _data_of(model: Any) -> Iterator[Any]:
    """Mutable parameters that have values, and fixed variables."""
    for parameter in model.component_objects(Param, active=True):
        if parameter.mutable:
            yield from parameter.sparse_values()
    yield from (variable for variable in model.component_data_objects(Var, active=True) if variable.fixed)


class _Captured:
    """One phase: its values, and its multipliers where they are known."""

    def __init__(
        self, phase: Any, known: RowMultipliers | None, weights: list[float], sign: float, why: str, *, constant: bool
    ) -> None:
        self.phase, self._weights, self._sign, self._why, self._constant = phase, weights, sign, why, constant
        self._trajectory: Trajectory = PhaseValues(phase).trajectory(evaluate=False)
        self._multipliers: PhaseMultipliers | None = None
        if any(True for _ in phase.component_data_objects(PAIR_TYPES, active=True)):
            # On finer meshes of a slider that is pushed the estimate stayed at twenty times the objective.
            self._why = "It has pairs, whose forces and multipliers jump inside elements."
        elif known is not None and not constant:
            try:
                self._multipliers = phase_multipliers(phase, known, self._trajectory.grid)
            except TrajectoryError as error:
                self._why = str(error)

    def error(self, size: float) -> PhaseEstimate:
        """The errors of the phase, as far as they can be estimated; `size` is that of the objective."""
        remarks: list[str] = []
        motion, state, largest, objective, net, flattered = None, "", 0.0, None, None, 0.0
        name = self.phase.name
        reason = asked_by_point(self.phase)
        if self.phase.record.discrete_states:
            reason = f"phase '{name}': step maps lead its states; on another mesh it would be another motion."
        if reason is not None:
            return PhaseEstimate(name, None, "", 0.0, None, (reason,))
        excesses = None
        with self._remarked(remarks, "error of the motion not estimated"):
            motion, state, largest = self._motion()
        with self._remarked(remarks, "error of the objective not estimated"):
            nets, objective, parts = self._errors_of_objective(size)
            net, flattered = float(nets.sum()), float(parts.sum())
        with self._remarked(remarks, "what is passed between the points is not known"):
            excesses = self._excesses()
        # A control with a value at each point passes a bound by a little wherever it is on it: verify() tells that.
        told = {
            name: of
            for name, of in self._bounds.items()
            if name in self.phase.record.declarations
            if not of.is_control or of.excess > SMALL_MOTION_ERROR * of.size
        }
        beyond = sentence_on_bounds(told)
        return PhaseEstimate(
            name, motion, state, largest, objective, tuple(remarks), net,
            flattered, excesses, f"phase '{name}': {beyond}" if beyond else "",
        )  # fmt: skip

    @contextmanager
    def _remarked(self, remarks: list[str], failed: str) -> Iterator[None]:
        """Say in a remark why something is not known: what rules say need not have a value between the points."""
        try:
            yield
        except (PyRobocopError, ArithmeticError, ValueError, TypeError, LookupError) as error:
            remarks.append(f"phase '{self.phase.name}': {failed}. {_said(error)}")

    @cached_property
    def _known(self) -> tuple[RuleFormulas, Trajectory]:
        """For all parts of the estimate: what rules say, and where to look at them, is evaluated once."""
        return RuleFormulas(self.phase, self._trajectory.grid), self._trajectory

    @cached_property
    def _bounds(self) -> dict[str, BoundPassed]:
        return bounds_passed(*self._known)

    @cached_property
    def _rows(self) -> dict[str, BoundPassed]:
        each = (rows_passed(*self._known, statement) for statement in self.phase.record.statements_of("constraint"))
        return {name: of for found in each for name, of in found.items()}

    def _excesses(self) -> Array:
        """How far each element passes what states alone have to keep, in sizes."""
        found = [of for of in (*self._bounds.values(), *self._rows.values()) if not of.is_control]
        none = np.zeros(self._trajectory.grid.mesh.elements)
        return np.max([none, *(of.of_elements / of.size for of in found)], axis=0)

    def _errors_of_objective(self, size: float) -> tuple[Array, Array, Array]:
        """As `PhaseLagrangian.errors`."""
        if self._constant:
            none = np.zeros(self._trajectory.grid.mesh.elements)
            return none, none, none
        inside = read_inside_elements(self.phase)
        if self._multipliers is None or inside is not None:
            raise TrajectoryError(inside or self._why)
        return PhaseLagrangian(*self._known, self._multipliers, self._weights, self._sign).errors(size)

    def _motion(self) -> tuple[Array, str, float]:
        """Errors of the elements relative to each state, and where the largest one is, in its own units."""
        trajectory = self._trajectory
        if not trajectory.states:
            return np.zeros(trajectory.grid.mesh.elements), "", 0.0
        coupled = coupled_phases_of(self.phase, trajectory.grid)
        formulas = RuleFormulas(self.phase, trajectory.grid, coupled) if coupled else self._known[0]
        with put_on_model([(self.phase, trajectory)]):
            found = reintegrate(self.phase, trajectory, formulas, states_only=True, ends_only=True)
        sizes = {name: _SMALLEST_SCALE + float(np.abs(of).max()) for name, of in trajectory.states.items()}
        relative = found.end_errors(found.local, trajectory, sizes)
        if not np.isfinite(relative).all():
            raise TrajectoryError("In some element its equations could not be followed.")
        within = {name: np.abs(found.local[name] - of) for name, of in found.planned.items()}
        worst = max(within, key=lambda name: float(within[name][:, -1].max()) / sizes[name])
        return relative, worst, float(relative.max()) * sizes[worst]


def _said(error: Exception) -> str:
    return str(error) if isinstance(error, PyRobocopError) else f"{type(error).__name__}: {error}"


def stepped_over(phase: Any) -> Iterator[tuple[str, float, float]]:
    """Path constraints that are missed between the points by more than a hundredth of their limit: name, amount, time.

    Where a rule gives no formula, or one of which no bounds are known, nothing is said.

    Parameters
    ----------
    phase : PhaseBlock
        With a solution.
    """
    record = phase.record
    if record.discrete_states or not record.statements_of("constraint"):
        return
    trajectory = PhaseValues(phase).trajectory(evaluate=False)
    formulas = RuleFormulas(phase, trajectory.grid)
    for statement in record.statements_of("constraint"):
        try:
            slacks = list(_slacks(formulas, statement))
        except TrajectoryError:
            continue
        for slack in slacks:
            allowed = -SMALL_MOTION_ERROR * _limit(slack)
            lowest, time = lowest_value(slack, allowed, formulas, trajectory)
            if lowest < allowed:
                yield statement.name, -lowest, time


def _slacks(formulas: RuleFormulas, statement: Statement) -> Iterator[Any]:
    """What each inequality of a rule has left: the larger less the smaller side."""
    for body, lower, upper in sides_stated(formulas, statement).values():
        if lower is upper:
            continue  # an equality
        for smaller, larger in ((lower, body), (body, upper)):
            is_limit = not any(side.__class__ is float and math.isinf(side) for side in (smaller, larger))
            if is_limit and hasattr(slack := larger - smaller, "is_expression_type"):
                yield slack


def _limit(slack: Any) -> float:
    """The number that a formula is compared with, as far as it stands in its sum; 1 without any."""
    sums, numbers = [slack], [0.0]
    while sums:
        of = sums.pop()
        for part in of.args if of.is_expression_type() else ():
            if part.__class__ in native_numeric_types:
                numbers.append(float(part))
            elif isinstance(part, (SumExpression, NegationExpression)):
                sums.append(part)
    return max(map(abs, numbers)) or 1.0
