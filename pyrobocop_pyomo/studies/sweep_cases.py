"""The cases of a sweep: what each puts on a model, what tells it apart, and from whose solution it starts.

What counts as data of a model that may change: mutable Params and fixed Vars.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentSet
from pyomo.core.base.block import Block
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.objective import Objective
from pyomo.core.base.param import Param
from pyomo.core.base.var import Var
from pyomo.core.expr.visitor import identify_mutable_parameters

from pyrobocop_pyomo.complementarity.pairs import PAIR_TYPES
from pyrobocop_pyomo.diagnosis.findings import quoted
from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy
from pyrobocop_pyomo.phases.structure import sides_of

# --------------------------------------------------------------------------------------------------------- data by name


def data_members(component: Any) -> dict[Any, Any]:
    """The members, by index, of a component whose numbers are data: a mutable Param, or a Var.

    Raises
    ------
    ModelError
        If its numbers cannot change from outside.
    """
    kind = getattr(component, "ctype", None)
    name = getattr(component, "name", None) or repr(component)
    if kind is Param:
        if not component.parent_component().mutable:
            raise ModelError(f"'{name}': is not mutable, so expressions hold its number. Declare mutable=True.")
    elif kind is not Var:
        raise ModelError(f"'{name}': mutable Params and Vars hold data; this is a {type(component).__name__}.")
    if not component.is_indexed():
        return {None: component}
    # A Param with a default has a member for each index only once it is used.
    return {index: component[index] for index in (component.index_set() if kind is Param else component)}


def fixed_members(component: Any) -> list[Any]:
    """The members of a component whose numbers are data as the model stands: a mutable Param, or a fixed Var.

    Raises
    ------
    ModelError
        If its numbers cannot change from outside.
    """
    members = list(data_members(component).values())
    for member in members:
        if member.is_variable_type() and not member.fixed:
            raise ModelError(f"'{member.name}': is free, so it is part of the solution. Fix it, or use a Param.")
    return members


def member_values(component: Any, given: Any, label: str) -> list[tuple[Any, float]]:
    """Members of a component, and the numbers that they are to get.

    Parameters
    ----------
    component : Component
    given : number, array or mapping
        One for all members, one for each in their order, or some by index.
    label : str
        What gives them, for messages.

    Raises
    ------
    ModelError
        When it is none of these, or the component cannot change.
    """
    members, name = data_members(component), getattr(component, "name", None) or repr(component)
    if isinstance(given, Mapping):
        unknown = [index for index in given if index not in members]
        if unknown:
            raise ModelError(f"'{name}': has no index {unknown[0]!r}; it has {quoted(members)}.")
        return [(members[index], finite_number(each, f"{name}[{index}]", label)) for index, each in given.items()]
    if np.ndim(given) == 0:
        number = finite_number(given, name, label)
        return [(member, number) for member in members.values()]
    values = np.asarray(given, dtype=object).ravel()
    if values.size != len(members):
        raise ModelError(f"'{name}': {label} has {values.size} values for its {len(members)} members.")
    return [(of, finite_number(each, name, label)) for of, each in zip(members.values(), values.tolist(), strict=True)]


def finite_number(given: Any, name: str, label: str) -> float:
    """A number of a component that the user gave.

    Raises
    ------
    ModelError
        When it is no finite number.
    """
    try:
        number = float(given)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ModelError(f"'{name}': {label} gives it {given!r}; expected a finite number.")
    return number


def by_component(given: Any, model: Any) -> list[tuple[Any, Any]]:
    """Read what is said per component: a mapping from components or their names, or pairs of component and value.

    Pyomo's single Params cannot be keys of a plain dict, so names, pairs and a ComponentMap are the ways to write it.

    Raises
    ------
    ModelError
        If it is none of these, or a name is not in the model.
    """
    try:
        pairs = [(component, said) for component, said in (given.items() if isinstance(given, Mapping) else given)]
    except (TypeError, ValueError):
        raise ModelError(
            f"'{model.name}': expected a mapping such as {{'p': value}}, or pairs of a component and what is said of "
            "it, such as [(m.p, value)]."
        ) from None
    return [(named(component, model), said) for component, said in pairs]


def named(component: Any, model: Any) -> Any:
    """The component, found in the model where a name was given."""
    if not isinstance(component, str):
        return component
    found = model.find_component(component)
    if found is None:
        raise ModelError(f"'{model.name}': has no component '{component}'.")
    return found


# ---------------------------------------------------------------------------------------------------------- sweep cases


# So many cases may start one from the other before one starts cold: what goes wrong at one does not go on forever, and
# a long row of cases is divided among processes.
LONGEST_CHAIN = 8


@dataclass(frozen=True, eq=False)
class SweepCase:
    """One case.

    Attributes
    ----------
    number : int
        Its place, from 0.
    name : str
    data : object
        As the user gave it.
    """

    number: int
    name: str
    data: Any


def read_cases(cases: Any) -> list[SweepCase]:
    """Number and name the cases.

    Parameters
    ----------
    cases : iterable, or mapping of name to case

    Raises
    ------
    ModelError
        When there are none.
    """
    if isinstance(cases, Mapping):
        found = [SweepCase(number, str(name), data) for number, (name, data) in enumerate(cases.items())]
    elif isinstance(cases, Iterable) and not isinstance(cases, str):
        found = [SweepCase(number, _name_of(data, number), data) for number, data in enumerate(cases)]
    else:
        raise ModelError(f"cases is {type(cases).__name__}; expected a list of cases, or a mapping of names to cases.")
    if not found:
        raise ModelError(
            "no cases to solve. A case is a mapping such as {'mass': 2.0}, or what put= or a builder takes."
        )
    return found


def _name_of(data: Any, number: int) -> str:
    """Short data stand for themselves."""
    numbers = numbers_of(data)
    if isinstance(data, Mapping) and numbers and len(numbers) == len(data):
        return ", ".join(f"{name}={value:.6g}" for name, value in numbers.items())[:60]
    entries = data if isinstance(data, tuple) else (data,)
    if all(isinstance(entry, (int, float, str)) for entry in entries):
        return ", ".join(f"{entry:.6g}" if isinstance(entry, float) else str(entry) for entry in entries)[:60]
    return f"case {number + 1}"


def numbers_of(data: Any) -> dict[str, float]:
    """The single numbers of a case by name: columns of its table."""
    if not isinstance(data, Mapping):
        return {}
    return {
        str(name): float(value)
        for name, value in data.items()
        if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    }


def put_mapping(model: Any, data: Any) -> None:
    """Put the numbers of a case on a model: values of mutable Params, and values at which Vars are fixed.

    Parameters
    ----------
    model : Block
    data : mapping or iterable of pairs
        From components or their names to a number for all members, an array in their order, or a mapping by index.

    Raises
    ------
    ModelError
        When a component does not exist or cannot change, or a value is no finite number.
    """
    for component, given in by_component(data, model):
        for member, number in member_values(component, given, "a case"):
            if member.ctype is Var:
                member.fix(number, skip_validation=True)
            else:
                member.set_value(number)


def unread_members(model: Any, members: Iterable[Any]) -> list[Any]:
    """Those Params and Vars that no active row, pair, objective or bound of a model reads."""
    left = {id(member): member for member in members}
    rows = model.component_data_objects((Constraint, Objective, *PAIR_TYPES), active=True, descend_into=Block)
    bounds = ((variable.lower, variable.upper) for variable in model.component_data_objects(Var))
    for expression in chain.from_iterable(chain(map(sides_of, rows), bounds)):
        if not left:
            break
        if hasattr(expression, "is_expression_type"):
            for leaf in (*variables_in(expression), *identify_mutable_parameters(expression)):
                left.pop(id(leaf), None)
    return list(left.values())


def doubts_on_cases(model: Any, data: Iterable[Any]) -> tuple[str, ...]:
    """What is doubtful about cases: Params and Vars of which nothing active reads a member.

    Parameters
    ----------
    model : Block
    data : iterable
        Of all cases, as for `put_mapping`.
    """
    swept = ComponentSet(component.parent_component() for each in data for component, _ in by_component(each, model))
    unread = ComponentSet(unread_members(model, (member for component in swept for member in component.values())))
    names = ", ".join(repr(component.name) for component in swept if all(each in unread for each in component.values()))
    said = f"no row, objective or bound reads {names}: the cases are all the same problem as far as that goes."
    return (f"{said} A rule that asks for pyo.value(...) or .value keeps that number: write the Param.",) * bool(names)


def starting_cases(cases: Sequence[SweepCase], start_from: Any) -> list[int | None]:
    """From whose solution each case starts; None for a cold start.

    Parameters
    ----------
    cases : sequence of SweepCase
    start_from : "nearest", callable or None
        A callable is evaluated for each number.

    Raises
    ------
    ModelError
        When it is none of these, or names no earlier case.
    """
    if start_from is None:
        return [None] * len(cases)
    if callable(start_from):
        return _checked([start_from(case.number) for case in cases])
    if start_from != "nearest":
        raise ModelError(f"start_from = {start_from!r}; expected 'nearest', a function of the case's number, or None.")
    depth: dict[int, int] = {}
    chosen: list[int | None] = [None] * len(cases)
    for number, parent in _nearest(_coordinates(cases)):
        depth[number] = 0 if parent is None else depth[parent] + 1
        chosen[number] = None if depth[number] % LONGEST_CHAIN == 0 else parent
    return chosen


def _checked(chosen: list[Any]) -> list[int | None]:
    for number, parent in enumerate(chosen):
        if parent is not None and not (isinstance(parent, (int, np.integer)) and 0 <= parent < number):
            raise ModelError(f"start_from({number}) is {parent!r}; expected the number of an earlier case, or None.")
    return [None if parent is None else int(parent) for parent in chosen]


def _coordinates(cases: Sequence[SweepCase]) -> Array:
    """A point per case, each number relative to its range over the cases; the place in the list where that fails."""
    data = [case.data for case in cases]
    named_alike = len({tuple(map(str, of)) if isinstance(of, Mapping) else () for of in data}) == 1
    try:
        rows = np.array([list(of.values()) if isinstance(of, Mapping) else of for of in data], dtype=float)
    except (TypeError, ValueError):
        rows = np.empty(0)
    if not (named_alike and rows.size and np.isfinite(rows).all()):
        rows = np.arange(len(cases), dtype=float)
    points = rows.reshape(len(cases), -1)
    ranges = np.ptp(points, axis=0)
    return points / np.where(ranges > 0.0, ranges, 1.0)


def _nearest(points: Array) -> list[tuple[int, int | None]]:
    """The shortest tree over the points, from the first one on: pairs of a case and its neighbour."""
    # In sparse graphs a zero is no edge; a number more for each edge changes no tree.
    tree = scipy.sparse.csgraph.minimum_spanning_tree(1.0 + scipy.spatial.distance.cdist(points, points))
    order, before = scipy.sparse.csgraph.breadth_first_order(tree, 0, directed=False)
    return [(number, None if number == 0 else int(before[number])) for number in order.tolist()]
