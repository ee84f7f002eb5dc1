"""`WorkerHost`: keeps agents where they are solved, and answers what the coordinator asks of them."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from pyrobocop_pyomo.errors import ModelError

PROTOCOL = 5  # of pickle: the same everywhere, so that counted bytes can be compared


class HostedSpec(Protocol):
    """How an agent is built, small enough to be sent.

    What is built is a deterministic function of its state and of what it is told: an object with ``facts()``,
    ``solve(order)``, ``state()`` and ``restore(state)``, of which all arguments and answers can be pickled.
    """

    @property
    def name(self) -> str:
        """Of the agent, unique in its team."""

    def build(self) -> Any:
        """Build the problem, here."""


@dataclass(frozen=True)
class Request:
    """What one agent is told to do.

    Attributes
    ----------
    agent : str
    task : str
        A method of its problem, "build" or "rebuild".
    payload : bytes
        Its arguments, pickled.
    with_state : bool
        Whether the state afterwards is wanted as well.
    """

    agent: str
    task: str
    payload: bytes
    with_state: bool = False

    @classmethod
    def of(cls, agent: str, task: str, *arguments: Any, with_state: bool = False) -> Request:
        """The request with these arguments."""
        return cls(agent, task, pickle.dumps(arguments, PROTOCOL), with_state)


@dataclass(frozen=True)
class Answer:
    """What came of a request.

    Attributes
    ----------
    payload : bytes
        The value, pickled; a `Raised` where the agent raised an exception.
    raised : bool
    state : bytes or None
        The state afterwards, pickled, where it was wanted and nothing was raised.
    """

    payload: bytes
    raised: bool = False
    state: bytes | None = None

    @property
    def value(self) -> Any:
        """The value, or what was raised."""
        return pickle.loads(self.payload)

    @property
    def size(self) -> int:
        """Bytes."""
        return len(self.payload) + len(self.state or b"")


@dataclass(frozen=True)
class Lost:
    """An agent whose home has ended before it answered.

    Attributes
    ----------
    reason : str
    at_work : bool
        Whether it was at work at that time, so that it may be the cause.
    """

    reason: str
    at_work: bool


@dataclass(frozen=True)
class Raised:
    """An exception of an agent, in a form that travels.

    Attributes
    ----------
    reason : str
        Its type and its text.
    traceback : str
    error : bytes or None
        The exception itself, pickled, where it can be.
    """

    reason: str
    traceback: str
    error: bytes | None

    @classmethod
    def of(cls, error: Exception) -> Raised:
        """The form of an exception that is being handled."""
        try:
            packed = pickle.dumps(error, PROTOCOL)
            pickle.loads(packed)  # an exception whose arguments are not those of its class fails here only
        except Exception:
            packed = None
        return cls(f"{type(error).__name__}: {error}", traceback.format_exc(), packed)

    def original(self) -> Exception | None:
        """The exception itself, where it could be sent and is known here."""
        try:
            return None if self.error is None else pickle.loads(self.error)
        except Exception:
            return None


class WorkerHost:
    """Keeps agents and answers requests.

    One lives in every worker, and one in the coordinator's process for the serial engine. An exception of an agent is
    an answer like any other: nothing that an agent does ends its host, except to end the process.

    Parameters
    ----------
    specs : mapping of agent's name to HostedSpec, optional
        Of agents that are built where they are known, and need not be sent.
    """

    def __init__(self, specs: Mapping[str, HostedSpec] | None = None) -> None:
        self._specs = dict(specs or {})
        self._problems: dict[str, Any] = {}

    def answer(self, request: Request) -> Answer:
        """Do what is required."""
        try:
            own: dict[str, Callable[..., Any]] = {"build": self.build, "rebuild": self.rebuild}
            if request.task in own:
                task = partial(own[request.task], request.agent)
            else:
                task = getattr(self._problems[request.agent], request.task)
            value = pickle.dumps(task(*_read(request.payload)), PROTOCOL)
            state = pickle.dumps(self._problems[request.agent].state(), PROTOCOL) if request.with_state else None
        except Exception as error:
            return Answer(pickle.dumps(Raised.of(error), PROTOCOL), raised=True)
        return Answer(value, state=state)

    def build(self, agent: str, spec: HostedSpec | None = None) -> Any:
        """Build an agent; gives its facts."""
        self._problems.pop(agent, None)  # the old model's memory is free before the new one is built
        self._problems[agent] = problem = (spec or self._specs[agent]).build()
        return problem.facts()

    def rebuild(self, agent: str, spec: bytes, state: bytes | None, requests: Sequence[Request]) -> None:
        """Build an agent anew, put it into a state, and let it do again what it was asked since."""
        self.build(agent, *_read(spec))
        if state is not None:
            self._problems[agent].restore(pickle.loads(state))
        for request in requests:
            self.answer(request)  # what raised an exception then, does so again


def _read(payload: bytes) -> Any:
    try:
        return pickle.loads(payload)
    except Exception as error:
        raise ModelError(
            f"a worker process cannot read what was sent to it ({type(error).__name__}: {error}). Functions have to "
            "stand in a file that other processes can import: in a module, or next to the notebook. Or install "
            "cloudpickle, by which they travel as they are."
        ) from error
