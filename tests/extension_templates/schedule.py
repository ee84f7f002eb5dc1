"""Template of a schedule: the values of delta, one per solve."""

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Superlinear:
    """``delta <- min(factor * delta, delta ** power)`` until `last`: each step gains more than the one before.

    Attributes
    ----------
    first, last : float
        First and last bound, ``0 < last <= first``.
    factor : float
        Least reduction per step, between 0 and 1.
    power : float
        Above 1.
    """

    first: float = 1e-1
    last: float = 1e-8
    factor: float = 0.2
    power: float = 1.5

    def steps(self) -> Iterator[float]:
        """Yield delta for each solve: positive, never increasing, the last one met exactly."""
        delta = self.first
        while delta > self.last:
            yield delta
            delta = min(self.factor * delta, delta**self.power)
        yield self.last
