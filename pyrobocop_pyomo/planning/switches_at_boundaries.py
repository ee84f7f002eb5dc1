"""Where pairs change sides inside elements: a second try with boundaries that move to the switches, and a doubt."""

from __future__ import annotations

import logging
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from pyomo.core.base.constraint import ConstraintList
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import CanonicalPair, Crossed, active_pairs
from pyrobocop_pyomo.complementarity.canonical import SidePart
from pyrobocop_pyomo.complementarity.grouping import PerPair, as_grouping
from pyrobocop_pyomo.diagnosis import Finding, Severity, Subject
from pyrobocop_pyomo.discretisation.estimates import ZERO_OBJECTIVE
from pyrobocop_pyomo.discretisation.jump_times import jump_fractions
from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.activity import is_inside
from pyrobocop_pyomo.modeling.failures import undone_on_failure
from pyrobocop_pyomo.numerics import Array, Mesh
from pyrobocop_pyomo.numerics.remeshing import halves_of
from pyrobocop_pyomo.phases import Control, phases_of
from pyrobocop_pyomo.phases.remeshing import free_element_widths, put_on_meshes, remesh_phases
from pyrobocop_pyomo.solving.ipopt_options import NEARLY_THERE
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.progress import Progress
from pyrobocop_pyomo.solving.settings import Settings
from pyrobocop_pyomo.solving.solve_result import SolveResult, with_steps_of_all
from pyrobocop_pyomo.solving.starts import take_values_of_copy
from pyrobocop_pyomo.solving.strategies import BARRIER, TIGHT

from .planning_point import PlanningPoint

logger = logging.getLogger(__name__)

# An element's width may become so many times what it was.
FACTORS = (0.2, 3.0)
# Of the sizes of the two sides: a product of sides at different points of an element that is above belongs to a switch.
OVERLAP = 1e-3
# A side that changes between neighbouring points by more than this part of all that it does may be one that jumps.
JUMP = 0.5
# Products are as many as points of an element times points of it: larger problems take too long.
MOST_PAIRS = 600
# The answer on elements that end at switches may be worse by so many elements' part of the objective: the first one
# flatters itself by an error of the order of the width.
FLATTERED = 2.0
# An error of the motion below which the plan is one of the equations, as a part of each state.
SMALL_MOTION_ERROR = 1e-2

# Of the run on the user's model, from the answer with moving boundaries.
AT_THE_ANSWER = {"mu_init": 1e-8, "bound_push": 1e-8, "bound_frac": 1e-8}

# Of runs from the answer on other elements.
WARM = replace(BARRIER, name="equal elements between switches", options={**NEARLY_THERE, "max_iter": 300})
MOST_MESHES = 3
# An objective that changes by less from one mesh to the next is exact; by more, it is not known. Relative.
SMALL_CHANGE, LARGE_CHANGE = 1e-3, 1e-2
EQUAL_WIDTHS = "equal_widths_between_switches"

Family = tuple[str, Hashable, str]


@dataclass(frozen=True)
class CrossedBySides(Crossed):
    """`Crossed` with the left end of each family on the side that is continuous in time.

    Attributes
    ----------
    left_ends : mapping of family to {"first", "second", None}
    """

    left_ends: dict[Family, str | None] = field(default_factory=dict, hash=False)
    left_end: str | None = "first"

    def products(self, pairs: Sequence[CanonicalPair]) -> list[tuple[CanonicalPair, CanonicalPair]]:
        """Those of `Crossed`."""
        end = self.left_ends.get(_family(pairs[0]), self.left_end)
        if end == self.left_end:
            return super().products(pairs)
        if end is not None or pairs[0].group is None:
            return Crossed(end).products(pairs)
        elements: dict[Any, list[CanonicalPair]] = {}
        for pair in pairs:
            elements.setdefault(pair.group, []).append(pair)
        return [product for members in elements.values() for product in Crossed().products(members)]


class SwitchesAtBoundaries:
    """The switches of an answer with pairs, and the same model on elements that end at them.

    Parameters
    ----------
    model : Block
        Holding the answer.
    settings : Settings
    """

    def __init__(self, model: Any, settings: Settings) -> None:
        self._model, self._settings = model, settings
        self._phases = [phase for phase in phases_of(model) if _has_points_inside(phase)]
        self._families = _sides_of(model, self._phases) if self._phases else {}

    def improved(self, first: SolveResult) -> SolveResult:
        """The answer, or that on elements which end at its switches; doubtful where it has some inside of elements."""
        if not self._families or first.quality is not Quality.OPTIMAL:
            return first
        switches = self._inside()
        if not switches and not any(jump_fractions(phase.trajectory()) for phase in self._phases):
            return first
        remark, doubts = "", (self._doubt(switches),) if switches else ()
        if self._may_try():
            point = PlanningPoint(self._model)
            try:
                with undone_on_failure(point.restore):
                    moved, remark = self._on_moved_boundaries(first)
                if moved is not None:
                    return moved
            except PyRobocopError as error:
                logger.info("'%s': no answer on moved element boundaries: %s", self._model.name, error)
                remark = f"Element boundaries cannot be moved to the switches here: {error}"
            point.restore()
        remarks = (*first.remarks, remark) if remark and switches else first.remarks
        return replace(first, doubts=(*first.doubts, *doubts), remarks=remarks)

    # ---------------------------------------------------------------- what switches where

    def _inside(self) -> dict[Family, list[int]]:
        """The elements in which a family is on both sides."""
        found = {family: sides.mixed() for family, sides in self._families.items()}
        return {family: elements for family, elements in found.items() if elements}

    def _doubt(self, switches: dict[Family, list[int]]) -> Finding:
        family, elements = max(switches.items(), key=lambda each: len(each[1]))
        source = self._families[family].pairs[0].source
        phase = next(p for p in self._phases if is_inside(source, p))
        boundaries = phase.trajectory().grid.mesh.boundaries
        place = f"{boundaries[elements[0]]:.4g} to {boundaries[elements[0] + 1]:.4g}"
        more = f" and {count} element{'s' if count > 1 else ''} more" if (count := len(elements) - 1) else ""
        message = (
            f"Pairs change sides inside of elements: '{family[0]}' at t = {place}{more}. The error there is of the "
            "order of the elements' width, and an optimiser can gain by it."
        )
        remedy = (
            "Let the boundaries move: PhaseBlock(..., free_element_widths=(0.2, 3)) and rcp.solve(m, "
            'grouping=rcp.relaxations.Crossed(left_end="first")), with the side that is continuous in time first in '
            "each pair; or compare with more elements."
        )
        return Finding(Severity.WARNING, Subject.OUTCOME, message, (family[0],), remedy)

    # ---------------------------------------------------------------- the second try

    def _may_try(self) -> bool:
        settings = self._settings
        return (
            settings.strategies is None
            and isinstance(as_grouping(settings.grouping), PerPair)
            and self._model.model() is self._model
            and sum(len(sides.pairs) for sides in self._families.values()) <= MOST_PAIRS
            and not any(phase.record.free_widths for phase in self._phases)
            and not settings.deadline.has_passed
        )

    def _on_moved_boundaries(self, first: SolveResult) -> tuple[SolveResult | None, str]:
        """The answer on the model with other boundaries, or None and why not."""
        copy = self._model.clone()
        phases = [copy.find_component(phase) for phase in self._phases]
        free_element_widths(phases, FACTORS)
        grouping = CrossedBySides(left_ends={family: sides.left_end for family, sides in self._families.items()})
        settings = replace(self._settings, grouping=grouping, progress=Progress(False))
        results = [self._solved(copy, replace(settings, exploration=0.0))]
        if (reason := self._reason_against(results[0], first)) is not None:
            return None, f"With element boundaries that move to the switches, {reason}."
        copy, change = self._with_equal_elements(copy, settings, results)
        if copy is None or change > LARGE_CHANGE:
            return None, "With equal elements between the switches, no solution was found that meshes agree on."
        found = results[-1]
        if (reason := self._reason_against(found, first)) is not None:
            return None, f"With element boundaries that move to the switches, {reason}."
        if not self._inside() and change <= SMALL_CHANGE and _difference(found, first) < SMALL_CHANGE / 10.0:
            return first, ""  # other elements bring nothing
        twins = [copy.find_component(phase) for phase in self._phases]
        remesh_phases({phase: _moved(phase, twin) for phase, twin in zip(self._phases, twins, strict=True)})
        take_values_of_copy(self._model, copy)
        for phase, twin in zip(self._phases, twins, strict=True):
            _take_by_position(phase, twin)
        again = replace(TIGHT, name="switches at boundaries", options=AT_THE_ANSWER)
        result = self._solved(self._model, replace(settings, strategies=(again,), exploration=0.0))
        if result.quality is not Quality.OPTIMAL or _difference(result, found) > SMALL_CHANGE:
            return None, "Boundaries that were moved to the switches could not be kept."
        doubts = () if change <= SMALL_CHANGE else (_doubt_on_elements(change),)
        return replace(_joined([first, *results, result]), doubts=(*result.doubts, *doubts)), ""

    def _with_equal_elements(self, copy: Any, settings: Settings, results: list[SolveResult]) -> tuple[Any, float]:
        """Solve on equal elements between switches, and on halves of these, until that makes no difference.

        Elements of any width would be an optimiser's to gain by, where quadrature is worst.

        Returns
        -------
        Block or None, float
            The last copy that was solved; how much its objective differs from the one before.
        """
        solved, change = None, np.inf
        warm = replace(settings, strategies=(WARM,), exploration=0.0)
        for _ in range(MOST_MESHES):
            if solved is not None:
                copy = solved.clone()
                copy.del_component(EQUAL_WIDTHS)
            phases = [copy.find_component(phase) for phase in self._phases]
            if solved is not None:
                put_on_meshes({twin: halves_of(twin.grid.mesh) for twin in phases})
            _keep_equal_widths(copy, phases, _Switched(copy, phases))
            found = self._solved(copy, warm)
            results.append(found)
            if found.quality is not Quality.OPTIMAL:
                results.pop()
                break
            solved, change = copy, _difference(found, results[-2])
            if change <= SMALL_CHANGE or settings.deadline.has_passed:
                break
        return solved, change

    def _solved(self, model: Any, settings: Settings) -> SolveResult:
        result = solve_model(model, settings)
        logger.info("'%s' with elements that end at switches: %s", model.name, result.one_line())
        return result

    def _reason_against(self, found: SolveResult, first: SolveResult) -> str | None:
        if found.quality is not Quality.OPTIMAL:
            return f"no solution was found ({found.stop_reason.value})"
        motion, before = found.discretisation.motion_error, first.discretisation.motion_error
        if motion is not None and motion > max(SMALL_MOTION_ERROR, before or 0.0):
            return f"the motion is not that of the equations ({motion:.1e} of a state's size)"
        elements = max(phase.grid.mesh.elements for phase in self._phases)
        worse = found.standing.cost - first.standing.cost
        if worse > FLATTERED / elements * max(abs(first.objective), abs(found.objective)):
            return f"a worse local optimum was found, {found.objective:.6g}"
        return None


class _Sides:
    """Both sides of a family at the points of its elements."""

    def __init__(self, pairs: list[CanonicalPair]) -> None:
        self.pairs = pairs
        self._a = np.array([_side(pair.a, pair.a_part) for pair in pairs])
        self._b = np.array([_side(pair.b, pair.b_part) for pair in pairs])
        self._elements = np.array([pair.group for pair in pairs])

    @property
    def left_end(self) -> str | None:
        """Which side is continuous in time, as far as its values show it."""
        first, second = _largest_change(self._a), _largest_change(self._b)
        if first > JUMP and second > JUMP:
            return None
        return "first" if first <= JUMP or first <= second else "second"

    def modes(self, elements: int) -> list[int]:
        """Of each element: 1 where the first side is positive, -1 where the second one is, 0 where none is."""
        sizes = np.abs(self._a).max(), np.abs(self._b).max()
        found = [0] * elements
        for element in np.unique(self._elements):
            here = self._elements == element
            a, b = self._a[here].max(), self._b[here].max()
            if a > OVERLAP * sizes[0] or b > OVERLAP * sizes[1]:
                found[int(element)] = 1 if a * sizes[1] > b * sizes[0] else -1
        return found

    def mixed(self) -> list[int]:
        """Elements in which the first side is positive at one point and the second at another one."""
        sizes = np.abs(self._a).max(), np.abs(self._b).max()
        if not min(sizes) > 0.0 or not np.isfinite(sizes).all():
            return []
        a, b, found = self._a / sizes[0], self._b / sizes[1], []
        for element in np.unique(self._elements):
            here = self._elements == element
            if a[here].max() * b[here].max() > OVERLAP:
                found.append(int(element))
        return found


def _sides_of(model: Any, phases: Sequence[Any]) -> dict[Family, _Sides]:
    """The values of both sides of each family of phases, point by point."""
    found: dict[Family, list[CanonicalPair]] = {}
    for pair in active_pairs(model):
        if isinstance(pair.group, int) and any(is_inside(pair.source, phase) for phase in phases):
            found.setdefault(_family(pair), []).append(pair)
    return {family: _Sides(pairs) for family, pairs in found.items()}


def _largest_change(values: Array) -> float:
    size = float(np.ptp(values))
    return float(np.abs(np.diff(values)).max(initial=0.0)) / size if size > 0.0 else 0.0


def _side(expression: Any, part: SidePart) -> float:
    number = float(value(expression))
    if part is SidePart.WHOLE:
        return max(number, 0.0)
    return max(number if part is SidePart.POSITIVE else -number, 0.0)


def _family(pair: CanonicalPair) -> Family:
    return pair.source.parent_component().name, pair.source.family, pair.role


def _has_points_inside(phase: Any) -> bool:
    """Whether an element has several points, of which the last is its end."""
    scheme = phase.grid.scheme
    return bool(scheme.stages > 1 and scheme.c[-1] == 1.0 and not phase.record.discrete_states)


def _moved(phase: Any, twin: Any) -> Mesh:
    """The mesh of a phase with the boundaries of its copy, which move."""
    first, last = (phase.grid.mesh.boundaries[i] for i in (0, -1))
    inner = [first + (last - first) * float(value(twin.boundary[i])) for i in range(1, twin.grid.mesh.elements)]
    return Mesh((first, *inner, last))


def _take_by_position(phase: Any, twin: Any) -> None:
    """Values of a copy with as many points."""
    record = phase.record
    names = [*record.names_of_states, *record.names_of_signals, *(f"{n}_derivative" for n in record.kept_derivatives)]
    for name in names:
        pairs = zip(record.nodes(name).variables(phase), twin.record.nodes(name).variables(twin), strict=True)
        for variable, other in pairs:
            if other.value is not None and not variable.fixed:
                variable.set_value(other.value, skip_validation=True)


def _difference(result: SolveResult, other: SolveResult) -> float:
    return abs(result.objective - other.objective) / max(abs(other.objective), ZERO_OBJECTIVE)


def _doubt_on_elements(change: float) -> Finding:
    message = f"Elements that end at the switches are few: on half as many the objective differs by {change:.1e} of it."
    return Finding(Severity.WARNING, Subject.OUTCOME, message, (), "Give the phases more elements.")


class _Switched:
    """The element boundaries of phases at which a pair changes sides, or a control jumps."""

    def __init__(self, model: Any, phases: Sequence[Any]) -> None:
        self._at: dict[int, set[int]] = {id(phase): set() for phase in phases}
        for phase in phases:
            for sides in _sides_of(model, [phase]).values():
                modes = sides.modes(phase.grid.mesh.elements)
                self._at[id(phase)] |= {i for i in range(1, len(modes)) if modes[i] != modes[i - 1]}
            trajectory = phase.trajectory()
            for name in phase.record.names(Control):
                values = trajectory.element_signals(name)
                jumps = np.abs(values[1:, 0] - values[:-1, -1]) > JUMP * np.ptp(values)
                self._at[id(phase)] |= {int(i) + 1 for i in np.flatnonzero(jumps)} if np.ptp(values) > 0.0 else set()

    def of(self, phase: Any) -> set[int]:
        """Numbers of the elements that begin with one."""
        return self._at[id(phase)]


def _keep_equal_widths(model: Any, phases: Sequence[Any], switched: _Switched) -> None:
    """Make all elements between two switches equally wide, by rows, and interpolate the values."""
    rows = ConstraintList()
    model.add_component(EQUAL_WIDTHS, rows)
    for phase in phases:
        boundary, trajectory, count = phase.boundary, phase.trajectory(), phase.grid.mesh.elements
        ends = [0, *sorted(switched.of(phase)), count]
        for first, last in pairwise(ends):
            left, right = value(boundary[first]), value(boundary[last])
            for i in range(first + 1, last):
                boundary[i].set_value(left + (right - left) * (i - first) / (last - first), skip_validation=True)
                rows.add(boundary[i + 1] - boundary[i] == boundary[i] - boundary[i - 1])
        phase.initialize(trajectory)


def _joined(results: Sequence[SolveResult]) -> SolveResult:
    """The last answer, with the steps of all."""
    first, result = results[0], results[-1]
    remark = (
        f"Pairs changed sides inside of elements, where the first answer, {first.objective:.6g}, has an error of the "
        "order of their width. The boundaries of the elements have moved to the switches, and the elements between "
        "are equal (mesh_tolerance=None keeps the mesh)."
    )
    return replace(with_steps_of_all(result, results), remarks=(*result.remarks, remark))
