"""Template of a schedule that follows the barrier parameter: delta moves inside one solve."""

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class PowerOfBarrier:
    """``delta = max(last, mu ** power)``: with a power below one, delta shrinks more slowly than mu.

    Attributes
    ----------
    power : float
        Positive.
    last : float
        delta never falls below; positive.
    """

    power: float = 0.8
    last: float = 1e-8

    def delta_for(self, mu: float) -> float:
        """Return delta for a barrier parameter: positive, never increasing as mu decreases."""
        return float(max(self.last, mu**self.power))

    def steps(self) -> Iterator[float]:
        """Yield the delta that the one solve ends with."""
        yield self.last
