"""Typical mistakes in rules: what an error from inside a rule means, and what to write instead."""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from pyomo.common.errors import PyomoException
from pyomo.core.base.block import Block

from pyrobocop_pyomo.errors import PyRobocopError

from .expression_arrays import FUNCTIONS, LAWS, remedy_for
from .expression_nodes import NUMPY_NAMES

_OF_NUMPY = {numpy_name: name for name, numpy_name in NUMPY_NAMES.items()}
_UFUNC = re.compile(r"has no callable (\w+) method")
_NO_ATTRIBUTE = re.compile(r"'(\w+)' object has no attribute '(\w+)'")
_SCALAR = re.compile(r"scalar component '(.*)' as an indexed component")
_OF_PHASE = re.compile(r"phase '.*?' has no '(\w+)'\.")
_OF_PYOMO = re.compile(r"VarData|ScalarVar|\w+Expression")
_SHAPES = re.compile(r"mismatch in its core dimension|could not be broadcast|shapes .* not aligned|same length")
_OF_TUPLE = re.compile(r"(operand|concatenate|between instances).*\btuple\b")
_FAMILY = re.compile(r"Indexed\w+|Signal(?:Var|Expression)|ComponentProxy|NotImplementedType")


@contextmanager
def slips_explained(
    rule: Any,
    label: str,
    block: Any,
    arguments: Sequence[str],
    error: type[PyRobocopError],
    time: float | None = None,
) -> Iterator[None]:
    """Explain what a rule raises, where it is a slip that is known; anything else stays as it is.

    Parameters
    ----------
    rule : callable
    label : str
        The rule in messages: ``"the pose of 'car'"``.
    block : Block
        First argument of the rule.
    arguments : sequence of str
        Names of the arguments that the rule is called with.
    error : type of exception
        What is raised instead.
    time : float, optional
        At which the rule is called.
    """
    try:
        yield
    except PyRobocopError:
        raise
    except ZeroDivisionError as found:
        raise error(f"{label}: {_division_by_zero(found, time)}") from found
    except (TypeError, ValueError, AttributeError, KeyError, PyomoException) as found:
        slip = slip_of(rule, found, block, arguments)
        if slip is None:
            raise
        raise error(f"{label}: {slip}") from found


def number_at(function: Callable[[float], Any], time: float, label: str, error: type[PyRobocopError]) -> Any:
    """What a function of the time alone gives; a division by zero is named with the time.

    Parameters
    ----------
    function : callable
    time : float
    label : str
        What it gives, in messages.
    error : type of exception
        What is raised instead.
    """
    try:
        return function(time)
    except ZeroDivisionError as found:
        raise error(f"{label}: {_division_by_zero(found, time)}") from found


def _division_by_zero(error: ZeroDivisionError, time: float | None) -> str:
    """In words; Pyomo raises some without any."""
    where = "" if time is None else f" at t = {time:g}"
    return (
        f"its rule divides numbers by zero{where} ({str(error) or 'division by zero'}). What is singular at an end of "
        "the phase can be stated with scheme='gauss', whose points lie inside."
    )


def slip_of(rule: Any, error: Exception, block: Any, arguments: Sequence[str]) -> str | None:
    """What was most likely meant, and how it is written; None for an error that is no known slip."""
    text = str(error)
    if isinstance(error, PyomoException):
        return _of_condition(text)
    if isinstance(error, ValueError):
        if _SHAPES.search(text) is None:
            return None
        return (
            f"its rule combines arrays whose shapes do not fit ({text.splitlines()[0].rstrip('.')}). A vector declared "
            "with index=n has n entries at each time: a matrix that multiplies it has n columns."
        )
    if isinstance(error, KeyError):
        scalar = _SCALAR.search(text)
        if scalar is None:
            return None
        name = scalar.group(1).rpartition(".")[2]
        return f"its rule reads '{name}' at [{arguments[1]}], which is one number at all times. Write b.{name}."
    if isinstance(error, AttributeError):
        if (of_phase := _OF_PHASE.match(text)) is not None:
            return _of_missing(of_phase.group(1), block, arguments)
        named = _NO_ATTRIBUTE.search(text)
        if named and _OF_PYOMO.fullmatch(named.group(1)) and isinstance(getattr(np, named.group(2), None), np.ufunc):
            return f"its rule gives a variable to np.{named.group(2)}, which takes numbers. {_of_numpy(named.group(2))}"
        of_block = named is not None and named.group(1) == type(block).__name__
        return _of_missing(named.group(2), block, arguments) if named and of_block else None
    rule = getattr(rule, "rule", rule)  # of a template
    if not callable(rule):
        return (
            f"it was given a {type(rule).__name__}; it takes a rule, a function that is called at every time: "
            f"lambda {', '.join(arguments)}: {{b.x: b.v[t]}} for an ode, and so on."
        )
    if not takes_arguments(rule, len(arguments)):
        given = ", ".join(arguments)
        return (
            f"its rule cannot be called with {len(arguments)} arguments, rule({given}). Write 'lambda b, "
            f"{', '.join(arguments[1:])}: ...', where b is {_named(block)}."
        )
    if "Implicit conversion of Pyomo" in text or "must be real number" in text:
        return (
            f"its rule gives a variable, or {arguments[1]}, to a function that needs a number, such as math.cos or "
            "float(). Use Pyomo's functions: pyo.cos, pyo.sin, pyo.sqrt; math.floor, math.fabs and the like jump or "
            f"have a kink: {LAWS}."
        )
    if (found := _UFUNC.search(text)) is not None:
        name = found.group(1)
        instead = f"pyo.{_OF_NUMPY[name]}(...)" if name in _OF_NUMPY else "Pyomo's functions"
        return f"its rule gives a variable to np.{name}, which takes numbers. Use {instead}."
    if "__round__" in text or "for %" in text or "for //" in text or "divmod" in text:
        return f"its rule rounds a variable, or takes a remainder. {remedy_for('floor')}"
    if type(block).__name__ in text or "BlockProxy" in text:
        return block_as_number(block, arguments)
    if "unhashable type: 'VarData'" in text or "unhashable type: 'ExpressionArray'" in text:
        return "its rule gives a variable at one time as a key. Keys are whole states: {b.x: ...}, not {b.x[t]: ...}."
    if "for ^" in text:
        return "its rule has '^', which is no power in Python. Write b.x[t] ** 2."
    if "NoneType" in text:
        return "its rule computes with None. Is a return statement missing, or a variable without value read by .value?"
    if _FAMILY.search(text) is not None:
        return forgotten_index(arguments[1])
    if _OF_TUPLE.search(text) is not None:
        return "its rule computes with a tuple. Is there a comma too many behind one of its terms?"
    return None


def _of_numpy(name: str) -> str:
    return f"Write it of arrays: np.{name}(rcp.array(...), ...)." if name in FUNCTIONS else remedy_for(name)


def block_as_number(block: Any, arguments: Sequence[str]) -> str:
    """The remedy for a first argument that is taken for a coordinate."""
    return (
        f"its rule uses its first argument, {_named(block)}, as a number. The rule is called as "
        f"rule({', '.join(arguments)}) and reads variables as b.x[{arguments[1]}]."
    )


def forgotten_index(index: str = "t", component: str = "b.x") -> str:
    """The remedy for a variable that is read without its index."""
    return (
        f"its rule uses '{component}', a variable at all times, as one number. Is an index missing? Write "
        f"{component}[{index}]."
    )


def _of_condition(text: str) -> str | None:
    if "Cannot convert non-constant Pyomo" not in text:
        return None
    return (
        "its rule asks whether a relation of variables, or of t, is true, by 'if', 'and', min, max, np.maximum, or a "
        "chain such as 0 <= b.x[t] <= 1. A rule states formulas: write (0, b.x[t], 1) for two bounds, and "
        f"pyo.Expr_if or complementarity for a choice: {LAWS}."
    )


def _of_missing(name: str, block: Any, arguments: Sequence[str]) -> str | None:
    if block is None or hasattr(block, name) or not hasattr(block, "component_map"):
        return None
    message = f"its rule reads '{name}', which {_named(block)} does not have: that is the first argument of the rule"
    others = [
        other
        for other in block.model().block_data_objects(active=None, descend_into=Block)
        if other is not block and other.component(name) is not None
    ]
    if others:
        path = others[0].name
        own = f"b.{path}" if block is block.model() else f"b.model().{path}"
        return f"{message}. '{path}' has it: state this on '{path}' instead, or write {own}.{name}[{arguments[1]}]."
    near = difflib.get_close_matches(name, list(block.component_map()), n=1)
    return f"{message}. {f'Did you mean {near[0]!r}?' if near else 'Declare it before the rule is stated.'}"


def _named(block: Any) -> str:
    kind = "phase" if hasattr(block, "time_at") else "model" if block is block.model() else "block"
    return f"the {kind} '{block.name}'"


def takes_arguments(rule: Callable[..., Any], count: int) -> bool:
    """Whether a function can be called with so many arguments."""
    try:
        inspect.signature(rule).bind(*range(count))
    except TypeError:
        return False
    except ValueError:  # a callable of C, which has no signature
        return True
    return True
