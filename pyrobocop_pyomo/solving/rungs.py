"""The rungs of the procedure: each can be chosen alone, and together they make the ladder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pyrobocop_pyomo.complementarity import Fixed, FollowBarrier, Geometric, Schedule


@dataclass(frozen=True)
class Rung:
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
        Of Ipopt, for this rung; the caller's win.
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
BARRIER = Rung("barrier", FollowBarrier(factor=2.0))
TIGHT = Rung("tight", Fixed(1e-8))
CONTINUATION = Rung("continuation", Geometric(first=1.0, factor=0.1, last=1e-8))
ELASTIC = Rung(
    "elastic", Geometric(first=1.0, factor=0.1, last=1e-8), relaxation="elastic", options={"mu_strategy": "adaptive"}
)
PROJECTION = Rung("projection", None, from_guess=False)

RUNGS = {rung.name: rung for rung in (BARRIER, TIGHT, CONTINUATION, ELASTIC, PROJECTION)}
LADDER = tuple(RUNGS.values())


def as_rungs(choice: str | Rung | Iterable[str | Rung]) -> tuple[Rung, ...]:
    """Turn a word, a rung or several of them into rungs.

    Raises
    ------
    ValueError
        If a word is not known, or nothing is chosen.
    """
    chosen = [choice] if isinstance(choice, (str, Rung)) else list(choice)
    for each in chosen:
        if not isinstance(each, Rung) and each not in RUNGS:
            raise ValueError(f"unknown rung {each!r}. Known: {', '.join(map(repr, RUNGS))}, or a Rung.")
    if not chosen:
        raise ValueError(f"no rung was chosen. Known: {', '.join(map(repr, RUNGS))}.")
    return tuple(each if isinstance(each, Rung) else RUNGS[each] for each in chosen)
