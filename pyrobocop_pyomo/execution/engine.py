"""`Engine`: where agents of a team and solvers of a study live, and what happens when a worker dies."""

from __future__ import annotations

import logging
import os
from abc import abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

from pyrobocop_pyomo.errors import EngineError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import NO_DEADLINE, Deadline, stop_threads
from pyrobocop_pyomo.modeling.failures import undone_on_failure

from .worker_host import Answer, HostedSpec, Request, packed

_LOGGER = logging.getLogger(__name__)


def available_cores() -> int:
    """Cores that this process may use: fewer than the machine has where somebody has restricted it."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
    """

    agent: str
    reason: str
    final: bool = False


Reply = Answer | AgentFailure
Arguments = Mapping[str, tuple[Any, ...]]


class Engine(AbstractContextManager["Engine"]):
    """Where the agents of a team live: the same orders give the same reports on every engine.

    Tasks of a study are done there too (`run_tasks`).

    An engine has places, of which each does one request after the other. Agents are dealt out to them in turn. A
    request brings along all that it takes to answer it: by what its agent is built, and the state that it is in. So an
    agent is built where it is solved, and stays there as long as its worker lives. Use an engine as a context, or call
    `stop`: no process that it has started outlives it.

    **Death of a worker.** The state of an agent comes along with each of its reports. When its worker dies, what it
    had not answered is requested again, elsewhere, in the last state. Its solves are deterministic, so it goes on as if
    nothing had happened, bit by bit. Agents whose workers die more than `deaths_allowed` times are given up: each later
    report of theirs is an `AgentFailure`.

    Parameters
    ----------
    workers : int, optional
        How many agents can solve side by side. By default one for each agent, but no more than there are processors.
    deaths_allowed : int
        How often the worker of an agent may die, and of one task of a study.

    Attributes
    ----------
    name : str
    in_this_process : bool
        Whether agents live here: specs are not sent, and no state of theirs is ever needed again.
    deaths : Counter
        How often the worker of each agent died, while the agent was at work.

    Raises
    ------
    EngineError
        When one of these is no such number.
    """

    name: str
    in_this_process = False

    def __init__(self, workers: int | None = None, *, deaths_allowed: int = 2) -> None:
        if workers is not None and workers < 1:
            raise EngineError(f"engine '{self.name}': workers = {workers!r}; expected at least 1.")
        if deaths_allowed < 0:
            raise EngineError(f"engine '{self.name}': deaths_allowed = {deaths_allowed!r}; expected 0 or more.")
        self.workers, self.deaths_allowed = workers, deaths_allowed
        self.deaths: Counter[Any] = Counter()
        self._agents: dict[str, Request] = {}  # without anything to do, in their last states
        self._given_up: dict[str, AgentFailure] = {}

    # ---------------------------------------------------------------- what an engine is made of

    @abstractmethod
    def open(self, places: int) -> None:
        """Make so many places ready."""

    @abstractmethod
    def submit(self, request: Request) -> Future[Answer]:
        """Begin with a request at its place, which is idle; the future raises something where the worker was lost."""

    def replace_worker(self, place: int, error: Exception) -> str:
        """Make another worker ready in place of a lost one, whose future raised this; gives how it ended, in words."""
        return str(error) or repr(error)

    @abstractmethod
    def close(self) -> None:
        """End everything that was opened; also after half an opening, and twice."""

    def places(self, most: int) -> int:
        """How many requests are answered side by side, at most so many."""
        return min(most, self.workers or available_cores())

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
        self.stop()
        self.deaths, self._given_up = Counter(), {}
        if not specs:
            raise EngineError(f"engine '{self.name}': there are no agents to start.")
        places = self.places(len(specs))
        for number, spec in enumerate(specs):
            label = f"agent '{spec.name}'"
            sent = spec if self.in_this_process else packed(label, spec, "engine='serial'", EngineError)
            self._agents[spec.name] = Request(spec.name, sent, number % places, spec.name)
        with undone_on_failure(self.stop):
            self.open(places)
            facts = self._call("facts", dict.fromkeys(self._agents, ()), "could not be built", with_states=False)
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
        return self._call("solve", {name: (order,) for name, order in orders.items()})

    def states(self) -> dict[str, dict[str, Any]]:
        """The states of all agents that are not given up."""
        return self.call_all("state", dict.fromkeys(self._agents, ()))

    def restore(self, states: Mapping[str, Mapping[str, Any]]) -> None:
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

    def call_all(self, method: str, arguments: Arguments) -> dict[str, Any]:
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
        found = self._call(method, arguments, f"{method}() failed")
        return {name: value for name, value in found.items() if name not in self._given_up}

    def stop(self) -> None:
        """End all workers. What was counted can still be read."""
        self._agents = {}
        self.close()

    def __exit__(self, *raised: object) -> None:
        self.stop()

    # ---------------------------------------------------------------- requests, answers and deaths

    def replies(self, waiting: list[Request], deadline: Deadline = NO_DEADLINE) -> Iterator[tuple[Request, Reply]]:
        """Have requests answered, each place one after the other, whatever workers die meanwhile.

        Parameters
        ----------
        waiting : list of Request
            They are taken out as soon as their places are idle; further ones may be put in at any time.
        deadline : Deadline
            When to wait no more.

        Yields
        ------
        tuple of Request and Answer or AgentFailure
            As they come.
        """
        running: dict[Future[Answer], Request] = {}
        try:
            while waiting or running:
                for request in list(waiting):
                    if all(request.place != other.place for other in running.values()):
                        waiting.remove(request)
                        running[self.submit(request)] = request
                if not wait(running, deadline.left, FIRST_COMPLETED).done:
                    return
                for future in [future for future in running if future.done()]:  # in the order of submission
                    request = running.pop(future)
                    reply = self._reply(request, future)
                    if reply is None:
                        waiting.insert(0, request)
                    else:
                        yield request, reply
        except KeyboardInterrupt:
            stop_threads()  # which do not hear it
            raise
        finally:
            for future in running:
                future.cancel()  # what has not begun

    def _reply(self, request: Request, future: Future[Answer]) -> Reply | None:
        """What came of a request; None where its worker died, and it is requested again."""
        try:
            return future.result()
        except Exception as error:  # each kind of executor has its own
            reason = self.replace_worker(request.place, error)
        self.deaths[request.label] += 1
        if self.deaths[request.label] <= self.deaths_allowed:
            _LOGGER.warning("'%s' is requested again: %s", request.label, reason)
            return None
        reason = f"its worker died {self.deaths[request.label]} times; {reason}"
        return AgentFailure(str(request.label), reason, final=True)

    def _call(self, method: str, arguments: Arguments, label: str = "", with_states: bool = True) -> dict[str, Any]:
        """What a method of agents gave; what one raised is raised here, or is a failure where nothing is said of it."""
        if not self._agents:
            raise EngineError(f"engine '{self.name}' has no agents: it was not started, or it was stopped. Start it.")
        requests: list[Request] = []
        for name, given in arguments.items():
            if name not in self._agents:
                raise EngineError(f"no agent '{name}'; the agents are {', '.join(self._agents)}.")
            if name not in self._given_up:
                requests.append(self._agents[name].request_for(method, given, with_states and not self.in_this_process))
        replies: dict[str, Reply] = {**self._given_up}
        with undone_on_failure(self.stop):  # what its workers do then is not known any more
            for request, reply in self.replies(requests):
                replies[request.agent] = reply
                if isinstance(reply, AgentFailure):
                    self._given_up[request.agent] = reply
                elif reply.state is not None:
                    self._agents[request.agent] = replace(self._agents[request.agent], state=reply.state)
        return {name: _value(name, replies[name], label) for name in arguments}


def _value(name: str, reply: Reply, label: str) -> Any:
    if isinstance(reply, AgentFailure):
        return reply
    if not reply.raised:
        return reply.value
    if not label:
        return AgentFailure(name, reply.raised)
    other = EngineError(f"agent '{name}' {label}: {reply.raised}")
    raise reply.error(PyRobocopError, other, f"agent '{name}'")
