"""Phases that nothing joins, or not wholly: as good as several problems, of which one may be there by mistake."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from itertools import chain, permutations
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.links import LinkData
from pyrobocop_pyomo.modeling.activity import enclosing_blocks, outermost_inactive
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Matching
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.avoidance_record import variables_of
from pyrobocop_pyomo.phases import PhaseBlockData, phases_of
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, quoted, warning_about


def joining_findings(block: Any) -> Iterator[Finding]:
    """A phase whose start nothing gives, beside one that ends anywhere, where no row and no pair holds both.

    Phases that share nothing and have starts of their own are meant so, as a sum of experiments is.
    """
    phases = phases_of(block)
    yield from _deactivated_findings(block)
    links = blocks_of_kind(block, LinkData)
    if len(phases) < 2 and not links:
        return
    joined = _Joined(block, phases)
    for link in links:
        if left := joined.open_ends(link.second, link.starts_asked_for, first=True):
            yield warning_about(
                f"link '{link.name}' leaves {quoted(left)} of '{link.second.name}' without a start: it may jump there.",
                (link.name, link.second.name),
                f"Give it in states= or jump=, or leave it alone by omit={left[:1]} where that is meant.",
            )
    for second, first in permutations(phases, 2):
        start = joined.open_ends(second, second.record.names_of_states, first=True)
        end = joined.open_ends(first, first.record.names_of_states, first=False)
        if start and end and not joined.are_one_group(first, second):
            yield warning_about(
                f"nothing joins the phases '{first.name}' and '{second.name}': no link, no constraint and no pair "
                f"holds variables of both, nothing says where {quoted(start)} of '{second.name}' "
                f"{'starts' if len(start) == 1 else 'start'}, and '{first.name}' may end anywhere.",
                (first.name, second.name),
                f"Join them: m.link = rcp.Link(m.{first.name}, m.{second.name}). Where each is meant by itself, "
                "give that start, or solve one after the other.",
            )
            return


def _deactivated_findings(block: Any) -> Iterator[Finding]:
    """Deactivated phases some of whose free variables are read by what is active."""
    every = (part for part in block.block_data_objects(descend_into=Block) if isinstance(part, PhaseBlockData))
    inactive = {id(phase): phase for phase in every if outermost_inactive(phase, block) is not None}
    readers: dict[int, dict[str, None]] = {}
    kinds = (Constraint, Objective, *PAIR_TYPES) if inactive else ()
    for row in block.component_data_objects(kinds, active=True, descend_into=Block):
        for variable in _variables_of(row):
            for home in map(id, enclosing_blocks(variable)):
                if home in inactive:
                    readers.setdefault(home, {})[row.parent_component().name] = None
    for home, names in readers.items():
        name, reading = inactive[home].name, ", ".join(map(repr, names))
        yield warning_about(
            f"phase '{name}' is deactivated, and so are its equations, but its variables are free in {reading}: they "
            "may have any values.",
            (name, *names),
            "Activate it, deactivate what reads it, or fix its variables.",
        )


def _variables_of(row: Any) -> list[Any]:
    """What may move in a row, an objective or a pair."""
    return [variable for side in sides_of(row) for variable in variables_in(side, include_fixed=False)]


class _Joined:
    """Which phases have a row, a pair or a variable in common, directly or by what lies between."""

    def __init__(self, block: Any, phases: list[Any]) -> None:
        self._phases = {id(phase): phase for phase in phases}
        self._home: dict[int, Any] = {}
        self._parent: dict[Hashable, Hashable] = {}
        self._in_others: set[int] = set()  # in inequalities and pairs beside the phases
        self._equations: list[set[int]] = []
        for component in block.component_objects((Constraint, *PAIR_TYPES), active=True, descend_into=Block):
            is_beside, rows = not self._is_per_point(component), [row for row in component.values() if row.active]
            # Of what a rule says at all points, the first and the last row tell what it joins.
            for row in rows if is_beside else (*rows[:1], *rows[-1:]):
                variables = _variables_of(row)
                self._unite(variables)
                if is_beside and row.ctype is Constraint and row.equality:
                    self._equations.append(set(map(id, variables)))
                elif is_beside:
                    self._in_others.update(map(id, variables))
        for avoidance in blocks_of_kind(block, ObstacleAvoidanceBlockData):
            poses = {body: pose for (body, _), pose in avoidance.record.poses.items()}
            self._unite(chain.from_iterable(map(variables_of, poses.values())))

    def _is_per_point(self, component: Any) -> bool:
        """Whether a rule of a phase, or a differential equation, has made it."""
        phase = self._phases.get(id(component.parent_block()))
        if phase is None:
            return False
        record = phase.record
        return component.local_name in record.generated_rows | {statement.name for statement in record.statements}

    def _unite(self, variables: Iterable[Any]) -> None:
        roots = {self._root(self._key(variable)) for variable in variables if not variable.fixed}
        self._parent.update(dict.fromkeys(roots, next(iter(roots), None)))

    def _key(self, variable: Any) -> Hashable:
        """The phase that a variable belongs to, or the variable itself."""
        component = variable.parent_component()
        if id(component) not in self._home:
            around = (id(block) for block in enclosing_blocks(component))
            self._home[id(component)] = next((number for number in around if number in self._phases), None)
        home = self._home[id(component)]
        return id(variable) if home is None else home

    def _root(self, key: Hashable) -> Hashable:
        while (above := self._parent.get(key, key)) != key:
            key = above
        return key

    def are_one_group(self, first: Any, second: Any) -> bool:
        """Whether something joins two phases."""
        return self._root(id(first)) == self._root(id(second))

    def open_ends(self, phase: Any, names: Iterable[str], *, first: bool) -> list[str]:
        """States that may have any value where the phase starts, or ends: an equation beside gives one of them."""
        ends = {}
        for name in names:
            declaration = phase.record.declarations[name]
            given = declaration.initial if first else declaration.final
            data = phase.component(name)[phase.initial_time if first else phase.final_time]
            if not (isinstance(given, tuple) or data.fixed or id(data) in self._in_others):
                ends[id(data)] = name
        return [ends[key] for key in Matching(self._equations, ends).unmatched_columns]
