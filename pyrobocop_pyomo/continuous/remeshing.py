"""Another mesh for a set that is discretised already: its values as the guess, and what stands in the way."""

from __future__ import annotations

import numpy as np
from pyomo.dae import Integral

from pyrobocop_pyomo.errors import TranscriptionError

from .expressions import variables_in
from .inheritance import set_guess
from .reading import families, interpolate, values_of
from .record import Discretisation, discretisations_of
from .structure import Spot, axes_of, continuous_sets, spots


class Guess:
    """The values that a discretised set has, for another mesh."""

    def __init__(self, found: list[Spot], done: Discretisation) -> None:
        self._done = Discretisation(done.domain, done.grid, done.points)
        self._values = values_of(found, done)

    def give_to(self, found: list[Spot], done: Discretisation) -> None:
        """Interpolate onto the new mesh; what is fixed keeps its value."""
        for family, _, data in families(found, done):
            if family in self._values:
                free = {time: each for time, each in data.items() if not each.fixed}
                is_state, values = self._values[family]
                guess = interpolate(self._done, is_state, values, np.array(list(free), dtype=float))
                for each, number in zip(free.values(), guess.tolist(), strict=True):
                    set_guess(each, number)


def refuse_newcomers(done: Discretisation) -> None:
    """Raise a `TranscriptionError` when something holds variables at points that go away with the mesh."""
    found = list(spots(done.domain.model()))
    kept = set(done.points)
    leaving = {id(each) for _, _, data in families(found, done) for time, each in data.items() if time not in kept}
    integrals = {id(each) for s in found if isinstance(s.component, Integral) for each in s.component.values()}
    own = {id(block) for each in discretisations_of(continuous_sets(found)) for block in each.generated}
    for spot in found:
        component = spot.component
        if not hasattr(component, "_rule") or isinstance(component, Integral) or id(component.parent_block()) in own:
            continue
        axes = axes_of(component)
        for index, data in component.items():
            if any(each is done.domain and time not in kept for each, time in spot.points(index, axes)):
                continue
            expression = getattr(data, "expr", None)
            if any(id(each) in leaving for each in variables_in(expression, integrals)):
                raise TranscriptionError(
                    f"'{data.name}': was built on the mesh that '{done.domain.name}' has now. Delete it (revert a "
                    "relaxation), apply the transformation again, and build it again."
                )
