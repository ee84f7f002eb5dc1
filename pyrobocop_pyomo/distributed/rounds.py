"""`Round`: one round of a team, in numbers; how the barrier parameter and the penalties move from round to round.

What travels between the coordinator of a team and its agents: plain numbers and arrays, nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.presentation import Presented

# ------------------------------------------------------------------------------------------------------------- messages


@dataclass(frozen=True)
class QuantityFacts:
    """One shared variable over its index, as an agent's model has it.

    Attributes
    ----------
    name : str
        Of the variable in the model, such as ``"push[a].fx"``.
    keys : tuple
        Its indices, in order.
    units : str
        As the model declares them, empty where it does not.
    group : int
        The number of its `Shared`.
    penalty : float
        As given.
    """

    name: str
    keys: tuple[object, ...]
    units: str
    group: int
    penalty: float


@dataclass(frozen=True)
class ProblemFacts:
    """What the coordinator learns about an agent's problem when it is built.

    Attributes
    ----------
    quantities : tuple of QuantityFacts
        In the order of the agent's shared values.
    has_pairs : bool
    values, fixed : float and bool arrays, shape (n,)
        First values of the shared variables, and which are fixed.
    plan : mapping of component name to float array
        The first one: what the physical score reads, and where robots are that are kept apart.
    own_controls : mapping of agent to tuple of str
        Controls of the phases of each agent whose model is in the problem: those that are free and not shared.
    """

    quantities: tuple[QuantityFacts, ...]
    has_pairs: bool
    values: Array
    fixed: np.ndarray
    plan: Mapping[str, Array]
    own_controls: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Order:
    """What an agent is told to solve in a round.

    The agent minimises its own objective plus ``linear @ v`` plus ``v @ (diagonal * v) / 2`` in its shared values v.

    Attributes
    ----------
    linear, diagonal : float arrays, shape (n,)
    mu : float or None
        The barrier problem to solve; None for the problem itself, with the delta of `delta`.
    delta : float or None
        Of relaxed pairs, where mu is None: a solve without the multipliers of the last one, with this delta throughout.
    tolerance : float
    iterations : int
        Limit of Ipopt's iterations. Time limits inside a round would make iterates depend on the machine.
    values : float array, shape (n,), or None
        Where the shared variables start, if not where they are.
    others : float array, shape (neighbours, coordinates, times), or None
        Positions to keep away from.
    """

    linear: Array
    diagonal: Array
    mu: float | None
    delta: float | None = None
    tolerance: float = 1e-6
    iterations: int = 150
    values: Array | None = None
    others: Array | None = None


@dataclass(frozen=True)
class Report:
    """What an agent answers to an order.

    Attributes
    ----------
    values : float array, shape (n,)
        Its shared values.
    status : str
        Name of the `IpoptStatus`.
    usable : bool
        Whether the point can be used, which it can at an iteration limit too.
    iterations : int
    cpu_seconds : float
    objective : float
        The agent's own, without the terms of the team.
    plan : mapping of component name to float array
    """

    values: Array
    status: str
    usable: bool
    iterations: int
    cpu_seconds: float
    objective: float
    plan: Mapping[str, Array]


# --------------------------------------------------------------------------------------------------------------- rounds


ENDINGS = ("strict", "practical", "rounds")


class PlanScore(Protocol):
    """What a combined plan is worth physically. A strict plan is a practical one, too."""

    @property
    def strict(self) -> bool:
        """Whether the plan holds to small tolerances."""

    @property
    def practical(self) -> bool:
        """Whether the plan would do its work."""


def is_success(score: PlanScore | None) -> bool:
    """Whether a plan with this score is a success: at least practical."""
    return score is not None and (score.strict or score.practical)


def ends_rounds(score: PlanScore | None, until: str) -> bool:
    """Whether a plan with this score is what the rounds were carried out for: never, where all of them are wanted."""
    return (until == "strict" and score is not None and score.strict) or (until == "practical" and is_success(score))


@dataclass(frozen=True)
class Round(Presented):
    """One round, in numbers.

    Attributes
    ----------
    number : int
        From 0.
    mu : float or None
    disagreement : float array
        Largest distance of an agent's value from the agreed value, for each `Shared`, in its unit.
    change : float array
        Largest change of an agreed value since the round before.
    scaled : float array
        Disagreement times the square root of the penalty as given.
    factors : float array
        On the penalties.
    objective : float
        Sum over the agents.
    reports : mapping of agent to (status, iterations, CPU seconds)
        Of those that were asked.
    failures : mapping of agent to text
        Of those without a usable point in this round.
    score : PlanScore or None
        Of the combined plan, where it was asked for.
    """

    number: int
    mu: float | None
    disagreement: Array
    change: Array
    scaled: Array
    factors: Array
    objective: float
    reports: Mapping[str, tuple[str, int, float]]
    failures: Mapping[str, str]
    score: PlanScore | None

    def agrees(self, tolerance: float) -> bool:
        """Whether neither disagreement nor change exceeds a tolerance."""
        return bool(max(self.disagreement.max(initial=0.0), self.change.max(initial=0.0)) <= tolerance)

    def _summary(self) -> str:
        return (
            f"{self.number}: objective {self.objective:.6g}, {len(self.reports)} reports, {len(self.failures)} failures"
        )


@dataclass(frozen=True)
class BarrierPath:
    """mu falls by a factor in each round; below `turn` only as fast as the agents agree.

    The robots' delta is twice as large. With ``start``, ``turn`` and ``floor`` alike mu stays as it is.

    Attributes
    ----------
    start : float
        mu of the first round.
    factor : float
        Between 0 and 1, down to `turn`.
    turn : float
        From here on mu falls by `fast` where the disagreement of each shared group is below the square root of mu, else
        by `slow`.
    fast, slow : float
    floor : float
        Least mu.
    """

    start: float = 0.1
    factor: float = 0.6
    turn: float = 1e-3
    fast: float = 0.5
    slow: float = 0.9
    floor: float = 1e-5

    def __post_init__(self) -> None:
        """Refuse numbers that make no falling path."""
        if not 0 < self.floor <= self.turn <= self.start:
            raise TeamError(f"{self!r}: expected 0 < floor <= turn <= start.")
        if not all(0 < factor < 1 for factor in (self.factor, self.fast, self.slow)):
            raise TeamError(f"{self!r}: factor, fast and slow must lie between 0 and 1.")

    def after(self, mu: float, disagreement: Array) -> float:
        """Return mu of the next round.

        Parameters
        ----------
        mu : float
            Of the last round.
        disagreement : float array
            Largest disagreement of the last round, for each `Shared` in its own unit.
        """
        if mu > self.turn:
            return max(self.turn, mu * self.factor)
        agreed = bool((disagreement < np.sqrt(mu)).all())
        return max(self.floor, mu * (self.fast if agreed else self.slow))


@dataclass(frozen=True)
class TargetedPenalties:
    """A penalty grows while its group disagrees by more than is wanted, and falls back where it agrees far better.

    A penalty that stays high after its quantity agrees holds what the others would have to move: with the object's path
    held fast, contacts cannot turn, and forces that are a little wrong stay so.

    Attributes
    ----------
    accuracy : float
        Wanted disagreement, times the square root of the penalty as given: square root of the objective's unit. The
        penalties say by their ratios how well each quantity has to agree.
    factor : float
        Of growth in a round, where the disagreement is larger.
    fall : float
        Of the way back, where the disagreement is below `ease` times the accuracy.
    ease : float
    largest : float
        Of the factor on the given penalty; never below 1.
    below : float
        Penalties move when mu is at most this.
    """

    accuracy: float = 3e-3
    factor: float = 1.25
    fall: float = 0.9
    ease: float = 0.3
    largest: float = 60.0
    below: float = 4e-3

    def __post_init__(self) -> None:
        """Refuse numbers that move penalties the wrong way."""
        if not (self.accuracy > 0 and self.factor >= 1 and 0 < self.fall <= 1 and self.largest >= 1):
            raise TeamError(f"{self!r}: expected accuracy > 0, factor >= 1, 0 < fall <= 1 and largest >= 1.")

    def after(self, factors: Array, mu: float | None, disagreement: Array) -> Array:
        """Return the factors of the next round.

        Parameters
        ----------
        factors : float array
            On the penalty of each `Shared` in the last round, first 1.
        mu : float or None
            Of the last round.
        disagreement : float array
            Of the last round, for each `Shared`, times the square root of its penalty as given.
        """
        if mu is not None and mu > self.below:
            return factors
        up, down = disagreement > self.accuracy, disagreement < self.ease * self.accuracy
        moved = np.where(up, factors * self.factor, np.where(down, factors * self.fall, factors))
        return np.clip(moved, 1.0, self.largest)
