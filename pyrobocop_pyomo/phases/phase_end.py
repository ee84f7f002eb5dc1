"""One end of a phase, read by name: what a link is stated in."""

from __future__ import annotations

from typing import Any

from pyrobocop_pyomo.errors import LinkError

from .controls import variables_name
from .declarations import Algebraic, Control, State


class PhaseEnd:
    """What a phase declares, at its start or at its end, as attributes.

    A state is its variable there, a parameter its variable. An algebraic or control is the value of its polynomial,
    which a scheme without a point at that end extrapolates from its first or last element; a linear one has a knot
    there. Other components of the
    phase are handed over too, those indexed by time at that time. `duration` is that of the phase.

    Parameters
    ----------
    phase : PhaseBlock
    last : bool
        True for the end, False for the start.
    """

    def __init__(self, phase: Any, last: bool) -> None:
        self._phase = phase
        self._last = last
        self._read: set[str] = set()

    @property
    def duration(self) -> Any:
        """Duration of the phase: a number or a variable."""
        return self._phase.duration

    @property
    def time(self) -> Any:
        """Real time of this end: a number, or an expression in free durations."""
        return self._phase.clock(self._index)

    @property
    def _index(self) -> float:
        return self._phase.final_time if self._last else self._phase.initial_time

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        declared = self._phase.record.declarations
        component = self._phase.component(name)
        if component is None:
            raise LinkError(
                f"phase '{self._phase.name}' has no '{name}', which a link asks for at its "
                f"{'end' if self._last else 'start'}; declared are {', '.join(declared) or 'none'}."
            )
        self._read.add(name)
        declaration = declared.get(name)
        if isinstance(declaration, State):
            return component[self._index]
        if isinstance(declaration, Control) and declaration.parametrization == "piecewise_linear":
            knots = self._phase.component(variables_name(name, declaration))
            return knots[len(knots) - 1 if self._last else 0]
        if isinstance(declaration, (Algebraic, Control)):
            return self._polynomial(component)
        return component[self._index] if component.is_indexed() and self._index in component else component

    def _polynomial(self, signal: Any) -> Any:
        grid = self._phase.grid
        times = grid.stage_times[-1 if self._last else 0]
        weights = grid.scheme.stage_polynomial_at([1.0 if self._last else 0.0])[0]
        # At a stage all other weights are zero: hand over the variable itself, not a sum that hides it.
        terms = [weight * signal[time] for time, weight in zip(times, weights.tolist(), strict=True) if weight != 1.0]
        return sum(terms) if len(terms) == len(times) else signal[times[int(weights.argmax())]]
