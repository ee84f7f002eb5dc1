"""What has to agree with what: the shared values of all agents, lined up by name and index."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.optional_imports import scipy

from .agents import Shared
from .messages import ProblemFacts, QuantityFacts

Key = tuple[str, object]


class Consensus:
    """The shared values of a team.

    A value is agreed on wherever it is free in a model. Models may hold more of a quantity, such as an initial velocity
    that is fixed and that others have no use for: a value that is fixed wherever it exists is left out.

    Parameters
    ----------
    facts : mapping of agent name to ProblemFacts
    shared : sequence of Shared

    Attributes
    ----------
    keys : list of (name, index)
        What the team agrees on.
    groups : int array
        The number of the `Shared` that each belongs to.
    penalties : float array
        As given, of each.

    Raises
    ------
    TeamError
        When a quantity has other indices or units in one model than in another, or nobody else shares it.
    """

    def __init__(self, facts: Mapping[str, ProblemFacts], shared: Sequence[Shared]) -> None:
        self._refuse_other_units(facts)
        free: dict[Key, tuple[int, float]] = {}
        for fact in facts.values():
            for (quantity, key), fixed in zip(_values_of(fact), fact.fixed.tolist(), strict=True):
                if not fixed:
                    free.setdefault((quantity.name, key), (quantity.group, quantity.penalty))
        self._refuse_other_indices(facts, free)
        self.keys = list(free)
        self.groups = np.array([group for group, _ in free.values()], dtype=np.intp)
        self.penalties = np.array([penalty for _, penalty in free.values()], dtype=float)
        # From an agent's values to the team's: a matrix with a one for each value that needs agreement.
        number = {key: i for i, key in enumerate(self.keys)}
        self._to_team: dict[str, Any] = {}
        for name, fact in facts.items():
            keys = [(quantity.name, key) for quantity, key in _values_of(fact)]
            agreed = [i for i, key in enumerate(keys) if key in number]
            places, shape = [number[keys[i]] for i in agreed], (len(number), len(keys))
            self._to_team[name] = scipy.sparse.csr_array((np.ones(len(agreed)), (places, agreed)), shape=shape)

    @staticmethod
    def _refuse_other_units(facts: Mapping[str, ProblemFacts]) -> None:
        units: dict[str, tuple[str, str]] = {}
        for name, fact in facts.items():
            for quantity in fact.quantities:
                first, known = units.setdefault(quantity.name, (name, quantity.units))
                if known != quantity.units:
                    raise TeamError(
                        f"'{quantity.name}' is in {known or 'no unit'} in the model of '{first}' and in "
                        f"{quantity.units or 'no unit'} in that of '{name}'. Declare the same units."
                    )

    @staticmethod
    def _refuse_other_indices(facts: Mapping[str, ProblemFacts], free: Iterable[Key]) -> None:
        held = {name: {of.name: set(of.keys) for of in fact.quantities} for name, fact in facts.items()}
        for label, index in free:
            holders = [name for name in facts if label in held[name]]
            if len(holders) == 1:
                raise TeamError(
                    f"'{label}' is shared by '{holders[0]}' alone: no other model has it. Check its name, or leave it "
                    "out."
                )
            without = next((name for name in holders if index not in held[name][label]), None)
            if without is not None:
                other = next(name for name in holders if index in held[name][label])
                raise TeamError(
                    f"'{label}' has {len(held[without][label])} values in the model of '{without}' and "
                    f"{len(held[other][label])} in that of '{other}': index {index} is missing in the first. "
                    "Give both models the same horizon and mesh."
                )

    def of_agent(self, name: str, team_values: Array) -> Array:
        """The team's values in the order of an agent's; 0 where no agreement is needed."""
        return self._to_team[name].T @ team_values

    def of_team(self, name: str, values: Array) -> Array:
        """An agent's values in the order of the team's; 0 where it has none."""
        return self._to_team[name] @ values

    def weights(self, factors: Array) -> Array:
        """The penalties, each group of them times its factor."""
        return factors[self.groups] * self.penalties


def _values_of(fact: ProblemFacts) -> Iterator[tuple[QuantityFacts, object]]:
    return ((quantity, key) for quantity in fact.quantities for key in quantity.keys)
