"""Starting points drawn around a guess: smooth over time in a phase, independent elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

from .named_data import by_component

WAVES = 4  # cosines in a curve over time: enough to change its shape, few enough to stay near the dynamics


class RandomStarts:
    """Draws values for the free variables of a model.

    Parameters
    ----------
    model : Block
        Its values are the guess.
    seed : int
    spread : float, mapping or iterable
        How far from the guess; see `multistart`.

    Raises
    ------
    ModelError
        If the spread makes no sense.
    """

    def __init__(self, model: Any, seed: int, spread: Any) -> None:
        self._seed = seed
        self._groups: list[tuple[list[Any], FloatArray, FloatArray, FloatArray, bool]] = []
        wanted = _spreads(model, spread)
        for component in model.component_objects(Var, active=True):
            factor = wanted.get(id(component), wanted.get(None, 0.0))
            members = [each for each in component.values() if not each.fixed]
            if factor <= 0.0 or not members:
                continue
            guess = np.array([_guess(each) for each in members])
            reach = np.maximum(1.0, np.abs(guess))
            lower = np.array([-np.inf if each.lb is None else each.lb for each in members])
            upper = np.array([np.inf if each.ub is None else each.ub for each in members])
            bounded = np.isfinite(lower) & np.isfinite(upper)
            down = np.where(bounded, guess - lower, np.minimum(reach, guess - lower))
            up = np.where(bounded, upper - guess, np.minimum(reach, upper - guess))
            over_time = component.is_indexed() and isinstance(component.parent_block(), PhaseBlockData)
            self._groups.append((members, guess, factor * down, factor * up, over_time))
        if not self._groups:
            raise ModelError(
                f"'{model.name}': no free variable is left to vary. Give a positive spread to one of them, or starts=1."
            )

    def put(self, number: int) -> None:
        """Put start `number` on the model; the same number gives the same point, however many are drawn."""
        generator = np.random.default_rng([self._seed, number])
        for members, guess, down, up, over_time in self._groups:
            draw = _curve(generator, len(members)) if over_time else generator.uniform(-1.0, 1.0, len(members))
            values = guess + np.where(draw < 0.0, draw * down, draw * up)
            for variable, number_of in zip(members, values.tolist(), strict=True):
                variable.set_value(number_of, skip_validation=True)


def _curve(generator: np.random.Generator, size: int) -> FloatArray:
    """A smooth curve within -1 and 1."""
    place = np.linspace(0.0, np.pi, size)
    waves = np.cos(np.outer(np.arange(WAVES), place))
    weights = generator.uniform(-1.0, 1.0, WAVES) / np.arange(1, WAVES + 1)
    # Uniform in its size as well: without the division the curves would crowd around the guess.
    curve = weights @ waves
    return np.asarray(curve / max(np.abs(curve).max(), 1e-12) * generator.uniform())


def _guess(variable: Any) -> float:
    """The value, moved within the bounds; without a value, the number nearest to zero within them."""
    number = 0.0 if variable.value is None else float(variable.value)
    if variable.lb is not None:
        number = max(number, variable.lb)
    return number if variable.ub is None else min(number, variable.ub)


def _spreads(model: Any, spread: Any) -> dict[Any, float]:
    given = [(None, spread)] if isinstance(spread, (int, float)) else by_component(spread, model)
    found = {}
    for component, number in given:
        name = "spread" if component is None else f"the spread of '{getattr(component, 'name', component)}'"
        if component is not None and getattr(component, "ctype", None) is not Var:
            raise ModelError(f"'{model.name}': {name} is for no Var. The keys of spread are Vars or their names.")
        if isinstance(number, bool) or not isinstance(number, (int, float)) or not 0.0 <= number < float("inf"):
            raise ModelError(f"'{model.name}': {name} is {number!r}; expected a finite number >= 0.")
        found[None if component is None else id(component.parent_component())] = float(number)
    return found
