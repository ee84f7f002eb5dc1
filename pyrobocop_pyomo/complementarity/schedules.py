"""How delta shrinks: constant, from solve to solve, or with the barrier parameter of one solve."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from pyrobocop_pyomo.errors import ComplementarityError


@runtime_checkable
class Schedule(Protocol):
    """The values of delta, one per solve."""

    def steps(self) -> Iterator[float]:
        """Yield delta for each solve, never increasing."""


@runtime_checkable
class BarrierSchedule(Schedule, Protocol):
    """A schedule whose delta follows the barrier parameter mu inside one solve.

    Its `steps` give the deltas of that solve's end: the last one is where delta stays however small mu becomes.
    """

    def delta_for(self, mu: float) -> float:
        """Return delta for a barrier parameter: positive, and never increasing as mu decreases."""


def _require(met: bool, schedule: object, label: str) -> None:
    if not met:
        raise ComplementarityError(f"{schedule}: {label}.")


@dataclass(frozen=True)
class Fixed:
    """One solve with one delta.

    Attributes
    ----------
    delta : float
        Positive.
    """

    delta: float = 1e-4

    def __post_init__(self) -> None:
        """Refuse numbers that give no schedule."""
        _require(0 < self.delta < math.inf, self, "delta must be positive and finite")

    def steps(self) -> Iterator[float]:
        """Yield delta once."""
        yield self.delta


@dataclass(frozen=True)
class Geometric:
    """``first, first * factor, first * factor**2, ..., last``.

    Attributes
    ----------
    first : float
        Of the first solve.
    factor : float
        Between 0 and 1.
    last : float
        Of the last solve, met exactly; positive and at most `first`.
    """

    first: float = 1.0
    factor: float = 0.1
    last: float = 1e-8

    def __post_init__(self) -> None:
        """Refuse numbers that give no schedule."""
        _require(0 < self.first < math.inf, self, "first must be positive and finite")
        _require(0 < self.factor < 1, self, "factor must lie between 0 and 1, else delta does not shrink")
        _require(0 < self.last <= self.first, self, "last must be positive and at most first")

    def steps(self) -> Iterator[float]:
        """Yield delta for each solve."""
        count = 0
        # Powers instead of repeated products, and a margin: rounding must not add a step just above the last.
        while (delta := self.first * self.factor**count) > self.last * (1 + 1e-9):
            yield delta
            count += 1
        yield self.last


@dataclass(frozen=True)
class Superlinear:
    """``delta <- min(factor * delta, delta ** exponent)`` down to the last: each step gains more than the one before.

    Attributes
    ----------
    first : float
        Of the first solve.
    factor : float
        Least reduction, between 0 and 1; it leads while delta is large, in particular where it is 1 or more.
    exponent : float
        Above 1.
    last : float
        Of the last solve, met exactly; positive and at most `first`.

    References
    ----------
    The rule by which Waechter & Biegler (2006) reduce the barrier parameter, eq. 7, doi:10.1007/s10107-004-0559-y
    """

    first: float = 1.0
    factor: float = 0.1
    exponent: float = 1.5
    last: float = 1e-8

    def __post_init__(self) -> None:
        """Refuse numbers that give no schedule."""
        _require(0 < self.first < math.inf, self, "first must be positive and finite")
        _require(0 < self.factor < 1, self, "factor must lie between 0 and 1, else delta does not shrink")
        _require(1 < self.exponent < math.inf, self, "exponent must be above 1 and finite")
        _require(0 < self.last <= self.first, self, "last must be positive and at most first")

    def steps(self) -> Iterator[float]:
        """Yield delta for each solve."""
        delta = self.first
        # A margin: rounding must not add a step just above the last.
        while delta > self.last * (1 + 1e-9):
            yield delta
            delta = min(self.factor * delta, delta**self.exponent)
        yield self.last


@dataclass(frozen=True)
class FollowBarrier:
    """delta follows the barrier parameter mu inside one solve: ``delta = max(floor, factor * mu)``.

    Attributes
    ----------
    floor : float
        delta never falls below; positive.
    factor : float
        Of mu; positive.

    References
    ----------
    Raghunathan & Biegler (2005), An interior point method for mathematical programs with complementarity
    constraints (MPCCs), doi:10.1137/S1052623403429081
    """

    floor: float = 1e-8
    factor: float = 1.0

    def __post_init__(self) -> None:
        """Refuse numbers that give no schedule."""
        _require(0 < self.floor < math.inf, self, "floor must be positive and finite")
        _require(0 < self.factor < math.inf, self, "factor must be positive and finite")

    def delta_for(self, mu: float) -> float:
        """Return delta for a barrier parameter."""
        return max(self.floor, self.factor * mu)

    def steps(self) -> Iterator[float]:
        """Yield the floor once: the one solve ends there."""
        yield self.floor
