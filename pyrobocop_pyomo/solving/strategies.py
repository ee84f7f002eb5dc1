"""The table of strategies: each can be chosen alone; by default they follow each other until one succeeds.

`Settings` is what the caller of `solve` chose, and what goes with every call below it: the clock, the options, the
progress.
"""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, cycle, repeat
from typing import Any, TextIO

from pyrobocop_pyomo.complementarity import Fixed, FollowBarrier, Geometric, Schedule
from pyrobocop_pyomo.ipopt.backends import Backend
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.presentation.progress import Progress
from pyrobocop_pyomo.programs.compiled_model import KeptProgram

from .ipopt_options import ITERATIONS_OF_ONE, NEARLY_THERE, SIDE_ITERATIONS, TIGHTER_TOLERANCES, IpoptOptions
from .iterates import Quality, StopReason, Tolerances


class StartingPoint(enum.Enum):
    """Where a strategy starts; the value is in words."""

    INITIAL_GUESS = "the user's initial guess"
    BEST = "the best point so far"
    STRAIGHT_LINES = "states on straight lines between their ends"
    SIMULATED = "the motion under the controls of the initial guess"
    ABSOLUTE_VALUES = "the answer with absolute values in two parts"
    RANDOM_START = "random values around the initial guess"
    RANDOM_MOTION = "the motion under random controls"
    RANDOM_CONTROLS = "random controls, and states on straight lines between their ends"
    MIRRORED = "the motion under the controls of the answer, on the other side of their bounds or of zero"
    REACHED = "where the run before ended"
    OTHER_OPTIMUM = "a better answer on fewer elements, from other starts"


# What a solve has come to so far. Models with pairs go by the best point: `Quality.OPTIMAL` says that it needs no
# further strategy. Models without pairs go by how their first run ended.
End = Quality | StopReason
_CERTIFIED, _NOT_CERTIFIED = frozenset({Quality.OPTIMAL}), frozenset({Quality.INFEASIBLE, Quality.FEASIBLE})
_ANY_END = frozenset(
    {
        StopReason.FINISHED,
        StopReason.ITERATION_LIMIT,
        StopReason.FAILED,
        StopReason.INFEASIBLE,
        StopReason.DIVERGED,
    }
)


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
        How delta shrinks; None for the schedule of the name.
    relaxation, grouping : str or object, optional
        As for ``pyrobocop.relax_complementarity``; by default "scholtes" and "pair".
    polish : bool
        Polish the point that it ends at; without it, a point is as complementary as its relaxation.
    exploration : float, optional
        How long to look for better optima beyond a certified point, as a multiple of the time that the rest of the
        solve took so far: in branches farther away, by other ways down, and from up to 32 random starts;
        ``float("inf")`` for no limit but `time_limit`. It ends after eight ways and starts in a row without a better
        point. By default 1 up to 100 pairs, and at least 0.3 seconds; then less, and 0 from 200 pairs; not more
        iterations than those so far, or 300; and, after a solve of at most 300 iterations, two ways and starts.
        Without pairs, in models with phases, by default 80 iterations and 0.4 times those so far, less from 500
        variables on, down to a quarter. A number asks for more starts, as long as eight in a row lead to nothing
        better, in any model without pairs. 0 ends the solve with its first solution. Other ways and starts follow the
        default sequence only.
    options : mapping
        Of Ipopt, for this strategy; the caller's win.
    for_pairs : bool or None
        Whether it is one for models with pairs, or one for models without any; None for both.
    start : StartingPoint
        Instead of the user's initial guess.
    elastic_rows : bool
        Without pairs: whether every row may be violated first, at a price.
    draw : int
        Of a random start: which one.
    most_iterations : int, optional
        Of one run, whatever the caller's options say.
    follows : set of Quality or StopReason
        After what it follows in the table; empty for the one that is first.
    most_pairs : int, optional
        Of a model in which it follows a certified point.
    figure : str
        The measurement for which it is in the table.
    """

    name: str = "default"
    schedule: Schedule | None = None
    relaxation: Any = None
    grouping: Any = None
    polish: bool = True
    exploration: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    for_pairs: bool | None = True
    start: StartingPoint = StartingPoint.INITIAL_GUESS
    elastic_rows: bool = False
    draw: int = 0
    most_iterations: int | None = None
    follows: frozenset[End] = frozenset()
    most_pairs: int | None = None
    figure: str = field(default="", repr=False, compare=False)


# These start from the best point so far, or what becomes of it.
FROM_THE_BEST = (StartingPoint.BEST, StartingPoint.MIRRORED, StartingPoint.OTHER_OPTIMUM)
# So many starts of a kind are drawn at most.
RANDOM_STARTS = 32
# Up to here further solves from the user's initial guess cost little.
CROSS_CHECKED_PAIRS = 100
_CONTINUED = Geometric(first=1.0, factor=0.1, last=1e-8)
# With delta = 2 mu the central path of a relaxed pair that nothing else decides has a * b = mu (minimise
# -mu log a - mu log b - mu log(delta - a b)): the path that interior-point methods for complementarity follow.
_BARRIER = FollowBarrier(factor=2.0)

# Each row follows those above it, as far as `follows` says. Models of carts: fourteen, that push each other, from rest.
STRATEGIES = (
    Strategy("barrier", _BARRIER, figure="2 of the models of carts, by the fewest iterations"),
    Strategy("continuation", _CONTINUED, follows=_NOT_CERTIFIED | _CERTIFIED, figure="11 of the models of carts"),
    Strategy(
        "elastic", _CONTINUED, "elastic", options={"mu_strategy": "adaptive"}, follows=_NOT_CERTIFIED | _CERTIFIED,
        most_pairs=CROSS_CHECKED_PAIRS, figure="12 of the models of carts; the three together all fourteen",
    ),
    Strategy("tight", Fixed(1e-8), follows=_NOT_CERTIFIED, figure="models that one choice of sides makes unbounded"),
    Strategy("solve", for_pairs=False, figure="109 of 120 starts of 40 textbook problems"),
    Strategy(
        "tighter", for_pairs=False, start=StartingPoint.BEST, options={**NEARLY_THERE, **TIGHTER_TOLERANCES},
        follows=frozenset({StopReason.FINISHED, Quality.FEASIBLE}),
        figure="a few iterations where only scaled tolerances are met, and the next row takes hundreds",
    ),
    Strategy(
        "absolute values as pairs", for_pairs=None, start=StartingPoint.ABSOLUTE_VALUES,
        follows=_ANY_END | _NOT_CERTIFIED,
        figure="least fuel and distances as costs: no other row gives them a derivative at zero",
    ),
    Strategy(
        "other start", _BARRIER, for_pairs=None, start=StartingPoint.RANDOM_START, most_iterations=ITERATIONS_OF_ONE,
        follows=_CERTIFIED | {StopReason.ITERATION_LIMIT},
        figure="20 of 21 problems with several optima end at the best one, 11 without",
    ),
    Strategy(
        "own units", for_pairs=False, options={"nlp_scaling_method": "gradient-based"}, follows=_ANY_END,
        figure="the secretion of a protein: 61 iterations after 500 that led nowhere in scaled units",
    ),
    Strategy(
        "simulated", _BARRIER, for_pairs=None, start=StartingPoint.SIMULATED, follows=_ANY_END | {Quality.INFEASIBLE},
        figure="up to 3 of the 11 starts of textbook problems that one run leaves",
    ),
    Strategy(
        "elastic rows", for_pairs=False, elastic_rows=True,
        follows=_ANY_END - {StopReason.DIVERGED}, figure="6 of the 11",
    ),
    Strategy(
        "straight lines", _CONTINUED, "elastic", for_pairs=None, start=StartingPoint.STRAIGHT_LINES,
        follows=_ANY_END | {Quality.INFEASIBLE}, figure="5 of the 11",
    ),
    Strategy(
        "random controls", for_pairs=False, start=StartingPoint.RANDOM_CONTROLS, most_iterations=SIDE_ITERATIONS,
        follows=frozenset({StopReason.FINISHED, StopReason.FAILED}),
        figure="a swimmer at rest, where seven others come back to rest (benchmarks/several_optima.py)",
    ),
    Strategy(
        "other optimum", for_pairs=False, start=StartingPoint.OTHER_OPTIMUM, options=NEARLY_THERE, follows=_CERTIFIED,
        figure="the better way past a hill on 80 elements (tests/solving/test_other_optima.py)",
    ),
)  # fmt: skip
(
    BARRIER, CONTINUATION, ELASTIC, TIGHT, SOLVE, TIGHTER, ABSOLUTE_VALUES, OTHER_START, OWN_UNITS, SIMULATED,
    ELASTIC_ROWS, STRAIGHT_LINES, RANDOM_CONTROLS, OTHER_OPTIMUM,
) = STRATEGIES  # fmt: skip

# From where elastic rows led to, or another start that found something better, and from beside a point that is
# stationary and no minimum; these follow by themselves, and are none to choose.
_NEAR = {**NEARLY_THERE, "max_iter": ITERATIONS_OF_ONE}
ONWARD = Strategy("solve from there", for_pairs=False, start=StartingPoint.REACHED, options=_NEAR)
BEYOND_SADDLE = replace(ONWARD, name="beyond a saddle")
# All that may follow where other starts are the caller's.
PLAIN = (SOLVE, TIGHTER, ABSOLUTE_VALUES)

# Without pairs each kind leads to optima that the others miss: where the motion under any controls is tame, simulated
# ones find most; where it is not, states on lines do.
_DRAWN = (StartingPoint.RANDOM_MOTION, StartingPoint.RANDOM_CONTROLS, StartingPoint.RANDOM_START)
_FIRST_KINDS = (
    StartingPoint.MIRRORED,
    *[StartingPoint.RANDOM_MOTION] * 3,
    *_DRAWN[1:],
    StartingPoint.SIMULATED,
    StartingPoint.STRAIGHT_LINES,
)


def other_starts(*, has_pairs: bool) -> Iterator[Strategy]:
    """The strategy `OTHER_START` from one start after the other, each with the name of its kind."""
    kinds = repeat(StartingPoint.RANDOM_START) if has_pairs else chain(_FIRST_KINDS, cycle(_DRAWN))
    drawn = Counter[StartingPoint]()
    for kind in kinds:
        drawn[kind] += 1
        if drawn[kind] > RANDOM_STARTS:
            return
        yield _from_start(kind, drawn[kind])


def starts_at_the_side() -> Iterator[Strategy]:
    """Two short ones, which do not take the time of the strategies that follow."""
    return (replace(_from_start(kind), most_iterations=SIDE_ITERATIONS) for kind in _DRAWN[1:])


def _from_start(kind: StartingPoint, draw: int = 1) -> Strategy:
    name = kind.name.lower().replace("_", " ")
    return replace(OTHER_START, name=name if draw == 1 else f"{name} {draw}", start=kind, draw=draw)


Choices = str | Strategy | Iterable[str | Strategy] | None


def are_open(choices: Choices) -> bool:
    """Whether the caller leaves to the procedure which strategies follow each other."""
    return choices in (None, "default") or (
        isinstance(choices, Strategy) and choices.name == "default" and choices.schedule is None
    )


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
        for name, default in (("grouping", "pair"), ("exploration", None))
    }
    # The relaxation of one of several is for its own runs only.
    relaxation = chosen[0].relaxation if len(chosen) == 1 else None
    stated["relaxation"] = "scholtes" if relaxation is None else relaxation
    strategies = None if are_open(chosen[0]) else tuple(chosen)
    return {"strategies": strategies, "polish": all(strategy.polish for strategy in chosen), **stated}


_BY_NAME = {strategy.name: strategy for strategy in STRATEGIES}


def _known() -> str:
    return f"{', '.join(map(repr, _BY_NAME))}, or a Strategy"


def _strategy(choice: str | Strategy) -> Strategy:
    """A strategy; one that only has the name of one of `STRATEGIES`, with what it leaves to that."""
    strategy = choice if isinstance(choice, Strategy) else Strategy(choice)
    known = _BY_NAME.get(strategy.name)
    if strategy.schedule is not None and strategy.name == "default":
        return replace(strategy, name="schedule")
    if strategy.schedule is not None or are_open(strategy) or (known is None and not strategy.for_pairs):
        return strategy
    if known is None:
        raise ValueError(f"unknown strategy {strategy.name!r}. Known: {_known()}.")
    default = Strategy(strategy.name)
    given = {name: stated for name, stated in vars(strategy).items() if stated != getattr(default, name)}
    return replace(known, **given)


# ------------------------------------------------------------------------------------------------------------- settings


@dataclass(frozen=True)
class Settings:
    """How to solve; see `solve`.

    Attributes
    ----------
    relaxation, grouping : object
    backend : Backend
    fallbacks : tuple of Backend
        What to take, in this order, where the backend cannot take the model.
    strategies : tuple of Strategy or None
        None for the default sequence.
    options : IpoptOptions
    tolerances : Tolerances
    second_tries : bool
        Whether strategies with other starts follow where the run of a model without pairs fails.
    polish : bool
    exploration : float or None
        How long to look for better optima beyond the nearest, as a multiple of the time that the solve took so far; by
        default 1 in small problems.
    deadline : Deadline
    output : sequence of text streams
        Where Ipopt's log goes.
    progress : Progress
    scaling : bool
        Whether programs without pairs are scaled by their bounds, initial values and derivatives.
    program : KeptProgram or None
        Of a model without pairs that is solved again and again.
    """

    relaxation: Any
    grouping: Any
    backend: Backend
    fallbacks: tuple[Backend, ...] = ()
    strategies: tuple[Strategy, ...] | None = None
    options: IpoptOptions = field(default_factory=IpoptOptions)
    tolerances: Tolerances = field(default_factory=Tolerances)
    second_tries: bool = True
    polish: bool = True
    exploration: float | None = None
    deadline: Deadline = field(default_factory=Deadline)
    output: Sequence[TextIO] = ()
    progress: Progress = field(default_factory=Progress)
    scaling: bool = True
    program: KeptProgram | None = None
