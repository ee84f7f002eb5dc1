"""`Link`: the end of one phase joined to the start of another, as an ordinary Pyomo block of constraints.

What a link joins: ends of phases, states that continue, and states that jump.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from pyomo.core.base.component import ModelComponentFactory
from pyomo.core.base.componentuid import ComponentUID
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.set import Set
from pyomo.core.expr.numvalue import native_numeric_types, value
from pyomo.core.expr.relational_expr import EqualityExpression, RelationalExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.blocks import BuiltBlock, BuiltBlockData, Rule
from pyrobocop_pyomo.modeling.expression_arrays import plain_expressions
from pyrobocop_pyomo.modeling.row_violations import largest_violation
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.variable_families import VariableFamily
from pyrobocop_pyomo.phases import Algebraic, Control, Parameter, PhaseBlock, PhaseBlockData
from pyrobocop_pyomo.phases.families import equations_by_component, name_of, names_by_component
from pyrobocop_pyomo.phases.record import labelled_rows
from pyrobocop_pyomo.trajectories import Trajectory

from .linked_initial_states import solve_start

# ---------------------------------------------------------------------------------------------------- what a link joins


class PhaseEnd:
    """What a phase declares, at its start or at its end, as attributes.

    A state is its variable there, a parameter its variable. An algebraic or control is the value of its polynomial,
    which a scheme without a point at that end extrapolates from its first or last element; a piecewise linear one has
    a knot there. Other components of the phase are handed over too, those indexed by time at that time.

    Parameters
    ----------
    phase : PhaseBlock
    last : bool
        True for the end, False for the start.
    """

    def __init__(self, phase: Any, last: bool) -> None:
        self._phase = phase
        self._last = last
        self._read: set[str] = set()

    @property
    def _index(self) -> float:
        return self._phase.final_time if self._last else self._phase.initial_time

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        declared, families = self._phase.record.declarations, self._phase.record.families
        if name in families:
            return VariableFamily(self, families[name]).array_of(lambda member: member)
        component = self._phase.component(name)
        if component is None:
            raise ModelError(
                f"phase '{self._phase.name}' has no '{name}', which a link asks for at its "
                f"{'end' if self._last else 'start'}; declared are {', '.join(declared) or 'none'}."
            )
        self._read.add(name)
        if isinstance(declared.get(name), (Algebraic, Control)):
            return component.at(self._index)  # it follows the mesh
        return component[self._index] if component.is_indexed() and self._index in component else component


def states_of_both(label: str, first: Any, second: Any, given: set[str], read: set[str]) -> dict[str, str]:
    """{state of the second: state of the first} for all common names that nothing else determines.

    Parameters
    ----------
    label : str
        The link, for messages.
    first, second : PhaseBlock
    given : set of str
        States to leave alone: those whose start a jump gives, and those that are omitted.
    read : set of str
        What a jump reads at the end of the first.

    Raises
    ------
    ModelError
        When a state is left over.
    """
    before, after = first.record.names_of_states, second.record.names_of_states
    continued = {name: name for name in after if name in before and name not in given}
    for name in after:
        start = second.component(name)[second.initial_time]
        if name not in continued and name not in given and not start.fixed:
            raise ModelError(
                f"{label}: nothing gives the start of state '{name}'; '{first.name}' has the states "
                f"{', '.join(before) or 'none'}. Give '{name}' in jump=, or leave it alone by omit=['{name}']."
            )
    for name in before:
        if name not in continued and name not in given | read:
            raise ModelError(
                f"{label}: state '{name}' of '{first.name}' goes nowhere; '{second.name}' has the states "
                f"{', '.join(after) or 'none'}. Use it in jump=, or leave it alone by omit=['{name}']."
            )
    return continued


def states_given(label: str, first: Any, second: Any, states: Any, determined: set[str]) -> dict[str, str]:
    """{state of the second: state of the first} for the user's own list or mapping.

    Raises
    ------
    ModelError
        When a name is no state, or a start is given twice.
    """
    sources = states if isinstance(states, Mapping) else names_by_component(first.record, listed(states))
    continued: dict[str, str] = {}
    for source in sources:
        target = states[source] if isinstance(states, Mapping) else source
        before, after = _state_name(label, first, name_of(source)), _state_name(label, second, name_of(target))
        if after in determined | set(continued):
            raise ModelError(f"{label}: the start of state '{after}' is given twice. Take it out of states=.")
        continued[after] = before
    return continued


def omitted_states(label: str, first: Any, second: Any, omit: Any) -> set[str]:
    """Names of the states to leave alone.

    Raises
    ------
    ModelError
        When a name is a state of neither phase.
    """
    named = names_by_component(second.record, names_by_component(first.record, listed(omit)))
    names = {name_of(state) for state in named}
    known = {*first.record.names_of_states, *second.record.names_of_states}
    for name in names - known:
        raise ModelError(f"{label}: omit= names '{name}', which is a state of neither phase.")
    return names


def listed(names: Any) -> list[Any]:
    """Several names, or one alone, as a list."""
    return [names] if isinstance(names, str) else list(names)


def _state_name(label: str, phase: Any, state: Any) -> str:
    try:
        return phase.state_name(state)
    except ModelError as error:
        raise ModelError(f"{label}: {error}") from None


def jump_of(
    where: str, second: Any, pre: PhaseEnd, post: PhaseEnd, jump: Callable[..., Any] | None
) -> tuple[dict[str, Any], dict[Any, Any], set[str]]:
    """Ask the rule: expressions by state, relations by label, and the states whose start these give.

    Raises
    ------
    ModelError
        When the result is neither, or names what is no state of the second phase.
    """
    expressions: dict[str, Any] = {}
    relations: dict[Any, Any] = {}
    if jump is None:
        return expressions, relations, set()
    try:
        result = jump(pre, post)
    except TypeError as error:
        if "unhashable" not in str(error):
            raise
        raise ModelError(
            f"{where}: a variable cannot be the key of a dict. Write {{'speed': ...}}, the name of the state, "
            "or the relation post.speed == ..."
        ) from error
    if isinstance(result, Mapping):
        for state, expression in plain_expressions(equations_by_component(second.record, result, where)).items():
            name = _state_name(f"{where}, its jump", second, state)
            numeric = expression.__class__ in native_numeric_types or hasattr(expression, "is_numeric_type")
            if isinstance(expression, RelationalExpression) or not numeric:
                raise ModelError(
                    f"{where}: the jump gives '{expression}' as the start of '{name}'; expected an expression."
                )
            if name in expressions:
                raise ModelError(f"{where}: the jump gives the start of '{name}' twice.")
            expressions[name] = expression
        return expressions, relations, set(expressions)
    seen: set[int] = set()
    for label, relation in labelled_rows("constraint", plain_expressions(result)).items():
        if not isinstance(relation, (RelationalExpression, tuple)):
            raise ModelError(
                f"{where}: the jump returned {relation!r}; expected {{state: expression}}, or one or several relations "
                "between pre and post. Is the return statement missing?"
            )
        relations[0 if label is None else label] = relation
        if isinstance(relation, EqualityExpression):
            seen |= {id(variable) for variable in variables_in(relation, include_fixed=True)}
    names = second.record.names_of_states
    return expressions, relations, {n for n in names if id(second.component(n)[second.initial_time]) in seen}


# ---------------------------------------------------------------------------------------------------------------- links


class _Ends(NamedTuple):
    """The two phases of a link, in a holder, since a block would adopt a component that is assigned to it.

    Attributes
    ----------
    first, second : PhaseBlock
    omitted : set of str
        States to leave alone.
    """

    first: Any
    second: Any
    omitted: set[str]


class LinkData(BuiltBlockData):
    """One link; see `Link` for how to make one.

    Attributes
    ----------
    continuity : Constraint
        One row per state that continues, by its name in the second phase.
    jump : Constraint
        One row per state, or relation, that the jump gives.
    shared : Constraint
        One row per shared parameter.
    """

    _kind = "link"
    _error = ModelError

    @property
    def first(self) -> Any:
        """The phase whose end is joined."""
        return self._record_if_built().first

    @property
    def second(self) -> Any:
        """The phase whose start is joined."""
        return self._record_if_built().second

    @property
    def pre(self) -> PhaseEnd:
        """The end of the first phase, by name, for equations of the user's own."""
        return PhaseEnd(self.first, last=True)

    @property
    def post(self) -> PhaseEnd:
        """The start of the second phase, by name."""
        return PhaseEnd(self.second, last=False)

    @property
    def violation(self) -> float:
        """Largest violation of a row of this link at the current values; NaN where a variable has none."""
        return largest_violation(self.component_data_objects(Constraint, active=True))

    @property
    def starts_asked_for(self) -> list[str]:
        """States of the second phase whose start this link, or something beside it, has to give."""
        if not (self.continuity or self.jump):
            return []
        return [name for name in self.second.record.names_of_states if name not in self._record.omitted]

    def start_after(self, trajectory: Trajectory) -> dict[str, float]:
        """Where the second phase starts after a motion of the first: what `simulate` takes as ``initial``.

        Parameters
        ----------
        trajectory : Trajectory
            Of the first phase.

        Returns
        -------
        dict of state name to number
            The states that this link gives.

        Raises
        ------
        ModelError
            When its relations do not determine them.
        """
        rows = [row for row in (*self.continuity.values(), *self.jump.values()) if row.equality]
        read = {id(variable) for row in rows for variable in variables_in(row.body, include_fixed=True)}
        starts = {name: getattr(self.post, name) for name in self.second.record.names_of_states}
        starts = {name: variable for name, variable in starts.items() if id(variable) in read}
        found = solve_start(self._what, self.second, rows, starts.values(), [(self.first, trajectory)])
        return dict(zip(starts, found, strict=True))

    @property
    def _what(self) -> str:
        return f"{super()._what} from '{self.first.name}' to '{self.second.name}'" if self.is_built else super()._what

    def _build(self, phases: Any, *, states: Any, omit: list[Any], jump: Rule | None, parameters: list[Any]) -> None:
        first, second = _two_phases(self, self._phases_of(phases))
        self._record = _Ends(first, second, set())
        where, pre, post = self._what, self.pre, self.post
        expressions, relations, determined = jump_of(where, second, pre, post, jump)
        if states is None:
            omitted = omitted_states(where, first, second, omit)
            self._record = _Ends(first, second, omitted)
            continued = states_of_both(where, first, second, determined | omitted, pre._read)
        elif omit:
            raise ModelError(f"{where}: states= says what continues, omit= what does not. Give one of them.")
        else:
            continued = states_given(where, first, second, states, determined)
        shared = [self._shared_parameter(name_of(parameter)) for parameter in parameters]
        self.continuity = Constraint(list(continued))
        self.jump = Constraint([*expressions, *relations])
        self.shared = Constraint(shared)
        for name, source in continued.items():
            self._add(self.continuity, name, getattr(pre, source), getattr(post, name))
        for name, expression in expressions.items():
            self._add(self.jump, name, expression, getattr(post, name))
        for label, relation in relations.items():
            self.jump.add(label, relation)
        for name in shared:
            self._add(self.shared, name, getattr(pre, name), getattr(post, name))

    def _shared_parameter(self, name: str) -> str:
        for phase in (self.first, self.second):
            known = phase.record.names(Parameter)
            if name not in known:
                raise ModelError(
                    f"{self._what}: '{name}' is no parameter of '{phase.name}'; its parameters are "
                    f"{', '.join(known) or 'none'}."
                )
        return name

    def _phases_of(self, source: Any) -> Any:
        """The two phases of this link: two neighbours of an indexed block, the result of a rule, or as given."""
        component = self.parent_component()
        if isinstance(source, PhaseBlock) and source.is_indexed():
            order = list(source)
            return source[order[order.index(self.index()) - 1]], source[self.index()]
        if isinstance(source, tuple):
            return source
        index = self.index() if component.is_indexed() else ()
        return source(component.parent_block(), *(index if isinstance(index, tuple) else (index,)))

    def _add(self, rows: Any, name: str, before: Any, after: Any) -> None:
        row = rows.add(name, before - after == 0)
        # Where nothing is left to choose, a solver would only say that the problem has too few variables.
        if after.fixed and row.body.is_fixed() and abs(value(row.body)) > 1e-8 * max(1.0, abs(after.value)):
            raise ModelError(
                f"{self._what}: '{before}' has the fixed value {value(before):g}, but '{after.name}' is fixed at "
                f"{after.value:g}. Leave one of them free, or state how '{name}' jumps."
            )


def _two_phases(link: LinkData, given: Any) -> tuple[PhaseBlockData, PhaseBlockData]:
    """The two phases, checked.

    Raises
    ------
    ModelError
        When they are not two single phases of the model that the link is on.
    """
    where = f"link '{link.name}'"
    if not (isinstance(given, tuple) and len(given) == 2):
        raise ModelError(f"{where}: expected two phases (first, second), found {given!r}.")
    for phase in given:
        if isinstance(phase, PhaseBlock) and phase.is_indexed():
            raise ModelError(f"{where}: '{phase.name}' is indexed; give one of its phases, such as {phase.name}[1].")
        if not isinstance(phase, PhaseBlockData):
            raise ModelError(f"{where}: {getattr(phase, 'name', repr(phase))!r} is no PhaseBlock.")
        if phase.model() is not link.model():
            raise ModelError(
                f"{where}: phase '{phase.name}' belongs to the model '{phase.model().name}', the link to "
                f"'{link.model().name}'. Add both to one model."
            )
    return given


@ModelComponentFactory.register("The end of one phase joined to the start of another.")
class Link(BuiltBlock, data=LinkData):
    """The end of one phase joined to the start of another: states continue, or jump.

    Parameters
    ----------
    *args
        Two phases, ``Link(m.flight, m.stance)``; the same phase twice makes a periodic motion. Or one indexed
        `PhaseBlock`: each of its phases is joined to the next, and the links are indexed by the later one. Or index
        sets, together with ``phases``.
    phases : callable, optional
        ``phases(model, *index)`` returns the two phases of an indexed link.
    states : list or mapping of states, optional
        What continues: states of both phases, or {state of the first: state of the second}. By default all states
        that both phases have and that no jump gives; a state that is then left over is an error.
    omit : list of states, optional
        States to leave alone: a distance travelled in a periodic motion, a state that ends with its phase.
    jump : callable, optional
        ``jump(pre, post)`` with a `PhaseEnd` each returns {name of a state: its start in the second phase, an
        expression of ``pre``}, or one or several relations between both. A state whose start stands in an equality
        does not continue by itself.
    parameters : list of Parameter, optional
        Parameters that have the same value in both phases.
    rule : callable, optional
        ``rule(link, *index)`` adds whatever else, by ``link.pre`` and ``link.post``.

    Raises
    ------
    ModelError
        When the phases cannot be joined so; the link is then not added to the model.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import pyrobocop_pyomo as rcp
    >>> m = pyo.ConcreteModel()
    >>> m.bounces = rcp.PhaseBlock([1, 2, 3], duration=rcp.Duration(bounds=(0.1, 2)), elements=1)
    >>> for b in m.bounces.values():
    ...     b.height, b.speed = rcp.State(final=0), rcp.State()
    ...     _ = b.ode(lambda b, t: {b.height: b.speed[t], b.speed: -9.81})
    >>> m.impacts = rcp.Link(m.bounces, jump=lambda pre, post: {"speed": -0.8 * pre.speed})
    >>> print(m.impacts[2].jump["speed"].body)
    -0.8*bounces[1].speed[1.0] - bounces[2].speed[0.0]
    """

    def __init__(
        self,
        *args: Any,
        phases: Any = None,
        states: Any = None,
        omit: Iterable[Any] = (),
        jump: Rule | None = None,
        parameters: Iterable[Any] = (),
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        sets, joined = _sort_arguments(args, phases)
        options = {"states": states, "omit": listed(omit), "jump": jump, "parameters": listed(parameters)}
        super().__init__(*sets, arguments=(joined,), options=options, rule=rule, **block_options)

    @classmethod
    def _is_scalar(cls, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> bool:
        return super()._is_scalar(args, keywords) or not _sort_arguments(args, keywords.get("phases"))[0]


class _LaterPhases:
    """The indices of all phases of a block but the first, asked when an AbstractModel gets its data."""

    def __init__(self, phases: ComponentUID) -> None:
        self._phases = phases

    def __call__(self, block: Any) -> list[Any]:
        return list(self._phases.find_component_on(block.model()))[1:]


def _sort_arguments(args: tuple[Any, ...], phases: Any) -> tuple[tuple[Any, ...], Any]:
    """Index sets, and what gives the phases: two of them, an indexed block, or a rule."""
    if args and isinstance(args[0], (PhaseBlock, PhaseBlockData)):
        if phases is not None:
            raise ModelError("a Link takes two phases, or index sets and phases=; it was given both.")
        if len(args) == 1 and isinstance(args[0], PhaseBlock) and args[0].is_indexed():
            # Of an AbstractModel: its phases are known with the data.
            if not args[0].is_constructed() and args[0].parent_block() is not None:
                return (Set(initialize=_LaterPhases(ComponentUID(args[0])), ordered=True),), args[0]
            order = list(args[0])
            if len(order) < 2:
                raise ModelError(f"'{args[0].name}' has {len(order)} phases; a Link takes two or more.")
            return (order[1:],), args[0]
        return (), args
    if not callable(phases):
        raise ModelError(
            "a Link takes two phases: Link(m.flight, m.stance). An indexed one takes index sets and "
            "phases=rule, which returns two phases for each index."
        )
    return args, phases
