"""`Engine`: where agents of a team and solvers of a study live, and how they come back when a worker dies."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EngineError, PyRobocopError
from pyrobocop_pyomo.modeling.failures import undone_on_failure

from .worker_host import Answer, HostedSpec, Lost, Request, WorkerHost, packed

_LOGGER = logging.getLogger(__name__)

Exchange = tuple[dict[str, Answer], dict[str, Lost]]
State = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class AgentFailure:
    """In place of a report: why an agent has none.

    Attributes
    ----------
    agent : str
    reason : str
        Type and text of its exception, or how its worker ended.
    final : bool
        Whether the engine has given it up, because its workers died too often. Otherwise it may be asked again.
    traceback : str
        Of the exception, where there was one.
    """

    agent: str
    reason: str
    final: bool = False
    traceback: str = ""


class Engine(ABC):
    """Where the agents of a team live: the same orders give the same reports on every engine.

    Tasks of a study are done there too: then the agents are solvers that differ in nothing but their names
    (`run_tasks`).

    An agent is built where it is solved, and stays there; only orders, reports and states travel. Use an engine as a
    context, or call `stop`: no process outlives it.

    **Death of a worker.** The state of an agent comes along with each of its reports. When its worker dies, it is built
    again elsewhere, put into the last state, and asked again what it had not answered. Its solves are deterministic, so
    it goes on as if nothing had happened, bit by bit. Agents whose workers die more than `deaths_allowed` times are
    given up: each later report of theirs is an `AgentFailure`.

    Parameters
    ----------
    deaths_allowed : int
        How often the worker of an agent may die, and of one task of a study.
    answer_within : float
        Seconds without an answer of anybody after which the workers that still owe one count as dead.

    Attributes
    ----------
    name : str
    deaths : Counter
        How often the worker of each agent died, while the agent was at work.
    writes_files : bool
        Whether this process is the one of its team that writes files. It is, except on all but one rank of MPI.

    Raises
    ------
    EngineError
        When one of these is no such number.
    """

    name: str
    writes_files = True
    _keeps_states = True

    def __init__(self, *, deaths_allowed: int = 2, answer_within: float = 600.0) -> None:
        if deaths_allowed < 0:
            raise EngineError(f"engine '{self.name}': deaths_allowed = {deaths_allowed!r}; expected 0 or more.")
        if not answer_within > 0:
            raise EngineError(f"engine '{self.name}': answer_within = {answer_within!r}; expected a positive number.")
        self.answer_within, self.deaths_allowed = answer_within, deaths_allowed
        self._forget()

    def _forget(self) -> None:
        self.deaths: Counter[str] = Counter()
        self._specs: dict[str, Request] = {}  # by which agents are built
        self._states: dict[str, bytes] = {}
        self._given_up: dict[str, AgentFailure] = {}
        self._returning: dict[str, Lost] = {}  # lost agents that are being built again

    # ---------------------------------------------------------------- what an engine is made of

    @abstractmethod
    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        """Make homes for these agents."""

    @abstractmethod
    def submit(self, request: Request) -> None:
        """Begin with a request, or let it wait where its agent's home is at work; at most one for each agent."""

    @abstractmethod
    def wait(self, timeout: float | None = None) -> Exchange:
        """Wait until something has come of the requests; both are empty when that takes longer than so many seconds.

        Returns
        -------
        tuple of dicts
            Answers, by agent; and all agents whose homes have ended, also those that had answered before and those that
            were not asked. One of each home was at work.
        """

    def respawn(self, agents: Sequence[str]) -> None:  # noqa: B027  # an engine that loses nobody needs none
        """Make new homes for agents that were lost."""

    def places(self, most: int) -> int:
        """How many agents can solve side by side, at most so many."""
        return 1

    def agreed(self, decision: bool) -> bool:
        """What is decided by all processes that run the same script, where one asks its own clock."""
        return decision

    @abstractmethod
    def _close(self) -> None:
        """End everything that was opened; also after half an opening, and twice."""

    # ---------------------------------------------------------------- what a coordinator asks

    def start(self, specs: Iterable[HostedSpec]) -> dict[str, Any]:
        """Build all agents.

        Parameters
        ----------
        specs : iterable of HostedSpec
            Each with a ``name`` and a method ``build()``.

        Returns
        -------
        dict of agent's name to what its ``facts()`` gave

        Raises
        ------
        EngineError
            When two agents have one name, one cannot be sent to a worker, or building it raises an exception.
            Exceptions of this package keep their class.
        """
        specs = list(specs)
        for name, count in Counter(spec.name for spec in specs).items():
            if count > 1:
                raise EngineError(f"{count} agents have the name '{name}'. Give each agent a name of its own.")
        if self._specs:
            self.stop()
        self._forget()
        if not specs:
            raise EngineError(f"engine '{self.name}': there are no agents to start.")
        self._specs = {spec.name: self._build_request(spec) for spec in specs}
        with undone_on_failure(self.stop):  # what its workers do then is not known any more
            self._open({spec.name: spec for spec in specs})
            facts = self._answers(self._specs, "could not be built")
            for failure in self._given_up.values():
                raise EngineError(f"agent '{failure.agent}' could not be built: {failure.reason}")
            return facts

    def solve(self, orders: Mapping[str, Any]) -> dict[str, Any]:
        """One round: have each of these agents solve its order, side by side.

        Parameters
        ----------
        orders : mapping of agent's name to its order

        Returns
        -------
        dict of agent's name to its report, or to an `AgentFailure`
        """
        return self._answers(self._requests("solve", {name: (order,) for name, order in orders.items()}), None)

    def states(self) -> dict[str, dict[str, np.ndarray]]:
        """The states of all agents that are not given up."""
        return self.call_all("state", dict.fromkeys(self._specs, ()))

    def restore(self, states: Mapping[str, State]) -> None:
        """Put agents into states; agents without one stay as they are.

        Raises
        ------
        EngineError
            When an agent is unknown or given up, or refuses its state.
        """
        self.call_all("restore", {name: (dict(state),) for name, state in states.items()})
        for name, failure in self._given_up.items():
            if name in states:
                raise EngineError(f"agent '{name}' is given up ({failure.reason}) and cannot be restored. Start anew.")

    def call_all(self, method: str, arguments: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
        """Call a method of several agents' problems, side by side.

        Parameters
        ----------
        method : str
        arguments : mapping of agent's name to tuple

        Returns
        -------
        dict of agent's name to what the method gave; agents that are given up are left out

        Raises
        ------
        EngineError
            When the method raises an exception. Exceptions of this package keep their class.
        """
        found = self._answers(self._requests(method, arguments), f"{method}() failed")
        return {name: value for name, value in found.items() if name not in self._given_up}

    def _requests(self, method: str, arguments: Mapping[str, tuple[Any, ...]]) -> dict[str, Request]:
        return {
            name: Request.of(name, method, *given, with_state=self._keeps_states) for name, given in arguments.items()
        }

    def end_silent_workers(self) -> None:  # noqa: B027 - an engine without other processes has none
        """Give up workers that owe an answer, such as stopped ones; `wait` then tells which were lost."""

    def hear(self, timeout: float | None = None) -> Exchange | None:
        """Wait until something has come of the requests. Lost agents are built again before it is told.

        Returns
        -------
        tuple of dicts, or None
            Answers; and agents whose requests were lost, with how that came. They are again as they were before these,
            unless they are given up now. None where nothing came within so many seconds.
        """
        answers, lost = self.wait(timeout)
        if not answers and not lost:
            return None
        told: dict[str, Lost] = {}
        for name in [name for name in answers if name in self._returning]:
            answer, loss = answers.pop(name), self._returning.pop(name)
            if answer.raised:
                lost[name] = Lost(f"it could not be built again: {answer.raised}", at_work=True)
            else:
                told[name] = loss
        told.update(self._bring_back(lost))
        return answers, told

    def stop(self) -> None:
        """End all workers. What was counted can still be read."""
        self._specs = {}
        self._close()

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()

    # ---------------------------------------------------------------- death and recovery

    def _ask(self, requests: Mapping[str, Request]) -> dict[str, Answer | AgentFailure]:
        """Have requests answered, whatever workers die meanwhile."""
        self._check(requests)
        replies: dict[str, Answer | AgentFailure] = {}
        with undone_on_failure(self.stop):  # what its workers do then is not known any more
            for name, request in requests.items():
                if name in self._given_up:
                    replies[name] = self._given_up[name]
                else:
                    self.submit(request)
            while len(replies) < len(requests) or self._returning:
                heard = self.hear(self.answer_within)
                if heard is None:
                    _LOGGER.warning("engine '%s': no answer within %g s", self.name, self.answer_within)
                    self.end_silent_workers()
                    continue
                answers, lost = heard
                for name, answer in answers.items():
                    replies[name] = answer
                    if answer.state is not None:
                        self._states[name] = answer.state
                for name in [name for name in lost if name in requests and name not in replies]:
                    if name in self._given_up:
                        replies[name] = self._given_up[name]
                    else:
                        self.submit(requests[name])
        return {name: replies[name] for name in requests}

    def _bring_back(self, lost: Mapping[str, Lost]) -> dict[str, Lost]:
        """Begin to build lost agents again, in their last states; gives those whose workers died too often."""
        given_up: dict[str, Lost] = {}
        for name, loss in lost.items():
            if name in self._given_up:
                continue
            self.deaths.update([name] * loss.at_work)
            if self.deaths[name] > self.deaths_allowed:
                reason = f"its worker died {self.deaths[name]} times; {loss.reason}"
                given_up[name], self._given_up[name] = loss, AgentFailure(name, reason, final=True)
                self._returning.pop(name, None)
                _LOGGER.error("agent '%s' is given up: %s", name, reason)
            else:
                self._returning[name] = loss
                _LOGGER.warning("agent '%s' is built again: %s", name, loss.reason)
        names = [name for name in lost if name in self._returning]
        self.respawn(names)
        for name in names:
            self.submit(replace(self._specs[name], state=self._states.get(name)))
        return given_up

    # ---------------------------------------------------------------- small things

    def _build_request(self, spec: HostedSpec) -> Request:
        """What has an agent built, with its spec, by workers that have memory of their own."""
        return Request(spec.name, "build", packed(f"agent '{spec.name}'", (spec,), "engine='serial'", EngineError))

    def _check(self, names: Iterable[str]) -> None:
        if not self._specs:
            raise EngineError(f"engine '{self.name}' has no agents: it was not started, or it was stopped. Start it.")
        unknown = [name for name in names if name not in self._specs]
        if unknown:
            raise EngineError(f"no agent '{unknown[0]}'; the agents are {', '.join(self._specs)}.")

    def _answers(self, requests: Mapping[str, Request], label: str | None) -> dict[str, Any]:
        """What agents gave; what one raised is raised here, or is a failure where nothing is said of it."""
        found: dict[str, Any] = {}
        for name, reply in self._ask(requests).items():
            if isinstance(reply, AgentFailure):
                found[name] = reply
            elif not reply.raised:
                found[name] = reply.value
            elif label is None:
                found[name] = AgentFailure(name, reply.raised, traceback=reply.traceback)
            else:
                other = EngineError(f"agent '{name}' {label}: {reply.raised}")
                raise reply.error(PyRobocopError, other, f"agent '{name}'")
        return found


class EngineWithHost(Engine):
    """An engine whose agents live in this process: specs need not be sent, and nobody is lost."""

    _keeps_states = False

    def __init__(self) -> None:
        super().__init__()
        self._close()

    def submit(self, request: Request) -> None:
        """Let a request wait for its turn."""
        self._submitted.append(request)

    def _build_request(self, spec: HostedSpec) -> Request:
        return Request.of(spec.name, "build")

    def _open(self, specs: Mapping[str, HostedSpec]) -> None:
        self._host, self._submitted = WorkerHost(specs), list[Request]()

    def _close(self) -> None:
        self._open({})
