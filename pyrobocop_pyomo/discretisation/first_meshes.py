"""First meshes: fine enough to see what a statement says of the time, before anything is solved.

What rules say with states and controls held is a function of time alone: a forcing, a price, a season, a pulse. Where
the points of a mesh miss it, the answer is that of another problem, and its own estimate of its error may miss it too.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import native_numeric_types, value
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.errors import PyRobocopError
from pyrobocop_pyomo.modeling.expression_arrays import plain_entry, plain_expressions
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.straight_line import StraightLine
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.resolved_functions import TOLERANCE, FunctionsOfTime, Resolution, mesh_of_delays
from pyrobocop_pyomo.numerics.tables import tables_continued
from pyrobocop_pyomo.phases import Parameter
from pyrobocop_pyomo.phases.declarations import within
from pyrobocop_pyomo.phases.delays import history_value
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.instant_rules import ARRAY_FUNCTIONS
from pyrobocop_pyomo.phases.rate_arrays import FormulasWithDelays
from pyrobocop_pyomo.phases.record import Statement
from pyrobocop_pyomo.phases.remeshing import remesh_phases, why_its_mesh_is_stated, why_not_remeshed

logger = logging.getLogger(__name__)

# Elements of a first mesh: so many times the user's, and at most so many in a model.
MOST_TIMES, MOST_ELEMENTS = 8, 1000
# Instants at which functions are sampled: for each element that there may be, and at most so many numbers.
_SAMPLES, _FEWEST, _MOST_NUMBERS = 16, 2000, 400_000
# Rules that have to know the time as a number are called at each instant: first at a few ones, and if they change with
# the time at some for each element. Jumps are looked for at few places, and not at all with many elements.
_FIRST_BY_INSTANT, _SAMPLES_BY_INSTANT, _JUMPS_BY_INSTANT, _MOST_BY_INSTANT = 23, 8, 60, 100
# From so much of a function's departure from its mean on, what a mesh does not see is another problem.
UNSEEN = 0.3
# Values that states and controls are held at: where between their bounds, or how far from the guess.
_TRIALS = ((0.5, 0.0), (0.31, 0.37), (0.83, -0.61))
# Bounds that are farther apart, as a multiple of the guess, say nothing of the size of a variable.
_WIDE = 10.0


class FirstMeshes:
    """What became of the meshes of some phases.

    Attributes
    ----------
    remarks : list of str
        What was changed, and why.
    """

    def __init__(self) -> None:
        self.remarks: list[str] = []
        self._watched: list[tuple[_Stated, str]] = []

    def follow(self, phase: Any, most: int) -> None:
        """Give one phase a mesh of at most so many elements that sees what is stated over its times."""
        elements, found = phase.grid.mesh.elements, _Stated(phase)
        if found.is_autonomous:
            return
        reason = found.remesh(most)
        now = phase.grid.mesh.elements
        if found.stands is not found.as_declared:
            moved = "other boundaries" if now == elements else f"{now} elements in place of {elements}"
            self.remarks.append(f"The mesh of '{phase.name}' has {moved}: {found.words()}.")
        if found.stands.missed > UNSEEN:
            self._watched.append((found, reason))

    def unseen(self) -> list[str]:
        """What the meshes that the phases have now do not see, in words."""
        found = []
        for stated, reason in self._watched:
            if (missed := stated.missed()) is not None:
                found.append(f"phase '{stated.phase.name}': its points miss much of {missed}. {reason}")
        return found


def mesh_from_statement(phases: Sequence[Any]) -> FirstMeshes:
    """Give phases meshes, in place, that see what is stated over their times.

    Phases whose rules do not depend on the time keep their meshes, and so do those with step maps, pairs or variable
    element boundaries, and those whose controls are constant or linear over the elements that the user has chosen.

    Parameters
    ----------
    phases : sequence of PhaseBlock
        Of one model, with their initial guesses.
    """
    meshes = FirstMeshes()
    for phase in phases:
        record = phase.record
        others = sum(other.grid.mesh.elements for other in phases) - record.grid.mesh.elements
        most = min(MOST_TIMES * record.grid.mesh.elements, MOST_ELEMENTS - others)
        fixed = record.discrete_states or record.free_widths or record.statements_of("complementarity")
        if fixed or most <= record.grid.mesh.elements:
            continue
        try:
            meshes.follow(phase, most)
        except Exception as error:  # a rule that was written for single instants may raise anything elsewhere
            logger.info("phase '%s': its first mesh is as declared (%s)", phase.name, error)
    return meshes


class _Stated:
    """What the rules and bounds of a phase say of the time."""

    def __init__(self, phase: Any) -> None:
        self.phase, self._record = phase, phase.record
        record, self._indices = phase.record, phase.grid.mesh.boundaries
        self._grid = real_grid(phase, record)
        by_instant = phase.grid.mesh.elements <= _MOST_BY_INSTANT
        self._formulas = FormulasWithDelays(phase, record, record.grid, self._grid, by_instant=by_instant)
        self._labels: list[str] = []
        self._expressions: list[Any] = []
        for statement in (*record.statements, *record.integrals):
            self._ask(statement)
        self._bounds = {name: of for name, of in record.declarations.items() if callable(of.bounds)}
        self._delayed = self._formulas.delayed_variables

    def _ask(self, statement: Statement) -> None:
        kind = statement.kind
        try:
            found = self._formulas.formulas_of(statement, _parts)
        except PyRobocopError as error:
            logger.info("what '%s' says of the time is not known: %s", statement.name, error)
            return
        moving = {id(variable) for variable in self._formulas.variables(())}
        for expression in found.values():
            if expression.__class__ in native_numeric_types:
                continue
            read = {id(variable) for variable in variables_in(expression)}
            if read & moving or read & {id(variable) for variable in self._formulas.delayed_variables}:
                self._labels.append(f"{kind} '{statement.name}'")
                self._expressions.append(expression)

    @property
    def is_autonomous(self) -> bool:
        """Whether nothing depends on the time."""
        if self._formulas.asks_by_instant:
            return not self._sampled(_FIRST_BY_INSTANT).vary
        return not self._expressions and not self._bounds

    def _sampled(self, samples: int) -> FunctionsOfTime:
        return FunctionsOfTime(self._values(), self._indices[0], self._indices[-1], samples)

    def remesh(self, most: int) -> str:
        """Give the phase a mesh that resolves what is stated; why it has no finer one is returned."""
        grid, by_instant = self.phase.grid, self._formulas.asks_by_instant
        samples = max(min(max(_FEWEST, _SAMPLES * most), _MOST_NUMBERS // max(len(self._expressions), 1)), 200)
        if by_instant:
            samples = max(200, _SAMPLES_BY_INSTANT * grid.mesh.elements)
        self._functions = self._sampled(samples)
        self.as_declared = self.stands = self._functions.resolution(grid.mesh, grid.scheme)
        of_delays = mesh_of_delays(grid.mesh, self._delays(), most)
        reason = f"It has {most} elements, of which there would have to be more."
        for mesh in (of_delays, grid.mesh):
            jumps = _JUMPS_BY_INSTANT if by_instant else MOST_ELEMENTS
            found = self._functions.resolving(mesh, grid.scheme, most, most_jumps=jumps)
            if found.mesh == grid.mesh:
                break
            if (refused := why_its_mesh_is_stated(self.phase) or why_not_remeshed(self.phase)) is not None:
                return refused
            try:
                remesh_phases({self.phase: found.mesh})
            except PyRobocopError as error:
                reason = str(error)
                continue
            self.stands = found
            break
        return reason

    def missed(self) -> str | None:
        """What the mesh of the phase misses, in words."""
        grid = self.phase.grid
        self.stands = self._functions.resolution(grid.mesh, grid.scheme, self.stands.jumps)
        return self._described(self.stands) if self.stands.missed > UNSEEN else None

    def _delays(self) -> list[float]:
        per_index = 1.0
        if self._record.normalised:
            per_index = self._grid.mesh.boundaries[-1] - self._grid.mesh.boundaries[0]
        return sorted({delay / per_index for variable in self._delayed if (delay := variable.index()[1]) > 0.0})

    # ---------------------------------------------------------------- functions of time

    def _values(self) -> Callable[[Array], Array]:
        record, formulas = self._record, self._formulas
        names = [*record.declarations]
        slopes = [formulas.derivative(name) for name in record.names_of_states]
        inputs = [*formulas.variables(names), *slopes, *self._delayed]
        lines = []
        for expression in self._expressions:
            line = StraightLine([expression], inputs, ARRAY_FUNCTIONS)
            line.refresh()
            lines.append(line)
        held = [{name: self._held(name, *trial) for name in names} for trial in _TRIALS]

        def values(times: Array) -> Array:
            clock = np.interp(times, self._indices, self._grid.mesh.boundaries)
            found = np.full((len(lines) + len(self._bounds), len(held), times.size), np.nan)
            for k, of in enumerate(held):
                zeros = np.zeros(times.size)
                arguments = [of[name] + zeros for name in names] + [times, clock] + [zeros + 1.0 for _ in slopes]
                arguments += [self._past(variable.index(), of, clock) for variable in self._delayed]
                for j, line in enumerate(lines):
                    # What is held somewhere lies beyond a table here and there, or where a function has no value.
                    with tables_continued(), np.errstate(all="ignore"), suppress(ArithmeticError, ValueError):
                        found[j, k] = line(*arguments)[0]
            for j, (name, declaration) in enumerate(self._bounds.items(), len(lines)):
                sides = [declaration.bounds_at(time, name) for time in times.tolist()]
                found[j] = [sum(side or 0.0 for side in pair) for pair in sides]
            return np.where(np.isfinite(found).all(axis=-1, keepdims=True), found, np.nan)

        return values

    def _held(self, name: str, part: float, away: float) -> float:
        """A value that a variable is held at: near the guess, or within bounds that are near to each other."""
        declaration = self._record.declarations[name]
        lower, upper = declaration.bounds_at(self._indices[0], name)
        if isinstance(declaration, Parameter):
            variables = [self.phase.component(name)]
        else:
            variables = self._record.nodes(name).variables(self.phase)
        known = np.array([variable.value for variable in variables if variable.value is not None] or [0.0])
        guess, extent = float(np.median(known)), float(np.ptp(known))
        size = max(abs(guess), extent)
        if lower is not None and upper is not None and upper - lower <= _WIDE * (size or 1.0):
            return lower + part * (upper - lower)
        return within(guess + away * (size or 1.0), (lower, upper))

    def _past(self, index: tuple[str, float], held: dict[str, float], clock: Array) -> Array:
        """What a variable was before: its history, and what it began with from then on."""
        name, delay = index
        earlier, start = clock - delay, self._grid.mesh.boundaries[0]
        if getattr(self._record.declarations[name], "history", None) is None:
            return np.full(clock.size, held[name])

        def before(time: float) -> float:
            return float(value(history_value(self._record, name, time, f"'{name}'", delay)))

        return np.array([before(time) for time in np.minimum(earlier, start).tolist()])

    # ---------------------------------------------------------------- words

    def words(self) -> str:
        """Why the mesh was changed."""
        if self.stands.jumps:
            count = len(self.stands.jumps)
            return f"what is stated jumps at {count} instant{'s' if count > 1 else ''}, where boundaries are now"
        if self.as_declared.missed > TOLERANCE:
            return self._described(self.as_declared)
        return "values at earlier times are then values at points of the mesh"

    def _described(self, resolution: Resolution) -> str:
        """The function that is resolved least."""
        worst = int(np.nanargmax(resolution.errors))
        label = [*self._labels, *(f"bounds of '{name}'" for name in self._bounds)][worst]
        turns = int(resolution.turns[worst])
        return f"{label}, which turns {turns} times over the phase" if turns > 1 else label


def _parts(result: Any) -> dict[str, Any]:
    """The expressions and numbers that a rule returned, in order."""
    found: list[Any] = []
    pending = [plain_expressions(result)]
    while pending:
        entry = plain_entry(pending.pop())
        if isinstance(entry, Mapping):
            pending += reversed(list(entry.values()))
        elif isinstance(entry, np.ndarray):
            pending += reversed(entry.ravel().tolist())
        elif isinstance(entry, (list, tuple)):
            pending += reversed(entry)
        elif isinstance(entry, RelationalExpression):
            pending += reversed(entry.args)
        elif entry.__class__ in native_numeric_types or hasattr(entry, "is_expression_type"):
            found.append(entry)
    return {str(i): entry for i, entry in enumerate(found)}
