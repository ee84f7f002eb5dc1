"""Checking a trajectory against the stated equations, recomputed without the rows or the solver."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import NumericValue

from pyrobocop_pyomo.complementarity import CanonicalForm, Complementarity, canonical_form
from pyrobocop_pyomo.complementarity.pairs import part_of_side
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.activity import foreign_read, foreign_variable
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.in_place_changes import expressions_of
from pyrobocop_pyomo.modeling.row_violations import bound_violation, sides_of_row
from pyrobocop_pyomo.modeling.shared_nodes import shared_value, variables_in_any
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import can_step

from .boundary_conditions import KINDS, end_violations, values_given
from .bounds_between_points import BoundPassed, bounds_passed, rows_passed, sentence_on_bounds
from .coupled_phases import (
    coupled_phases_of,
    indices_of,
    is_of_grid,
    is_on_model,
    other_phases,
    put_on_model,
)
from .declarations import Algebraic, Control, Duration, Parameter, State, in_infinities
from .element_instants import ElementInstants
from .nodes import IntervalNodes
from .record import AT_BOUNDARIES, PhaseRecord, Statement
from .reintegration import Reintegration, reintegrate
from .rule_formulas import RuleFormulas
from .stated_numbers import moving_end, rows_of_ends

# What is violated by more than this does not hold; an error of an element above this, in sizes of the states, is a
# coarse mesh; errors of the horizon are said to grow where they exceed the sum of those of the elements so many times.
HOLDS, COARSE, GROWS = 1e-5, 1e-2, 10.0


@dataclass(frozen=True)
class Verification(Presented):
    """What was recomputed from a trajectory; every number is a maximum over time, in the model's own units.

    Attributes
    ----------
    defect : float
        How far the derivative of the state polynomial is from the stated right-hand side, and a state at the end of an
        element from what its step map says.
    continuity : float
        Jump of a state between elements.
    equations : float
        Violation of residual equations and path constraints at the collocation points.
    bounds : float
        Violation of declared bounds, those of derivatives and of the duration included, and of boundary values.
        Also how far an integer control is from its values.
    natural_residual : float
        Largest ``|min(a, b)|`` over all complementarity pairs.
    product : float
        Largest ``|a b|`` over all complementarity pairs.
    element_error : float or None
        Re-integration of each element from its own start: largest difference at its end. This is the
        local discretisation error. None where it cannot be computed; then see `remarks`.
    horizon_error : float or None
        Re-integration of the whole horizon in one go: largest difference at any element end.
    motion_error : float or None
        Largest difference, inside elements too, of a state's polynomial from the solution of the equations under the
        plan's controls, from the start of the plan on; where pairs decide what happens, with contact simulated.
    integral_error : float or None
        Of all integrals of the phase, those in the objective and in constraints, the largest sum over all elements of
        the difference between the quadrature of the mesh and the integral along the motion that the equations make of
        each element. None where none was stated, or none is known; then see `remarks`.
    remarks : tuple of str
        What could not be checked, and why.
    element_errors : array, shape (N,), or None
        The re-integration error of each element; `element_error` is the largest.
    relative_error : float or None
        The largest of `element_errors` where that of each state is divided by its size.
    contact : bool
        Whether pairs decide what happens.
    bounds_passed : dict of name to a tuple (excess, time, bound, size, is_control)
        States and controls whose polynomials pass a declared bound between the points of the mesh: by how much, when,
        which bound, and how large the signal is; the same of declared rates, named ``"rate of u"``, and of path
        constraints.
    """

    defect: float
    continuity: float
    equations: float
    bounds: float
    natural_residual: float
    product: float
    element_error: float | None
    horizon_error: float | None
    motion_error: float | None = None
    integral_error: float | None = None
    remarks: tuple[str, ...] = field(default=())
    element_errors: Array | None = field(default=None, repr=False, compare=False)
    relative_error: float | None = field(default=None, repr=False, compare=False)
    contact: bool = field(default=False, repr=False, compare=False)
    bounds_passed: Mapping[str, BoundPassed] = field(default_factory=dict, repr=False, compare=False)

    @property
    def verdict(self) -> str:
        """Whether the plan holds, in words, what it does between the points, and what a large horizon error means."""
        violations = {
            "the equations of motion are violated": self.defect,
            "a state jumps between elements": self.continuity,
            "an equation or a constraint is violated": self.equations,
            "a bound or a boundary value is violated": self.bounds,
            "a pair is violated": self.natural_residual,
        }
        worst = max(violations, key=lambda name: violations[name])
        if not violations[worst] <= HOLDS:
            return (
                f"Verdict: this does NOT hold: {worst} by {violations[worst]:.1e}. After a failed solve print(result) "
                "says what is not met. Values that another integrator made, as simulate() does, are off by its error. "
                f"{sentence_on_bounds(self.bounds_passed)}"
            ).rstrip()
        said = (
            f"Verdict: equations{', bounds and pairs' if self.contact else ' and bounds'} hold at the points of the "
            f"mesh (to {violations[worst]:.0e})"
        )
        between = f"{self._between_points()} {self._over_the_horizon()}".rstrip()
        return f"{said}{between} {sentence_on_bounds(self.bounds_passed)}".rstrip()

    def _between_points(self) -> str:
        """How far each element follows its equations, which goes on from what holds at the points."""
        if self.element_error is None or self.relative_error is None:
            return "; what happens between the points is not known."
        if self.relative_error <= COARSE:
            return f", and each element follows its equations to {self.element_error:.0e}."
        return (
            ", but the mesh is coarse: between two element ends the equations lead up to "
            f"{100 * self.relative_error:.2g} % of a state's size elsewhere. "
            + ("Where an impact is spread over one element, that is its height. " if self.contact else "")
            + "Take more elements."
        )

    def _over_the_horizon(self) -> str:
        """What a horizon error means that is much larger than those of the elements; empty where it is not."""
        if self.element_errors is None or self.horizon_error is None:
            return ""
        if self.horizon_error <= GROWS * max(float(self.element_errors.sum()), HOLDS):
            return ""
        why = "contact opens or closes a moment apart" if self.contact else "the motion is unstable"
        size = f"to {self.horizon_error:.1e}" if self.horizon_error < math.inf else "beyond what can be followed"
        return (
            f"Integrated over the whole horizon the difference grows {size}, since {why}: small "
            "differences at the start are large at the end. That is harmless where a controller or replanning corrects "
            "the motion on the way, for which the error per element counts, and matters where controls are replayed "
            "without measurements."
        )

    @property
    def largest_violation(self) -> float:
        """The worst of defect, continuity, equations, bounds and natural residual."""
        return max(self.defect, self.continuity, self.equations, self.bounds, self.natural_residual)

    def _summary(self) -> str:
        horizon = "" if self.horizon_error is None else f", re-integration over the horizon {self.horizon_error:.1e}"
        return f"largest violation {self.largest_violation:.1e}{horizon}"

    def _rows(self) -> dict[str, str]:
        numbers = {
            "collocation defect": self.defect,
            "continuity": self.continuity,
            "equations and constraints": self.equations,
            "bounds": self.bounds,
            "complementarity min(a, b)": self.natural_residual,
            "complementarity a * b": self.product,
            "re-integration, per element": self.element_error,
            "re-integration, horizon": self.horizon_error,
            "motion inside elements": self.motion_error,
            "integrals, re-integrated": self.integral_error,
        }
        return {check: "not available" if number is None else f"{number:.2e}" for check, number in numbers.items()}

    def __str__(self) -> str:
        lines = [f"{check:27} {number}" for check, number in self._rows().items()]
        return "\n".join([*lines, *self.remarks, self.verdict])


def verify(block: Any, trajectory: Trajectory) -> Verification:
    """Recompute everything that a trajectory promises; see `Verification`.

    Parameters
    ----------
    block : PhaseBlock
    trajectory : Trajectory
        Where it is not what stands on the model, rules that read other phases are not checked.

    Raises
    ------
    TrajectoryError
        When the trajectory has other variables than the phase.
    """
    record: PhaseRecord = block.record
    signals = record.names(Algebraic) + record.names(Control)
    for kind, given, needed in (
        ("states", trajectory.states, record.names_of_states),
        ("algebraics and controls", trajectory.signals, signals),
        ("parameters", trajectory.parameters, record.names(Parameter)),
    ):
        if set(given) != set(needed):
            raise TrajectoryError(
                f"trajectory '{trajectory.name}' has the {kind} {sorted(given)}, phase '{block.name}' has "
                f"{sorted(needed)}. Verify it by the phase that it belongs to."
            )
    check = _TrajectoryCheck(block, trajectory)
    with put_on_model([(block, trajectory)]):
        check.remark_what_is_not_stated(block)
        defect, equations, natural, product = check.at_collocation_points()
        motion, passed = check.reintegrate(), check.passed_between_points()
        at_ends, of_pairs = check.at_given_ends()  # the last: it uses up the formulas
        ends = None if motion is None else motion.end_errors(motion.local, trajectory)
        gained = {} if motion is None else motion.integrals
        integrals = (float(np.abs(planned - moved).sum()) for planned, moved in gained.values())
        horizon = None if motion is None else float(motion.end_errors(motion.open_loop, trajectory).max())
        return Verification(
            defect=defect,
            continuity=check.continuity(),
            equations=max(equations, at_ends),
            bounds=check.bounds(),
            natural_residual=max(natural, of_pairs),
            product=product,
            element_error=None if ends is None else float(ends.max()),
            horizon_error=horizon,
            motion_error=None if motion is None else float(motion.errors.max()),
            integral_error=max(integrals, default=None),
            remarks=tuple(check.remarks),
            element_errors=ends,
            relative_error=None if motion is None else check.relative_error(motion),
            contact=bool(record.statements_of("complementarity")),
            bounds_passed=passed,
        )


class _TrajectoryCheck:
    def __init__(self, block: Any, trajectory: Trajectory) -> None:
        record: PhaseRecord = block.record
        self.block, self.record, self.trajectory, self.grid = block, record, trajectory, trajectory.grid
        # Rules are evaluated at time indices, which are normalised where something of the horizon was to be found.
        self.on_grid = is_of_grid(record, trajectory.grid)
        self.indices = record.grid if self.on_grid else indices_of(record, trajectory.grid)
        self.formulas = RuleFormulas(block, trajectory.grid, coupled_phases_of(block, trajectory.grid))
        self.states = {name: trajectory.element_states(name) for name in trajectory.states}
        self.slopes = {name: self._slopes(name) for name in self.states}
        self.remarks: list[str] = []
        self.statements = list(record.statements)
        others = other_phases(block)
        if others and not is_on_model(block, trajectory):
            self._leave_out(others)
        if record.discrete_states and not can_step(self.grid.scheme):
            raise TrajectoryError(
                f"trajectory '{trajectory.name}' is one of {self.grid.scheme.name}; the phase has step maps "
                f"({', '.join(sorted(record.discrete_states))}), which lead from one element boundary to the next."
            )

    def _leave_out(self, unknown: Sequence[Any]) -> None:
        """Leave out the rules that read other phases whose values at the times of the trajectory nobody knows."""
        for statement in self.record.statements:
            read = {id(variable.parent_block()) for variable in self._variables_of(statement)}
            names = [phase.name for phase in unknown if id(phase) in read]
            if names:
                self.statements.remove(statement)
                self.remarks.append(
                    f"not checked: '{statement.name}', which reads {', '.join(names)}. The model has other values than "
                    "this trajectory, so that those of the other phase are not known: initialize both."
                )

    def _variables_of(self, statement: Statement) -> Iterable[Any]:
        """What stands in the rows that a rule has made."""
        of_states = [name for name, of in self.record.equation_of.items() if of == statement.name]
        names = [statement.name, *(f"{name}_{of}" for name in of_states for of in ("collocation", "equation", "step"))]
        rows = (data for name in names for data in (self.block.component(name) or {}).values())
        return variables_in_any(chain.from_iterable(map(expressions_of, rows))).values()

    def _stated(self, kind: str) -> list[Statement]:
        return [statement for statement in self.statements if statement.kind == kind]

    def _slopes(self, name: str) -> Array:
        """Derivatives at the stages: of the polynomial, or as handed over where its values do not determine them."""
        scheme, widths = self.grid.scheme, self.grid.mesh.widths
        if len(scheme.D) == scheme.stages:
            return self.states[name] @ scheme.D.T / widths[:, None]
        if name not in self.trajectory.rates:
            raise TrajectoryError(
                f"trajectory '{self.trajectory.name}' has no rates of '{name}'; with the scheme {scheme.name} the "
                "values alone do not determine them. Extract it with phase.trajectory()."
            )
        return self.trajectory.element_rates(name)

    def remark_what_is_not_stated(self, block: Any) -> None:
        known = self.record.generated_rows | {statement.name for statement in self.record.statements}
        known |= rows_of_ends(self.record.declarations) | {"boundary_width", "duration_as_stated"}
        own = [name for name in block.component_map((Constraint, Complementarity)) if name not in known]
        if own:
            self.remarks.append(f"not checked, since they were not stated through the phase: {', '.join(own)}.")

    # ---------------------------------------------------------------- at the points

    def at_collocation_points(self) -> tuple[float, float, float, float]:
        """Violations of rates and step maps, of equations, and of pairs by smaller side and by product."""
        at = ElementInstants(self.formulas, self.trajectory, self.grid.scheme.c)
        # Not the polynomials, but the values at the stages themselves.
        first = 0 if self.grid.scheme.starts_on_a_stage else 1  # an element start, or an end, may be none
        at.values |= {name: of[:, first : first + self.grid.scheme.stages].T for name, of in self.states.items()}
        rates = {name: slopes.T for name, slopes in self.slopes.items()}
        of_steps = equations = natural = product = 0.0
        for statement in self._stated("ode"):
            rates |= self._values_by_state(statement, at)
        for statement in self._stated("step map"):
            for name, following in self._values_by_state(statement, at).items():
                of_steps = max(of_steps, float(np.abs(self.states[name][:, -1] - following).max()))
        for kind in ("residual", "constraint", "complementarity"):
            for statement in self._stated(kind):
                found = self._violations(statement, at)
                equations, natural, product = map(max, (equations, natural, product), found)
        at_boundaries = self._stated(AT_BOUNDARIES)
        ends = ElementInstants(self.formulas, self.trajectory, np.array([0.0, 1.0]))
        equations = max([equations, *(self._violations(statement, ends)[0] for statement in at_boundaries)])
        return max(of_steps, self._defect(rates)), equations, natural, product

    def _values_by_state(self, statement: Statement, at: ElementInstants) -> dict[str, Array]:
        """What an ode or a step map gives at the points, by the names of the states."""
        if not self._asks_rows(statement):
            stated = self.formulas.by_state(statement)
            return dict(zip(stated, at.values_stated([*stated.values()], statement), strict=True))
        found = {}
        for name in (name for name, of in self.record.equation_of.items() if of == statement.name):
            in_order = [self.record.rates[name][t] for times in self.indices.stage_times for t in times]
            found[name] = self._values_on_model(in_order, statement).reshape(-1, self.grid.scheme.stages).T
        return found

    def _violations(self, statement: Statement, at: ElementInstants) -> tuple[float, float, float]:
        """Largest violations of what a statement makes: of rows, and of pairs by smaller side and by product."""
        asks_rows = self._asks_rows(statement)
        if asks_rows:
            data = self.block.component(statement.name).values()
            said = [canonical_form(of) if statement.kind == "complementarity" else of.expr for of in data]
        else:
            said = [*self.formulas.formulas_of(statement, statement.rows).values()]
        rows: list[Any] = []
        pairs: list[Any] = []
        for row in said:
            is_pair = isinstance(row, CanonicalForm)
            rows += map(sides_of_row, row.rows if is_pair else [row])
            pairs += row.pairs if is_pair else []
        of_rows, natural, product = [0.0], [0.0], [0.0]
        sides = [*chain.from_iterable(rows), *(side for pair in pairs for side in (pair.a, pair.b))]
        values = iter(self._values_on_model(sides, statement) if asks_rows else at.values_stated(sides, statement))
        for _ in rows:
            of_rows.append(_beyond(next(values), next(values), next(values)))
        for pair in pairs:
            a, b = part_of_side(next(values), pair.a_part), part_of_side(next(values), pair.b_part)
            natural.append(float(np.abs(np.minimum(a, b)).max()))
            product.append(float(np.abs(a * b).max()))
        return max(of_rows), max(natural), max(product)

    def _values_on_model(self, expressions: Iterable[Any], statement: Statement) -> Array:
        """Values on the model, which has those of the trajectory meanwhile."""
        with failures_as(TrajectoryError, f"{statement.label(self.block)} has no value on the trajectory"):
            return np.array([float(shared_value(expression)) for expression in expressions])

    def _asks_rows(self, statement: Statement) -> bool:
        """Whether a rule is known at the points of this grid alone."""
        asks = self.on_grid and not self.formulas.gives_formulas(statement)
        foreign = foreign_variable(self.block, self._variables_of(statement)) if asks else None
        if foreign is not None:
            words = foreign_read(foreign, self.block.model())
            raise TrajectoryError(f"phase '{self.block.name}': the rule '{statement.name}' {words}")
        return asks

    def at_given_ends(self) -> tuple[float, float]:
        """Violation of equations and of sides of pairs by the values that are given at ends without a stage."""
        worst = dict.fromkeys((*KINDS, "bounds"), 0.0)
        ends = (self.record.grid.times[0], 0), (self.record.grid.times[-1], -1)
        for time, position in ends:
            given = values_given(self.block, time)
            states, parameters = self.trajectory.states, self.trajectory.parameters
            values = {name: states[name][position] if name in states else parameters[name] for name in given}
            if self.indices.times[position] in self.indices.points or not values:
                continue
            # A rule that cannot be evaluated there says nothing of it: no remark.
            for found in end_violations(self.formulas, time, values, self.statements, []):
                worst[found.kind] = max(worst[found.kind], found.amount)
        return max(worst["residual"], worst["constraint"], worst["bounds"]), worst["complementarity"]

    def _defect(self, stated: Mapping[str, Array]) -> float:
        """How far the rows of the scheme are from holding with the stated rates, and these from the handed over."""
        scheme, widths = self.grid.scheme, self.grid.mesh.widths
        worst = 0.0
        for name, slopes in self.slopes.items():
            rates = stated[name].T
            rows = self.states[name] @ scheme.D.T / widths[:, None] - rates @ scheme.F.T
            worst = max(worst, float(np.abs(rows).max()), float(np.abs(rates - slopes).max()))
        return worst

    def continuity(self) -> float:
        end_weights = self.grid.scheme.end_weights
        ends = (values @ end_weights for values in self.states.values())
        starts = ([*values[1:, 0], self.trajectory.states[name][-1]] for name, values in self.states.items())
        return max((float(np.abs(end - start).max()) for end, start in zip(ends, starts, strict=True)), default=0.0)

    def bounds(self) -> float:
        trajectory, violations = self.trajectory, [self._switching(), *self._rates_of_controls()]
        if isinstance(self.record.duration, Duration):
            violations.append(bound_violation(trajectory.duration, *self.record.duration.bounds_at(0.0, "duration")))
        for name, declaration in self.record.declarations.items():
            numbers = trajectory.signals.get(name, np.zeros(0))
            if name in trajectory.parameters:
                numbers = np.array([trajectory.parameters[name]])
            elif isinstance(declaration, State):
                numbers = trajectory.states[name]
                violations += self._of_ends(name, declaration, numbers)
                violations.append(_beyond(self.slopes[name], *in_infinities(declaration.derivative_bounds)))
            levels = getattr(declaration, "levels", None)
            if levels is not None:
                violations += [min(abs(number - level) for level in levels) for number in numbers]
            violations.append(_beyond(numbers, *in_infinities(declaration.bounds_at(0.0, name))))
        return float(max(violations))

    def _of_ends(self, name: str, declaration: State, numbers: Array) -> Iterator[float]:
        """By how much a state misses what was stated of its ends."""
        for end, reached in (("initial", numbers[0]), ("final", numbers[-1])):
            given = getattr(declaration, end)
            if isinstance(given, NumericValue):
                given = moving_end(self.block, name, declaration, end)
            lower, upper = given if isinstance(given, tuple) else (given, given)
            yield bound_violation(reached, lower, upper)

    def _rates_of_controls(self) -> Iterator[float]:
        """By how much controls change more than they may, from each of their values to the next."""
        for name in self.record.names(Control):
            control: Any = self.record.declarations[name]
            if control.rate_bounds is None:
                continue
            nodes, values = control.nodes(name, self.indices, ""), self.trajectory.signals[name]
            times = np.array(self.grid.points)
            if isinstance(nodes, IntervalNodes):  # one value for each interval, from middle to middle
                values = values[np.unique(nodes.of_points, return_index=True)[1]]
                times = np.interp(nodes.times, self.indices.mesh.boundaries, self.grid.mesh.boundaries)
            lower, upper = (np.diff(times) * bound for bound in in_infinities(control.rate_bounds))
            yield _beyond(np.diff(values), lower, upper)

    def _switching(self) -> float:
        """By how much integer controls switch too often, or too soon after another switch."""
        worst = 0.0
        for name in self.record.names(Control):
            control: Any = self.record.declarations[name]
            if control.levels is None:
                continue
            family = next((of for of in self.record.families.values() if control.one_of and name in of.members), None)
            members = (name,) if family is None else family.members
            values = [self.trajectory.element_signals(member)[:, 0] for member in members]
            levels = np.abs(np.array(values)[:, :, None] - np.array(control.levels)).argmin(axis=2)
            switches = np.flatnonzero(np.diff(levels, axis=1).any(axis=0))
            if control.max_switches is not None:
                worst = max(worst, float(len(switches) - control.max_switches))
            kept = np.diff(np.array(self.grid.mesh.boundaries)[switches + 1])
            worst = max(worst, (control.min_dwell or 0.0) - float(kept.min(initial=np.inf)))
        return worst

    def passed_between_points(self) -> dict[str, BoundPassed]:
        """What passes declared bounds, rates and path constraints between the points; remarks on what is not known."""
        found = bounds_passed(self.formulas, self.trajectory)
        for statement in self._stated("constraint"):
            try:
                found |= rows_passed(self.formulas, self.trajectory, statement)
            except TrajectoryError as error:
                self.remarks.append(f"not looked at between the points: '{statement.name}'. {error}")
        return found

    def relative_error(self, motion: Reintegration) -> float:
        """The largest error of an element in sizes of the states: their largest values."""
        sizes = {name: max(1e-3, float(np.abs(values).max())) for name, values in self.trajectory.states.items()}
        return float(motion.end_errors(motion.local, self.trajectory, sizes).max(initial=0.0))

    def reintegrate(self) -> Reintegration | None:
        """The motion that the equations make of the plan; None, with a remark, where it is not known."""
        if self._stated("ode") != self.record.statements_of("ode"):
            return None  # as remarked
        try:
            found = reintegrate(self.block, self.trajectory, self.formulas)
        except TrajectoryError as error:
            self.remarks.append(f"re-integration, which asks between the points of the grid, failed: {error}")
            return None
        self.remarks.extend(found.remarks)
        if found.open_loop is None:
            self.remarks.append(
                "re-integration over the whole horizon could not be followed: the motion is unstable, and goes far "
                "from the plan."
            )
        return found


def _beyond(numbers: Array, lower: Any, upper: Any) -> float:
    """How far the farthest of some numbers is from its interval; infinite where one is none."""
    beyond = np.maximum(lower - numbers, numbers - upper)
    return math.inf if np.isnan(beyond).any() else float(beyond.max(initial=0.0))
