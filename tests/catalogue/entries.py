"""What an entry of the catalogue of wrong models is, and the right models that the mistakes are made in.

Each entry is a generator. Up to its ``yield`` it states what is right; after it comes the mistake. Where the
statement itself raises, the model must be left as it was at the ``yield``. The other mistakes are found by
``phase.check()``, which `rcp.solve` calls, or by ``rcp.diagnose(model)``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.diagnosis import Subject
from pyrobocop_pyomo.errors import ModelError

GRAVITY = 9.81
Mistake = Iterator[None]


@dataclass(frozen=True)
class WrongModel:
    """One mistake.

    Attributes
    ----------
    state : callable
        Generator function of a model.
    found_by : {"statement", "check", "diagnose"}
    expected : exception type or Subject
        What is raised, or the subject of the finding.
    words : str
        Regular expression that the message has to match; it names the component.
    component : str or None
        Name that the finding has to list.
    """

    state: Callable[[Any], Mistake]
    found_by: str
    expected: Any
    words: str
    component: str | None = None


ENTRIES: dict[str, WrongModel] = {}


def refused_at_once(error: type[Exception], words: str) -> Callable[[Any], Any]:
    """The statement raises."""
    return _enter("statement", error, words)


def refused_by_check(words: str) -> Callable[[Any], Any]:
    """``phase.check()`` raises, hence `rcp.solve`."""
    return _enter("check", ModelError, words)


def found_by_diagnosis(subject: Subject, words: str, component: str) -> Callable[[Any], Any]:
    """``rcp.diagnose(model)`` has a finding."""
    return _enter("diagnose", subject, words, component)


def _enter(found_by: str, expected: Any, words: str, component: str | None = None) -> Callable[[Any], Any]:
    def enter(state: Callable[[Any], Mistake]) -> Callable[[Any], Mistake]:
        ENTRIES[state.__name__.replace("_", " ")] = WrongModel(state, found_by, expected, words, component)
        return state

    return enter


def pushed(m: Any, controlled: str = "collocated", **options: Any) -> Any:
    """A complete phase 'p': a mass 'x', 'v' with a force 'u'."""
    m.p = b = rcp.PhaseBlock(**{"duration": 1, "elements": 4, "stages": 2, **options})
    b.x = rcp.State(initial=0, initial_guess=0.1)
    b.v = rcp.State(initial=0, initial_guess=0.1)
    b.u = rcp.Control(bounds=(-1, 1), initial_guess=0.1, parametrization=controlled)
    b.ode(newton)
    m.cost = pyo.Objective(expr=b.integral(effort))
    return b


def newton(b: Any, t: float) -> Any:
    return {b.x: b.v[t], b.v: b.u[t]}


def effort(b: Any, t: float) -> Any:
    return b.u[t] ** 2


def pendulum(m: Any, **options: Any) -> Any:
    """A mass on a rod in Cartesian coordinates, without its rod."""
    m.swing = b = rcp.PhaseBlock(duration=1, elements=3, stages=2, **options)
    for name, initial in {"x": 1.0, "y": 0.0, "u": 0.0, "v": 0.0}.items():
        setattr(b, name, rcp.State(initial=initial, initial_guess=initial))
    b.tension = rcp.Algebraic(initial_guess=1)
    b.ode(mass)
    return b


def mass(b: Any, t: float) -> Any:
    along = b.tension[t]
    return {b.x: b.u[t], b.y: b.v[t], b.u: -along * b.x[t], b.v: -along * b.y[t] - GRAVITY}


def rod(b: Any, t: float) -> Any:
    return b.x[t] ** 2 + b.y[t] ** 2 == 1


def rod_in_velocities(b: Any, t: float) -> Any:
    return b.x[t] * b.u[t] + b.y[t] * b.v[t] == 0
