"""Keywords and names that do not exist: the nearest one that does."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

from pyrobocop_pyomo.errors import KeywordError, ModelError

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")

# What other packages call components is a method of a phase here.
_METHODS_OF_PHASES = {
    "BoundaryConstraint": "phase.constraint(rule), or an ordinary Constraint on b.x.at_end",
    "Derivative": "phase.ode(rule)",
    "DerivativeVar": "phase.ode(rule)",
    "Integral": "phase.integral(rule)",
    "PathConstraint": "phase.constraint(lambda b, t: ...)",
    "integral": "phase.integral(rule)",
    "ode": "phase.ode(rule)",
}


def check_keywords(
    label: str,
    given: Iterable[str],
    known: Iterable[str],
    error: type[ModelError],
    other_words: Mapping[str, str] | None = None,
) -> None:
    """Refuse a keyword that does not exist, and name the nearest one.

    Parameters
    ----------
    label : str
        What was called, in messages.
    given, known : iterable of str
    error : type of ModelError
        What is raised.
    other_words : mapping of str to str, optional
        Words of other packages, and which keyword each of them stands for or how it is written here.

    Raises
    ------
    ModelError
        Of the class given.
    """
    known = list(known)
    meanings = {} if other_words is None else {word: name for word, name in other_words.items() if word not in known}
    for name in given:
        if name in known:
            continue
        meant = meanings.get(name)
        nearest = difflib.get_close_matches(name, known, n=1)
        if meant is not None and (meant in known or "=" in meant):
            remedy = f"Write {meant}." if "=" in meant else f"Did you mean '{meant}'?"
        elif nearest:
            remedy = f"Did you mean '{nearest[0]}'?"
        else:
            remedy = f"Its keywords are {', '.join(known)}."
        raise error(f"{label} has no keyword '{name}'. {remedy}")


def keywords_checked(
    other_words: Mapping[str, str] | None = None,
) -> Callable[[Callable[Parameters, Returned]], Callable[Parameters, Returned]]:
    """Decorate a function whose unknown keywords are to be refused with the nearest one that it has.

    Parameters
    ----------
    other_words : mapping of str to str, optional
        As for `check_keywords`.
    """

    def decorate(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
        keyword = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        known = [name for name, each in inspect.signature(function).parameters.items() if each.kind in keyword]

        @functools.wraps(function)
        def checked(*arguments: Any, **keywords: Any) -> Any:
            check_keywords(f"{function.__name__}()", list(keywords), known, KeywordError, other_words)
            return function(*arguments, **keywords)

        return checked

    return decorate


def where_it_is(name: str, package: Any, public: Sequence[str]) -> str:
    """The end of a message about a name that a package does not have: where it is, or the nearest name.

    Parameters
    ----------
    name : str
    package : module
    public : sequence of str
        Its public names, namespaces among them.

    Returns
    -------
    str
        Starts with ". " where something was found; else empty.
    """
    if name.startswith("_"):
        return ""
    if name in _METHODS_OF_PHASES:
        return f". Write {_METHODS_OF_PHASES[name]}"
    places: dict[str, str] = {}
    for known in public:
        found = getattr(package, known)
        places.setdefault(known, known)
        if isinstance(found, ModuleType):
            for member in getattr(found, "__all__", ()):
                places.setdefault(member, f"{known}.{member}")
    if name in places:
        return f". It is rcp.{places[name]}"
    same = [known for known in places if known.lower() == name.lower()]
    near = same or difflib.get_close_matches(name, places, n=1)
    return f". Did you mean rcp.{places[near[0]]}?" if near else ""
