"""What a pose rule reads, asked before anything has a value: by placeholders, and twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyomo.common.modeling import unique_component_name
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import native_numeric_types
from pyomo.core.expr.visitor import identify_mutable_parameters

from pyrobocop_pyomo.errors import ObstacleError
from pyrobocop_pyomo.geometry import Pose
from pyrobocop_pyomo.modeling.rule_proxies import Signal, Signals, rule_result
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.numerics.rounding import NEGLIGIBLE

from .expression_values import ExpressionValues
from .motion import Motion
from .pose_rules import asked_pose

# Values of the placeholders, in the two askings and in the comparison: a rule that takes one of them gives itself away.
_FIRST, _SECOND, _COMPARED = 0.31, 0.47, 0.39


@dataclass(frozen=True, eq=False)
class PoseReading:
    """What the pose of a body is a formula of.

    Attributes
    ----------
    pose : Pose
        In placeholders for whatever is read at ``t``, and in the model's own variables without ``t``.
    index, time : Var
        Placeholders of ``t`` and of ``time_at(t)``.
    signals : tuple of Signal
        What is read at ``t``.
    """

    pose: Pose
    index: Any
    time: Any
    signals: tuple[Signal, ...]
    _placeholders: Any  # keeps their owner alive

    @property
    def variables(self) -> list[Any]:
        """Variables of the formulas, placeholders included."""
        return _variables(self.pose.entries)

    @property
    def reads_index(self) -> bool:
        """Whether the pose depends on ``t`` as a number."""
        return any(variable is self.index for variable in self.variables)

    @property
    def reads_time(self) -> bool:
        """Whether the pose depends on ``time_at(t)``."""
        return any(variable is self.time for variable in self.variables)

    @property
    def parameters(self) -> list[Any]:
        """Mutable parameters of the formulas."""
        expressions = [entry for entry in self.pose.entries if entry.__class__ not in native_numeric_types]
        return [parameter for entry in expressions for parameter in identify_mutable_parameters(entry)]

    @property
    def stands_still(self) -> bool:
        """Whether nothing can move the body: neither a variable, nor a parameter, nor time."""
        return not self.variables and not self.parameters

    @property
    def turns(self) -> bool:
        """Whether the rotation changes in time."""
        own = {id(variable) for variable in self._placeholders.component_data_objects(Var)}
        rotation = [entry for row in self.pose.rotation for entry in row]
        return any(id(variable) in own for variable in _variables(rotation))

    def values(self, replaced: dict[int, float]) -> np.ndarray | None:
        """Entries with other values of some variables, by identity; None where they cannot be evaluated."""
        leaves = {id(variable): np.array([_COMPARED]) for variable in self.variables} | {
            key: np.array([number]) for key, number in replaced.items()
        }
        known = ExpressionValues(leaves)
        try:
            with np.errstate(all="ignore"):
                return np.array([np.broadcast_to(known.of(entry), 1)[0] for entry in self.pose.entries], dtype=float)
        except (ObstacleError, ArithmeticError):
            return None


def read_pose(motion: Motion, rule: Callable[..., Any], name: str) -> PoseReading:
    """Ask a pose rule with placeholders, twice with other values of these.

    Parameters
    ----------
    motion : Motion
        With intervals.
    rule : callable
        ``rule(block, t)``, as for a `Body`.
    name : str
        Name of the body in messages.

    Raises
    ------
    ObstacleError
        Naming the body, when the rule cannot be asked between the nodes, reads there what has no motion between plain
        numbers, or goes by the *value* of what it reads.
    """
    first, second = (_asked(motion, rule, name, number) for number in (_FIRST, _SECOND))
    one, other = first.values({}), second.values({})
    same_reading = [signal.identity for signal in first.signals] == [signal.identity for signal in second.signals]
    if same_reading and (
        one is None or other is None or np.allclose(one, other, rtol=NEGLIGIBLE, atol=NEGLIGIBLE, equal_nan=True)
    ):
        return first
    raise ObstacleError(
        f"the pose of '{name}' goes by the value that t or a variable has at the moment, as by pyo.value(t): the "
        "result then does not follow it. Compute with t and with the variables themselves, by Pyomo's functions."
    )


def _asked(motion: Motion, rule: Callable[..., Any], name: str, number: float) -> PoseReading:
    probe = _Probe(motion, number)
    pose = asked_pose(lambda: rule_result(rule, motion.block, probe, f"the pose of '{name}'"), rule, motion.block, name)
    return PoseReading(pose, probe.index, probe.time, tuple(probe.signals), probe.owner)


class _Probe(Signals):
    """Placeholders without any meaning but their name, all with the same value."""

    def __init__(self, motion: Motion, number: float) -> None:
        self.owner = ConcreteModel()
        self.index, self.time = self._placeholder("t", number), self._placeholder("time_at(t)", number)
        self.signals: list[Signal] = []
        self._motion = motion
        self._number = number
        self._known: dict[Any, Any] = {}

    def _placeholder(self, name: str, number: float) -> Any:
        placeholder = Var(initialize=number)
        # Messages quote formulas: the placeholder has the user's name.
        self.owner.add_component(unique_component_name(self.owner, name), placeholder)
        return placeholder

    def value_of(self, signal: Signal) -> Any:
        if signal.identity not in self._known:
            assert self._motion.interpolation is not None
            self._motion.interpolation.check_early(signal)
            self.signals.append(signal)
            self._known[signal.identity] = self._placeholder(signal.name, self._number)
        return self._known[signal.identity]

    def time_at(self, block: Any) -> Any:
        assert self._motion.interpolation is not None
        if not self._motion.interpolation.is_time_of(block):
            raise ObstacleError(f"time_at(t) is read from '{block.name}', whose time is not that of the set of points.")
        return self.time


def _variables(entries: list[Any]) -> list[Any]:
    found: dict[int, Any] = {}
    for entry in entries:
        if entry.__class__ not in native_numeric_types:
            found |= {id(variable): variable for variable in variables_in(entry, include_fixed=True)}
    return list(found.values())
