"""A problem of optimal control as CasADi functions, independent of how it is solved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, NamedTuple

Bounds = tuple[float, float]
FREE: Bounds = (-inf, inf)


class Ends(NamedTuple):
    """Of an arc: time and state at its beginning and at its end, and the integral of its running cost."""

    start: Any
    first: Any
    end: Any
    last: Any
    integral: Any


@dataclass(frozen=True)
class Arc:
    """What happens between two instants.

    Attributes
    ----------
    dynamics : callable
        ``dynamics(t, x, u, p)`` returns the rates of the n states; t, x, u and p may be CasADi's.
    states : sequence of (lower, upper)
        Bounds of the n states at every point; `FREE` for none.
    controls : sequence of (lower, upper)
        Bounds of the m controls at every collocation point.
    duration : float or (lower, upper)
    guess : callable
        ``guess(s)``, with s from 0 to 1, returns the n states and the m controls.
    first, last : sequence of float or None
        Values of the n states at the beginning and at the end; None where free.
    running : callable, optional
        ``running(t, x, u, p)``, the rate of the integral.
    path : callable, optional
        ``path(t, x, u, p)`` returns quantities that are bounded at every collocation point.
    path_bounds : sequence of (lower, upper)
    guessed_duration : float, optional
        Where the duration is free.
    scale : sequence of float, optional
        Sizes of the n states.
    start : float
        When the arc begins; later arcs begin where the one before ends if `follows`.
    follows : bool
    breaks : tuple of float
        Instants, as fractions of the duration, that have to be boundaries of elements.
    """

    dynamics: Callable[..., Sequence[Any]]
    states: Sequence[Bounds]
    controls: Sequence[Bounds]
    duration: float | Bounds
    guess: Callable[[float], tuple[Sequence[float], Sequence[float]]]
    first: Sequence[float | None] = ()
    last: Sequence[float | None] = ()
    running: Callable[..., Any] | None = None
    path: Callable[..., Sequence[Any]] | None = None
    path_bounds: Sequence[Bounds] = ()
    guessed_duration: float | None = None
    scale: Sequence[float] = ()
    start: float = 0.0
    follows: bool = False
    breaks: tuple[float, ...] = ()


@dataclass(frozen=True)
class Statement:
    """Arcs with what joins them.

    Attributes
    ----------
    name : str
        Of the problem in the table of textbook problems.
    arcs : sequence of Arc
    objective : callable
        ``objective(ends, p)``; one `Ends` for each arc.
    maximise : bool
    conditions : callable, optional
        ``conditions(ends, p)`` returns what is bounded at the ends.
    condition_bounds : sequence of (lower, upper)
    parameters : sequence of (lower, upper, guess)
    elements, degree : int
        Of the first mesh of each arc.
    size : float
        Of the objective: Ipopt's tolerance is absolute.
    error : float
        Largest of the differential equations between the points, relative to the states' sizes, when refinement ends.
    width : float
        Smallest of an element, as a fraction of its arc.
    options : dict
        Of Ipopt, for the first solve.
    """

    name: str
    arcs: Sequence[Arc]
    objective: Callable[..., Any]
    maximise: bool = False
    conditions: Callable[..., Sequence[Any]] | None = None
    condition_bounds: Sequence[Bounds] = ()
    parameters: Sequence[tuple[float, float, float]] = ()
    elements: int = 20
    degree: int = 5
    size: float = 1.0
    error: float = 1e-8
    width: float = 1e-7
    options: dict[str, Any] = field(default_factory=dict)
