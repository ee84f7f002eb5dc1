"""What an entry of the catalogue of mistakes is, and the cart that most of them are made with.

An entry is a function ``(b, followed)`` that goes on with the phase of a cart, or ``(m, followed)`` that states a whole
model. With ``followed=False`` it makes the mistake; with ``followed=True`` it does what the message says instead. Its
name is the mistake in words, and the words given to the decorator are what the answer has to name: the culprit first,
then the remedy.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

Statement = Callable[[Any, bool], Any]


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes
    ----------
    state : callable
        ``state(m, followed)``; what it returns are keywords of `rcp.solve`, or None.
    words : tuple of str
        The answer holds each of them.
    solves : bool
        Whether the answer is that of a solve, an exception or a result; else the statement raises.
    """

    state: Statement
    words: tuple[str, ...]
    solves: bool


MISTAKES: dict[str, Mistake] = {}


@dataclass(frozen=True)
class Diagnosed:
    """A mistake that ``rcp.diagnose(model)`` finds, and which ``state(m, True)`` does not make.

    Attributes
    ----------
    state : callable
    words : str
        Regular expression that its message has to match.
    component : str
        Name that it has to list.
    """

    state: Statement
    words: str
    component: str


DIAGNOSED: dict[str, Diagnosed] = {}


def cart(m: Any, *, final: float | None = 1.0, force: float | None = 2.0, **options: Any) -> Any:
    """A phase 'p' with a mass 'x', 'v' and a force 'u', without equations."""
    m.p = b = rcp.PhaseBlock(**{"duration": 2.0, "elements": 4, **options})
    b.x = rcp.State(initial=0, final=final)
    b.v = rcp.State(initial=0, final=None if final is None else 0)
    b.u = rcp.Control(bounds=(None, None) if force is None else (-force, force))
    return b


def driven(m: Any, **options: Any) -> Any:
    """The same with its equations and the effort as objective: a problem with a solution."""
    b = cart(m, **options)
    b.ode(newton)
    m.effort = pyo.Objective(expr=b.integral(effort))
    return b


def newton(b: Any, t: Any) -> Any:
    return {b.x: b.v[t], b.v: b.u[t]}


def effort(b: Any, t: Any) -> Any:
    return b.u[t] ** 2


def refused(*words: str, on: Callable[[Any], Any] | None = cart) -> Callable[[Statement], Statement]:
    """The statement raises, before any solve; it goes on with a cart, or with a phase of another kind."""
    return _enter(MISTAKES, lambda state: Mistake(state, words, solves=False), on)


def fails(*words: str, on: Callable[[Any], Any] | None = cart) -> Callable[[Statement], Statement]:
    """The solve raises, or ends without a solution; with the remedy it is solved."""
    return _enter(MISTAKES, lambda state: Mistake(state, words, solves=True), on)


def diagnosed(words: str, component: str, on: Callable[[Any], Any] | None) -> Callable[[Statement], Statement]:
    """The statement stands, and a diagnosis of the model has a finding."""
    return _enter(DIAGNOSED, lambda state: Diagnosed(state, words, component), on)


def _enter(entries: dict[str, Any], entry: Callable[[Statement], Any], on: Any) -> Callable[[Statement], Statement]:
    def enter(state: Statement) -> Statement:
        @wraps(state)
        def on_a_model(m: Any, followed: bool) -> Any:
            return state(m if on is None else on(m), followed)

        entries[state.__name__.replace("_", " ")] = entry(on_a_model)
        return state

    return enter
