"""`Template`: a rule ``rule(block, t)`` that is called once, for all times, and answers everywhere.

The rule gets a template of the time in place of ``t``, as Pyomo's own templates do: ``b.x[t]`` becomes an item of the
template, however the rule gets hold of ``b.x``. What it returns is compiled to a function of what it reads. Its answer
at a point of the grid, with proxies of the model or in placeholders is that function of what stands there.

A rule that has to know the time, because it compares it, looks it up or computes with its value, is no template. It is
called at every point.

What a rule has said for all times is kept: on another mesh, and in a copy of the model, it is not called again, since
what surrounds it (the variable of a loop, a number of the module) may have changed.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields, is_dataclass
from types import CellType, CodeType, FunctionType
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from pyomo.common.errors import TemplateExpressionError
from pyomo.core.base.expression import Expression
from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.base.initializer import IndexedCallInitializer
from pyomo.core.base.var import ScalarVar, Var
from pyomo.core.expr import Expr_if, inequality, numvalue
from pyomo.core.expr import numeric_expr as functions_of_pyomo
from pyomo.core.expr.template_expr import GetItemExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, array, plain_entry
from pyrobocop_pyomo.modeling.expression_nodes import (
    CALL,
    LEAF,
    NAMED,
    NUMPY_NAMES,
    RELATION,
    comparison_name,
    comparisons,
    kind_of_node,
)
from pyrobocop_pyomo.modeling.expression_steps import ExpressionSteps
from pyrobocop_pyomo.modeling.expressions import same_expression
from pyrobocop_pyomo.modeling.pickling import picklable_or_none
from pyrobocop_pyomo.modeling.pyomo_internals import stated_rule
from pyrobocop_pyomo.modeling.time_index import TimeIndex

from .slots import Always, Item, NamedItem, Place, Slot, Time, is_on_indices

_IS_ASKING: ContextVar[bool] = ContextVar("a rule gives its template", default=False)

# What functions and relations of Pyomo mean where expressions are made of expressions.
_EXPRESSIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(functions_of_pyomo, name, abs) for name in NUMPY_NAMES},
    **comparisons(lambda first, second: None),
    "<=<=": inequality,
    # In rows, the side that the time decides.
    "choose": lambda condition, then, otherwise: (
        (then if condition else otherwise) if condition.__class__ is bool else Expr_if(condition, then, otherwise)
    ),
    "call": lambda output, *arguments: (
        output.evaluate(arguments)
        if all(argument.__class__ in numvalue.native_numeric_types for argument in arguments)
        else functions_of_pyomo.ExternalFunctionExpression(arguments, output)
    ),
}


def is_asked_for_all_times() -> bool:
    """Whether a rule is called for its template now."""
    return _IS_ASKING.get()


@contextmanager
def asked_for_all_times() -> Iterator[None]:
    """Context in which a rule may be called with a `TimeTemplate`."""
    token = _IS_ASKING.set(True)
    try:
        yield
    finally:
        _IS_ASKING.reset(token)


class _Unknown(ScalarVar):
    """A variable of a template: it has no value, which Pyomo takes for a template of an index."""

    def __call__(self, exception: bool = True) -> Any:
        """Refused."""
        raise TemplateExpressionError(self, "the rule has to know a number")

    value = lb = ub = property(__call__)


class TimeTemplate(_Unknown):
    """Stands for all times while a rule gives its template; it has no value, no text, and is no key of a dictionary."""

    __hash__ = None  # type: ignore[assignment]

    def __deepcopy__(self, memo: dict[int, Any]) -> TimeTemplate:
        return self

    def __str__(self) -> str:
        if is_asked_for_all_times():
            raise TemplateExpressionError(self, "the rule has to know the time as a number")
        return "t"

    def __format__(self, how: str) -> str:
        return str(self)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy's functions of the time are formulas, as Pyomo's are."""
        return getattr(ufunc, method)(*(ArrayEntry(each) if each is self else each for each in inputs), **options)


class PointBetween(TimeTemplate):
    """Stands for all points that a continuous set gets: they lie between those that it has, and are none of them.

    Parameters
    ----------
    points : tuple of float
        Those that it has, in their order.
    """

    __hash__ = None

    def __init__(self, points: tuple[float, ...]) -> None:
        super().__init__()
        self._points = points

    def __eq__(self, other: Any) -> Any:
        if other.__class__ in numvalue.native_numeric_types and other in self._points:
            return False
        return super().__eq__(other)

    def __lt__(self, other: Any) -> bool:
        first, last = self._points[0], self._points[-1]
        if other.__class__ in numvalue.native_numeric_types and (other <= first or other >= last):
            return bool(other >= last)
        raise TemplateExpressionError(self, "the rule has to know the point as a number")

    def __gt__(self, other: Any) -> bool:
        return not self < other

    __le__, __ge__ = __lt__, __gt__  # they are none of the numbers that they are compared with


class Reading(_Unknown):
    """Stands for what a rule reads at the template of the time other than by ``component[t]``.

    Parameters
    ----------
    slot : Slot
    """

    def __init__(self, slot: Slot) -> None:
        super().__init__()
        self.slot = slot


class OverTime:
    """What a rule gets in place of a mapping from points to values, of which it reads the item at the template."""

    def __init__(self, slot: Slot) -> None:
        self._slot = slot

    def __getitem__(self, t: Any) -> Any:
        if not isinstance(t, TimeTemplate):
            raise TypeError("a rule that reads other points is called at each of them")
        return Reading(self._slot)


class Template:
    """A rule of the user's, which is called as the user's is.

    Parameters
    ----------
    rule : callable
        ``rule(block, t, *more)``. Each further argument has a method ``template(position)``, which gives what stands
        for it at all times, made of `Reading`s of ``place.more[position]``. A rule of this package with the attribute
        ``skips_points`` is a formula that it states at some points only, so that it is called at each.

    Attributes
    ----------
    rule : callable
    """

    def __init__(self, rule: Callable[..., Any]) -> None:
        self.rule = self.__wrapped__ = rule  # whoever asks for the signature gets that of the rule
        self._answers: WeakKeyDictionary[Any, _Answer] = WeakKeyDictionary()  # by the block that the rule was given

    def __getstate__(self) -> dict[str, Any]:
        return {"rule": picklable_or_none(self.rule), "answers": list(self._answers.items())}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.rule = self.__wrapped__ = state["rule"] or _Lost()
        self._answers = WeakKeyDictionary(state["answers"])

    def __deepcopy__(self, memo: dict[int, Any]) -> Template:
        twin = type(self)(self.rule)
        for block, answer in self._answers.items():
            own = memo.get(id(block))
            formulas = answer.formulas if own is None else copy.deepcopy(answer.formulas, memo)
            twin._answers[block if own is None else own] = _Answer(formulas, None, _COMPARED)
        return twin

    def __call__(self, block: Any, t: Any, *more: Any) -> Any:
        """What the rule says at a time."""
        answer = self._answer(block, more)
        if t.__class__ in numvalue.native_numeric_types and is_on_indices(block):
            t = TimeIndex(t, f"the rule '{getattr(self.rule, '__name__', type(self.rule).__name__)}'", block)
        if answer.formulas is None or getattr(self.rule, "skips_points", False):
            return self.rule(block, t, *more)
        is_stating = _grid_of(block) is answer.grid
        try:
            result = answer.formulas.on_model(Place(block, t, more))
        except Exception:
            if not is_stating:
                raise
            return self.rule(block, t, *more)  # which says by itself what is wrong
        answer.stated += is_stating
        if is_stating and answer.stated == (1 if answer.grid is None else _COMPARED):
            stated = self.rule(block, t, *more)
            if not same_results(result, stated):
                answer.formulas = None
                return stated
        return result

    def formulas(self, block: Any, *more: Any) -> _Formulas | None:
        """What the rule says for all times, given what it would get at one; None where it has to know the time."""
        return self._answer(block, more).formulas

    def is_template(self, block: Any, *more: Any) -> bool:
        """Whether the rule gives formulas for all times, given what it would get at one."""
        return self.formulas(block, *more) is not None

    def _answer(self, block: Any, more: tuple[Any, ...]) -> _Answer:
        if block not in self._answers:
            self._answers[block] = _Answer(formulas_of(self.rule, block, more), _grid_of(block))
        return self._answers[block]


@dataclass
class _Answer:
    """What a rule has said for all times when it was given a block.

    Attributes
    ----------
    formulas : _Formulas or None
        None where it has to know the time.
    grid : Grid or None
        That its rows are stated on, in the model in which it was asked.
    stated : int
        At how many points.
    """

    formulas: _Formulas | None
    grid: Any
    stated: int = 0


class _Lost:
    """In place of a rule that a pickle cannot hold: what it has said for all times is kept, and nothing else."""

    def __call__(self, *arguments: Any) -> Any:
        """Refused."""
        raise ModelError(
            "a rule that has to know the time as a number did not survive pickling. Define it at the top level of a "
            "module."
        )


def _grid_of(block: Any) -> Any:
    """The grid of a phase; None of another block."""
    return getattr(getattr(block, "record", None), "grid", None)


_QUESTIONS_OF_TYPES = frozenset({"isinstance", "type", "issubclass"})

# The answer on a phase that is compared with the rule's own: not the first, where a rule may say something else. Away
# from phases there may be one only while the model is built.
_COMPARED = 2


def templated(rule: Any) -> Any:
    """A rule as a template; None where there is none."""
    return rule if rule is None or isinstance(rule, Template) else Template(rule)


def formulas_of(
    rule: Callable[..., Any],
    home: Any,
    more: tuple[Any, ...] = (),
    time: TimeTemplate | None = None,
) -> _Formulas | None:
    """What a rule says for all times, or for those that a template stands for; None where it has to know the time."""
    if _looks_at_types(rule):
        return None
    time = TimeTemplate() if time is None else time
    try:
        with asked_for_all_times():
            return _Formulas(rule(home, time, *(given.template(i) for i, given in enumerate(more))), time)
    except Exception:  # a rule that is no template may raise anything
        return None


def _looks_at_types(rule: Any) -> bool:
    """Whether a rule may say something else to a number than to a formula: it, or a function that it holds."""
    pending, seen = [rule], set()
    while pending:
        held = pending.pop()
        held = getattr(held, "_fcn", held)  # Pyomo wraps the rules of components
        code = getattr(held, "__code__", held)
        if id(held) in seen or not isinstance(code, CodeType):
            continue
        seen.add(id(held))
        if _QUESTIONS_OF_TYPES.intersection(code.co_names):
            return True
        pending += code.co_consts
        pending += getattr(held, "__defaults__", None) or ()
        pending += map(_content, getattr(held, "__closure__", None) or ())
        names = getattr(held, "__globals__", {})
        pending += [names[name] for name in code.co_names if isinstance(names.get(name), FunctionType)]
    return False


def _content(cell: CellType) -> Any:
    """What a function holds in a cell of its closure; None before it is filled."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


class _Formulas:
    """What a rule returned for the template of the time: steps over what it reads, and the form of the result.

    Parameters
    ----------
    result : object
    time : TimeTemplate
    """

    def __init__(self, result: Any, time: TimeTemplate) -> None:
        outputs: list[Any] = []
        self._form = _form_of(result, outputs)
        named: dict[Item, NamedItem] = {}
        self._steps = ExpressionSteps(outputs, lambda node: _slot_of(node, time, named))

    def on_model(self, place: Place) -> Any:
        """The result of the rule at a place of the model."""
        return self.at(lambda slot: slot.on_model(place))

    def at(self, read: Callable[[Slot], Any], functions: Mapping[str, Callable[..., Any]] = _EXPRESSIONS) -> Any:
        """The result with other things in place of what the rule reads.

        Parameters
        ----------
        read : callable
            From a slot to what stands in its place: an expression, an array, bounds.
        functions : mapping of str to callable
            What functions mean for these; by default those of Pyomo.

        Raises
        ------
        UnknownFunction
            For a function that is not among them.
        """
        return _formed(self._form, iter(self._steps.evaluate(read, functions)))

    def depending(self, slots: Callable[[Slot], bool]) -> Any:
        """The result with 1.0 in place of each expression that depends on one of these slots, and 0.0 of others."""
        depends = self._steps.depends_on(slots)
        return _formed(self._form, iter([float(depends[place]) for place in self._steps.outputs]))

    def slots_by(self, parts_of: Callable[[Any], Mapping[Hashable, Any]]) -> dict[Hashable, list[Slot]]:
        """What each part of the result reads.

        Parameters
        ----------
        parts_of : callable
            From a result to its parts: it gets the one of `depending` for each slot.
        """
        found: dict[Hashable, list[Slot]] = {part: [] for part in parts_of(self.depending(lambda slot: False))}
        for slot in self.slots:
            for part, depends in parts_of(self.depending(slot.__eq__)).items():
                found[part] += [slot] if depends else []
        return found

    @staticmethod
    def says(result: Any, other: Any) -> bool:
        """Whether a result is another one, in its form and its expressions."""
        return same_results(result, other)

    @property
    def slots(self) -> list[Slot]:
        """What the rule reads, by named expressions as well."""
        found: dict[Slot, None] = {}
        for slot in self._steps.leaves:
            inner = slot.rule.formulas(slot.component.parent_block()) if isinstance(slot, NamedItem) else None
            found |= dict.fromkeys([slot] if inner is None else inner.slots)
        return list(found)

    @property
    def reads_variables_alone(self) -> bool:
        """Whether it reads variables at the time, and others that stay, and calls no function in Python."""
        return not any(step.kind == CALL for step in self._steps.steps) and all(
            kind_of_node(slot.component.__class__) == LEAF
            if isinstance(slot, Always)
            else type(slot) is Item and issubclass(slot.component.ctype, Var)
            for slot in self._steps.leaves
        )


def _slot_of(node: Any, time: TimeTemplate, named: dict[Item, NamedItem]) -> Slot | None:
    """What a node of a template reads; None for an operation. Expressions with a rule of their own are collected."""
    if node is time:
        return Time(None)
    if isinstance(node, Reading):
        return node.slot
    if not isinstance(node, GetItemExpression):
        # A named expression stays by name: it may be given another value.
        return Always(node) if kind_of_node(node.__class__) in (LEAF, NAMED) else None
    component, *keys = node.args
    if any(key is not time and hasattr(key, "is_expression_type") for key in keys):
        raise TemplateExpressionError(node, "an index is computed from the time")
    item = Item(component, tuple([None if key is time else key for key in keys]))
    # Pyomo has no public question for the rule that an Expression was made by.
    rule = stated_rule(component) if component.ctype is Expression else None
    if not isinstance(rule, IndexedCallInitializer):
        return item
    if item not in named:
        # The rule of the expression is called while the rule that reads it is.
        said = Template(lambda block, t: rule(block, item.key_at(t)))
        said.formulas(component.parent_block())
        named[item] = NamedItem(component, item.rest, said)
    return named[item]


class _Output:
    """Marks the place of an expression in the form of a result."""


class _Form(NamedTuple):
    """How a result is made of its parts.

    Attributes
    ----------
    kind : type, or tuple of int
        The shape of an array.
    names : list
        Keys of a mapping, fields of an object; empty where parts have none.
    parts : list
        Forms, `_Output`, or what is the same at all times.
    """

    kind: Any
    names: list[Any]
    parts: list[Any]


def _taken_apart(result: Any) -> _Form | None:
    """The form of a result that holds others, with these as its parts; None of what holds none."""
    if isinstance(result, np.ndarray):
        return _Form(result.shape, [], result.ravel().tolist())
    if isinstance(result, Mapping):
        return _Form(dict, list(result), list(result.values()))
    if isinstance(result, (list, tuple)):
        return _Form(type(result), list(getattr(result, "_fields", ())), list(result))
    if is_dataclass(result) and not isinstance(result, type):
        names = [item.name for item in fields(result) if item.init]
        return _Form(type(result), names, [getattr(result, name) for name in names])
    return None


def _form_of(result: Any, outputs: list[Any]) -> Any:
    """The form of a result; its expressions are added to `outputs`."""
    result = plain_entry(result)
    if hasattr(result, "is_expression_type"):
        outputs.append(result)
        return _Output
    if (form := _taken_apart(result)) is not None:
        return form._replace(parts=[_form_of(part, outputs) for part in form.parts])
    if result is None or result is IndexedComponent.Skip or result.__class__ in numvalue.native_types:
        return result
    raise TypeError(f"a {type(result).__name__} is returned")


def _formed(form: Any, values: Iterator[Any]) -> Any:
    """A result of a form, with these values as its expressions."""
    if form is _Output:
        return next(values)
    if not isinstance(form, _Form):
        return form
    kind, names, parts = form.kind, form.names, [_formed(part, values) for part in form.parts]
    if isinstance(kind, tuple):
        held = np.empty(len(parts), dtype=object)
        held[:] = parts
        return array(held.reshape(kind))
    if kind is dict:
        return dict(zip(names, parts, strict=True))
    return kind(**dict(zip(names, parts, strict=True))) if names else kind(parts)


def same_results(first: Any, second: Any) -> bool:
    """Whether two results have the same form and expressions."""
    first, second = plain_entry(first), plain_entry(second)
    one, other = _taken_apart(first), _taken_apart(second)
    if one is not None and other is not None:
        alike = one.kind == other.kind and len(one.parts) == len(other.parts)
        return alike and all(map(same_results, one.parts, other.parts))
    if first is second:
        return True
    if not all(
        given.__class__ in numvalue.native_types or hasattr(given, "is_expression_type") for given in (first, second)
    ):
        return False  # such as Constraint.Skip, at some points
    if same_expression(first, second):
        return True
    kinds = [kind_of_node(given.__class__) for given in (first, second)]
    if RELATION in kinds:
        if kinds[0] != kinds[1] or comparison_name(first) != comparison_name(second):
            return False
        sides = [second.args, second.args[::-1]] if comparison_name(first) == "==" else [second.args]
        return any(all(map(same_results, first.args, each)) for each in sides)  # Python may turn an equality around
    return _same_values(first, second)


def _same_values(first: Any, second: Any) -> bool:
    """Whether two expressions have the same value whatever their variables are, as far as two trials tell."""
    steps = ExpressionSteps([first, second])
    for trial in (0.31, 0.73):
        numbers = {leaf: trial + 0.61803 * (i + 1) % 1.0 for i, leaf in enumerate(steps.leaves)}
        try:
            one, other = steps.evaluate(numbers.__getitem__)
        except (ArithmeticError, ValueError):
            return False
        if not abs(one - other) <= 1e-12 * (1.0 + abs(other)):
            return False
    return True
