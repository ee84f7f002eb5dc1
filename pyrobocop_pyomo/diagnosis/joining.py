"""Phases that nothing joins, or not wholly: as good as several problems, of which one may be there by mistake."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from itertools import chain, permutations
from typing import Any

from pyomo.core.base.constraint import Constraint

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.links import LinkData
from pyrobocop_pyomo.modeling.activity import enclosing_blocks
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.obstacles import ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.avoidance_record import variables_of
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases import phases_of
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, quoted, warning_about


def joining_findings(block: Any) -> Iterator[Finding]:
    """A phase whose start nothing gives, beside one that ends anywhere, where no row and no pair holds both.

    Phases that share nothing and have starts of their own are meant so, as a sum of experiments is.
    """
    phases = phases_of(block)
    links = blocks_of_kind(block, LinkData)
    if len(phases) < 2 and not links:
        return
    joined = _Joined(block, phases)
    for link in links:
        starts = joined.open_ends(link.second, first=True)
        if left := [name for name in link.starts_asked_for if name in starts]:
            yield warning_about(
                f"link '{link.name}' leaves {quoted(left)} of '{link.second.name}' without a start: it may jump there.",
                (link.name, link.second.name),
                f"Give it in states= or jump=, or leave it alone by omit={left[:1]} where that is meant.",
            )
    for second, first in permutations(phases, 2):
        start, end = joined.open_ends(second, first=True), joined.open_ends(first, first=False)
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


class _Joined:
    """Which phases have a row, a pair or a variable in common, directly or by what lies between."""

    def __init__(self, block: Any, phases: list[Any]) -> None:
        self._phases = {id(phase): phase for phase in phases}
        self._groups = scipy.cluster.hierarchy.DisjointSet(self._phases)
        self._held: set[int] = set()  # in rows and pairs beside the phases
        for component in block.component_objects((Constraint, *PAIR_TYPES), active=True, descend_into=True):
            is_beside, rows = not self._is_per_point(component), [row for row in component.values() if row.active]
            # Of what a rule says at all points, the first and the last row tell what it joins.
            for row in rows if is_beside else (*rows[:1], *rows[-1:]):
                variables = [v for side in sides_of(row) for v in variables_in(side, include_fixed=False)]
                self._unite(variables)
                if is_beside:
                    self._held.update(map(id, variables))
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
        keys = {self._key(variable) for variable in variables if not variable.fixed}
        for key in keys:
            self._groups.add(key)
            self._groups.merge(key, next(iter(keys)))

    def _key(self, variable: Any) -> Hashable:
        """The phase that a variable belongs to, or the variable itself."""
        around = (id(block) for block in enclosing_blocks(variable))
        return next((number for number in around if number in self._phases), id(variable))

    def are_one_group(self, first: Any, second: Any) -> bool:
        """Whether something joins two phases."""
        return bool(self._groups.connected(id(first), id(second)))

    def open_ends(self, phase: Any, *, first: bool) -> list[str]:
        """States that may have any value where the phase starts, or ends: not given, and in no row beside."""
        time = phase.initial_time if first else phase.final_time
        found = []
        for name in phase.record.names_of_states:
            declaration, data = phase.record.declarations[name], phase.component(name)[time]
            given = declaration.initial if first else declaration.final
            if not (isinstance(given, tuple) or data.fixed or id(data) in self._held):
                found.append(name)
        return found
