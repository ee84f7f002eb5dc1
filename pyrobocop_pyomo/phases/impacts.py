"""Newton's law of impact in the steps of a simulation, in place of the pairs of a gap and a force that close."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import InitialGuessError
from pyrobocop_pyomo.modeling.shared_nodes import variables_read
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.mixed_complementarity import (
    ComplementaritySolution,
    ComplementarityValues,
    solve_mixed_complementarity,
)
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .implicit_steps import StepSystem
from .step_equations import PairStatement


class Impacts:
    """Contacts that rebound, and how fast their gaps change.

    Parameters
    ----------
    pairs : sequence of PairStatement
        Of a step.
    restitution : mapping of name of a pair to number
        Newton's coefficient, from 0 to 1, of pairs of a gap and a force.
    states : collection of int
        Identities of the variables that are states: the side of a pair that reads one is its gap.
    label : str
        The phase, in words.

    Raises
    ------
    InitialGuessError
        When a coefficient is none, or names no pair.
    """

    def __init__(
        self, pairs: Sequence[PairStatement], restitution: Mapping[str, float], states: Collection[int], label: str
    ) -> None:
        names = [pair.name for pair in pairs]
        self._coefficients = np.full(len(pairs), np.nan)
        for name, coefficient in restitution.items():
            # A contact law states its pairs under its own name and "_pairs".
            meant = [name == each or each.split("[")[0] in (name, f"{name}_pairs") for each in names]
            if not any(meant):
                raise InitialGuessError(
                    f"{label}: restitution is given for '{name}', which is no pair of a simulation; these are "
                    f"{', '.join(sorted(names)) or 'none'}."
                )
            if isinstance(coefficient, bool) or not 0 <= coefficient <= 1:
                raise InitialGuessError(
                    f"{label}: the restitution of '{name}' is {coefficient!r}; it is a number from 0 to 1."
                )
            self._coefficients[meant] = coefficient
        self._watched = np.isfinite(self._coefficients)

        def moves(side: Any) -> bool:
            return any(id(variable) in states for variable in variables_read(side))

        # Both sides of a pair say the same; those of a range, and of a side of any sign, do not.
        alike = [(pair.lower, pair.upper, pair.either) == (0.0, np.inf, False) for pair in pairs]
        turned = [same and moves(of.other) and not moves(of.body) for of, same in zip(pairs, alike, strict=True)]
        self._turned = self._watched & np.array(turned, dtype=bool)
        self._gaps: Array | None = None
        self._speeds = np.zeros(len(pairs))

    def gaps_first(self, pairs: Sequence[PairStatement]) -> list[PairStatement]:
        """Pairs of a step, those turned that state the force first."""
        each = zip(pairs, self._turned, strict=True)
        return [replace(pair, body=pair.other, other=pair.body) if turned else pair for pair, turned in each]

    def solved(
        self, system: StepSystem, guess: Array, share_of: Callable[[float], StepSystem], shortest: float
    ) -> ComplementaritySolution:
        """A step in which contacts that close rebound, all at once, until no other one closes because of it.

        Parameters
        ----------
        system : StepSystem
        guess : array
        share_of : callable
            The equations of a share of the step, from its start on.
        shortest : float
            The share after which the gaps of the first step show how fast they change.
        """
        solution = solve_mixed_complementarity(system.problem(), guess)
        if not self._watched.any():
            return solution
        if self._gaps is None:
            self._gaps = self._apart(share_of(0.0), guess, self._watched)
            later = share_of(shortest)
            self._speeds = (self._apart(later, guess, self._watched) - self._gaps) / later.length
        closing, at = np.zeros(len(self._gaps), dtype=bool), system.values(solution.point)
        while (found := self._watched & (self._speeds < -NEGLIGIBLE) & (at.other > NEGLIGIBLE) & ~closing).any():
            closing |= found
            solution = self._rebound(system, guess, closing)
            if not solution.solved:
                return solution
            at = system.values(solution.point)
        self._speeds, self._gaps = (at.body - self._gaps) / system.length, at.body
        return solution

    def _rebound(self, system: StepSystem, guess: Array, closing: Array) -> ComplementaritySolution:
        """A step with Newton's law in place of gaps: the speed after an impact, from that before and without contact.

        What else accelerates the bodies goes on doing so after the impact: without that the step would lift them for
        nothing. No gap closes further than to zero.
        """
        gaps, width = self._gaps, system.length
        assert gaps is not None
        apart = (self._apart(system, guess, closing) - gaps) / width
        after = -self._coefficients * self._speeds + np.minimum(apart - self._speeds, 0.0)
        after = np.maximum(after, -gaps / width)
        return self._with_bodies(
            system, guess, closing, lambda at: ((at.body - gaps) / width - after, at.body_jacobian / width)
        )

    def _apart(self, system: StepSystem, guess: Array, chosen: Array) -> Array:
        """Gaps at the end of a step in which some pairs exert no force, as ``force >= 0 ⟂ force >= 0`` says."""
        solution = self._with_bodies(system, guess, chosen, lambda at: (at.other, at.other_jacobian))
        at = system.values(solution.point)
        return at.body if solution.solved or self._gaps is None else self._gaps

    def _with_bodies(
        self,
        system: StepSystem,
        guess: Array,
        chosen: Array,
        body_of: Callable[[ComplementarityValues], tuple[Array, Array]],
    ) -> ComplementaritySolution:
        """A step with other bodies, and their derivatives, in place of some."""

        def evaluate(point: Array) -> ComplementarityValues:
            at = system.values(point)
            body, slopes = body_of(at)
            slopes = np.where(chosen[:, None], slopes, at.body_jacobian)
            return replace(at, body=np.where(chosen, body, at.body), body_jacobian=slopes)

        return solve_mixed_complementarity(replace(system.problem(), evaluate=evaluate), guess)
