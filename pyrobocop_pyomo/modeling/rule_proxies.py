"""What a rule for a pose is asked with between the nodes: the model, with signals in place of indexed variables.

A rule was written for nodes: ``rule(block, t)`` reads ``block.x[t]``. Given a `StandIn` for the block, what it reads at
``t`` is whatever a `Reader` answers: the interpolated expression at a point between nodes, or a placeholder.
An indexed `Expression` is followed
through its own rule. Everything else of the model is itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from pyomo.core.base.block import BlockData
from pyomo.core.base.expression import Expression
from pyomo.core.base.indexed_component import IndexedComponent
from pyomo.core.base.initializer import IndexedCallInitializer

from pyrobocop_pyomo.errors import ModelError, ObstacleError


class _Index:
    """Marks the place of ``t`` among the indices of a component."""

    def __repr__(self) -> str:
        return "t"


INDEX = _Index()


@dataclass(frozen=True)
class Series:
    """What ``component[..., t, ...]`` means for all ``t``.

    Attributes
    ----------
    component : indexed component
    keys : tuple
        Its indices, `INDEX` in place of ``t``.
    """

    component: Any
    keys: tuple[Any, ...]

    @property
    def identity(self) -> tuple[Any, ...]:
        """Equal for two series that are the same variables."""
        return (id(self.component), *self.keys)

    @property
    def name(self) -> str:
        """As the user writes it: ``push.x[t]``."""
        return f"{self.component.name}[{', '.join(map(str, self.keys))}]"

    def at(self, time: Any) -> Any:
        """The variable at a node.

        Raises
        ------
        ObstacleError
            When there is none.
        """
        keys = tuple(time if key is INDEX else key for key in self.keys)
        try:
            return self.component[keys if len(keys) > 1 else keys[0]]
        except KeyError:
            raise ObstacleError(
                f"'{self.name}': has no value at t = {time!r}, where a pose needs it. Poses may read what has a value "
                "at every node, such as the states of a phase."
            ) from None


class Reader(Protocol):
    """What a rule gets as ``t``, and what it then reads."""

    @property
    def index(self) -> Any:
        """Passed to the rule as ``t``."""

    def is_index(self, key: Any) -> bool:
        """Whether an index that the rule uses is that ``t``."""

    def read(self, series: Series) -> Any:
        """What the rule gets for an indexed component at ``t``."""

    def clock(self, block: Any) -> Any:
        """The time that ``t`` stands for on a phase."""


class StandIn:
    """Stands for a block; see the module."""

    def __init__(self, block: Any, reader: Reader) -> None:
        self._block = block
        self._reader = reader

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return _stand_in_for(getattr(self._block, name), self._reader)

    def clock(self, t: Any) -> Any:
        """Real time of an index, as `PhaseBlock.clock` gives it."""
        return self._reader.clock(self._block) if self._reader.is_index(t) else self._block.clock(t)

    def component(self, name: str) -> Any:
        """Component by name, as every block gives it."""
        return _stand_in_for(self._block.component(name), self._reader)

    def parent_block(self) -> Any:
        """The block above."""
        return _stand_in_for(self._block.parent_block(), self._reader)

    def model(self) -> Any:
        """The block at the top."""
        return _stand_in_for(self._block.model(), self._reader)


class IndexedStandIn:
    """Stands for an indexed component."""

    def __init__(self, component: Any, reader: Reader) -> None:
        self._component = component
        self._reader = reader

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._component, name)

    def __getitem__(self, key: Any) -> Any:
        keys = key if isinstance(key, tuple) else (key,)
        marked = tuple(INDEX if self._reader.is_index(each) else each for each in keys)
        if any(each is INDEX for each in marked):
            return self._formula(key) if self._has_formula else self._reader.read(Series(self._component, marked))
        if any(getattr(each, "is_potentially_variable", bool)() for each in keys):
            raise ObstacleError(
                f"'{self._component.name}' is read at an index that is computed from t ({', '.join(map(str, keys))}). "
                "A pose may read variables at t itself only."
            )
        return _stand_in_for(self._component[key], self._reader)

    @property
    def _has_formula(self) -> bool:
        # Pyomo has no public question for the rule that an Expression was made by.
        return self._component.ctype is Expression and isinstance(self._component._rule, IndexedCallInitializer)

    def _formula(self, key: Any) -> Any:
        """A named expression at ``t``: its own rule, asked as the rule of the pose is."""
        return self._component._rule(StandIn(self._component.parent_block(), self._reader), key)

    def __len__(self) -> int:
        return len(self._component)

    def __iter__(self) -> Any:
        return iter(self._component)


def _stand_in_for(found: Any, reader: Reader) -> Any:
    if isinstance(found, BlockData):
        return StandIn(found, reader)
    if isinstance(found, IndexedComponent) and found.is_indexed():
        return IndexedStandIn(found, reader)
    return found


def ask(rule: Any, block: Any, reader: Reader, name: str) -> Any:
    """The answer of a rule for a pose, asked with stand-ins.

    Raises
    ------
    ObstacleError
        Naming the body, when the rule cannot be asked so.
    """
    try:
        return rule(StandIn(block, reader), reader.index)
    except ModelError as error:
        raise type(error)(f"the pose of '{name}': {error}") from error
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0].rstrip(".")  # Pyomo adds paragraphs of advice
        raise ObstacleError(
            f"the pose of '{name}' cannot be asked between the nodes ({reason}). Its rule has to "
            "read variables through its first argument, not through the model, and to be made of Pyomo's functions: "
            "pyo.cos(t) instead of math.cos(t), no 'if' on t."
        ) from error
