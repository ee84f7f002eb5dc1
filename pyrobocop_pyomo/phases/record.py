"""What a phase remembers beside its Pyomo components: its grid, its declarations and the user's rules."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from pyomo.core.expr.numvalue import native_numeric_types

from pyrobocop_pyomo.numerics import Grid

from .declarations import Declaration, Duration, State
from .pickling import picklable_or_none


@dataclass(frozen=True)
class Statement:
    """One rule that the user stated, kept so that a trajectory can be verified with it.

    A rule that cannot be pickled (a lambda, a function within a function) is left behind by a pickle: the
    model survives, and verification says what is missing.
    """

    kind: str
    name: str
    rule: Callable[..., Any] | None

    def __deepcopy__(self, memo: dict[int, Any]) -> Statement:
        return self

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "rule": picklable_or_none(self.rule)}


@dataclass
class PhaseRecord:
    """The facts behind a `PhaseBlock`; components are referred to by name, which survives clones.

    Attributes
    ----------
    grid : Grid
        In time; since the start where that is an expression; in normalised time when the duration is a variable.
    start : float or expression
        Time at which the phase starts.
    duration : float or Duration
    declarations : dict of name to Declaration
    statements : list of Statement
        Every rule, in the order stated.
    equation_of : dict of state name to the name of the rule that gives its derivative
    rates : dict of state name to {collocation point: expression}
        Right-hand sides that were substituted.
    kept_derivatives : set of str
        States whose derivative is a variable of its own.
    generated_rows : set of str
        Names of the constraints that tie states to their derivatives: no equations of the user's.
    residuals_per_point : int
        Number of residual equations stated so far, per collocation point.
    """

    grid: Grid
    start: Any
    duration: float | Duration
    declarations: dict[str, Declaration] = field(default_factory=dict)
    statements: list[Statement] = field(default_factory=list)
    equation_of: dict[str, str] = field(default_factory=dict)
    rates: dict[str, Mapping[float, Any]] = field(default_factory=dict)
    kept_derivatives: set[str] = field(default_factory=set)
    generated_rows: set[str] = field(default_factory=set)
    residuals_per_point: int = 0

    def names(self, kind: type[Declaration]) -> list[str]:
        """Names of all declarations of a kind, in the order of declaration."""
        return [name for name, declaration in self.declarations.items() if isinstance(declaration, kind)]

    @property
    def start_is_known(self) -> bool:
        """False where the start is an expression, as after a phase whose duration is a variable."""
        return self.start.__class__ in native_numeric_types

    def clock(self, t: float, duration: Any, start: Any) -> Any:
        """The time that an index stands for, given values or expressions for duration and start."""
        if isinstance(self.duration, Duration):
            return start + duration * t
        return t if self.start_is_known else start + t

    @property
    def names_of_states(self) -> list[str]:
        """Names of all states, in the order of declaration."""
        return self.names(State)

    def snapshot(self) -> PhaseRecord:
        """A copy that later additions to this record do not reach."""
        duplicate = copy.copy(self)
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, (dict, list, set)):
                setattr(duplicate, each.name, copy.copy(value))
        return duplicate
