"""True motions of switched systems: SciPy integrates, every switch is located, sliding is followed on its surface.

None of it knows a mesh, a scheme or a complementarity pair: it is what plans are compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
TOLERANCES = {"rtol": 1e-10, "atol": 1e-12, "method": "DOP853"}
MOST_SWITCHES = 200


class Chattering(RuntimeError):
    """A motion switches more often than can be followed."""


@dataclass(frozen=True)
class Filippov:
    """One switching surface between two smooth motions.

    Attributes
    ----------
    rates : callable
        ``rates(x, u, w)``: derivative of x under the constant control u, affine in the step w in [0, 1].
    surface : callable
        ``surface(x)``: the step is 1 where it is positive, 0 where it is negative.
    gradient : callable
        ``gradient(x)``: of the surface, shape ``(n,)``.
    """

    rates: Callable[[Array, float, float], Array]
    surface: Callable[[Array], float]
    gradient: Callable[[Array], Array]

    def simulate(self, boundaries: Sequence[float], controls: Sequence[float], initial: Sequence[float]) -> Array:
        """States at the boundaries, shape ``(N + 1, n)``, under a control that is constant between them."""
        states = [np.array(initial, dtype=float)]
        for start, end, control in zip(boundaries[:-1], boundaries[1:], controls, strict=True):
            states.append(self._hold(start, end, float(control), states[-1]))
        return np.array(states)

    def _approach(self, x: Array, u: float, w: float) -> float:
        return float(self.gradient(x) @ self.rates(x, u, w))

    def _sliding_step(self, x: Array, u: float) -> float:
        below, above = self._approach(x, u, 0.0), self._approach(x, u, 1.0)
        return below / (below - above)

    def _mode(self, x: Array, u: float) -> float | None:
        """The step, or None for sliding."""
        distance = self.surface(x)
        if abs(distance) > 1e-9:
            return float(distance > 0)
        below, above = self._approach(x, u, 0.0), self._approach(x, u, 1.0)
        if above <= 0 <= below and below > above:
            return None
        return float(above > 0)

    def _hold(self, start: float, end: float, u: float, x: Array) -> Array:
        for _ in range(MOST_SWITCHES):
            mode = self._mode(x, u)
            if mode is None:

                def rates(t, x):
                    return self.rates(x, u, self._sliding_step(x, u))

                # Sliding ends where one of the two motions no longer leads to the surface.
                events = [
                    _event(lambda t, x: self._approach(x, u, 1.0), 1),
                    _event(lambda t, x: self._approach(x, u, 0.0), -1),
                ]
            else:

                def rates(t, x, step=mode):
                    return self.rates(x, u, step)

                events = [_event(lambda t, x: self.surface(x), -1 if mode else 1)]
            answer = solve_ivp(rates, (start, end), x, events=events, **TOLERANCES)
            x = answer.y[:, -1]
            if answer.status != 1:
                return x
            start = float(answer.t[-1])
            if end - start < 1e-12:
                return x
        raise Chattering(f"more than {MOST_SWITCHES} switches before t = {end:g}")


@dataclass(frozen=True)
class DelayedRelay:
    """A relay with memory: it goes on where a signal rises to `on`, and off where the signal falls to `off` < `on`.

    Attributes
    ----------
    rates : callable
        ``rates(x, u, w)``, with the relay's output w, 0 or 1.
    signal : callable
        ``signal(x)``.
    on, off : float
    """

    rates: Callable[[Array, float, float], Array]
    signal: Callable[[Array], float]
    on: float
    off: float

    def simulate(
        self, boundaries: Sequence[float], controls: Sequence[float], initial: Sequence[float], output: float
    ) -> tuple[Array, list[float]]:
        """States at the boundaries, shape ``(N + 1, n)``, and the times at which the relay switches."""
        x, switches = np.array(initial, dtype=float), []
        states = [x]
        for start, end, u in zip(boundaries[:-1], boundaries[1:], controls, strict=True):
            while True:
                level, direction = (self.off, -1) if output else (self.on, 1)
                event = _event(lambda t, x, level=level: self.signal(x) - level, direction)
                answer = solve_ivp(
                    lambda t, x, u=float(u), w=output: self.rates(x, u, w), (start, end), x, events=event, **TOLERANCES
                )
                x = answer.y[:, -1]
                if answer.status != 1:
                    break
                start, output = float(answer.t[-1]), 1.0 - output
                switches.append(start)
                if end - start < 1e-12:
                    break
            states.append(x)
        return np.array(states), switches


def _event(function: Callable[[float, Array], float], direction: int) -> Callable[[float, Array], float]:
    def event(t, x):
        return function(t, x)

    event.terminal, event.direction = True, direction
    return event
