"""What equations and pairs determine at an instant, and which of it the motion of a phase depends on.

States and controls are given at an instant. Derivatives that no ode states, and algebraics, are to be found: rows and
pairs are matched with them, and what is left over determines controls. A row that is left over even so, of states
alone as a rule, asks something of the motion and is no equation for it, unless as many unknowns are without one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.repn import generate_standard_repn

from pyrobocop_pyomo.complementarity import CanonicalForm, Complementarity
from pyrobocop_pyomo.errors import TrajectoryError
from pyrobocop_pyomo.modeling.failures import failures_as
from pyrobocop_pyomo.modeling.rows_by_rule import is_equality
from pyrobocop_pyomo.modeling.shared_nodes import NodeReplacement, variables_in, variables_in_any
from pyrobocop_pyomo.numerics import Matching

from .declarations import Algebraic, Control
from .record import PhaseRecord, Statement
from .rule_formulas import RuleFormulas
from .step_equations import PairStatement, as_tuple, labelled, statements_of, zero_of


@dataclass(frozen=True, eq=False)
class _Equation:
    """A row, as an expression that is zero, or a pair, with the names of the unknowns, controls and states in it."""

    name: str
    row: Any
    pair: PairStatement | None
    reads: frozenset[str]


class InstantEquations:
    """The equations that decide the motion of a phase, as formulas that hold at all times; see `known_equations`.

    Attributes
    ----------
    rates : list of expressions
        Derivatives of all states, in the order of declaration.
    unknowns : dict of name to VarData
        What rows and pairs determine and the motion depends on, with what stands for it in the formulas: algebraics,
        controls, and derivatives as ``"d x"``.
    rows : list of expressions
        Zero where they hold.
    pairs : list of PairStatement
        Together with the rows as many as there are unknowns.
    read : set of str
        What the motion depends on at an instant.
    is_hidden : bool
        Whether unknowns follow from rows by differentiation alone.
    statements : list of Statement
        Where all of this is stated.
    """

    def __init__(self, formulas: RuleFormulas, *, all_given: bool) -> None:
        block, record = formulas.block, formulas.record
        self._phase, self._formulas = f"phase '{block.name}'", formulas
        names = record.names_of_states
        explicit = [name for name in names if name in record.equation_of]
        # What is fixed is given, as controls are.
        fixed = {name for name in record.names(Algebraic) if all(v.fixed for v in record.nodes(name).variables(block))}
        self._controls = frozenset(record.names(Control)) | fixed
        slopes = {f"d {name}": formulas.derivative(name) for name in names if name not in record.equation_of}
        variables = {**slopes, **formulas.at_instant}
        self._names = {id(variable): name for name, variable in variables.items()}
        stated = dict(zip(explicit, formulas.rates_of(explicit), strict=True))
        self._explicit = {id(formulas.derivative(name)) for name in explicit}
        self._replaced = NodeReplacement({id(formulas.derivative(name)): rate for name, rate in stated.items()})
        rates = {name: self._replaced.of(rate) for name, rate in stated.items()}
        self.rates = [rates[name] if name in rates else slopes[f"d {name}"] for name in names]
        read = self._reads(self.rates)
        self.statements = record.statements_of("ode")
        statements = [] if all_given else self._stated()
        found = [each for statement, labels in statements for each in self._equations_of(statement, labels)]
        found.sort(key=lambda equation: equation.pair is not None)
        algebraics = [name for name in record.names(Algebraic) if name not in fixed and not all_given]
        unknown, equations, self.is_hidden = self._select(found, frozenset(slopes), algebraics, read)
        self.read = read.union(*(equation.reads for equation in equations))
        self.unknowns = {name: variables[name] for name in unknown}
        self.rows = [equation.row for equation in equations if equation.pair is None]
        self.pairs = [equation.pair for equation in equations if equation.pair is not None]

    @property
    def needs_steps(self) -> bool:
        """Whether an instant alone does not tell the unknowns: contacts and hidden conditions depend on what was."""
        return bool(self.pairs) or self.is_hidden

    def _reads(self, expressions: Iterable[Any]) -> frozenset[str]:
        """Names of what formulas hold."""
        held = variables_in_any(expressions)
        if held.keys() & self._explicit:
            raise TrajectoryError(f"{self._phase}: an ode reads a derivative that another ode states.")
        return frozenset(self._names[key] for key in held if key in self._names)

    def _stated(self) -> Iterator[tuple[Statement, set[tuple[Any, ...]]]]:
        """Statements of equalities and pairs, with the labels of those that hold at more instants than the ends."""
        block = self._formulas.block
        enough = min(3, len(block.record.grid.points))
        for statement in block.record.statements:
            component = block.component(statement.name)
            if component is None or statement.kind not in ("residual", "constraint", "complementarity"):
                continue
            counts: Counter[tuple[Any, ...]] = Counter()
            for index, data in component.items():
                label = as_tuple(index)[1:]
                if counts[label] < enough and data.active and (data.ctype is not Constraint or is_equality(data)):
                    counts[label] += 1
            labels = {label for label, count in counts.items() if count == enough}
            if labels:
                self.statements.append(statement)
                yield statement, labels

    def _equations_of(self, statement: Statement, labels: Container[Any]) -> Iterator[_Equation]:
        """Rows and pairs with some labels that a statement says at any time."""
        for label, said in self._formulas.formulas_of(statement, statement.rows).items():
            if as_tuple(label) not in labels:
                continue
            is_pair = isinstance(said, CanonicalForm)
            rows, pairs = statements_of(labelled(statement.name, label), said) if is_pair else ([zero_of(said)], [])
            for row in map(self._replaced.of, rows):
                yield _Equation(statement.name, row, None, self._reads([row]))
            for stated in pairs:
                pair = replace(stated, body=self._replaced.of(stated.body), other=self._replaced.of(stated.other))
                yield _Equation(statement.name, None, pair, self._reads([pair.body, pair.other]))

    def _select(
        self, stated: list[_Equation], slopes: frozenset[str], algebraics: list[str], read: frozenset[str]
    ) -> tuple[list[str], list[_Equation], bool]:
        """Unknowns that the motion depends on, and the equations that determine them; whether some are hidden."""
        equations = [equation for equation in stated if not self._only_ties_controls(equation)]
        columns, reads = [*sorted(slopes), *algebraics], [equation.reads for equation in equations]
        for asks in (self._lone_control, self._controls_of_row):
            over = [equations[row] for row in Matching(reads, columns).overdetermined[0]]
            columns += sorted({name for equation in over for name in asks(equation)} - set(columns))
        matching = Matching(reads, columns)
        depends = {*slopes, *read}
        waiting = [name for name in columns if name in depends]
        for name in waiting:
            row = matching.row_of.get(name)
            depends |= (more := frozenset() if row is None else equations[row].reads - depends)
            waiting += [other for other in columns if other in more]
        lacking = matching.unmatched_columns
        left = [equations[row] for row in matching.unmatched_rows]
        spare = [of for of in left if of.pair is None and not of.reads & {*columns, *self._controls}]
        if lacking and len(lacking) == len(spare):
            return columns, [of for of in equations if of not in left or of in spare], True
        # An algebraic that stands in no equation is a choice; a derivative is none.
        held = slopes.union(*(equation.reads for equation in equations))
        short = depends & held & {*matching.underdetermined[1]}
        if short:
            rows = {equations[row].name for row in matching.underdetermined[0]}
            raise TrajectoryError(
                f"{self._phase}: the motion depends on {_listed(short)}, of which {_listed(rows) or 'nothing'} can "
                "determine only some. Declare as Control what is chosen, and as Algebraic what follows from it."
            )
        tied = {name for of in left if of.pair is not None for name in of.reads & self._controls & depends}
        if tied:
            raise TrajectoryError(
                f"{self._phase}: pairs say something of {_listed(tied)}, and not what is determined by them. Declare "
                "as Algebraic what contact decides."
            )
        found = [name for name in waiting if name in matching.row_of]
        return found, [equations[matching.row_of[name]] for name in found], False

    def _only_ties_controls(self, equation: _Equation) -> bool:
        """Whether controls alone stand in it, so that what holds at the points holds between them, or is a choice."""
        if not equation.reads <= self._controls:
            return False
        return equation.pair is not None or generate_standard_repn(equation.row, compute_values=False).is_linear()

    def _lone_control(self, equation: _Equation) -> frozenset[str]:
        """The control that a pair decides: that which is a side by itself, or the only one that it reads."""
        if equation.pair is None:
            return frozenset()
        sides = {self._names.get(id(side)) for side in (equation.pair.body, equation.pair.other)}
        read = equation.reads & self._controls
        found = read & sides or read
        return found if len(found) == 1 else frozenset()

    def _controls_of_row(self, equation: _Equation) -> frozenset[str]:
        return equation.reads & self._controls if equation.pair is None else frozenset()


def known_equations(formulas: RuleFormulas, *, all_given: bool = False) -> InstantEquations:
    """The equations of a phase.

    Parameters
    ----------
    formulas : RuleFormulas
    all_given : bool
        Whether nothing but states is to be found; by default what the motion depends on is, by the equations that
        determine it.

    Raises
    ------
    TrajectoryError
        When a rule gives no formula, or does not hold at all points, or something that the motion depends on is not
        determined.
    """
    with failures_as(TrajectoryError, f"phase '{formulas.block.name}': its equations are no formulas"):
        return InstantEquations(formulas, all_given=all_given)


def refuse_equations_beside(block: Any, read: Iterable[str]) -> None:
    """Refuse rows over the points that were not stated through the phase: nobody knows what they say in between.

    Parameters
    ----------
    block : PhaseBlock
    read : iterable of str
        What the motion depends on.

    Raises
    ------
    TrajectoryError
        Naming the rows, and what they may determine.
    """
    record: PhaseRecord = block.record
    wanted = {*record.names(Algebraic), *read} - set(record.names_of_states)
    own = {statement.name for statement in record.statements} | record.generated_rows
    for component in block.model().component_objects((Constraint, Complementarity), active=True, descend_into=Block):
        stated = component.parent_block() is block and component.local_name in own
        if stated or len(component) < len(record.grid.points):
            continue
        data = next(iter(component.values()))
        sides = data.args if component.ctype is Complementarity else [data.body] if data.equality else []
        homes = [(of.parent_block(), of.parent_component().local_name) for of in chain(*map(variables_in, sides))]
        held = {name for _, name in homes} & wanted
        if held and all(home is block for home, _ in homes):
            raise TrajectoryError(
                f"phase '{block.name}': '{component.name}' may determine {_listed(held)}, and is not stated through "
                "the phase, so that nobody knows what it says between the points. State it by the phase."
            )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in sorted(names))
