"""Random starts: values drawn around the initial guess, smooth over time where a variable belongs to a phase."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pyomo.core.base.var import Var

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.modeling.variable_values import within_bounds
from pyrobocop_pyomo.phases import PhaseBlockData
from pyrobocop_pyomo.programs.nonlinear_program import FloatArray

WAVES = 4  # cosines in a curve over time: enough to change its shape, few enough to stay near the dynamics


class RandomStarts:
    """Draws values for the free variables of a model.

    Parameters
    ----------
    model : Block
        Its values are the initial guess.
    seed : int
    spreads : mapping from int or None to float
        How far from the initial guess, as a multiple of the distance to the bounds or of its own size: by the
        identity of a component, None for all others.

    Raises
    ------
    ModelError
        If no free variable is left to vary.
    """

    def __init__(self, model: Any, seed: int, spreads: Mapping[int | None, float]) -> None:
        self._seed = seed
        self._groups: list[tuple[list[Any], FloatArray, FloatArray, FloatArray, bool]] = []
        for component in model.component_objects(Var, active=True):
            factor = spreads.get(id(component), spreads.get(None, 0.0))
            members = [member for member in component.values() if not member.fixed]
            if factor <= 0.0 or not members:
                continue
            guess = np.array([_initial_guess(member) for member in members])
            reach = np.maximum(1.0, np.abs(guess))
            lower = np.array([-np.inf if member.lb is None else member.lb for member in members])
            upper = np.array([np.inf if member.ub is None else member.ub for member in members])
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
    # Uniform in its size as well: without the division the curves would crowd around the initial guess.
    curve = weights @ waves
    return np.asarray(curve / max(np.abs(curve).max(), 1e-12) * generator.uniform())


def _initial_guess(variable: Any) -> float:
    """The value, moved within the bounds; without a finite value, the number nearest to zero within them."""
    known = variable.value is not None and np.isfinite(variable.value)
    return within_bounds(float(variable.value) if known else 0.0, variable)
