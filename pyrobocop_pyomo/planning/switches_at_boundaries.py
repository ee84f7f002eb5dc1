"""Where pairs change sides inside elements: a second try with boundaries that move to the switches, and a doubt."""

from __future__ import annotations

import logging
from collections.abc import Hashable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from pyomo.core.base.constraint import ConstraintList
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import CanonicalPair, Crossed, active_pairs, side_values
from pyrobocop_pyomo.complementarity.relaxations import PerPair, as_grouping
from pyrobocop_pyomo.diagnosis import Finding, Severity
from pyrobocop_pyomo.discretisation.estimates import (
    SMALL_MOTION_ERROR,
    SMALL_OBJECTIVE_ERROR,
    ZERO_OBJECTIVE,
    jump_fractions,
)
from pyrobocop_pyomo.errors import PyRobocopError, SolveFailed
from pyrobocop_pyomo.modeling.activity import is_inside
from pyrobocop_pyomo.numerics import Array, Mesh
from pyrobocop_pyomo.numerics.mesh import halves_of
from pyrobocop_pyomo.phases import Control, phases_of
from pyrobocop_pyomo.phases.remeshing import free_element_widths, put_on_meshes
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.solving.ipopt_options import NEARLY_THERE
from pyrobocop_pyomo.solving.iterates import Quality
from pyrobocop_pyomo.solving.procedure import solve_model
from pyrobocop_pyomo.solving.solve_result import SolveResult, with_steps_of_all
from pyrobocop_pyomo.solving.starts import take_values_of_copy
from pyrobocop_pyomo.solving.strategies import BARRIER, TIGHT, Settings

from .mesh_loop import MeshLoop, MeshPlan

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
# Of the run on the user's model, from the answer with moving boundaries.
AT_THE_ANSWER = {"mu_init": 1e-8, "bound_push": 1e-8, "bound_frac": 1e-8}
# Of runs from the answer on other elements.
WARM = replace(BARRIER, name="equal elements between switches", options={**NEARLY_THERE, "max_iter": 300})
# Meshes with equal elements between switches, each with twice as many as the one before.
MOST_MESHES = 3
EQUAL_WIDTHS = "equal_widths_between_switches"

Family = tuple[str, Hashable, str]


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
        self._families = _sides_of(model, self._phases)

    def improved(self, first: SolveResult) -> SolveResult:
        """The answer, or that on elements which end at its switches; doubtful where it has some inside of elements."""
        if not self._families or first.quality is not Quality.OPTIMAL:
            return first
        switches = self._inside()
        if not switches and not any(jump_fractions(phase.trajectory()) for phase in self._phases):
            return first
        remark, doubts = "", (self._doubt(switches),) if switches else ()
        if self._may_try():
            try:
                return self._on_moved_boundaries(first)
            except PyRobocopError as error:
                logger.info("'%s': no answer on moved element boundaries: %s", self._model.name, error)
                remark = f"Element boundaries were not moved to the switches: {error}"
        remarks = (*first.remarks, remark) if remark and switches else first.remarks
        return replace(first, doubts=(*first.doubts, *doubts), remarks=remarks)

    # ---------------------------------------------------------------- what switches where

    def _inside(self) -> dict[Family, list[int]]:
        """The elements in which a family is on both sides: one is positive at one point, and the other at another."""
        found = {
            family: [element for element, (a, b) in sides.largest.items() if a * b > OVERLAP]
            for family, sides in self._families.items()
        }
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
            "Let the boundaries move: PhaseBlock(..., free_element_widths=(0.2, 3)) and rcp.solve(m, strategies="
            'rcp.Strategy(grouping=rcp.relaxations.Crossed(left_end="first"))), with the side that is continuous in '
            "time first in each pair; or compare with more elements."
        )
        return Finding(Severity.WARNING, message, (family[0],), remedy)

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

    def _on_moved_boundaries(self, first: SolveResult) -> SolveResult:
        """The answer on the model with other boundaries.

        Raises
        ------
        PyRobocopError
            Saying why there is none.
        """
        copy = self._model.clone()
        twins = [copy.find_component(phase) for phase in self._phases]
        free_element_widths(twins, FACTORS)
        left_ends = {family: sides.left_end for family, sides in self._families.items()}
        grouping = Crossed(left_end=lambda pair: left_ends.get(_family(pair), "first"))
        settings = replace(self._settings, grouping=grouping, exploration=0.0)
        results, change = [self._solved(copy, settings, first)], np.inf
        while change > SMALL_OBJECTIVE_ERROR and len(results) <= MOST_MESHES:
            if len(results) > 1:
                copy.del_component(EQUAL_WIDTHS)
                put_on_meshes({twin: halves_of(twin.grid.mesh) for twin in twins})
            # Elements of any width would be an optimiser's to gain by, where quadrature is worst.
            _keep_equal_widths(copy, twins)
            results.append(self._solved(copy, replace(settings, strategies=(WARM,)), first))
            change = _difference(results[-1], results[-2])
        found = results[-1]
        if change > 10.0 * SMALL_OBJECTIVE_ERROR:  # below, the answer is nearer to them than the first one
            raise SolveFailed("with equal elements between them, meshes agree on no solution.", found)
        if not self._inside() and _difference(found, first) < SMALL_OBJECTIVE_ERROR / 10.0:
            return first  # other elements bring nothing
        plan = MeshPlan({p: _moved(p, twin) for p, twin in zip(self._phases, twins, strict=True)}, "switches")
        again = replace(TIGHT, name="switches at boundaries", options=AT_THE_ANSWER)

        def solve() -> SolveResult:
            take_values_of_copy(self._model, copy)
            return self._solved(self._model, replace(settings, strategies=(again,)), first)

        loop = MeshLoop(self._model)
        result = loop.solve_on(plan, solve, lambda result: not _difference(result, found) > SMALL_OBJECTIVE_ERROR)
        if result is None:
            raise SolveFailed(loop.remark or "the model has another solution there than its copy.", found)
        remark = (
            f"Pairs changed sides inside of elements, where the first answer, {first.objective:.6g}, has an error of "
            "the order of their width. The boundaries of the elements have moved to the switches, and the elements "
            "between are equal (mesh_tolerance=None keeps the mesh)."
        )
        joined = replace(with_steps_of_all(result, [first, *results, result]), remarks=(*result.remarks, remark))
        if change <= SMALL_OBJECTIVE_ERROR:
            return joined
        message = f"Elements that end at switches are few: on half as many the objective differs by {change:.1e} of it."
        few = Finding(Severity.WARNING, message, (), "Give the phases more elements.")
        return replace(joined, doubts=(*result.doubts, few))

    def _solved(self, model: Any, settings: Settings, first: SolveResult) -> SolveResult:
        """Solve, and raise SolveFailed where the answer does not replace the first one."""
        found = solve_model(model, replace(settings, progress=Progress(False)))
        logger.info("'%s' with elements that end at switches: %s", model.name, found.one_line())
        if found.quality is not Quality.OPTIMAL:
            raise SolveFailed(f"no solution was found there ({found.stop_reason.value}).", found)
        motion, before = found.discretisation.motion_error, first.discretisation.motion_error
        if motion is not None and motion > max(SMALL_MOTION_ERROR, before or 0.0):
            raise SolveFailed(f"the motion there is not that of the equations ({motion:.1e} of a state's size).", found)
        elements = max(phase.grid.mesh.elements for phase in self._phases)
        worse = found.standing.cost - first.standing.cost
        if worse > FLATTERED / elements * max(abs(first.objective), abs(found.objective)):
            raise SolveFailed(f"a worse local optimum was found there, {found.objective:.6g}.", found)
        return found


class _Sides:
    """Both sides of a family at the points of its elements.

    Attributes
    ----------
    pairs : list of CanonicalPair
    left_end : {"first", "second", None}
        Which side is continuous in time, as far as its values show it.
    largest : dict of int to pair of float
        The largest value of each side in each element, as a part of all its values.
    """

    def __init__(self, pairs: list[CanonicalPair]) -> None:
        self.pairs = pairs
        sides = np.array([side_values(pair) for pair in pairs]).clip(0.0)
        first, second = (_largest_change(values) for values in sides.T)
        is_first = first <= JUMP or first <= second
        self.left_end = None if min(first, second) > JUMP else "first" if is_first else "second"
        sizes = np.abs(sides).max(axis=0)
        parts = np.divide(sides, sizes, out=np.zeros_like(sides), where=sizes > 0.0)
        elements = np.array([pair.group for pair in pairs])
        self.largest = {int(element): parts[elements == element].max(axis=0) for element in np.unique(elements)}


def _sides_of(model: Any, phases: Sequence[Any]) -> dict[Family, _Sides]:
    """The values of both sides of each family of phases, point by point."""
    found: dict[Family, list[CanonicalPair]] = {}
    for pair in active_pairs(model) if phases else ():
        if isinstance(pair.group, int) and any(is_inside(pair.source, phase) for phase in phases):
            found.setdefault(_family(pair), []).append(pair)
    return {family: _Sides(pairs) for family, pairs in found.items()}


def _largest_change(values: Array) -> float:
    size = float(np.ptp(values))
    return float(np.abs(np.diff(values)).max(initial=0.0)) / size if size > 0.0 else 0.0


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


def _difference(result: SolveResult, other: SolveResult) -> float:
    return abs(result.objective - other.objective) / max(abs(other.objective), ZERO_OBJECTIVE)


def _switches_of(model: Any, phase: Any) -> set[int]:
    """Numbers of the elements that begin where a pair changes sides, or a control jumps."""
    found: set[int] = set()
    for sides in _sides_of(model, [phase]).values():
        # 1 where the first side is positive, -1 where the second one is, 0 where none is.
        modes = {i: int(np.sign(a - b)) if max(a, b) > OVERLAP else 0 for i, (a, b) in sides.largest.items()}
        found |= {i for i in range(1, phase.grid.mesh.elements) if modes.get(i, 0) != modes.get(i - 1, 0)}
    trajectory = phase.trajectory()
    for name in phase.record.names(Control):
        values = trajectory.element_signals(name)
        jumps = np.abs(values[1:, 0] - values[:-1, -1]) > JUMP * np.ptp(values)
        found |= set((np.flatnonzero(jumps) + 1).tolist()) if np.ptp(values) > 0.0 else set()
    return found


def _keep_equal_widths(model: Any, phases: Sequence[Any]) -> None:
    """Make all elements between two switches equally wide, by rows, and interpolate the values."""
    rows = ConstraintList()
    model.add_component(EQUAL_WIDTHS, rows)
    for phase in phases:
        boundary, trajectory, count = phase.boundary, phase.trajectory(), phase.grid.mesh.elements
        for first, last in pairwise([0, *sorted(_switches_of(model, phase)), count]):
            left, right = value(boundary[first]), value(boundary[last])
            for i in range(first + 1, last):
                boundary[i].set_value(left + (right - left) * (i - first) / (last - first), skip_validation=True)
                rows.add(boundary[i + 1] - boundary[i] == boundary[i] - boundary[i - 1])
        phase.initialize(trajectory)
