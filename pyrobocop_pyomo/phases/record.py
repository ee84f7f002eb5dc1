"""What a phase remembers beside its Pyomo components: its grid, its declarations and the user's rules."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pyomo.core.base.expression import Expression
from pyomo.core.base.set import Any as AnyIndex
from pyomo.core.base.var import Var
from pyomo.core.expr.relational_expr import RelationalExpression

from pyrobocop_pyomo.complementarity import Complementarity, form_of
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.in_place_changes import expressions_of
from pyrobocop_pyomo.modeling.rows_by_rule import RowByRule, RowRule, SumByRule, put_arguments, sum_by_rule
from pyrobocop_pyomo.modeling.time_index import TimeIndex
from pyrobocop_pyomo.modeling.variable_families import FamilyNames, VariableFamily
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.templates.slots import Place, Slot
from pyrobocop_pyomo.templates.template import Reading, Template

from .declarations import Algebraic, Bounds, Control, Declaration, Duration, State
from .nodes import Nodes, StageNodes

# The kind of path constraints on the states at element boundaries.
AT_BOUNDARIES = "constraint at boundaries"


@dataclass(frozen=True)
class Statement:
    """One rule that the user stated, kept so that a trajectory can be verified with it.

    What the rule has said for all times is in copies and pickles of the model, too. A pickle leaves a rule behind that
    it cannot hold (a lambda, a function within a function).
    """

    kind: str
    name: str
    rule: Template

    def __call__(self, block: Any, t: Any, *more: Any) -> Any:
        """What the rule says at a time; where it is a template it is called once."""
        return self.rule(block, t, *more)

    def reads_variables_alone(self, block: Any) -> bool:
        """Whether the rule gives formulas for all times in variables over time, and calls no function in Python."""
        formulas = self.rule.formulas(block)
        return formulas is not None and formulas.reads_variables_alone

    def label(self, block: Any) -> str:
        """The phase and the rule, for messages."""
        return f"phase '{block.name}': {self.kind} '{self.name}'"

    def times(self, block: Any) -> tuple[float, ...]:
        """Where it holds: at the points of the mesh or at its boundaries."""
        grid: Grid = block.record.grid
        return grid.mesh.boundaries if self.kind == AT_BOUNDARIES else grid.points

    def rows(self, result: Any) -> dict[Hashable, Any]:
        """The rows of what the rule returned by label; of pairs their canonical forms, but for those left out."""
        found = labelled_rows(self.kind, plain_expressions(result))
        if self.kind != "complementarity":
            return found
        stated = {label: pair for label, pair in found.items() if pair is not Complementarity.Skip}
        return {label: form_of(self, a, b, (*choices, None, None)[:2]) for label, (a, b, *choices) in stated.items()}


class Stated(NamedTuple):
    """What a component held when it was stated.

    Attributes
    ----------
    parts : int
        How many it had.
    expressions : dict of index to list of expression
        Those in the parts, without parts that follow a rule: these are ordinary ones once they are set.
    """

    parts: int = 0
    expressions: Mapping[Any, list[Any]] = {}

    @classmethod
    def of(cls, component: Any) -> Stated:
        """What it holds now."""
        parts = {} if component.ctype is Var else dict(component.items())
        held = {index: expressions for index, part in parts.items() if (expressions := _stated_in(part))}
        return cls(len(parts), held)

    def with_part(self, index: Any, part: Any) -> Stated:
        """With another part, as that is now; the others as they were."""
        return Stated(self.parts + 1, {**self.expressions, index: _stated_in(part)})


def _stated_in(part: Any) -> list[Any]:
    """The expressions in a part; none of one that follows a rule."""
    is_by_rule = part.__class__ is RowByRule or sum_by_rule(part) is not None
    return [] if is_by_rule else expressions_of(part)


@dataclass
class PhaseRecord:
    """The facts behind a `PhaseBlock`; components are referred to by name, which survives clones.

    Attributes
    ----------
    grid : Grid
        In time, or in normalised time when something about it is to be found.
    duration : float or Duration
    normalised : bool
        True when start, duration or element boundaries are to be found: indices then run from 0 to 1.
    declarations : dict of name to Declaration
    families : dict of name to FamilyNames
        Vectors and matrices, whose components are declarations of their own.
    statements : list of Statement
        Every rule, in the order stated; named expressions over the points among them, which laws of this package state.
    equation_of : dict of state name to the name of the rule that gives its derivative, or its value an element later
    discrete_states : set of str
        States that a step map leads from element to element: they have no derivative.
    rates : dict of state name to mapping of collocation point to expression
        Right-hand sides that were substituted; of states that a step map leads, the values an element later.
    kept_derivatives : set of str
        States whose derivative is a variable of its own.
    made : dict of name to Stated
        The components that declarations, rules and the horizon have made, which another mesh makes anew.
    generated_rows : set of str
        Names of the constraints that tie states to their derivatives: no equations of the user's.
    control_rates : dict of control name to {collocation point: expression}
        Filled when first asked for.
    residuals_per_point : int
        Number of residual equations stated so far, per collocation point.
    allow_higher_index : bool
        True when equations may leave algebraics to hidden constraints.
    time_units : Pyomo unit or None
        Units of time; rows and integrals carry them where they are given.
    width_factors : (smallest, largest) or None
        Between which the width of each element may change, where the boundaries are variables.
    integrals : list of Statement
        Integrands of the integrals that were handed out, in the order of the members that stand for them.
    values_at_times : list of (name, time index)
        Values at fixed times that were handed out, in the order of the members that stand for them.
    named_times : set of float
        Time indices at which statements read a value, wherever the points of the mesh are.
    chosen_times : frozenset of float
        Element boundaries that were given one by one.
    delayed_names : set of str
        What rules read at earlier times than their own.
    asking : bool
        True while a statement asks its rule, which is kept: what the rule makes is made anew with it.
    restating : Restatement or None
        The change of mesh that is going on.
    outcome : (words, fingerprint) or None
        How the last solve ended, and of which values that is said.
    """

    grid: Grid
    duration: float | Duration
    normalised: bool = False
    declarations: dict[str, Declaration] = field(default_factory=dict)
    families: dict[str, FamilyNames] = field(default_factory=dict)
    statements: list[Statement] = field(default_factory=list)
    equation_of: dict[str, str] = field(default_factory=dict)
    discrete_states: set[str] = field(default_factory=set)
    rates: dict[str, Any] = field(default_factory=dict)
    kept_derivatives: set[str] = field(default_factory=set)
    made: dict[str, Stated] = field(default_factory=dict)
    generated_rows: set[str] = field(default_factory=set)
    control_rates: dict[str, Mapping[float, Any]] = field(default_factory=dict)
    residuals_per_point: int = 0
    allow_higher_index: bool = False
    time_units: Any = None
    width_factors: Bounds | None = None
    integrals: list[Statement] = field(default_factory=list)
    values_at_times: list[tuple[str, float]] = field(default_factory=list)
    named_times: set[float] = field(default_factory=set)
    chosen_times: frozenset[float] = frozenset()
    delayed_names: set[str] = field(default_factory=set)
    asking: bool = False
    restating: Any = None
    outcome: tuple[str, int] | None = None

    @property
    def free_widths(self) -> bool:
        """Whether the element boundaries are variables."""
        return self.width_factors is not None

    def names(self, kind: type[Declaration]) -> list[str]:
        """Names of all declarations of a kind, in the order of declaration."""
        return [name for name, declaration in self.declarations.items() if isinstance(declaration, kind)]

    def statements_of(self, kind: str) -> list[Statement]:
        """All rules of a kind, in the order stated."""
        return [statement for statement in self.statements if statement.kind == kind]

    @property
    def names_of_states(self) -> list[str]:
        """Names of all states, in the order of declaration."""
        return self.names(State)

    @property
    def names_of_signals(self) -> list[str]:
        """Names of all algebraics and controls, which have values at the collocation points."""
        return [*self.names(Algebraic), *self.names(Control)]

    def nodes(self, name: str) -> Nodes:
        """Where the values of a state, algebraic, control or kept derivative live."""
        if name.removesuffix("_derivative") in self.kept_derivatives and name not in self.declarations:
            return StageNodes(name, self.grid)
        return self.declarations[name].nodes(name, self.grid, f"'{name}'")

    def index_for_rule(self, block: Any, time: float, label: str) -> float | TimeIndex:
        """The ``t`` that a rule is given at a point: an expression in formulas where indices are no times."""
        return TimeIndex(time, label, block) if self.normalised else time

    @property
    def rules(self) -> list[Statement]:
        """Every rule, and every integrand."""
        return [*self.statements, *self.integrals]


def place(block: Any, name: str, component: Any) -> Any:
    """Add a component to a phase block; where the phase gets another mesh, make the one that stands there like it.

    Returns
    -------
    component
        The one on the block.
    """
    block.record.made[name] = Stated()
    if block.record.restating is not None:
        return block.record.restating.place(name, component)
    block.add_component(name, component)
    return component


def note_stated(block: Any, names: Iterable[str]) -> None:
    """Remember what components hold, so that it is seen when the user changes them."""
    for name in names:
        if (component := block.component(name)) is not None:
            block.record.made[name] = Stated.of(component)


def add_generated(block: Any, name: str, component: Any) -> Any:
    """Add what is named after a declaration, not by the user; returns the component on the block.

    Raises
    ------
    ModelError
        When the name is taken.
    """
    if block.record.restating is None and hasattr(block, name):
        raise ModelError(
            f"phase '{block.name}': the name '{name}' is needed for what is generated, but it is taken. "
            "Choose another name for yours."
        )
    return place(block, name, component)


def hand_out(block: Any, name: str, entries: list[Any], entry: Any, expression: Any) -> Any:
    """A member of a named expression, for components of the user's: it is another expression on another mesh.

    Parameters
    ----------
    block : PhaseBlock
    name : str
        Of the named expression.
    entries : list
        Of the record: what each member stands for. This one is added.
    entry : object
    expression : expression or RowRule
        On the grid that the phase has now, or what says it when it is read.
    """
    if block.component(name) is None:
        add_generated(block, name, Expression(AnyIndex))
    entries.append(entry)
    members = block.component(name)
    if isinstance(expression, RowRule):
        members[len(entries)] = 0.0
        put_arguments(members[len(entries)], SumByRule(expression, members[len(entries)]))
    else:
        members[len(entries)] = expression
    # What the user has changed of the others stays a change.
    block.record.made[name] = block.record.made[name].with_part(len(entries), members[len(entries)])
    return members[len(entries)]


class PreviousStates:
    """The states where an element starts, by name: ``previous.x``. A step map gets them as its third argument.

    Parameters
    ----------
    what : str
        Phase and rule, for messages.
    values : mapping of state name to variable or number
    families : mapping of name to FamilyNames, optional
        Vectors and matrices of the phase, which are read as arrays.
    """

    def __init__(self, label: str, values: Mapping[str, Any], families: Mapping[str, FamilyNames]) -> None:
        self._what, self._values, self._families = label, values, families

    def template(self, position: int) -> PreviousStates:
        """What stands for it while a rule gives its template."""
        names = {name: Reading(Previous(None, (position, name))) for name in self._values}
        return PreviousStates(self._what, names, self._families)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._families:
            return VariableFamily(self, self._families[name]).array_of(lambda member: member)
        if name not in self._values:
            raise ModelError(
                f"{self._what} reads previous.{name}; only states have a value where an element starts; those of the "
                f"phase are {', '.join(self._values) or 'none'}."
            )
        return self._values[name]


class Previous(Slot):
    """``previous.x``: a state where the element starts; `rest` is the position of the argument and the name."""

    def on_model(self, place: Place) -> Any:
        """That of the argument."""
        position, name = self.rest
        return getattr(place.more[position], name)  # type: ignore[call-overload]


def labelled_rows(kind: str, result: Any) -> dict[Hashable, Any]:
    """The rows of a rule result by label; the label is None where there is just one.

    Parameters
    ----------
    kind : {"residual", "constraint", "constraint at boundaries", "complementarity"}
        What the rule states. It decides what a tuple is: one pair in a complementarity, Pyomo's
        ``(lower, body, upper)`` in a constraint unless relations stand in it, and otherwise several rows.
    result : object
        What the rule returned.
    """
    if isinstance(result, Mapping):
        return dict(result)
    if isinstance(result, list) or (isinstance(result, tuple) and not _is_one_row(kind, result)):
        return dict(enumerate(result))
    return {None: result}


def _is_one_row(kind: str, result: tuple[Any, ...]) -> bool:
    if kind in ("constraint", AT_BOUNDARIES):
        return not any(isinstance(entry, (RelationalExpression, tuple)) for entry in result)
    return kind == "complementarity"
