"""What a team is made of: agents, the quantities that they share, and what keeps them apart."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike
from pyomo.core.base.constraint import Constraint
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Any as AnyIndex

from pyrobocop_pyomo.errors import TeamError
from pyrobocop_pyomo.numerics.arrays import finite_numbers

_NAMES_ON_A_MERGED_MODEL = ("objective", "keep_apart", "agreement")
# Times the distance to keep: nearer robots are too near for a plan that holds, and the closing step moves them apart.
TOO_NEAR = 0.99

Penalty = Union[float, tuple[float, ...]]  # noqa: UP007


@dataclass(frozen=True, init=False)
class Agent:
    """One member of a team: how its model is built.

    The model is built where it is solved, and stays there. So the builder has to be a function of a module, and the
    data have to be such as can be pickled.

    Parameters
    ----------
    name : str
    builder : callable
        ``builder(*data)`` returns a ConcreteModel.
    *data
        What the builder is called with.

    Raises
    ------
    TeamError
        When the name is empty or one that models have for something else, or the builder is not callable.
    """

    name: str
    builder: Callable[..., Any]
    data: tuple[Any, ...]

    def __init__(self, name: str, builder: Callable[..., Any], *data: Any) -> None:
        if not isinstance(name, str) or not name:
            raise TeamError(f"an agent needs a name; {name!r} is none.")
        if hasattr(ConcreteModel(), name) or name in _NAMES_ON_A_MERGED_MODEL:
            raise TeamError(f"no agent can be called '{name}': models have that name for something else. Take another.")
        if not callable(builder):
            raise TeamError(
                f"agent '{name}': its builder {builder!r} cannot be called. Give a function that builds its model."
            )
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "builder", builder)
        object.__setattr__(self, "data", data)


@dataclass(frozen=True, init=False)
class Shared:
    """Quantities that several agents have in their models under the same names, and have to agree on.

    Parameters
    ----------
    *components : str
        Names of components, such as ``"body.qx"``. A block stands for all its variables. ``{robot}`` stands for the
        name of one robot: ``"push[{robot}]"`` is shared by that robot and the hub only.
    penalty : float or sequence of floats
        Weight of a disagreement, in units of the objective over the square of the quantity's unit; a sequence has one
        for each of the variables that the components stand for, in their order.

    Raises
    ------
    TeamError
        When nothing is named, or the penalty is not positive.
    """

    components: tuple[str, ...]
    penalty: Penalty

    def __init__(self, *components: str, penalty: float | ArrayLike = 1.0) -> None:
        if not components or not all(isinstance(name, str) and name for name in components):
            raise TeamError(f"Shared{components!r}: name one component or several, such as 'body.qx'.")
        label = f"Shared({', '.join(map(repr, components))})"
        weights = finite_numbers(penalty, f"{label}: penalty", TeamError)
        if weights.ndim > 1 or weights.size == 0:
            raise TeamError(f"{label}: penalty = {penalty!r}; expected a number, or one for each variable.")
        if weights.min() <= 0:
            raise TeamError(
                f"{label}: the penalty is not positive: its least weight is {weights.min():g}. Every disagreement has "
                "to cost something."
            )
        object.__setattr__(self, "components", components)
        object.__setattr__(self, "penalty", tuple(weights.tolist()) if weights.ndim else float(weights))

    def names_for(self, robot: str) -> tuple[str, ...]:
        """The names of the components with the name of a robot put in."""
        # Quoted within brackets: '1' would be taken for the number 1.
        return tuple(name.replace("[{robot}]", f"[{robot!r}]").replace("{robot}", robot) for name in self.components)

    @property
    def of_one_robot(self) -> bool:
        """Whether one robot and the hub share it, and not everybody."""
        return any("{robot}" in name for name in self.components)


@dataclass(frozen=True)
class KeepApart:
    """Robots that keep a distance from each other.

    Where a closing step follows the rounds, it keeps them apart. Without one, robots do not see each other's unknowns,
    so their distance is bounded with the positions of the round before; where the rounds converge, it holds in the end.
    A plan in which two robots are nearer, by more than a hundredth, is no success.

    Attributes
    ----------
    components : tuple of str
        Names of the coordinates of a robot's position in its model, each indexed by time, such as ``("me.x", "me.y")``.
    distance : float
        Least distance of two positions, metres.
    neighbours : int
        How many others a robot heeds at each time, the nearest first. It bounds the size of a robot's problem.
    """

    components: tuple[str, ...]
    distance: float
    neighbours: int = 3

    def __post_init__(self) -> None:
        """Refuse a number that is no distance."""
        object.__setattr__(self, "components", tuple(self.components))
        if not self.components:
            raise TeamError("KeepApart: name the coordinates of a robot's position, such as ('me.x', 'me.y').")
        if not (np.isfinite(self.distance) and self.distance > 0):
            raise TeamError(f"KeepApart: distance = {self.distance!r}; expected a positive number.")
        if self.neighbours < 1:
            raise TeamError(f"KeepApart: neighbours = {self.neighbours!r}; expected at least 1.")

    def least_distance(self, plans: Mapping[str, Mapping[str, Any]], robots: Collection[str]) -> float:
        """Least distance of two robots at any time of their plans, metres.

        Parameters
        ----------
        plans : mapping of agent to (mapping of component to float array)
        robots : collection of str

        Returns
        -------
        float
            NaN where a robot has no plan, infinite where there are no two.
        """
        if not plans.keys() >= set(robots):
            return float("nan")
        places = [np.array([plans[name][component] for component in self.components]) for name in robots]
        gaps = [np.linalg.norm(one - other, axis=0).min() for one, other in combinations(places, 2)]
        return float(min(gaps, default=np.inf))

    def holds(self, plans: Mapping[str, Mapping[str, Any]], robots: Collection[str]) -> bool:
        """Whether no two robots are too near in their plans, as far as all have one."""
        return self.least_distance(plans, robots) >= TOO_NEAR * self.distance

    def constrain(self, model: Any, parts: Sequence[Any], within: float = np.inf) -> int:
        """Add rows that keep the robots of one model apart, beside those that it has.

        Parameters
        ----------
        model : ConcreteModel
        parts : sequence of blocks
            One for each robot, in which the coordinates have their names.
        within : float, optional
            Only where two robots are nearer than this now, and at the times beside, metres.

        Returns
        -------
        int
            How many rows are new.
        """
        positions = [[part.find_component(name) for name in self.components] for part in parts]
        keys = [key for key in positions[0][0] if any(not p[0][key].fixed for p in positions)]
        rows = model.component("keep_apart")
        if rows is None:
            rows = model.keep_apart = Constraint(AnyIndex)
        known = len(rows)
        for i, j in combinations(range(len(parts)), 2):
            for key in self._near(positions[i], positions[j], keys, within):
                index = (i, j, *(key if isinstance(key, tuple) else (key,)))
                if index not in rows:
                    apart = sum((a[key] - b[key]) ** 2 for a, b in zip(positions[i], positions[j], strict=True))
                    rows[index] = apart >= self.distance**2
        return len(rows) - known

    def _near(self, first: Sequence[Any], second: Sequence[Any], keys: Sequence[Any], within: float) -> list[Any]:
        if not np.isfinite(within):
            return list(keys)
        gaps = np.array([[a[key].value - b[key].value for key in keys] for a, b in zip(first, second, strict=True)])
        near = np.linalg.norm(gaps, axis=0) < within
        near = np.convolve(near, (1, 1, 1), "same") > 0  # at the times beside as well
        return [key for key, is_near in zip(keys, near, strict=True) if is_near]
