"""One end of a phase, read by name: what a link is stated in."""

from __future__ import annotations

from typing import Any

from pyrobocop_pyomo.errors import LinkError

from .declarations import Algebraic, Control, State


class PhaseEnd:
    """What a phase declares, at its start or at its end, as attributes.

    A state is its variable there, a parameter its variable. An algebraic or control is the value of its polynomial,
    which a scheme without a point at that end extrapolates from its first or last element; a piecewise linear one has
    a knot there. Other components of the phase are handed over too, those indexed by time at that time. `duration` is
    that of the phase.

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
        return self._phase.time_at(self._index)

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
        if isinstance(declaration, (Algebraic, Control)):
            nodes = self._phase.record.nodes(name)
            variables, weights = nodes.variables(self._phase), nodes.weights_at(self._index, after=not self._last)
            if len(weights) == 1:  # a node: hand over the variable itself, not a sum that hides it
                return variables[weights[0][0]]
            return sum(weight * variables[i] for i, weight in weights)
        return component[self._index] if component.is_indexed() and self._index in component else component
