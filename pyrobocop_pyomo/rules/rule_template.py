"""`RuleTemplate`: a rule ``rule(block, t)`` that is called once, for all times, and answers everywhere.

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
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from itertools import chain
from types import CellType, CodeType, FunctionType
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from pyomo.common.errors import TemplateExpressionError
from pyomo.core.base.expression import Expression
from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.base.initializer import IndexedCallInitializer
from pyomo.core.base.var import ScalarVar
from pyomo.core.expr import Expr_if, inequality, numvalue
from pyomo.core.expr import numeric_expr as functions_of_pyomo
from pyomo.core.expr.template_expr import GetItemExpression

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.expression_arrays import ArrayEntry, array, plain_entry
from pyrobocop_pyomo.modeling.expression_nodes import (
    LEAF,
    NAMED,
    NUMPY_NAMES,
    RELATION,
    ExpressionEvaluator,
    comparison_name,
    comparisons,
    kind_of_node,
)
from pyrobocop_pyomo.modeling.expressions import same_expression
from pyrobocop_pyomo.modeling.pickling import picklable_or_none
from pyrobocop_pyomo.modeling.rule_proxies import BlockProxy, proxy_of
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.modeling.straight_line import StraightLine
from pyrobocop_pyomo.modeling.time_index import TimeIndex

_IS_ASKING: ContextVar[bool] = ContextVar("a rule gives its template", default=False)

# What functions and relations of Pyomo mean where expressions are made of expressions.
_EXPRESSIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(functions_of_pyomo, name, abs) for name in NUMPY_NAMES},
    **comparisons(lambda first, second: None),
    "<=<=": inequality,
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


class Reading(_Unknown):
    """What a rule reads at the template of the time other than by ``component[t]``: a delayed value, a derivative.

    Parameters
    ----------
    read : callable
        ``read(place, *operands)``: what is read at the `Place` at which the rule is evaluated.
    *operands
        Of the model, which a copy has its own of, or data.
    """

    def __init__(self, read: Callable[..., Any], *operands: Any) -> None:
        super().__init__()
        self._read, self._operands = read, operands

    def __deepcopy__(self, memo: dict[int, Any]) -> Reading:
        return Reading(self._read, *copy.deepcopy(self._operands, memo))

    def read(self, place: Place) -> Any:
        """What is read there."""
        return self._read(place, *self._operands)


class OverTime:
    """What a rule gets in place of a mapping from points to values, of which it reads the item at the template."""

    def __init__(self, read: Callable[..., Any], *operands: Any) -> None:
        self._reading = read, *operands

    def __getitem__(self, t: Any) -> Any:
        if not isinstance(t, TimeTemplate):
            raise TypeError("a rule that reads other points is called at each of them")
        return Reading(*self._reading)


class Place:
    """Where a rule is evaluated.

    Parameters
    ----------
    block : block or proxy of one
    t : object
        As the rule would get it.
    more : tuple
        What else it would get.
    """

    def __init__(self, block: Any, t: Any, more: tuple[Any, ...] = ()) -> None:
        self._signals = block._signals if isinstance(block, BlockProxy) else None
        self.block, self.t, self.more = block, t, more

    def of(self, component: Any) -> Any:
        """A block or component of the model as it is seen from here."""
        return component if self._signals is None else proxy_of(component, self._signals)

    @property
    def is_on_model(self) -> bool:
        """Whether the model itself is there, and no proxy of it."""
        return self._signals is None

    def of_expression(self, component: Any, keys: tuple[Any, ...], said: RuleTemplate) -> Any:
        """What an indexed Expression is at a proxy, by its own rule.

        Raises
        ------
        PyRobocopError
            When its rule is no template, or it was given another value since.
        """
        block, signals = component.parent_block(), self._signals
        assert signals is not None
        formulas = said.formulas(block)
        if formulas is None:
            raise signals.error(
                f"the rule of '{component.name}' has to know the time as a number, and was asked at the points of the "
                "model: what it says between them is not known."
            )
        if (id(component), keys) not in signals.checked_expressions:
            for index, data in component.items():
                parts = index if isinstance(index, tuple) else (index,)
                if any(key not in (None, part) for key, part in zip(keys, parts, strict=True)):
                    continue
                stated = formulas.at(Place(block, parts[keys.index(None)]))
                if not same_results(stated, data.expr):
                    raise signals.error(
                        f"'{data.name}' is '{data.expr}', but its rule said '{stated}': it was given another value "
                        "since, and nothing says what it is between the points. State it by a rule alone."
                    )
            signals.checked_expressions.add((id(component), keys))
        return formulas.at(Place(self.of(block), self.t))

    @property
    def time(self) -> Any:
        """The time that ``t`` means in a formula."""
        return self.block.time_at(self.t) if is_on_indices(self.block) else self.t

    def scalar(self, leaf: Any) -> Any:
        """A variable, parameter or named expression that does not depend on ``t``."""
        if self._signals is None or not hasattr(leaf, "parent_component"):
            return leaf
        component = leaf.parent_component()
        if component is None or component.is_indexed() or component.parent_block() is None:
            return leaf
        return getattr(self.of(component.parent_block()), component.local_name)


class RuleTemplate:
    """A rule of the user's, which is called as the user's is.

    Parameters
    ----------
    rule : callable
        ``rule(block, t, *more)``. Each further argument has a method ``template(position)``, which gives what stands
        for it at all times, made of `Reading`s of ``place.more[position]``. A rule of this package with the attribute
        ``skips_points`` is a formula that it states at some points only; with ``needs_the_time`` it is no template.

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

    def __deepcopy__(self, memo: dict[int, Any]) -> RuleTemplate:
        twin = type(self)(self.rule)
        for block, answer in self._answers.items():
            own = memo.get(id(block))
            formulas = answer.formulas if own is None else copy.deepcopy(answer.formulas, memo)
            twin._answers[block if own is None else own] = _Answer(formulas, None, _COMPARED)
        return twin

    def __call__(self, block: Any, t: Any, *more: Any) -> Any:
        """What the rule says at a time, on the model or on a proxy of it."""
        answer = self._answer(block, more)
        on_model = not isinstance(block, BlockProxy)
        if on_model and t.__class__ in numvalue.native_numeric_types and is_on_indices(block):
            t = TimeIndex(t, f"the rule '{getattr(self.rule, '__name__', type(self.rule).__name__)}'", block)
        if answer.formulas is None or (on_model and getattr(self.rule, "skips_points", False)):
            return self.rule(block, t, *more)
        is_stating = on_model and _grid_of(block) is answer.grid
        try:
            result = answer.formulas.at(Place(block, t, more))
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

    def is_known_at_other_times(self, block: Any) -> bool:
        """Whether nothing of the user's would be called there: the rule is a template, or data of this package."""
        return getattr(self.rule, "needs_the_time", False) or self.is_template(block)

    def readings(self, block: Any, *more: Any) -> list[Any]:
        """Variables and parameters at given points that a template reads at all times."""
        formulas = self.formulas(block, *more)
        return [] if formulas is None else formulas.readings

    def _answer(self, block: Any, more: tuple[Any, ...]) -> _Answer:
        block = block_behind(block)
        if block not in self._answers:
            self._answers[block] = _Answer(_formulas_of(self.rule, block, more), _grid_of(block))
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


def block_behind(block: Any) -> Any:
    """The block itself, also of a proxy."""
    return block._block if isinstance(block, BlockProxy) else block


def is_on_indices(block: Any) -> bool:
    """Whether ``t`` is an index on a block, or on a proxy of one, because the time is to be found."""
    return getattr(getattr(block_behind(block), "record", None), "normalised", False) is True


def templated(rule: Callable[..., Any] | None) -> RuleTemplate | None:
    """A rule as a template; None where there is none."""
    return rule if rule is None or isinstance(rule, RuleTemplate) else RuleTemplate(rule)


def _formulas_of(rule: Callable[..., Any], home: Any, more: tuple[Any, ...]) -> _Formulas | None:
    """What a rule says for all times; None where it has to know the time."""
    if getattr(rule, "needs_the_time", False) or _looks_at_types(rule):
        return None
    time = TimeTemplate()
    try:
        with asked_for_all_times():
            found = _Formulas(rule(home, time, *(given.template(i) for i, given in enumerate(more))), time)
            found.readings  # noqa: B018  # compiled while nothing has changed
            return found
    except Exception:  # a rule that is no template may raise anything
        return None


def _looks_at_types(rule: Any) -> bool:
    """Whether a rule may say something else to a number than to a formula: it, or a function that it holds."""
    pending, seen = [rule], set()
    while pending:
        held = pending.pop()
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
    """What a rule returned for the template of the time.

    Parameters
    ----------
    result : object
    time : TimeTemplate
    named : sequence of (component, keys, RuleTemplate)
        Of the indexed Expressions that it reads, with None for the time among their keys.
    """

    def __init__(self, result: Any, time: TimeTemplate, named: Sequence[Any] = ()) -> None:
        self._result, self._time, self._named = result, time, list(named)

    def __reduce__(self) -> Any:
        return _Formulas, (self._result, self._time, self._named)

    def __deepcopy__(self, memo: dict[int, Any]) -> _Formulas:
        return _Formulas(copy.deepcopy(self._result, memo), self._time, copy.deepcopy(self._named, memo))

    @cached_property
    def _parts(self) -> tuple[Callable[[Any], Any], _Program]:
        outputs: list[Any] = []
        form = _form_of(self._result, outputs)
        return form, _Program(outputs, self._time, self._named)

    def at(self, place: Place) -> Any:
        """The result of the rule at a place."""
        form, program = self._parts
        return form(iter(program.at(place)))

    @property
    def readings(self) -> list[Any]:
        """What is read other than at the time."""
        return [leaf for leaf in self._parts[1].others if not isinstance(leaf, (_Unknown, GetItemExpression))]


class _Program(StraightLine):
    """Makes the expressions of a place: the lines are operations on whatever stands there."""

    def __init__(self, outputs: list[Any], time: TimeTemplate, named: list[Any]) -> None:
        self._time, self._is_on_model, self._named = time, True, named
        super().__init__(outputs, (), {**_EXPRESSIONS, "choose": self._choose})
        self._readers = [self._reader(leaf) for leaf in self.others]

    def at(self, place: Place) -> list[Any]:
        """The outputs where `others` are what is read at a place."""
        self._held[:] = [read(place) for read in self._readers]
        self._is_on_model = place.is_on_model
        return self()

    def _choose(self, condition: Any, then: Any, otherwise: Any) -> Any:
        """In rows, the side that the time decides; between the points a proof looks at the times around."""
        if self._is_on_model and condition.__class__ is bool:
            return then if condition else otherwise
        return Expr_if(condition, then, otherwise)

    def _is_leaf(self, node: Any) -> bool:
        # A named expression stays by name: it may be given another value.
        return isinstance(node, GetItemExpression) or kind_of_node(node.__class__) in (LEAF, NAMED)

    def _number(self, number: Any) -> str:
        return repr(number) if number.__class__ is int else super()._number(number)

    def _reader(self, leaf: Any) -> Callable[[Place], Any]:
        if leaf is self._time:
            return lambda place: place.time
        if isinstance(leaf, Reading):
            return leaf.read
        if not isinstance(leaf, GetItemExpression):
            return lambda place: place.scalar(leaf)
        component, *keys = leaf.args
        if any(key is not self._time and hasattr(key, "is_expression_type") for key in keys):
            raise TemplateExpressionError(leaf, "an index is computed from the time")
        marked = tuple([None if key is self._time else key for key in keys])
        said = self._rule_of(component, marked)
        if said is not None:
            return lambda place: (
                component[_key_at(marked, place.t)]
                if place.is_on_model
                else place.of_expression(component, marked, said)
            )
        return lambda place: place.of(component)[_key_at(marked, place.t)]

    def _rule_of(self, component: Any, keys: tuple[Any, ...]) -> RuleTemplate | None:
        """The template of an indexed Expression: asked while the rule that reads it is."""
        # Pyomo has no public question for the rule that an Expression was made by.
        rule = component._rule if component.ctype is Expression else None
        if not isinstance(rule, IndexedCallInitializer):
            return None
        for known, at, said in self._named:
            if known is component and at == keys:
                return said
        said = RuleTemplate(lambda block, t: rule(block, _key_at(keys, t)))
        said.formulas(component.parent_block())
        self._named.append((component, keys, said))
        return said


def _key_at(keys: tuple[Any, ...], t: Any) -> Any:
    return t if len(keys) == 1 else tuple([t if key is None else key for key in keys])


def _form_of(result: Any, outputs: list[Any]) -> Callable[[Any], Any]:
    """From an iterator over values of the outputs to a result of the same form; expressions are added to `outputs`."""
    result = plain_entry(result)
    if isinstance(result, np.ndarray):
        parts, shape = [_form_of(entry, outputs) for entry in result.ravel().tolist()], result.shape
        return lambda values: array(_object_array([part(values) for part in parts], shape))
    if isinstance(result, Mapping):
        entries = {key: _form_of(entry, outputs) for key, entry in result.items()}
        return lambda values: {key: part(values) for key, part in entries.items()}
    if isinstance(result, (list, tuple)):
        parts, kind = [_form_of(entry, outputs) for entry in result], type(result)
        make = (lambda given: kind(*given)) if hasattr(result, "_fields") else kind
        return lambda values: make([part(values) for part in parts])
    if is_dataclass(result) and not isinstance(result, type):
        held = {item.name: _form_of(getattr(result, item.name), outputs) for item in fields(result) if item.init}
        return lambda values: replace(result, **{name: part(values) for name, part in held.items()})
    if hasattr(result, "is_expression_type"):
        outputs.append(result)
        return next
    if result is not None and result is not IndexedComponent.Skip and result.__class__ not in numvalue.native_types:
        raise TypeError(f"a {type(result).__name__} is returned")
    return lambda values: result


def _object_array(entries: list[Any], shape: tuple[int, ...]) -> Any:
    held = np.empty(len(entries), dtype=object)
    held[:] = entries
    return held.reshape(shape)


def same_results(first: Any, second: Any) -> bool:
    """Whether two results have the same form and expressions."""
    if isinstance(first, ArrayEntry) or isinstance(second, ArrayEntry):
        return same_results(plain_entry(first), plain_entry(second))
    if isinstance(first, np.ndarray):
        return (
            isinstance(second, np.ndarray)
            and first.shape == second.shape
            and same_results(first.ravel().tolist(), second.ravel().tolist())
        )
    if isinstance(first, Mapping):
        if not isinstance(second, Mapping) or len(first) != len(second):
            return False
        return all(same_results(one, other) for one, other in zip(first.values(), second.values(), strict=True))
    if isinstance(first, (list, tuple)):
        return type(first) is type(second) and len(first) == len(second) and all(map(same_results, first, second))
    if is_dataclass(first) and not isinstance(first, type):
        return type(first) is type(second) and all(
            same_results(getattr(first, item.name), getattr(second, item.name)) for item in fields(first) if item.init
        )
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


class _DecidedChoices(ExpressionEvaluator):
    """Evaluates choices, too, whose condition is decided already: at one time, one by the time is."""

    def of(self, node: Any) -> Any:
        """Value of an expression, or of a condition."""
        return node if node.__class__ is bool else super().of(node)


def _same_values(first: Any, second: Any) -> bool:
    """Whether two expressions have the same value whatever their variables are, as far as two trials tell."""
    variables = list(chain(variables_in(first), variables_in(second)))
    for trial in (0.31, 0.73):
        leaves = {id(variable): trial + 0.61803 * (i + 1) % 1.0 for i, variable in enumerate(variables)}
        known = _DecidedChoices(leaves)
        try:
            values = [known.of(expression) for expression in (first, second)]
        except (ArithmeticError, ValueError):
            return False
        if not abs(values[0] - values[1]) <= 1e-12 * (1.0 + abs(values[1])):
            return False
    return True
