"""What a user declares on a phase: states, algebraics, controls, parameters, and how long it lasts.

A declaration is plain frozen data. Assigned to a name of a phase, it becomes Pyomo variables there::

    phase.theta = State(initial=0, final=pi)       # phase.theta[t] is a Var from then on
"""

from __future__ import annotations

import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from inspect import signature
from pathlib import Path
from typing import Any, Union

from pyomo.core.expr import numvalue

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.keywords import check_keywords
from pyrobocop_pyomo.modeling.pickling import picklable_or_none
from pyrobocop_pyomo.modeling.rule_slips import number_at
from pyrobocop_pyomo.numerics import Grid
from pyrobocop_pyomo.templates.template import Template

from .nodes import InitialGuess, IntervalNodes, KnotNodes, Nodes, StageNodes, StateNodes, knots_on_mesh

Bounds = tuple[Union[float, None], Union[float, None]]  # noqa: UP007
BoundsInTime = Union[Bounds, Callable[[float], Bounds]]  # noqa: UP007

# Before a phase starts: a number, or a function of real time.
History = Union[float, Callable[[float], Any], None]  # noqa: UP007

UNBOUNDED: Bounds = (None, None)

# What other packages call it.
_OTHER_WORDS = {
    **dict.fromkeys(("value", "initialize", "guess", "init"), "initial_guess"),
    **dict.fromkeys(("lb", "ub", "lower", "upper", "min", "max"), "bounds"),
    **dict.fromkeys(("start", "x0"), "initial"),
    **dict.fromkeys(("end", "goal", "target"), "final"),
    **dict.fromkeys(("shape", "size", "dim"), "index"),
    "unit": "units",
}
# What stands for the domain of a Pyomo variable.
_DOMAIN = "bounds=(lower, upper)"
_DOMAIN_OF_CONTROL = "integer=(0, 1), with the values that it takes, or bounds=(lower, upper) where they are real"


class FunctionOfTime:
    """A history by a function of the time, which is called while the phase is built, as a rule is.

    Parameters
    ----------
    function : callable
        The user's.
    """

    def __init__(self, function: Callable[[float], Any]) -> None:
        self._template = Template(lambda block, t: function(t))

    def __repr__(self) -> str:
        return "a function of time"

    @property
    def is_asked_by_point(self) -> bool:
        """Whether the function has to know the time as a number."""
        return not self._template.is_template(self)

    def __call__(self, time: Any) -> Any:
        """What the function says of a time."""
        return self._template(self, time)


@dataclass(frozen=True)
class BoundsOverTime:
    """Rule of the path constraint that bounds by a function of the time are. A class, because it must survive pickling.

    Attributes
    ----------
    name : str
        Of what is bounded.
    function : callable
        The user's.
    """

    name: str
    function: Callable[[float], Bounds]

    def __call__(self, b: Any, t: Any) -> Any:
        """Both sides, where there are any, at a time index."""
        bounded, sides = getattr(b, self.name)[t], self.function(t)
        lower, upper = UNBOUNDED if sides is None else sides
        above = {} if lower is None else {"lower": bounded >= lower}
        return above if upper is None else {**above, "upper": bounded <= upper}


_PACKAGE = str(Path(__file__).parents[1])


def call_site() -> str:
    """File and line of the user's statement, so that a message can point at it."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith((_PACKAGE, "<string>")):
        frame = frame.f_back
    return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """What all declarations share.

    Attributes
    ----------
    bounds : (lower, upper), or function of the time that returns such a pair, or None
        None where there is no bound. A function makes a path constraint, ``<name>_bounds``.
    initial_guess : number, array, function of the time index, or None
        Where the solver starts. By default 0, and for a state the value that it starts with, or else ends with. What
        lies outside the bounds moves onto the nearest one.
    units : Pyomo unit or None
        Units of the variable, such as ``pyo.units.m``; numbers of this declaration are meant in them.
    index : int, iterable of labels, Set, or list of several of these, optional
        Makes it a vector or a matrix: ``index=3``, ``index=m.JOINTS``, ``index=[range(2), range(3)]``. Numbers, bounds
        and guesses of the declaration are then for every component alike, or one for each.
    declared_at : str
        File and line of the declaration, quoted in messages.
    """

    bounds: BoundsInTime = UNBOUNDED
    initial_guess: InitialGuess = None
    units: Any = None
    index: Any = None
    declared_at: str = field(default_factory=call_site, repr=False, compare=False)

    def __new__(cls, *arguments: Any, **keywords: Any) -> Declaration:
        """Refuse what the class does not take, with the nearest keyword; `__init__` follows."""
        known = [name for name in cls.__dataclass_fields__ if name not in ("declared_at", "levels")]
        if arguments:
            raise ModelError(
                f"{cls.__name__} (declared at {call_site()}) takes keywords only: {cls.__name__}({known[0]}=...). Its "
                f"keywords are {', '.join(known)}."
            )
        if not keywords.keys() <= cls.__dataclass_fields__.keys():
            unknown = [name for name in keywords if name not in cls.__dataclass_fields__]
            what = f"{cls.__name__} (declared at {call_site()})"
            domain = _DOMAIN_OF_CONTROL if "integer" in known else _DOMAIN
            words = {**_OTHER_WORDS, "within": domain, "domain": domain}
            check_keywords(what, unknown, known, ModelError, other_words=words)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        if self.bounds is None:
            object.__setattr__(self, "bounds", UNBOUNDED)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.__repr__ = Declaration.__repr__  # type: ignore[method-assign]  # which dataclasses leave as it is

    def __repr__(self) -> str:
        """What was declared, without what is so by default."""
        shown = [(one, repr(getattr(self, one.name))) for one in fields(self) if one.repr]
        given = [f"{one.name}={' '.join(text.split())}" for one, text in shown if text != repr(one.default)]
        return f"{type(self).__name__}({', '.join(given)})"

    def bounds_at(self, time: float, name: str) -> Bounds:
        """Bounds at one time, checked.

        Raises
        ------
        ModelError
            When they are no pair of numbers, or cross.
        """
        where = f" (declared at {self.declared_at})"
        name = name.removesuffix(where) + where
        bounds = self.bounds
        if callable(bounds):
            bounds = number_at(bounds, time, f"{name}: bounds", ModelError)
            # A choice by the time is an expression.
            bounds = tuple(map(numvalue.value, bounds)) if isinstance(bounds, tuple) else bounds
        return check_bounds(bounds, name, "bounds")

    def nodes(self, name: str, grid: Grid, label: str) -> Nodes:
        """Where the values of a variable over time live, that is declared so under a name.

        Raises
        ------
        ModelError
            When knots do not fit the mesh.
        """
        raise ModelError(f"{label}: a {type(self).__name__} cannot be declared on a phase.")

    def __getstate__(self) -> dict[str, Any]:
        # The variables are built: only a verification asks for bounds again, and nothing for an initial guess.
        state = dict(self.__dict__)
        if callable(self.initial_guess):
            state["initial_guess"] = picklable_or_none(self.initial_guess)
        return state

    def __deepcopy__(self, memo: dict[int, Any]) -> Declaration:
        return self  # nothing in it can change, so that cloned models share it


@dataclass(frozen=True, kw_only=True)
class State(Declaration):
    """A differential variable: it has a derivative, hence an equation, and is continuous in time.

    Attributes
    ----------
    initial, final : number, (lower, upper) or None
        The value at the start and at the end of the phase: fixed, within bounds, or free.
    derivative_bounds : (lower, upper) or None
        Bounds on the time derivative. They keep the derivative as a variable of its own, which is
        otherwise eliminated.
    history : number, function of time, or None
        What it was before the phase starts, for ``b.x.delayed(t, delay)``.
    """

    initial: float | Bounds | None = None
    final: float | Bounds | None = None
    derivative_bounds: Bounds | None = None
    history: History = None

    def nodes(self, name: str, grid: Grid, label: str) -> Nodes:
        """Element boundaries and collocation points."""
        return StateNodes(name, grid)


@dataclass(frozen=True, kw_only=True)
class Algebraic(Declaration):
    """A variable without derivative that the equations determine: a force, a slip speed, a slack.

    Attributes
    ----------
    history : number, function of time, or None
        What it was before the phase starts, for ``b.z.delayed(t, delay)``.
    """

    history: History = None

    def nodes(self, name: str, grid: Grid, label: str) -> Nodes:
        """Collocation points."""
        return StageNodes(name, grid)


PARAMETRIZATIONS = ("collocated", "piecewise_constant", "piecewise_linear")


@dataclass(frozen=True, kw_only=True)
class Control(Declaration):
    """A variable that the optimiser chooses.

    Attributes
    ----------
    parametrization : {"collocated", "piecewise_constant", "piecewise_linear"}
        One value per collocation point (the default), one per element, or continuous and linear over each element.
        A piecewise constant control respects its bounds at every collocation point, a linear one at its knots.
    knots : sequence of float, optional
        Time indices, the first and the last of the phase among them, between which a piecewise control is constant or
        linear; each must be an element boundary. All element boundaries by default.
    rate_bounds : (lower, upper) or None
        Bounds on the rate of change in real time: the slope of a linear control; for the others, the difference of
        neighbouring values over the distance of their times (middles, where values are constant).
    history : number, function of time, or None
        What it was before the phase starts, for ``b.u.delayed(t, delay)``.
    integer : sequence of numbers, True or None
        The values that it may take; True means the whole numbers within its bounds. Such a control is piecewise
        constant. `solve` solves the problem with all values in between, rounds, and solves again.
    one_of : bool
        Of a vector with ``integer=(0, 1)``: exactly one of its components is 1.
    max_switches : int, optional
        How often an integer control may change.
    min_dwell : float, optional
        How long in real time it keeps a value at least.
    levels : tuple of float or None
        The values of `integer`, in order; not to be given.
    """

    parametrization: str = "collocated"
    knots: tuple[float, ...] | None = None
    rate_bounds: Bounds | None = None
    history: History = None
    integer: Any = None
    one_of: bool = False
    max_switches: int | None = None
    min_dwell: float | None = None
    levels: tuple[float, ...] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.integer is not None and self.integer is not False:
            self._restrict_to_levels()
        elif self.one_of or self.max_switches is not None or self.min_dwell is not None:
            raise ModelError(
                f"control declared at {self.declared_at}: one_of, max_switches and min_dwell belong to an integer "
                "control. Say which values it takes: integer=(0, 1)."
            )
        if self.parametrization not in PARAMETRIZATIONS:
            raise ModelError(
                f"control declared at {self.declared_at}: parametrization {self.parametrization!r} is unknown; "
                f"choose one of {', '.join(map(repr, PARAMETRIZATIONS))}."
            )
        if self.knots is not None:
            if self.parametrization == "collocated":
                raise ModelError(
                    f"control declared at {self.declared_at}: knots belong to a piecewise control. Add "
                    "parametrization='piecewise_constant' or 'piecewise_linear'."
                )
            object.__setattr__(self, "knots", tuple(float(knot) for knot in self.knots))

    def _restrict_to_levels(self) -> None:
        what = f"integer control declared at {self.declared_at}"
        if self.parametrization == "piecewise_linear":
            raise ModelError(f"{what}: it is constant over intervals, not piecewise_linear.")
        object.__setattr__(self, "parametrization", "piecewise_constant")
        if self.levels is None:
            object.__setattr__(self, "levels", integer_levels(self.integer, self.bounds, what))
        assert self.levels is not None
        if self.bounds == UNBOUNDED:
            object.__setattr__(self, "bounds", (self.levels[0], self.levels[-1]))
        if self.one_of and self.levels != (0.0, 1.0):
            raise ModelError(f"{what}: one_of is for components that are 0 or 1; say integer=(0, 1).")
        if self.max_switches is not None and (self.max_switches != int(self.max_switches) or self.max_switches < 0):
            raise ModelError(f"{what}: max_switches = {self.max_switches!r}; expected 0, 1, 2, ...")
        if self.min_dwell is not None and not 0.0 <= float(self.min_dwell) < math.inf:
            raise ModelError(f"{what}: min_dwell = {self.min_dwell!r}; expected a time, 0 or more.")

    def nodes(self, name: str, grid: Grid, label: str) -> Nodes:
        """Collocation points, the intervals between knots, or the knots."""
        if self.parametrization == "collocated":
            return StageNodes(name, grid)
        knots = knots_on_mesh(self.knots, grid, label)
        if self.parametrization == "piecewise_linear":
            return KnotNodes(f"{name}_at_knots", grid, knots)
        return IntervalNodes(f"{name}_per_{'element' if self.knots is None else 'interval'}", grid, knots)


@dataclass(frozen=True, kw_only=True)
class Parameter(Declaration):
    """A number that the optimiser chooses once for the whole phase: a mass, a stiffness."""


@dataclass(frozen=True, kw_only=True)
class Duration(Declaration):
    """A duration that the optimiser chooses; its bounds must be positive.

    The phase is then stated in normalised time: its time indices run from 0 to 1, and
    ``phase.time_at(t)`` is the time they stand for.
    """


@dataclass(frozen=True, kw_only=True)
class Start(Declaration):
    """A start time that the optimiser chooses; the phase is then stated in normalised time."""


_MOST_LEVELS = 1000


def integer_levels(integer: Any, bounds: Any, label: str) -> tuple[float, ...]:
    """The values of an integer control in order.

    Raises
    ------
    ModelError
        When there is no range, or it holds no whole number.
    """
    if integer is not True:
        try:
            levels = tuple(sorted({float(level) for level in integer}))
        except (TypeError, ValueError):
            levels = ()
        if not levels or not all(map(math.isfinite, levels)):
            raise ModelError(f"{label}: integer = {integer!r}; expected the values it takes, such as (0, 1).")
        return levels
    lower, upper = (None, None) if callable(bounds) else check_bounds(bounds, label, "bounds")
    if lower is None or upper is None:
        raise ModelError(
            f"{label}: it has no range. Say integer=(0, 1, 2), the values that it takes, or give it bounds=(0, 2)."
        )
    first, last = math.ceil(lower - 1e-9), math.floor(upper + 1e-9)
    if first > last or last - first >= _MOST_LEVELS:
        raise ModelError(
            f"{label}: its bounds ({lower:g}, {upper:g}) hold {max(last - first + 1, 0)} whole numbers; expected 1 to "
            f"{_MOST_LEVELS}."
        )
    return tuple(map(float, range(first, last + 1)))


def check_bounds(bounds: object, name: str, label: str) -> Bounds:
    """A pair (lower, upper) of finite numbers or None, in this order; None alone stands for no bounds.

    Raises
    ------
    ModelError
        Naming the variable and the values.
    """
    if bounds is None:
        return UNBOUNDED
    try:
        lower, upper = (None if value is None else float(value) for value in bounds)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise ModelError(
            f"{name}: {label} = {bounds!r}; expected a pair (lower, upper), each a number, or None for no bound."
        ) from None
    if any(value is not None and math.isnan(value) for value in (lower, upper)):
        raise ModelError(f"{name}: {label} = {bounds!r} hold a NaN. Give numbers, or None where there is no bound.")
    if lower == math.inf or upper == -math.inf:
        raise ModelError(f"{name}: {label} = {bounds!r} exclude every number. Give None where there is no bound.")
    lower, upper = (None if value is None or math.isinf(value) else value for value in (lower, upper))
    if lower is not None and upper is not None and lower > upper:
        raise ModelError(f"{name}: the lower of its {label}, {lower:g}, exceeds the upper, {upper:g}. Swap them.")
    return lower, upper


def in_infinities(bounds: Bounds | None) -> tuple[float, float]:
    """Bounds as two numbers, of which infinite ones bound nothing."""
    lower, upper = bounds or UNBOUNDED
    return -math.inf if lower is None else lower, math.inf if upper is None else upper


_LAW_WORDS = {"mu": "coefficient", "friction": "coefficient", "velocity": "slip", "speed": "slip", "distance": "gap"}


@dataclass(frozen=True, kw_only=True)
class Law(ABC):
    """What a phase takes as a whole: ``phase.wall = law`` calls ``law.state(phase, "wall")``.

    On any error in it, everything that it has added is taken off the phase again.

    Attributes
    ----------
    declared_at : str
        File and line where the law was made, quoted in messages.
    """

    declared_at: str = field(default_factory=call_site, repr=False, compare=False)

    def __new__(cls, *_: Any, **given: Any) -> Any:
        """Refuse a keyword that the law has not, with the one that may be meant."""
        known = [name for name in signature(cls.__init__).parameters if name not in ("self", "declared_at")]
        check_keywords(cls.__name__, given.keys() - {"declared_at"}, known, ModelError, _LAW_WORDS)
        return super().__new__(cls)

    @abstractmethod
    def state(self, phase: Any, name: str) -> None:
        """Declare and state everything, all of it named after the name.

        Parameters
        ----------
        phase : PhaseBlock
        name : str
        """
