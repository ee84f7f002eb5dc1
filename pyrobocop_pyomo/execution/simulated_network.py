"""`SimulatedNetwork`: agents in this process behind a network that loses and delays their reports."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EngineError

from .engine import AgentFailure
from .serial_engine import SerialEngine


class SimulatedNetwork(SerialEngine):
    """The serial engine behind a network that loses some reports and delivers others late, the same ones in each run.

    A lost report is a failure of its agent in that round. A late agent is at work for some rounds: there is no report
    of it until then, and it gets its next order only afterwards.

    Parameters
    ----------
    lost : float
        Share of reports that are lost, below 1.
    late : mapping of agent to int
        Rounds that an agent is late.
    seed : int
        Of the random numbers that choose the lost reports.
    reliable : collection of str
        Agents whose reports are never lost, such as the hub where it lives with the coordinator.

    Raises
    ------
    EngineError
        When `lost` is no share, or a delay is negative.
    """

    name = "simulated network"

    def __init__(
        self, *, lost: float = 0.0, late: Mapping[str, int] | None = None, seed: int = 0, reliable: Collection[str] = ()
    ) -> None:
        super().__init__()
        self._late = dict(late or {})
        if not 0 <= lost < 1 or any(rounds < 0 for rounds in self._late.values()):
            raise EngineError(
                f"engine '{self.name}': lost = {lost!r}, late = {self._late!r}; expected 0 <= lost < 1 and no negative "
                "number of rounds."
            )
        self._lost, self._reliable = lost, frozenset(reliable)
        self._random = np.random.default_rng(seed)
        self._at_work: dict[str, tuple[int, Any]] = {}  # rounds that are left, and the report

    def solve(self, orders: Mapping[str, Any]) -> dict[str, Any]:
        """One round, in which some reports are lost, and others not there yet."""
        idle = {name: order for name, order in orders.items() if name not in self._at_work}
        for name, report in super().solve(idle).items():
            self._at_work[name] = self._late.get(name, 0), report
        return {name: self._delivered(name) for name in orders}

    def _delivered(self, name: str) -> Any:
        left, report = self._at_work.pop(name)
        if left:
            self._at_work[name] = left - 1, report
            return AgentFailure(name, "it is still at work")
        if name not in self._reliable and self._random.random() < self._lost:
            return AgentFailure(name, "its report was lost")
        return report
