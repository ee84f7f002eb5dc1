"""Steps by rows: each element a mixed complementarity problem in its rows and pairs, with impacts inside it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.rule_results import variables_read
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.mixed_complementarity import ComplementaritySolution, solve_mixed_complementarity
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE
from pyrobocop_pyomo.transcription import can_step

from .declarations import State
from .element_system import ElementSystem, PairStatement, element_systems
from .record import PhaseRecord
from .simulated_unknowns import Unknowns

# Of a step: how far states are moved on to see how fast gaps change.
_LITTLE = 1e-6


class ContactSteps:
    """One step after the other; the values of what was found stand on the model.

    Parameters
    ----------
    block : PhaseBlock
    record : PhaseRecord
    unknowns : Unknowns
    widths : array, shape (N,)
        Of the elements in real time.
    restitution : mapping of name of a pair to number
        Newton's coefficient, from 0 to 1, of pairs of a gap and a force.

    Raises
    ------
    InitialGuessError
        When counts do not match, or a coefficient is none or names no pair.
    """

    def __init__(
        self,
        block: Any,
        record: PhaseRecord,
        unknowns: Unknowns,
        widths: Array,
        restitution: Mapping[str, float],
    ) -> None:
        self._record, self._widths = record, widths
        self._systems = element_systems(block, record, unknowns)
        self._restitution = self._checked(block, restitution)
        self._put_gaps_first(block)
        components = [block.component(record.nodes(name).component) for name in unknowns.algebraics]
        self._last = {
            id(component): next((float(v.value) for v in component.values() if v.value is not None), 0.0)
            for component in components
        }
        self._gaps: dict[str, float] = {}
        self._speeds: dict[str, float] = {}

    @property
    def unknowns(self) -> list[Any]:
        """Everything that is to be found, also what a phase asks of its end: that is no equation of a simulation."""
        return [variable for system in self._systems for variable in system.unknowns]

    def begin(self, start: Mapping[str, float], block: Any) -> None:
        """Take note of where the states start."""
        self._last |= {id(block.component(name)): number for name, number in start.items()}

    def solve(self, i: int) -> tuple[float, str] | None:
        """Find everything on an element; its values are on the model then. Else the residual, and where it is."""
        system = self._systems[i]
        guess = np.array([self._last.get(id(v.parent_component()), 0.0) for v in system.unknowns], dtype=float)
        if i == 0 and self._restitution:
            self._at_start(system, guess)
        solution = solve_mixed_complementarity(system.problem(), guess)
        if not solution.solved and not self._restitution:
            return solution.residual, system.name_of(solution.worst)
        self._put(system, solution)
        solution = self._with_impacts(system, i, guess, solution)
        if not solution.solved:
            return solution.residual, system.name_of(solution.worst)
        self._put(system, solution)
        self._remember(system, i)
        return None

    def _put(self, system: ElementSystem, solution: ComplementaritySolution) -> None:
        for variable, number in zip(system.unknowns, solution.point.tolist(), strict=True):
            variable.set_value(number, skip_validation=True)

    def _remember(self, system: ElementSystem, i: int) -> None:
        for variable in system.unknowns:  # later times come later
            self._last[id(variable.parent_component())] = variable.value
        for statement in system.statements:
            if statement.name in self._restitution:
                gap = float(value(statement.body))
                self._speeds[statement.name] = (gap - self._gaps[statement.name]) / self._widths[i]
                self._gaps[statement.name] = gap

    # ---------------------------------------------------------------- impacts

    def _with_impacts(
        self, system: ElementSystem, i: int, guess: Array, solution: ComplementaritySolution
    ) -> ComplementaritySolution:
        """Let contacts that close in this step rebound, all at once, until no other one closes because of it."""
        closing: set[str] = set()
        while self._restitution:
            found = {
                statement.name
                for statement in system.statements
                if statement.name in self._restitution
                and self._speeds[statement.name] < -NEGLIGIBLE
                and value(statement.other) > NEGLIGIBLE
            }
            if found <= closing:
                break
            closing |= found
            apart = self._apart(system, guess, closing)
            speeds = {name: (gap - self._gaps[name]) / float(self._widths[i]) for name, gap in apart.items()}
            stated = [
                self._rebound(each, i, speeds[each.name]) if each.name in closing else each
                for each in system.statements
            ]
            solution = solve_mixed_complementarity(system.problem(stated), guess)
            if not solution.solved:
                break
            self._put(system, solution)
        return solution

    def _rebound(self, statement: PairStatement, i: int, apart: float) -> PairStatement:
        """Newton's law in place of the gap: the speed after an impact, from that before and that without contact.

        What else accelerates the bodies goes on doing so after the impact: without that the step would lift them for
        nothing. No gap closes further than to zero.
        """
        name, width = statement.name, float(self._widths[i])
        before, gap = self._speeds[name], self._gaps[name]
        after = max(-self._restitution[name] * before + min(apart - before, 0.0), -gap / width)
        return replace(statement, body=(statement.body - gap) / width - after)

    def _apart(self, system: ElementSystem, guess: Array, names: Iterable[str]) -> dict[str, float]:
        """Gaps at the end of a step in which some pairs exert no force."""
        open_ones = [each for each in system.statements if each.name in names]
        stated = [
            replace(each, body=each.other, other=0.0, lower=0.0, upper=0.0) if each in open_ones else each
            for each in system.statements
        ]
        solution = solve_mixed_complementarity(system.problem(stated), guess)
        self._put(system, solution)
        return {each.name: float(value(each.body)) if solution.solved else self._gaps[each.name] for each in open_ones}

    def _at_start(self, system: ElementSystem, guess: Array) -> None:
        """Gaps at the start, and the speeds with which they change before anything acts."""
        watched = [statement for statement in system.statements if statement.name in self._restitution]
        self._gaps = self._gaps_at(system, guess, watched, guess)
        width = float(self._widths[0])
        moved = self._moved_a_little(system, guess, _LITTLE * width)
        if moved is None:  # what a step without contact changes is next to it
            gaps = self._apart(system, guess, self._gaps)
        else:
            gaps, width = self._gaps_at(system, guess, watched, moved), _LITTLE * width
        self._speeds = {name: (gap - self._gaps[name]) / width for name, gap in gaps.items()}

    def _moved_a_little(self, system: ElementSystem, guess: Array, time: float) -> Array | None:
        """The unknowns with all states moved on by their rates at the start; None where equations do not give these."""
        rates = self._record.rates
        for variable, number in zip(system.unknowns, guess.tolist(), strict=True):
            variable.set_value(number, skip_validation=True)
        moved = guess.copy()
        stage = self._record.grid.stage_times[0][-1]
        for k, variable in enumerate(system.unknowns):
            name = variable.parent_component().local_name
            if name in self._record.declarations and isinstance(self._record.declarations[name], State):
                if name not in rates:
                    return None
                moved[k] += time * float(value(rates[name][stage]))
        return moved

    def _gaps_at(
        self, system: ElementSystem, guess: Array, watched: Sequence[PairStatement], point: Array
    ) -> dict[str, float]:
        """Gaps at a point; algebraics that depend on the states there follow by the residual equations."""
        for variable, number in zip(system.unknowns, point.tolist(), strict=True):
            variable.set_value(number, skip_validation=True)
        names = {statement.name for statement in self._record.statements_of("residual")}
        rows = [(name, row) for name, row in system.rows if name.split("[")[0].rsplit(".", 1)[-1] in names]
        of_signals = set(self._record.names_of_signals)
        follow = [v for v in system.unknowns if v.parent_component().local_name in of_signals]
        if rows and follow:
            problem = ElementSystem(follow, rows, []).problem()
            found = np.array([v.value for v in follow], dtype=float)
            for _ in range(10):
                values = problem.evaluate(found)
                step = np.linalg.lstsq(values.rows_jacobian, -values.rows, rcond=None)[0]
                found = found + step
                if np.abs(step).max(initial=0.0) <= 1e-14 * max(1.0, np.abs(found).max(initial=0.0)):
                    break
            problem.evaluate(found)
        return {statement.name: float(value(statement.body)) for statement in watched}

    def _put_gaps_first(self, block: Any) -> None:
        """Of a pair that states the force first, take the other side for the gap: the one that reads states."""
        states = {id(v) for name in self._record.names_of_states for v in block.component(name).values()}

        def moves(side: Any) -> bool:
            return any(id(variable) in states for variable in variables_read(side))

        for system in self._systems:
            for k, statement in enumerate(system.statements):
                if statement.name in self._restitution and moves(statement.other) and not moves(statement.body):
                    system.statements[k] = replace(statement, body=statement.other, other=statement.body)

    def _checked(self, block: Any, restitution: Mapping[str, float]) -> dict[str, float]:
        known = {statement.name for system in self._systems for statement in system.statements}
        if restitution and not can_step(self._record.grid.scheme):
            raise InitialGuessError(
                f"phase '{block.name}': restitution needs one step per element; {self._record.grid.scheme.name} has "
                f"{self._record.grid.scheme.stages} stages. Use scheme='implicit_euler'."
            )
        checked: dict[str, float] = {}
        for name, coefficient in restitution.items():
            # A contact law states its pairs under its own name and "_pairs".
            meant = [each for each in known if each.split("[")[0] in (name, f"{name}_pairs") or each == name]
            if not meant:
                raise InitialGuessError(
                    f"phase '{block.name}': restitution is given for '{name}', which is no pair of a simulation; these "
                    f"are {', '.join(sorted(known)) or 'none'}."
                )
            if isinstance(coefficient, bool) or not 0 <= coefficient <= 1:
                raise InitialGuessError(
                    f"phase '{block.name}': the restitution of '{name}' is {coefficient!r}; it is a number from 0 to 1."
                )
            checked |= dict.fromkeys(meant, float(coefficient))
        return checked
