"""Variables that nothing determines, and equations of the whole model that contradict or repeat each other.

Phases that nothing joins, or not wholly: as good as several problems, of which one may be there by mistake.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain, permutations
from typing import Any

import numpy as np
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.var import Var

from pyrobocop_pyomo.complementarity import active_sources
from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.complementarity.record import records_above, records_below
from pyrobocop_pyomo.links import LinkData
from pyrobocop_pyomo.modeling.activity import enclosing_blocks, is_inside, outermost_inactive
from pyrobocop_pyomo.modeling.blocks import blocks_of_kind
from pyrobocop_pyomo.modeling.shared_nodes import variables_in, variables_in_any
from pyrobocop_pyomo.numerics import Array, Matching
from pyrobocop_pyomo.obstacles import ContainmentData, ObstacleAvoidanceBlockData
from pyrobocop_pyomo.obstacles.avoidance_record import variables_of
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases import Algebraic, PhaseBlockData, phases_of
from pyrobocop_pyomo.phases.structure import sides_of

from .findings import Finding, Severity, error_about, quoted, warning_about
from .linearised_rows import Equations, equilibrate

FREE_AN_END = "Remove an equation, or free an initial or final value."


def freedom_findings(block: Any, equations: Equations, without: str) -> Iterator[Finding]:
    """Variables that no equation and no pair is left for, in a model without an objective that could choose them.

    What a phase declares to be chosen is not counted: controls, parameters and its horizon; nor the planes that keep
    shapes apart.

    Parameters
    ----------
    block : Block
    equations : Equations
        Of the block.
    without : str
        Words that say that there is no objective.
    """
    left = _undetermined(block, equations)
    if left:
        yield warning_about(
            f"{without}, and {len(left)} variable{'s are' if len(left) > 1 else ' is'} left that no equation "
            f"determines, for example {quoted(data.name for data in left)}: the point is one of many that meet all "
            "constraints.",
            (data.parent_component().name for data in left),
            "Give them values, such as initial conditions, add the equations that are missing, or state an objective.",
        )


def excess_findings(block: Any, equations: Equations, without: str = "") -> Iterator[Finding]:
    """More equations than variables somewhere: a doubt of a model that is said to be without an objective.

    Such a model is meant to be square, and its equations may hold all the same.
    """
    over, columns = Matching(equations.incidence, range(len(equations.variables))).overdetermined
    if over:
        names = _components(equations.rows[i] for i in over)
        yield Finding(
            Severity.WARNING if without else Severity.ERROR,
            f"{without}{', and ' if without else ''}{len(over)} equations hold only {len(columns)} variables that may "
            f"move: {quoted(names)}.{_fixed_ends(block)}",
            names,
            FREE_AN_END,
        )


def _undetermined(block: Any, equations: Equations) -> list[Any]:
    """Variables that a maximum matching with equations and pairs leaves over."""
    chosen = {id(component) for component in _chosen(block)}
    # In the order of declaration. Rows take the last first, so that of a chain in time the start is left.
    variables = {
        id(data): data
        for component in block.component_objects(Var, active=True, descend_into=Block)
        if id(component) not in chosen
        for data in component.values()
        if not data.fixed
    }
    held = [[id(equations.variables[j]) for j in own] for own in equations.incidence]
    held += [list(variables_in_any(sides_of(source))) for source in stated_pairs(block)]
    read = set(chain.from_iterable(held))
    return [variables[key] for key in Matching(held, reversed(variables)).unmatched_columns[::-1] if key in read]


def stated_pairs(block: Any) -> list[Any]:
    """The component data of pairs, relaxed or not."""
    records = (*records_below(block), *records_above(block))
    relaxed = (source for record in records for source in record.statements if is_inside(source, block))
    return list({id(source): source for source in (*active_sources(block), *relaxed)}.values())


def _chosen(block: Any) -> Iterator[Any]:
    """Components whose values are there to be chosen."""
    for phase in phases_of(block):
        record = phase.record
        determined = {*record.names_of_states, *record.names(Algebraic)}
        determined |= {f"{name}_derivative" for name in record.kept_derivatives}
        yield from (var for name, var in phase.component_map(Var).items() if name not in determined)
    for avoidance in blocks_of_kind(block, (ObstacleAvoidanceBlockData, ContainmentData)):
        yield from avoidance.component_objects(Var, descend_into=True)


def dependence_findings(block: Any, equations: Equations) -> Iterator[Finding]:
    """Equations of which one follows from the others, where none is too many."""
    jacobian, residuals = equations.jacobian, equations.residuals
    if not equations.rows or not (np.isfinite(jacobian.data).all() and np.isfinite(residuals).all()):
        return
    row_factors, column_factors = equilibrate(jacobian)
    weights = left_null_vector(scipy.sparse.diags(row_factors) @ jacobian @ scipy.sparse.diags(column_factors))
    if weights is None:
        return
    heavy = np.abs(weights) > 1e-3 * np.abs(weights).max()
    concerned = [row for row, counts in zip(equations.rows, heavy, strict=True) if counts]
    residuals = row_factors * residuals
    names = _components(concerned)
    gap, largest = abs(weights @ residuals), float(np.abs(residuals).max())
    is_linear = all(row.body.polynomial_degree() in (0, 1) for row in concerned)
    if is_linear and gap > 1e-8 * max(1.0, largest):
        said = f"the equations {quoted(names)} contradict each other.{_fixed_ends(block)}"
        yield error_about(said, names, FREE_AN_END)
    else:
        said = f"at the initial guess one of the equations {quoted(names)} follows from the others."
        remedy = "Remove one of them, free an initial or final value, or start from another initial guess."
        yield warning_about(f"{said}{_fixed_ends(block)}", names, remedy)


def left_null_vector(matrix: Any) -> Array | None:
    """Unit vector ``y`` with ``y @ matrix`` as good as zero, or None where the rows are independent.

    Such a vector is the lower part of the eigenvector of an augmented matrix whose eigenvalue is zero.
    """
    count, columns = matrix.shape
    augmented = scipy.sparse.bmat([[scipy.sparse.identity(columns), matrix.T], [matrix, None]], format="csc")
    start = np.random.default_rng(0).standard_normal(count + columns)
    try:
        _, vectors = scipy.sparse.linalg.eigsh(augmented, k=1, sigma=-1e-14, v0=start)
    except RuntimeError:  # exactly singular, as the shift was lost in rounding; or no eigenvalue is near zero
        return None
    vector = vectors[columns:, 0]
    size = np.linalg.norm(vector)
    # Well above rounding, well below what a long horizon or an unstable motion leaves of independent equations.
    return vector / size if np.linalg.norm(matrix.T @ vector) < 1e-9 * size else None


def _components(rows: Any) -> tuple[str, ...]:
    return tuple(dict.fromkeys(row.parent_component().name for row in rows))


def _fixed_ends(block: Any) -> str:
    """Which states are fixed at both ends: the usual suspects."""
    found = [
        f"'{phase.name}.{name}'"
        for phase in phases_of(block)
        for name in phase.record.names_of_states
        if phase.component(name)[phase.initial_time].fixed and phase.component(name)[phase.final_time].fixed
    ]
    return f" Fixed at both ends: {', '.join(found)}." if found else ""


# -------------------------------------------------------------------------------------------- phases that nothing joins


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
        self._groups = scipy.cluster.hierarchy.DisjointSet(self._phases)
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
        keys = [self._key(variable) for variable in variables if not variable.fixed]
        for key in keys:
            self._groups.add(key)
            self._groups.merge(keys[0], key)

    def _key(self, variable: Any) -> int:
        """The phase that a variable belongs to, or the variable itself."""
        component = variable.parent_component()
        if id(component) not in self._home:
            around = (id(block) for block in enclosing_blocks(component))
            self._home[id(component)] = next((number for number in around if number in self._phases), None)
        home = self._home[id(component)]
        return id(variable) if home is None else home

    def are_one_group(self, first: Any, second: Any) -> bool:
        """Whether something joins two phases."""
        return bool(self._groups.connected(id(first), id(second)))

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
