"""Checking a trajectory against the stated equations, recomputed without the rows or the solver."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pyomo.core.base.constraint import Constraint
from pyomo.core.expr.numvalue import NumericValue

from pyrobocop_pyomo.complementarity import Complementarity, form_of, side_values
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.lent_items import variables_read
from pyrobocop_pyomo.modeling.row_violations import bound_violation, relation_violation
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented, facts_table, paragraph
from pyrobocop_pyomo.trajectories import Trajectory
from pyrobocop_pyomo.transcription import can_step

from .between_points import check_rules_between_points
from .bounds_between_points import BoundPassed, bounds_passed, sentence_on_bounds
from .companions import (
    Companion,
    companions_of,
    indices_of,
    is_of_grid,
    is_on_model,
    other_phases,
    put_on_model,
)
from .declarations import UNBOUNDED, Algebraic, Control, Duration, Parameter, State
from .delays import past_of
from .given_ends import KINDS, end_violations, values_given
from .point_model import PointModel
from .record import PhaseRecord, PreviousStates, Statement, labelled_rows
from .reintegration import Reintegration, reintegrate
from .stated_numbers import moving_end, rows_of_ends
from .undefined_instants import named_where_undefined
from .verdicts import verdict_in_words


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
        Re-integration of each element from its own start by SciPy: largest difference at its end. This is the
        local discretisation error. None where it cannot be computed; then see `remarks`.
    horizon_error : float or None
        Re-integration of the whole horizon in one go: largest difference at any element end.
    motion_error : float or None
        Largest difference, inside elements too, of a state's polynomial from the solution of the equations under the
        plan's controls: integrated from the start of the plan on, or, where pairs decide what happens, from the start
        of each element.
    integral_error : float or None
        Of all integrals of the phase, those in the objective and in constraints, the largest sum over all elements of
        the difference between the quadrature of the mesh and the integral along the motion that the equations make of
        each element. None where none was stated, or none is known; then see `remarks`.
    remarks : tuple of str
        What could not be checked, and why.
    element_errors : array, shape (N,), or None
        The re-integration error of each element; `element_error` is the largest.
    integral_errors : dict of name to array, shape (N,)
        Of each integral over each element; its name is that of its rule, numbered in the order stated.
    relative_error : float or None
        The largest of `element_errors` where that of each state is divided by its size.
    contact : bool
        Whether pairs decide what happens.
    bounds_passed : dict of name to a tuple (excess, time, bound, size, is_control)
        States and controls whose polynomials pass a declared bound between the points of the mesh: by how much, when,
        which bound, and how large the signal is. Bounds that are functions of time are not examined.
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
    integral_errors: Mapping[str, Array] = field(default_factory=dict, repr=False, compare=False)
    relative_error: float | None = field(default=None, repr=False, compare=False)
    contact: bool = field(default=False, repr=False, compare=False)
    bounds_passed: Mapping[str, BoundPassed] = field(default_factory=dict, repr=False, compare=False)

    @property
    def verdict(self) -> str:
        """Whether the plan holds, in words, what it does between the points, and what a large horizon error means."""
        said = verdict_in_words(
            {
                "the equations of motion are violated": self.defect,
                "a state jumps between elements": self.continuity,
                "an equation or a constraint is violated": self.equations,
                "a bound or a boundary value is violated": self.bounds,
                "a pair is violated": self.natural_residual,
            },
            self.element_error,
            self.relative_error,
            self.horizon_error,
            0.0 if self.element_errors is None else float(self.element_errors.sum()),
            self.contact,
        )
        return f"{said} {sentence_on_bounds(self.bounds_passed)}".rstrip()

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
        return {what: "not available" if number is None else f"{number:.2e}" for what, number in numbers.items()}

    def _html_parts(self) -> list[str]:
        return [facts_table(self._rows()), *(paragraph(text) for text in (*self.remarks, self.verdict))]

    def __str__(self) -> str:
        lines = [f"{what:27} {number}" for what, number in self._rows().items()]
        return "\n".join([*lines, *self.remarks, self.verdict])


def verify(block: Any, record: PhaseRecord, trajectory: Trajectory, beside: Sequence[Trajectory] = ()) -> Verification:
    """Recompute everything that a trajectory promises; see `Verification`.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    trajectory : Trajectory
    beside : sequence of Trajectory
        Values of other phases that the rules read. Those on the model are taken where the trajectory is what stands on
        the model; elsewhere, what reads them is not checked.

    Raises
    ------
    TrajectoryError
        When the trajectory has other variables than the phase, or one beside it is of no other phase.
    """
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
    check = _TrajectoryCheck(block, record, trajectory, beside)
    with put_on_model(check.values_of_phases), check.rules_asked():
        check.remark_what_is_not_stated(block)
        defect, equations, natural, product = check.at_collocation_points()
        motion = check.reintegrate()
        ends = None if motion is None else motion.end_errors(motion.local, trajectory)
        integrals = {} if motion is None else dict(motion.integral_errors)
        horizon = None if motion is None else float(motion.end_errors(motion.open_loop, trajectory).max())
        return Verification(
            defect=defect,
            continuity=check.continuity(),
            equations=equations,
            bounds=check.bounds(),
            natural_residual=natural,
            product=product,
            element_error=None if ends is None else float(ends.max()),
            horizon_error=horizon,
            motion_error=None if motion is None else float(motion.errors.max()),
            integral_error=max((float(errors.sum()) for errors in integrals.values()), default=None),
            remarks=tuple(check.remarks),
            element_errors=ends,
            integral_errors=integrals,
            relative_error=None if motion is None else check.relative_error(motion),
            contact=bool(record.statements_of("complementarity")),
            bounds_passed=bounds_passed(record, trajectory),
        )


class _TrajectoryCheck:
    def __init__(
        self, block: Any, record: PhaseRecord, trajectory: Trajectory, beside: Sequence[Trajectory] = ()
    ) -> None:
        self.block, self.record = block, record
        self.trajectory = trajectory
        self.grid = trajectory.grid
        # Rules are evaluated at time indices, which are normalised where something of the horizon was to be found.
        self.on_grid = is_of_grid(record, trajectory.grid)
        self.indices = record.grid if self.on_grid else indices_of(record, trajectory.grid)
        companions = companions_of(block, self.indices.mesh.boundaries, beside)
        self.point = PointModel(block, record, self.indices, trajectory.grid, companions)
        self.point.set_values(trajectory.parameters)
        self.states = {name: trajectory.element_states(name) for name in trajectory.states}
        self.signals = {name: trajectory.element_signals(name) for name in trajectory.signals}
        self.slopes = {name: self._slopes(name) for name in self.states}
        self.remarks: list[str] = []
        others = other_phases(block)
        on_model = not others or is_on_model(block, trajectory)
        known = [(other.phase, other.trajectory) for other in companions if other.trajectory is not None]
        self.values_of_phases = [(block, trajectory), *known]
        self.statements = list(record.statements)
        if not on_model:
            given = [phase for phase, _ in known]
            self._leave_out([phase for phase in others if not any(phase is one for one in given)], companions)
        if record.discrete_states and not can_step(self.grid.scheme):
            raise TrajectoryError(
                f"trajectory '{trajectory.name}' is one of {self.grid.scheme.name}; the phase has step maps "
                f"({', '.join(sorted(record.discrete_states))}), which lead from one element boundary to the next."
            )

    @contextmanager
    def rules_asked(self) -> Iterator[None]:
        """Context for asking rules, with the values on the model: of the phase itself, where its grid is that."""
        self.point.asks_phase = self.on_grid
        self.point.past = None if self.on_grid else past_of(self.trajectory)
        try:
            if not self.on_grid:
                self.check_between_points(self.statements)
            yield
        finally:
            self.point.leave_nodes()

    def check_between_points(self, statements: Sequence[Statement]) -> None:
        """Refuse what has no answer between the points of the phase's own grid."""
        check_rules_between_points(self.block, self.record, self.point, statements)
        self.point.set_values(self.trajectory.parameters)

    def _leave_out(self, unknown: Sequence[Any], companions: Sequence[Companion]) -> None:
        """Leave out the rules that read other phases whose values at the times of the trajectory nobody knows."""
        for statement in self.record.statements:
            variables = self._variables_of(statement)
            read = {id(variable.parent_block()) for variable in variables}
            read |= {id(other.phase) for other in companions if other.is_read_in(variables)}
            names = [phase.name for phase in unknown if id(phase) in read]
            if names:
                self.statements.remove(statement)
                self.remarks.append(
                    f"not checked: '{statement.name}', which reads {', '.join(names)}. The model has other values than "
                    "this trajectory, so that those of the other phase are not known: verify(beside=[trajectory of "
                    f"{', '.join(names)}])."
                )

    def _variables_of(self, statement: Statement) -> list[Any]:
        """What a rule reads at its first instant; nothing, where it cannot be asked there."""
        at_boundaries = statement.kind == "constraint at boundaries"
        time = self.indices.times[0] if at_boundaries else self.indices.stage_times[0][0]
        states = dict.fromkeys(self.states, 0.0)
        try:
            previous = PreviousStates("", states, self.record.families)
            more = [previous] if statement.kind == "step map" else []
            return variables_read(self.point.result_of(statement, time, *more))
        except Exception:  # said where the rule is checked
            return []
        finally:
            self.point.leave_nodes()

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
        known |= rows_of_ends(self.record.declarations)
        own = [name for name in block.component_map((Constraint, Complementarity)) if name not in known]
        if own:
            self.remarks.append(f"not checked, since they were not stated through the phase: {', '.join(own)}.")

    def at_collocation_points(self) -> tuple[float, float, float, float]:
        equations = natural = product = of_steps = 0.0
        stated = {name: np.full_like(slopes, np.nan) for name, slopes in self.slopes.items()}
        stage_states = {name: self._at_stages(at_nodes) for name, at_nodes in self.states.items()}
        kinds = ("ode", "step map", "residual", "constraint", "complementarity")
        asked = [statement for kind in kinds for statement in self._stated(kind)]
        for i, times in enumerate(self.indices.stage_times):
            self.point.element = i
            for k, time in enumerate(times):
                values = {name: per_stage[i, k] for name, per_stage in (stage_states | self.signals).items()}
                slope = {name: float(per_stage[i, k]) for name, per_stage in self.slopes.items()}
                self.point.set_values(values, slope)
                self.point.set_bounds(time)
                real = self.grid.stage_times[i][k]
                with named_where_undefined(f"phase '{self.block.name}'", self.point, asked, time, real, i):
                    found = self._at_instant(i, k, time, stated)
                equations, natural, product, of_steps = map(max, (equations, natural, product, of_steps), found)
        self.point.element = None
        at_ends, of_pairs = self._at_given_ends()
        equations = max(equations, self._at_boundaries(), at_ends)
        return max(of_steps, self._defect(stated)), equations, max(natural, of_pairs), product

    def _at_instant(
        self, i: int, k: int, time: float, stated: Mapping[str, Array]
    ) -> tuple[float, float, float, float]:
        """Violations of equations, of pairs by smaller side and by product, and of step maps; fills `stated`."""
        equations = natural = product = of_steps = 0.0
        for name, rate in self.point.rates(self._stated("ode"), time).items():
            stated[name][i, k] = rate
        previous = {name: float(at_nodes[i, 0]) for name, at_nodes in self.states.items()}
        for name, following in self.point.next_states(self._stated("step map"), time, previous).items():
            of_steps = max(of_steps, abs(float(self.states[name][i, -1]) - following))
        for statement in self._stated("residual") + self._stated("constraint"):
            for row in labelled_rows(statement.kind, self.point.result_of(statement, time)).values():
                equations = max(equations, relation_violation(row))
        for statement in self._stated("complementarity"):
            for pair in labelled_rows(statement.kind, self.point.result_of(statement, time)).values():
                if pair is Complementarity.Skip:
                    continue
                pair_values, beside = _sides_and_rows(pair, statement)
                equations = max(equations, beside)
                for a, b in pair_values:
                    natural, product = max(natural, abs(min(a, b))), max(product, abs(a * b))
        return equations, natural, product, of_steps

    def _at_boundaries(self) -> float:
        """Violation of the constraints that are stated for element boundaries."""
        worst = 0.0
        statements = self._stated("constraint at boundaries")
        position = {time: i for i, time in enumerate(self.indices.times)}
        for time in self.indices.mesh.boundaries if statements else ():
            self.point.set_values({name: samples[position[time]] for name, samples in self.trajectory.states.items()})
            for statement in statements:
                for row in labelled_rows("constraint", self.point.result_of(statement, time)).values():
                    worst = max(worst, relation_violation(row))
        return worst

    def _at_given_ends(self) -> tuple[float, float]:
        """Violation of equations and of sides of pairs by the values that are given at ends without a stage."""
        worst = dict.fromkeys((*KINDS, "bounds"), 0.0)
        ends = (self.record.grid.times[0], 0), (self.record.grid.times[-1], -1)
        for time, position in ends:
            given = values_given(self.block, self.record, time)
            states, parameters = self.trajectory.states, self.trajectory.parameters
            values = {name: states[name][position] if name in states else parameters[name] for name in given}
            if self.indices.times[position] in self.indices.points or not values:
                continue
            grids = (self.indices, self.grid)
            # A rule that cannot be evaluated there says nothing of it: no remark.
            for found in end_violations(self.block, self.record, time, values, self.statements, grids, []):
                worst[found.kind] = max(worst[found.kind], found.amount)
        return max(worst["residual"], worst["constraint"], worst["bounds"]), worst["complementarity"]

    def _at_stages(self, states: Array) -> Array:
        """The columns of the nodes that are stages: all but an element start, or an end, that is none."""
        scheme = self.grid.scheme
        first = 0 if scheme.starts_on_a_stage else 1
        return states[:, first : first + scheme.stages]

    def _defect(self, stated: Mapping[str, Array]) -> float:
        """How far the rows of the scheme are from holding with the stated rates, and these from the handed over."""
        scheme, widths = self.grid.scheme, self.grid.mesh.widths
        worst = 0.0
        for name, slopes in self.slopes.items():
            rates = np.where(np.isnan(stated[name]), slopes, stated[name])
            rows = self.states[name] @ scheme.D.T / widths[:, None] - rates @ scheme.F.T
            worst = max(worst, float(np.abs(rows).max()), float(np.abs(rates - slopes).max()))
        return worst

    def continuity(self) -> float:
        end_weights = self.grid.scheme.end_weights
        ends = (values @ end_weights for values in self.states.values())
        starts = ([*values[1:, 0], self.trajectory.states[name][-1]] for name, values in self.states.items())
        return max((float(np.abs(end - start).max()) for end, start in zip(ends, starts, strict=True)), default=0.0)

    def bounds(self) -> float:
        worst = 0.0
        if isinstance(self.record.duration, Duration):
            worst = bound_violation(self.trajectory.duration, *self.record.duration.bounds_at(0.0, "duration"))
        for name, declaration in self.record.declarations.items():
            if name in self.trajectory.parameters:
                samples = [(0.0, self.trajectory.parameters[name])]
            elif name in self.trajectory.states:
                samples = list(zip(self.indices.times, self.trajectory.states[name], strict=True))
                assert isinstance(declaration, State)
                for end, reached in (("initial", samples[0][1]), ("final", samples[-1][1])):
                    given = getattr(declaration, end)
                    if isinstance(given, NumericValue):
                        given = moving_end(self.block, name, declaration, end)
                    lower, upper = given if isinstance(given, tuple) else (given, given)
                    worst = max(worst, bound_violation(reached, lower, upper))
                for slope in self.slopes[name].ravel():
                    worst = max(worst, bound_violation(slope, *(declaration.derivative_bounds or UNBOUNDED)))
            else:
                samples = list(zip(self.indices.points, self.trajectory.signals[name], strict=True))
            levels = getattr(declaration, "levels", None)
            if levels is not None:
                worst = max([worst, *(min(abs(sample - level) for level in levels) for _, sample in samples)])
            for time, sample in samples:
                worst = max(worst, bound_violation(sample, *declaration.bounds_at(time, name)))
        return worst

    def relative_error(self, motion: Reintegration) -> float:
        """The largest error of an element in sizes of the states: their largest values."""
        sizes = {name: max(1e-3, float(np.abs(values).max())) for name, values in self.trajectory.states.items()}
        return float(motion.end_errors(motion.local, self.trajectory, sizes).max(initial=0.0))

    def reintegrate(self) -> Reintegration | None:
        """The motion that the equations make of the plan; None, with a remark, where it is not known."""
        if self._stated("ode") != self.record.statements_of("ode"):
            return None  # as remarked
        try:
            found = reintegrate(self.block, self.record, self.trajectory, self.point)
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


def _sides_and_rows(pair: Any, statement: Statement) -> tuple[list[tuple[float, float]], float]:
    """Values of both sides of the pairs that a statement makes, and how far the rows beside them are from holding."""
    first, second, *choices = pair
    form = form_of(statement, first, second, (choices[0], choices[1]) if choices else (None, None))
    return [side_values(made) for made in form.pairs], max(map(relation_violation, form.rows), default=0.0)
