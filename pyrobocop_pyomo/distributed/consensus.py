"""What has to agree with what: the shared values of all agents, lined up by name and index."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics import Array

from .agents import Shared
from .messages import ProblemFacts

Key = tuple[str, object]


@dataclass(frozen=True)
class SharedValues:
    """Where the shared values of one agent are found among those of the team.

    Attributes
    ----------
    places : int array, shape (n,)
        Of each value of the agent: its number in the team, or -1 for what needs no agreement.
    """

    places: np.ndarray

    @cached_property
    def agreed(self) -> np.ndarray:
        """Positions of the values that need agreement."""
        return np.flatnonzero(self.places >= 0)


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
    values_of : dict of agent name to SharedValues

    Raises
    ------
    TeamError
        When a quantity has other indices or units in one model than in another, or nobody else shares it.
    """

    def __init__(self, facts: Mapping[str, ProblemFacts], shared: Sequence[Shared]) -> None:
        self._refuse_other_units(facts)
        free: dict[Key, int] = {}
        held: dict[str, set[Key]] = {}
        for name, fact in facts.items():
            keys = [(quantity.name, key) for quantity in fact.quantities for key in quantity.keys]
            held[name] = set(keys)
            for key, fixed, group in zip(keys, fact.fixed.tolist(), fact.penalty.groups.tolist(), strict=True):
                if not fixed:
                    free.setdefault(key, group)
        self._refuse_other_indices(facts, free, held)
        self.keys = list(free)
        self.groups = np.array(list(free.values()), dtype=np.intp)
        number = {key: i for i, key in enumerate(self.keys)}
        self.values_of = {
            name: SharedValues(
                np.array([number.get((q.name, key), -1) for q in fact.quantities for key in q.keys], dtype=np.intp)
            )
            for name, fact in facts.items()
        }
        self.group_names = [", ".join(entry.components) for entry in shared]

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
    def _refuse_other_indices(
        facts: Mapping[str, ProblemFacts], free: Mapping[Key, int], held: Mapping[str, set[Key]]
    ) -> None:
        holders: dict[str, list[str]] = {}
        for name, fact in facts.items():
            for quantity in fact.quantities:
                holders.setdefault(quantity.name, []).append(name)
        lengths = {name: {q.name: len(q.keys) for q in fact.quantities} for name, fact in facts.items()}
        for key in free:
            label, index = key
            names = holders[label]
            if len(names) == 1:
                raise TeamError(
                    f"'{label}' is shared by '{names[0]}' alone: no other model has it. Check its name, or leave it "
                    "out."
                )
            for name in names:
                if key not in held[name]:
                    other = next(holder for holder in names if key in held[holder])
                    raise TeamError(
                        f"'{label}' has {lengths[name][label]} values in the model of '{name}' and "
                        f"{lengths[other][label]} in that of '{other}': index {index} is missing in the first. "
                        "Give both models the same horizon and mesh."
                    )

    def of_agent(self, name: str, team_values: Array) -> Array:
        """The team's values in the order of an agent's; 0 where no agreement is needed."""
        places = self.values_of[name]
        values = np.zeros(places.places.size)
        values[places.agreed] = team_values[places.places[places.agreed]]
        return values

    def masked(self, name: str, values: Array) -> Array:
        """An agent's values, 0 where no agreement is needed."""
        masked = np.zeros(values.size)
        agreed = self.values_of[name].agreed
        masked[agreed] = values[agreed]
        return masked

    def add_to_team(self, name: str, team_values: Array, values: Array) -> None:
        """Add an agent's values to the team's."""
        places = self.values_of[name]
        team_values[places.places[places.agreed]] += values[places.agreed]

    def mean(self, values: Mapping[str, Array]) -> Array:
        """Mean of all agents' values, in the team's order."""
        total, count = np.zeros(len(self.keys)), np.zeros(len(self.keys))
        for name, own in values.items():
            self.add_to_team(name, total, own)
            self.add_to_team(name, count, np.ones(own.size))
        mean: Array = total / np.maximum(count, 1)
        return mean
