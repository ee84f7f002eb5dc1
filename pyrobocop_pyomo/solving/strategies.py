"""The strategies of the procedure: each can be chosen alone; by default they follow each other until one succeeds."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from pyrobocop_pyomo.complementarity import Fixed, FollowBarrier, Geometric, Schedule

from .ipopt_options import ITERATIONS_OF_ONE, NEARLY_THERE, TIGHTER_TOLERANCES


class StartingPoint(enum.Enum):
    """Where a strategy starts; the value is in words."""

    INITIAL_GUESS = "the user's initial guess"
    BEST = "the best point so far"
    STRAIGHT_LINES = "states on straight lines between their ends"
    SIMULATED = "the motion under the controls of the initial guess"
    COARSE_MESH = "the answer on fewer elements"
    INSIDE_BOUNDS = "the middle of the bounds"
    ABSOLUTE_VALUES = "the answer with absolute values in two parts"
    RANDOM = "random values around the initial guess"
    RANDOM_MOTION = "the motion under random controls"
    RANDOM_CONTROLS = "random controls, and states on straight lines between their ends"
    MIRRORED = "the motion under the controls of the answer, on the other side of their bounds or of zero"
    REACHED = "where the run before ended"
    OTHER_OPTIMUM = "a better answer on fewer elements, from other starts"


@dataclass(frozen=True)
class Strategy:
    """One way to a nearly complementary point, or to a solution of a model without pairs.

    ``Strategy(polish=False)``, without name and schedule, is the default sequence with these choices,
    ``Strategy("barrier", polish=False)`` one of its members with them, and ``Strategy(schedule=...)`` a strategy of its
    own. Of several strategies that are chosen, the first that says so decides on grouping and exploration, and no point
    is polished where one says so.

    Attributes
    ----------
    name : str
        As it appears in reports, and the word that chooses it.
    schedule : Schedule or None
        How delta shrinks; None for that of the name.
    relaxation, grouping : str or object, optional
        As for ``pyrobocop.relax_complementarity``; by default "scholtes" and "pair".
    polish : bool
        Polish the point that it ends at; without it, a point is as complementary as its relaxation.
    exploration : float, optional
        How long to look for better optima beyond a certified point, as a multiple of the time that the rest of the
        solve took so far: in branches farther away, by other ways down, and from up to 32 random starts;
        ``float("inf")`` for no limit but `time_limit`. It ends after eight ways and starts in a row without a better
        point. By default 1 up to 100 pairs, and at least a second; then less, and 0 from 200 pairs; not more
        iterations than those so far, or 300; and, after a solve of at most 300 iterations, three ways and starts.
        Without pairs, in models with phases, by default 80 iterations and 0.4 times those so far, less from 500
        variables on, down to a quarter. A number asks for more starts, as long as eight in a row lead to nothing
        better, in any model without pairs. 0 ends the solve with its first solution. Other ways and starts follow the
        default sequence only.
    options : mapping
        Of Ipopt, for this strategy; the caller's win.
    for_pairs : bool
        Whether it is one for models with pairs, or one for models without any.
    start : StartingPoint
        Instead of the user's initial guess.
    elastic_rows : bool
        Without pairs: whether every row may be violated first, at a price.
    draw : int
        Of a random start: which one.
    most_iterations : int, optional
        Of one run, whatever the caller's options say.
    """

    name: str = "default"
    schedule: Schedule | None = None
    relaxation: Any = None
    grouping: Any = None
    polish: bool = True
    exploration: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    for_pairs: bool = True
    start: StartingPoint = StartingPoint.INITIAL_GUESS
    elastic_rows: bool = False
    draw: int = 0
    most_iterations: int | None = None


# So many starts are drawn at most.
RANDOM_STARTS = 32

# With delta = 2 mu the central path of a relaxed pair that nothing else decides has a * b = mu (minimise
# -mu log a - mu log b - mu log(delta - a b)): the path that interior-point methods for complementarity follow.
BARRIER = Strategy("barrier", FollowBarrier(factor=2.0))
# Its remaining iterations, where no strategy has solved the problem.
BARRIER_TO_THE_END = Strategy("barrier to the end", BARRIER.schedule)
TIGHT = Strategy("tight", Fixed(1e-8))
CONTINUATION = Strategy("continuation", Geometric(first=1.0, factor=0.1, last=1e-8))
ELASTIC = Strategy("elastic", CONTINUATION.schedule, relaxation="elastic", options={"mu_strategy": "adaptive"})

# Each finds optima that the others miss. Of fourteen problems of carts that push each other, from rest, "barrier" finds
# the best optimum in two, "continuation" in eleven, "elastic" in twelve, and all three together in each. The others
# follow where none of them has led to a certified point.
DEFAULT_SEQUENCE = (BARRIER, CONTINUATION, ELASTIC, TIGHT, BARRIER_TO_THE_END)
# Where all of these ended infeasible, from the user's initial guess.
OTHER_STARTS = (
    Strategy("simulated, with pairs", BARRIER.schedule, start=StartingPoint.SIMULATED),
    replace(ELASTIC, name="straight lines, with pairs", start=StartingPoint.STRAIGHT_LINES),
)


def _random_starts(
    strategy: Strategy, start: StartingPoint = StartingPoint.RANDOM, name: str = "random start"
) -> tuple[Strategy, ...]:
    """The strategy from each random start of a kind."""
    return tuple(replace(strategy, name=f"{name} {k}", start=start, draw=k) for k in range(1, RANDOM_STARTS + 1))


# Beyond a certified point: other ways down from the initial guess and other starts, as long as exploring pays.
_RANDOM = _random_starts(BARRIER)
OTHER_WAYS = (ELASTIC, *_RANDOM)

# Models without pairs: one run, and what follows where it fails. The order was measured on problems of optimal control
# from naive and from random starts: a simulated start helps most often, then elastic rows, then fewer elements.
SOLVE = Strategy("solve", None, for_pairs=False)
TIGHTER = Strategy(
    "tighter", None, for_pairs=False, start=StartingPoint.BEST, options={**NEARLY_THERE, **TIGHTER_TOLERANCES}
)
SIMULATED = Strategy("simulated", None, for_pairs=False, start=StartingPoint.SIMULATED)
ELASTIC_ROWS = Strategy("elastic rows", None, for_pairs=False, elastic_rows=True)
OWN_UNITS = Strategy("own units", None, for_pairs=False, options={"nlp_scaling_method": "gradient-based"})
COARSE_MESH = Strategy("coarse mesh", None, for_pairs=False, start=StartingPoint.COARSE_MESH, options=NEARLY_THERE)
ADAPTIVE = Strategy("adaptive", None, for_pairs=False, options={"mu_strategy": "adaptive"})
STRAIGHT_LINES = Strategy("straight lines", None, for_pairs=False, start=StartingPoint.STRAIGHT_LINES)
INSIDE_BOUNDS = Strategy("inside bounds", None, for_pairs=False, start=StartingPoint.INSIDE_BOUNDS)
# Where the model holds absolute values, before all others: no other start gives these a derivative.
ABSOLUTE_VALUES = Strategy("absolute values as pairs", None, for_pairs=False, start=StartingPoint.ABSOLUTE_VALUES)
SECOND_TRIES = (OWN_UNITS, SIMULATED, ELASTIC_ROWS, COARSE_MESH, ADAPTIVE, STRAIGHT_LINES, INSIDE_BOUNDS)
# Its remaining iterations, where nothing else succeeded.
SOLVE_TO_THE_END = replace(SOLVE, name="solve to the end")
# A run of these that takes long rarely gets anywhere, where the next strategy does.
CUT_SHORT = (BARRIER, TIGHT, SOLVE)

# Beyond a solution of a model without pairs. Each kind leads to optima that the others miss: where the motion under
# any controls is tame, simulated ones find most; where it is not, states on lines do.
_ONE_RUN = replace(SOLVE, most_iterations=ITERATIONS_OF_ONE)
_MOTIONS = _random_starts(_ONE_RUN, StartingPoint.RANDOM_MOTION, "random motion")
_CONTROLS = _random_starts(_ONE_RUN, StartingPoint.RANDOM_CONTROLS, "random controls")
_VALUES = _random_starts(_ONE_RUN)
MIRRORED = replace(_ONE_RUN, name="mirrored", start=StartingPoint.MIRRORED)
_FIRST = (MIRRORED, *_MOTIONS[:3], _CONTROLS[0], _VALUES[0], SIMULATED, STRAIGHT_LINES)
_LATER = (one for kinds in zip(_MOTIONS[3:], _CONTROLS[1:], _VALUES[1:], strict=False) for one in kinds)
OTHER_STARTS_WITHOUT_PAIRS = (*_FIRST, *_LATER)
# Short runs, for where a guess is symmetric: from the middle of what stands in the way no side is downhill.
SIDE_STARTS = (_CONTROLS[0], _VALUES[0])
OTHER_OPTIMUM = Strategy(
    "other optimum", None, for_pairs=False, start=StartingPoint.OTHER_OPTIMUM, options=NEARLY_THERE
)

# From beside a point that is stationary and no minimum; it follows by itself, and is none to choose.
BEYOND_SADDLE = Strategy("beyond a saddle", None, for_pairs=False, options={**NEARLY_THERE, "max_iter": 500})

STRATEGIES = {
    strategy.name: strategy
    for strategy in (*DEFAULT_SEQUENCE, *OTHER_STARTS, SOLVE, ABSOLUTE_VALUES, TIGHTER, *SECOND_TRIES)
}


Choices = str | Strategy | Iterable[str | Strategy] | None


def are_open(choices: Choices) -> bool:
    """Whether the caller leaves to the procedure which strategies follow each other."""
    return choices in (None, "default") or (
        isinstance(choices, Strategy) and choices.name == "default" and choices.schedule is None
    )


def in_order(choices: Choices, names: Iterable[str]) -> Choices:
    """The caller's strategies; where they are left open those with these names, with the choices that go with all."""
    if not are_open(choices):
        return choices
    stated = choices if isinstance(choices, Strategy) else Strategy()
    return tuple(replace(stated, name=name) for name in names)


def settings_of(choices: Choices) -> dict[str, Any]:
    """What the caller's strategies, or words for such, say in the terms of `Settings`.

    Raises
    ------
    ValueError
        If a word is not known, nothing is chosen, or the default sequence is one of several.
    """
    given = "default" if choices is None else choices
    chosen = [_strategy(choice) for choice in ([given] if isinstance(given, (str, Strategy)) else given)]
    if not chosen or (len(chosen) > 1 and any(map(are_open, chosen))):
        raise ValueError(f"no strategy was chosen, or one of several has no name. Known: {_known()}.")
    for strategy in chosen:
        if strategy.exploration is not None and not strategy.exploration >= 0.0:
            expected = "expected a multiple of the solve's time, 0 or more"
            raise ValueError(f"exploration = {strategy.exploration!r}; {expected}.")
    stated = {
        name: next((getattr(strategy, name) for strategy in chosen if getattr(strategy, name) is not None), default)
        for name, default in (("relaxation", "scholtes"), ("grouping", "pair"), ("exploration", None))
    }
    strategies = None if are_open(chosen[0]) else tuple(map(_completed, chosen))
    return {"strategies": strategies, "polish": all(strategy.polish for strategy in chosen), **stated}


def _known() -> str:
    return f"{', '.join(map(repr, STRATEGIES))}, or a Strategy"


def _strategy(choice: str | Strategy) -> Strategy:
    strategy = choice if isinstance(choice, Strategy) else Strategy(choice)
    is_own = strategy.schedule is not None or not strategy.for_pairs
    if not is_own and strategy.name != "default" and strategy.name not in STRATEGIES:
        raise ValueError(f"unknown strategy {strategy.name!r}. Known: {_known()}.")
    return strategy


def _completed(strategy: Strategy) -> Strategy:
    """A strategy that only has the name of one of `STRATEGIES`, with what it leaves to that."""
    known = STRATEGIES.get(strategy.name)
    if known is None or strategy.schedule is not None:
        return strategy if strategy.name != "default" else replace(strategy, name="schedule")
    names = {each.name for each in fields(Strategy)} - {"name", "grouping", "polish", "exploration"}
    given = {name: getattr(strategy, name) for name in names if getattr(strategy, name) != getattr(Strategy(), name)}
    return replace(known, **given) if given else known
