"""`Engine`: where agents of a team and solvers of a study live, and what happens when a worker dies."""

from __future__ import annotations

import logging
import os
import pickle
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyrobocop_pyomo.errors import EngineError, PyRobocopError
from pyrobocop_pyomo.modeling.deadline import Deadline
from pyrobocop_pyomo.modeling.failures import undone_on_failure

from .worker_host import Answer, HostedSpec, Request, packed

_LOGGER = logging.getLogger(__name__)

State = Mapping[str, np.ndarray]


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
    traceback : str
        Of the exception, where there was one.
    """

    agent: str
    reason: str
    final: bool = False
    traceback: str = ""


class Engine(ABC):
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
    deaths : Counter
        How often the worker of each agent died, while the agent was at work.
    writes_files : bool
        Whether this process is the one of its team that writes files. It is, except on all but one rank of MPI.
    answer_within : float or None
        Seconds without an answer of any agent after which the workers that owe one are ended with `kill`.

    Raises
    ------
    EngineError
        When one of these is no such number.
    """

    name: str
    writes_files = True
    answer_within: float | None = None
    _in_this_process = False  # where specs need not be sent, and no state is ever needed again

    def __init__(self, workers: int | None = None, *, deaths_allowed: int = 2) -> None:
        if workers is not None and workers < 1:
            raise EngineError(f"engine '{self.name}': workers = {workers!r}; expected at least 1.")
        if deaths_allowed < 0:
            raise EngineError(f"engine '{self.name}': deaths_allowed = {deaths_allowed!r}; expected 0 or more.")
        self.workers, self.deaths_allowed = workers, deaths_allowed
        self._forget()

    def _forget(self) -> None:
        self.deaths: Counter[Any] = Counter()
        self._specs: dict[str, bytes | HostedSpec] = {}
        self._place_of: dict[str, int] = {}
        self._states: dict[str, tuple[int, bytes | None]] = {}
        self._given_up: dict[str, AgentFailure] = {}

    # ---------------------------------------------------------------- what an engine is made of

    @abstractmethod
    def open(self, places: int) -> None:
        """Make so many places ready."""

    @abstractmethod
    def submit(self, request: Request) -> Future[Answer]:
        """Begin with a request at its place, which is idle; the future raises something where the worker was lost."""

    def wait(self, futures: Collection[Future[Answer]], timeout: float | None = None) -> None:
        """Wait until something has come of one of the requests, but no longer than so many seconds."""
        wait(futures, timeout, FIRST_COMPLETED)

    def kill(self, place: int) -> None:  # noqa: B027  # who waits for ever need not
        """End the worker of a place that owes an answer, such as a stopped one."""

    def replace_worker(self, place: int, error: Exception) -> str:
        """Make another worker ready in place of a lost one, whose future raised this; gives how it ended, in words."""
        return str(error) or repr(error)

    @abstractmethod
    def close(self) -> None:
        """End everything that was opened; also after half an opening, and twice."""

    def places(self, most: int) -> int:
        """How many tasks are done side by side, at most so many."""
        return min(most, self.workers or available_cores())

    def places_of_agents(self, agents: int) -> int:
        """At how many places so many agents live."""
        return self.places(agents)

    def agreed(self, decision: bool) -> bool:
        """What is decided by all processes that run the same script, where one asks its own clock."""
        return decision

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
        self._forget()
        if not specs:
            raise EngineError(f"engine '{self.name}': there are no agents to start.")
        places = self.places_of_agents(len(specs))
        for number, spec in enumerate(specs):
            sent = self.sent(spec, f"agent '{spec.name}'", "engine='serial'")
            self._specs[spec.name], self._place_of[spec.name] = sent, number % places
        with undone_on_failure(self.stop):
            self.open(places)
            facts = self._call("facts", dict.fromkeys(self._specs, ()), "could not be built", changes=False)
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
        found = self._call(method, arguments, f"{method}() failed")
        return {name: value for name, value in found.items() if name not in self._given_up}

    def sent(self, spec: HostedSpec, label: str, instead: str) -> bytes | HostedSpec:
        """A spec in the form in which it goes to workers; `packed` has the label and what there is instead."""
        return spec if self._in_this_process else packed(label, spec, instead, EngineError)

    def stop(self) -> None:
        """End all workers. What was counted can still be read."""
        self._specs = {}
        self.close()

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()

    # ---------------------------------------------------------------- requests, answers and deaths

    def replies(
        self, waiting: list[Request], deadline: Deadline | None = None
    ) -> Iterator[tuple[Request, Answer | AgentFailure]]:
        """Have requests answered, each place one after the other, whatever workers die meanwhile.

        Parameters
        ----------
        waiting : list of Request
            They are taken out as soon as their places are idle; further ones may be put in at any time.
        deadline : Deadline, optional
            When to wait no more. By default workers that do not answer within `answer_within` are ended.

        Yields
        ------
        tuple of Request and Answer or AgentFailure
            As they come.
        """
        running: dict[Future[Answer], Request] = {}
        while waiting or running:
            for request in list(waiting):
                if all(request.place != other.place for other in running.values()):
                    waiting.remove(request)
                    running[self.submit(request)] = request
            self.wait(list(running), self.answer_within if deadline is None else deadline.left)
            done = [future for future in running if future.done()]  # in the order of submission
            if not done and deadline is not None:
                return
            if not done:
                _LOGGER.warning("engine '%s': no answer within %g s", self.name, self.answer_within)
                for request in running.values():
                    self.kill(request.place)
            for future in done:
                request = running.pop(future)
                reply = self._reply(request, future)
                if reply is None:
                    waiting.insert(0, request)
                else:
                    yield request, reply

    def _reply(self, request: Request, future: Future[Answer]) -> Answer | AgentFailure | None:
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
        _LOGGER.error("'%s' is given up: %s", request.label, reason)
        return AgentFailure(str(request.label), reason, final=True)

    def _call(
        self, method: str, arguments: Mapping[str, tuple[Any, ...]], label: str | None = None, *, changes: bool = True
    ) -> dict[str, Any]:
        """What a method of agents gave; what one raised is raised here, or is a failure where nothing is said of it."""
        if not self._specs:
            raise EngineError(f"engine '{self.name}' has no agents: it was not started, or it was stopped. Start it.")
        for name in arguments:
            if name not in self._specs:
                raise EngineError(f"no agent '{name}'; the agents are {', '.join(self._specs)}.")
        replies: dict[str, Answer | AgentFailure] = {**self._given_up}
        waiting = [self._request(name, method, arguments[name], changes) for name in arguments if name not in replies]
        with undone_on_failure(self.stop):  # what its workers do then is not known any more
            for request, reply in self.replies(waiting):
                replies[request.agent] = reply
                self._keep(request.agent, reply)
        return {name: _value(name, replies[name], label) for name in arguments}

    def _request(self, name: str, method: str, arguments: tuple[Any, ...], changes: bool) -> Request:
        return Request(
            name,
            self._specs[name],
            method,
            pickle.dumps(arguments, pickle.HIGHEST_PROTOCOL),
            label=name,
            place=self._place_of[name],
            state=self._states.get(name, (0, None)),
            with_state=changes and not self._in_this_process,
        )

    def _keep(self, name: str, reply: Answer | AgentFailure) -> None:
        if isinstance(reply, AgentFailure):
            self._given_up[name] = reply
        elif reply.state is not None:
            self._states[name] = reply.state


def _value(name: str, reply: Answer | AgentFailure, label: str | None) -> Any:
    if isinstance(reply, AgentFailure):
        return reply
    if not reply.raised:
        return reply.value
    if label is None:
        return AgentFailure(name, reply.raised, traceback=reply.traceback)
    other = EngineError(f"agent '{name}' {label}: {reply.raised}")
    raise reply.error(PyRobocopError, other, f"agent '{name}'")
