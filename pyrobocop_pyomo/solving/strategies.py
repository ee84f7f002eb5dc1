"""The strategies of the procedure: each can be chosen alone; by default they follow each other until one succeeds."""

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
    small_problem_iterations : int, optional
        Ipopt's iterations, where it is one of the default sequence and the problem is small.
    from_initial_guess : bool
        Whether it starts from the user's initial guess, or from the best point so far.
    """

    name: str
    schedule: Schedule | None
    relaxation: Any = None
    options: Mapping[str, Any] = field(default_factory=dict)
    small_problem_iterations: int | None = None
    from_initial_guess: bool = True


# With delta = 2 mu the central path of a relaxed pair that nothing else decides has a * b = mu (minimise
# -mu log a - mu log b - mu log(delta - a b)): the path that interior-point methods for complementarity follow.
BARRIER = Strategy("barrier", FollowBarrier(factor=2.0), small_problem_iterations=300)
TIGHT = Strategy("tight", Fixed(1e-8), small_problem_iterations=100)
CONTINUATION = Strategy("continuation", Geometric(first=1.0, factor=0.1, last=1e-8), small_problem_iterations=200)
ELASTIC = Strategy(
    "elastic",
    Geometric(first=1.0, factor=0.1, last=1e-8),
    relaxation="elastic",
    options={"mu_strategy": "adaptive"},
    small_problem_iterations=100,
)
PROJECTION = Strategy("projection", None, from_initial_guess=False)

STRATEGIES = {strategy.name: strategy for strategy in (BARRIER, TIGHT, CONTINUATION, ELASTIC, PROJECTION)}
DEFAULT_SEQUENCE = tuple(STRATEGIES.values())


def as_strategies(choices: str | Strategy | Iterable[str | Strategy]) -> tuple[Strategy, ...]:
    """Turn a word, a strategy or several of them into strategies.

    Raises
    ------
    ValueError
        If a word is not known, or nothing is chosen.
    """
    chosen = [choices] if isinstance(choices, (str, Strategy)) else list(choices)
    for choice in chosen:
        if not isinstance(choice, Strategy) and choice not in STRATEGIES:
            raise ValueError(f"unknown strategy {choice!r}. Known: {', '.join(map(repr, STRATEGIES))}, or a Strategy.")
    if not chosen:
        raise ValueError(f"no strategy was chosen. Known: {', '.join(map(repr, STRATEGIES))}.")
    return tuple(choice if isinstance(choice, Strategy) else STRATEGIES[choice] for choice in chosen)
