"""Proxies of a model that a rule is evaluated with: signals stand in place of indexed variables.

A rule was written for nodes: ``rule(block, t)`` reads ``block.x[t]``. Given a `BlockProxy` for the block, what it reads
at ``t`` is what `Signals` have for it: an interpolated expression, a placeholder, a variable that holds a value. An
template follows an indexed `Expression` through its own rule. Everything else of the model is itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pyomo.core.base.block import BlockData
from pyomo.core.base.indexed_component import IndexedComponent

from pyrobocop_pyomo.errors import ModelError, ObstacleError, PyRobocopError

from .rule_slips import slip_of
from .variable_families import VariableFamily


class _Index:
    """Marks the place of ``t`` among the indices of a component."""

    def __repr__(self) -> str:
        return "t"


INDEX = _Index()


@dataclass(frozen=True)
class Signal:
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
        """Equal for two signal that are the same variables."""
        return (id(self.component), *self.keys)

    @property
    def name(self) -> str:
        """As the user writes it: ``push.x[t]``."""
        return f"{self.component.name}[{', '.join(map(str, self.keys))}]"

    def key_at(self, time: Any) -> Any:
        """The index of the component at a time."""
        keys = tuple(time if key is INDEX else key for key in self.keys)
        return keys if len(keys) > 1 else keys[0]

    def at(self, time: Any) -> Any:
        """The variable at a node.

        Raises
        ------
        ObstacleError
            When there is none.
        """
        try:
            return self.component[self.key_at(time)]
        except KeyError:
            raise ObstacleError(
                f"'{self.name}': has no value at t = {time!r}, where a pose needs it. Poses may read what has a value "
                "at every node, such as the states of a phase."
            ) from None


class Signals:
    """What a rule gets as ``t``, and what it then reads.

    Attributes
    ----------
    index : object
        Passed to the rule as ``t``.
    error : type of exception
        What a reading raises that cannot be answered.
    """

    index: Any
    error: type[PyRobocopError] = ObstacleError

    def is_index(self, key: Any) -> bool:
        """Whether an index that the rule uses is that ``t``."""
        # By identity: another label, such as the number of a joint, may be the same number.
        return key is self.index

    def value_of(self, signal: Signal) -> Any:
        """What the rule reads of an indexed component at ``t``."""
        raise NotImplementedError

    def time_at(self, block: Any) -> Any:
        """The time that ``t`` stands for on a phase."""
        raise NotImplementedError

    def delayed_value(self, component: Any, t: Any, delay: Any) -> Any:
        """What the rule reads of a variable over time a while before ``t``."""
        raise self.error(
            f"'{component.name}' is read at an earlier time (delayed), which has no answer between the nodes here."
        )

    def scalar(self, component: Any) -> Any:
        """What the rule reads of a component without index."""
        return component

    def proxy_of(self, block: Any) -> BlockProxy:
        """The proxy of a block."""
        return BlockProxy(block, self)

    @cached_property
    def checked_expressions(self) -> set[tuple[int, tuple[Any, ...]]]:
        """Indexed expressions that are known to be what their templates say: identities, and keys."""
        return set()


class BlockProxy:
    """Proxy of a block; see the module."""

    def __init__(self, block: Any, signals: Signals) -> None:
        self._block = block
        self._signals = signals

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        # Kept, because rules use what they read as keys: ``rates[b.x]``.
        found = self.__dict__[name] = proxy_of(getattr(self._block, name), self._signals)
        return found

    def time_at(self, t: Any) -> Any:
        """Real time of an index, as `PhaseBlock.time_at` gives it."""
        return self._signals.time_at(self._block) if self._signals.is_index(t) else self._block.time_at(t)

    def component(self, name: str) -> Any:
        """Component by name, as every block gives it."""
        return None if self._block.component(name) is None else getattr(self, name)

    def parent_block(self) -> Any:
        """The block above."""
        return proxy_of(self._block.parent_block(), self._signals)

    def model(self) -> Any:
        """The block at the top."""
        return proxy_of(self._block.model(), self._signals)


class ComponentProxy:
    """Proxy of an indexed component."""

    def __init__(self, component: Any, signals: Signals) -> None:
        self._component = component
        self._signals = signals

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._component, name)

    def __getitem__(self, key: Any) -> Any:
        keys = key if isinstance(key, tuple) else (key,)
        marked = tuple([INDEX if self._signals.is_index(index) else index for index in keys])
        if any(index is INDEX for index in marked):
            return self._signals.value_of(Signal(self._component, marked))
        if any(getattr(index, "is_potentially_variable", bool)() for index in keys):
            raise ObstacleError(
                f"'{self._component.name}' is read at an index that is computed from t ({', '.join(map(str, keys))}). "
                "A pose may read variables at t itself only."
            )
        return proxy_of(self._component[key], self._signals)

    def delayed(self, t: Any, delay: Any) -> Any:
        """Its value a while ago, as a variable over the time of a phase gives it."""
        return self._signals.delayed_value(self._component, t, delay)

    def __len__(self) -> int:
        return len(self._component)

    def __iter__(self) -> Any:
        return iter(self._component)


def proxy_of(found: Any, signals: Signals) -> Any:
    """What stands in place of a block, a component or a family of the model; anything else is itself."""
    if isinstance(found, BlockData):
        return signals.proxy_of(found)
    if isinstance(found, IndexedComponent):
        return ComponentProxy(found, signals) if found.is_indexed() else signals.scalar(found)
    return found.on(signals.proxy_of(found.parent_block())) if isinstance(found, VariableFamily) else found


def rule_result(rule: Any, block: Any, signals: Signals, label: str) -> Any:
    """The result of a rule for a pose or a length, evaluated with proxies.

    Raises
    ------
    ObstacleError
        Naming what the rule is about, when the rule cannot be evaluated so.
    """
    try:
        return rule(signals.proxy_of(block), signals.index)
    except ModelError as error:
        raise error if label in str(error) else type(error)(f"{label}: {error}") from error
    except Exception as error:
        if slip_of(rule, error, block, ("b", "t")) is not None:
            raise  # whoever asks explains it
        reason = f"{type(error).__name__}: {error}".splitlines()[0].rstrip(".")  # Pyomo adds paragraphs of advice
        raise ObstacleError(
            f"{label} cannot be asked between the nodes ({reason}). Its rule has to "
            "read variables through its first argument, not through the model, and to be made of Pyomo's functions: "
            "pyo.cos(t) instead of math.cos(t), no 'if' on t."
        ) from error
