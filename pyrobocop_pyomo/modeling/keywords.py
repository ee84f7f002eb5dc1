"""Keywords that do not exist are refused with the nearest one that does."""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ParamSpec, TypeVar

from pyrobocop_pyomo.errors import KeywordError, ModelError

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")


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
