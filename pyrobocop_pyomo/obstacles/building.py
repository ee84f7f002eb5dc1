"""Building the blocks of this folder: from their arguments, or by a rule that says them; whole or not at all."""

from __future__ import annotations

import copy
from collections.abc import Callable, Hashable, Iterable
from typing import Any

from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import BlockData
from pyomo.core.base.set import Set

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.phases.pickling import picklable_or_none

Rule = Callable[..., Any]


class BuildByArguments:
    """The block rule: our build, or the user's rule, which asks for it. A class, because it must survive pickling."""

    def __init__(self, points: Any, options: dict[str, Any], rule: Rule | None) -> None:
        self.points = points
        self.options = options
        self.rule = rule

    def __call__(self, block: Any, *index: Hashable) -> None:
        """Build one block."""
        if self.rule is None:
            block.build(self.points, **self.options)
            return
        # Pyomo passes the index None to a rule of a scalar block that takes any number of arguments.
        self.rule(block, *(index if block.parent_component().is_indexed() else ()))
        if not block.is_built:
            raise ObstacleError(f"'{block.name}': its rule has to call block.build(points, ...), and did not.")

    def __deepcopy__(self, memo: dict[int, Any]) -> BuildByArguments:
        # Points are components of the model; the rest is the user's own and stays what it is.
        return BuildByArguments(copy.deepcopy(self.points, memo), self.options, self.rule)

    def __getstate__(self) -> dict[str, Any]:
        # A block that is built needs none of this again; one that is not needs rules that a pickle can hold.
        options = {name: each for name, each in self.options.items() if picklable_or_none(each) is not None}
        return {"points": self.points, "options": options, "rule": picklable_or_none(self.rule)}


def sort_arguments(
    what: str, positional: tuple[Any, ...], options: dict[str, Any], rule: Rule | None
) -> tuple[tuple[Any, ...], BuildByArguments]:
    """Index sets of a block, and what builds it.

    Parameters
    ----------
    what : str
        Name of the class.
    positional : tuple
        One set of points, or with a rule index sets.
    options : dict
        Arguments of ``build``.
    rule : callable or None

    Raises
    ------
    ObstacleError
        When both a rule and arguments are given, or not one set of points.
    """
    if rule is not None:
        given = [name for name in ("bodies", "body", "pose", "obstacles", "region") if options.get(name) is not None]
        if given:
            raise ObstacleError(
                f"{what} with rule= takes index sets only, and was given {', '.join(given)}. The rule says the rest: "
                "block.build(points, ...)."
            )
        return positional, BuildByArguments(None, {}, rule)
    if len(positional) != 1:
        raise ObstacleError(
            f"{what} takes one set of points, such as phase.time, and was given {len(positional)}. "
            "An indexed one takes index sets and rule=."
        )
    return (), BuildByArguments(positional[0], options, None)


class BuiltWhole(BlockData):
    """Base of blocks that are built once, by `build`, and on any error not at all."""

    @property
    def is_built(self) -> bool:
        """True once `build` has succeeded."""
        raise NotImplementedError

    @property
    def _what(self) -> str:
        raise NotImplementedError

    def build(self, points: Any, **options: Any) -> None:
        """State everything; for rules of indexed blocks, with the arguments of the class.

        Raises
        ------
        ObstacleError
            When the arguments contradict themselves; nothing is then left on the block.
        """
        if self.is_built:
            raise ObstacleError(f"{self._what} is built already.")
        before = set(self.component_map())
        try:
            with PauseGC():
                if not hasattr(points, "ctype"):
                    if not isinstance(points, Iterable):
                        raise ObstacleError(
                            f"{self._what}: its points are {points!r}; expected a set of times, such as phase.time."
                        )
                    self.points = points = Set(initialize=list(points), ordered=True, doc="times that were given")
                self._build(points, options)
        except BaseException:
            for name in [name for name in self.component_map() if name not in before]:
                self.del_component(name)
            self._forget()
            raise

    def _build(self, points: Any, options: dict[str, Any]) -> None:
        raise NotImplementedError

    def _forget(self) -> None:
        raise NotImplementedError
