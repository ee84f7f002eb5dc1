"""The strategies of the procedure: each can be chosen alone, and together they make the ladder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pyrobocop_pyomo.complementarity import Fixed, FollowBarrier, Geometric, Schedule


@dataclass(frozen=True)
class Strategy:
    """One way to a nearly complementary point.

    Attributes
    ----------
    name : str
        As it appears in reports, and the word that chooses it.
    schedule : Schedule or None
        How delta shrinks; None for the projection, which relaxes nothing.
    relaxation : object, optional
        Instead of the one that the call asks for.
    options : mapping
        Of Ipopt, for this strategy; the caller's win.
    from_guess : bool
        Whether it starts from the user's guess, or from the best point so far.
    """

    name: str
    schedule: Schedule | None
    relaxation: Any = None
    options: Mapping[str, Any] = field(default_factory=dict)
    from_guess: bool = True


# With delta = 2 mu the central path of a relaxed pair that nothing else decides has a * b = mu (minimise
# -mu log a - mu log b - mu log(delta - a b)): the path that interior-point methods for complementarity follow.
BARRIER = Strategy("barrier", FollowBarrier(factor=2.0))
TIGHT = Strategy("tight", Fixed(1e-8))
CONTINUATION = Strategy("continuation", Geometric(first=1.0, factor=0.1, last=1e-8))
ELASTIC = Strategy(
    "elastic", Geometric(first=1.0, factor=0.1, last=1e-8), relaxation="elastic", options={"mu_strategy": "adaptive"}
)
PROJECTION = Strategy("projection", None, from_guess=False)

STRATEGIES = {strategy.name: strategy for strategy in (BARRIER, TIGHT, CONTINUATION, ELASTIC, PROJECTION)}
LADDER = tuple(STRATEGIES.values())


def as_strategies(choice: str | Strategy | Iterable[str | Strategy]) -> tuple[Strategy, ...]:
    """Turn a word, a strategy or several of them into strategies.

    Raises
    ------
    ValueError
        If a word is not known, or nothing is chosen.
    """
    chosen = [choice] if isinstance(choice, (str, Strategy)) else list(choice)
    for each in chosen:
        if not isinstance(each, Strategy) and each not in STRATEGIES:
            raise ValueError(f"unknown strategy {each!r}. Known: {', '.join(map(repr, STRATEGIES))}, or a Strategy.")
    if not chosen:
        raise ValueError(f"no strategy was chosen. Known: {', '.join(map(repr, STRATEGIES))}.")
    return tuple(each if isinstance(each, Strategy) else STRATEGIES[each] for each in chosen)
