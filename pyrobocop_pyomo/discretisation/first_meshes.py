"""First meshes: fine enough to see what a statement says of the time, before anything is solved.

What rules say with states and controls held is a function of time alone: a forcing, a price, a season, a pulse. Where
the points of a mesh miss it, the answer is that of another problem, and its own estimate of its error may miss it too.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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
from pyrobocop_pyomo.phases import Control, Parameter
from pyrobocop_pyomo.phases.declarations import within
from pyrobocop_pyomo.phases.delays import history_value
from pyrobocop_pyomo.phases.horizon import real_grid
from pyrobocop_pyomo.phases.instant_rules import ARRAY_FUNCTIONS
from pyrobocop_pyomo.phases.rate_arrays import FormulasWithDelays
from pyrobocop_pyomo.phases.record import Statement
from pyrobocop_pyomo.phases.remeshing import remesh_phases, why_not_remeshed

logger = logging.getLogger(__name__)

# Elements of a first mesh: so many times the user's, and at most so many in a model.
MOST_TIMES, MOST_ELEMENTS = 8, 1000
# Instants at which functions are sampled: for each element that there may be; rules that have to know the time as a
# number are asked at fewer ones.
_SAMPLES, _FEWEST, _MOST_NUMBERS = 16, 2000, 400_000
_SAMPLES_BY_INSTANT, _JUMPS_BY_INSTANT, _MOST_BY_INSTANT = 1200, 100, 300
# From so much of a function's departure from its mean on, what a mesh does not see is another problem.
UNSEEN = 0.3
# Values that states and controls are held at: where between their bounds, or how far from the guess.
_TRIALS = ((0.5, 0.0), (0.31, 0.37), (0.83, -0.61))
# Bounds that are farther apart, as a multiple of the guess, say nothing of the size of a variable.
_WIDE = 10.0


@dataclass(frozen=True)
class FirstMeshes:
    """What became of the meshes.

    Attributes
    ----------
    remarks : tuple of str
        What was changed and why.
    unseen : tuple of str
        What the points of a mesh that stays do not see.
    """

    remarks: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()


def mesh_from_statement(phases: Sequence[Any]) -> FirstMeshes:
    """Give phases meshes, in place, that see what is stated over their times.

    Phases whose rules do not depend on the time keep their meshes, and so do those with step maps, pairs or variable
    element boundaries, and those whose controls are constant or linear over the elements that the user has chosen.

    Parameters
    ----------
    phases : sequence of PhaseBlock
        Of one model, with their initial guesses.
    """
    remarks, unseen = [], []
    total = sum(phase.grid.mesh.elements for phase in phases)
    for phase in phases:
        elements = phase.grid.mesh.elements
        most = min(MOST_TIMES * elements, elements + MOST_ELEMENTS - total)
        if phase.record.discrete_states or phase.record.free_widths or phase.record.statements_of("complementarity"):
            continue
        try:
            found = _Stated(phase)
            if found.is_autonomous:
                continue
            # What is sampled lies beyond tables here and there.
            with tables_continued(), np.errstate(all="ignore"):
                made = found.meshes(most)
        except (PyRobocopError, ArithmeticError, ValueError, LookupError, TypeError, AttributeError) as error:
            logger.info("phase '%s': its first mesh is as declared: %s", phase.name, error)
            continue
        reason = _reason_to_stay(phase) if made[0].mesh != phase.grid.mesh else None
        for resolution in made if reason is None else ():
            try:
                remesh_phases({phase: resolution.mesh})
            except PyRobocopError as error:
                reason = str(error)
                continue
            reason, stands = None, resolution
            break
        else:
            stands = found.as_it_is
        now = phase.grid.mesh.elements
        total += now - elements
        if stands is not found.as_it_is:
            why = found.words(found.as_it_is, stands)
            remarks.append(f"The mesh of '{phase.name}' has {now} elements in place of {elements}: {why}.")
        worst = None if stands is None else stands.worst
        if stands is not None and worst is not None and stands.errors[worst] > UNSEEN:
            why = f"{now} elements are {MOST_TIMES} times those declared." if reason is None else reason
            unseen.append(f"phase '{phase.name}': its points miss much of {found.described(stands, worst)}. {why}")
    return FirstMeshes(tuple(remarks), tuple(unseen))


def _reason_to_stay(phase: Any) -> str | None:
    for name in phase.record.names(Control):
        control = phase.record.declarations[name]
        if control.parametrization != "collocated" and control.knots is None:
            return (
                f"They stay, since the control '{name}' is {control.parametrization.replace('_', ' ')} over its "
                "elements. Declare more elements, with knots=... for the control."
            )
    return why_not_remeshed(phase)


class _Stated:
    """What the rules and bounds of a phase say of the time."""

    def __init__(self, phase: Any) -> None:
        self._phase, self._record = phase, phase.record
        self._grid = real_grid(phase, self._record)
        record = self._record
        self._formulas = FormulasWithDelays(phase, record, record.grid, self._grid, by_instant=True)
        self._labels: list[str] = []
        self._expressions: list[Any] = []
        for statement in (*record.statements, *record.integrals):
            self._ask(statement)
        self._bounds = {name: of for name, of in record.declarations.items() if callable(of.bounds)}
        self._delayed = self._formulas.delayed_variables
        self.as_it_is: Resolution | None = None

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
        return not self._expressions and not self._bounds

    def meshes(self, most: int) -> list[Resolution]:
        """Meshes that resolve what is stated, the best first; the last one keeps all boundaries where none need go."""
        grid, by_instant = self._record.grid, self._formulas.asks_by_instant
        start, end = grid.mesh.boundaries[0], grid.mesh.boundaries[-1]
        samples = max(_FEWEST, _SAMPLES * min(most, MOST_ELEMENTS))
        samples = max(min(samples, _MOST_NUMBERS // max(len(self._expressions), 1)), 64)
        if by_instant:
            most = min(most, max(_MOST_BY_INSTANT, grid.mesh.elements))
            samples = min(samples, _SAMPLES_BY_INSTANT)
        functions = FunctionsOfTime(self._values(), start, end, samples)
        jumps = _JUMPS_BY_INSTANT if by_instant else MOST_ELEMENTS
        self.as_it_is = functions.resolution(grid.mesh, grid.scheme)
        self._labels += [f"bounds of '{name}'" for name in self._bounds]
        firsts = [mesh_of_delays(grid.mesh, self._delays(), most), grid.mesh]
        found = [
            functions.resolving(mesh, grid.scheme, most, most_jumps=jumps, move=move)
            for mesh, move in ((firsts[0], True), (firsts[1], True), (firsts[1], False))
        ]
        return [one for i, one in enumerate(found) if one.mesh not in [other.mesh for other in found[:i]]]

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
            clock = np.interp(times, record.grid.mesh.boundaries, self._grid.mesh.boundaries)
            found = np.full((len(lines) + len(self._bounds), len(held), times.size), np.nan)
            for k, of in enumerate(held):
                zeros = np.zeros(times.size)
                arguments = [of[name] + zeros for name in names] + [times, clock] + [zeros + 1.0 for _ in slopes]
                arguments += [self._past(variable.index(), of, clock) for variable in self._delayed]
                for j, line in enumerate(lines):
                    try:
                        found[j, k] = line(*arguments)[0]
                    except (ArithmeticError, ValueError):
                        continue  # such a value has no place in this function
            for j, (name, declaration) in enumerate(self._bounds.items(), len(lines)):
                sides = [declaration.bounds_at(time, name) for time in times.tolist()]
                found[j] = [sum(side or 0.0 for side in pair) for pair in sides]
            return found

        return values

    def _held(self, name: str, part: float, away: float) -> float:
        """A value that a variable is held at: near the guess, or within bounds that are near to each other."""
        declaration = self._record.declarations[name]
        lower, upper = declaration.bounds_at(self._record.grid.mesh.boundaries[0], name)
        if isinstance(declaration, Parameter):
            variables = [self._phase.component(name)]
        else:
            variables = self._record.nodes(name).variables(self._phase)
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

    def words(self, before: Resolution, after: Resolution) -> str:
        """Why a mesh was changed."""
        if after.jumps:
            count = len(after.jumps)
            return f"what is stated jumps at {count} instant{'s' if count > 1 else ''}, where boundaries are now"
        worst = before.worst
        if worst is not None and before.errors[worst] > TOLERANCE:
            return self.described(before, worst)
        return "values at earlier times are then values at points of the mesh"

    def described(self, resolution: Resolution, worst: int) -> str:
        """One of the functions, in words."""
        turns = int(resolution.turns[worst])
        return f"{self._labels[worst]}, which turns {turns} times over the phase" if turns > 1 else self._labels[worst]


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
