"""`WorkerHost`: keeps agents where they are solved, and answers what the coordinator asks of them."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.optional_imports import cloudpickle, cloudpickle_available


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
        return cls(agent, task, pickle.dumps(arguments, pickle.HIGHEST_PROTOCOL), with_state)


@dataclass(frozen=True)
class Answer:
    """What came of a request.

    Attributes
    ----------
    payload : bytes
        The value, pickled; a `Raised` where the agent raised an exception.
    raised : bool
    state : bytes or None
        The state afterwards, pickled, where it was wanted.
    """

    payload: bytes
    raised: bool = False
    state: bytes | None = None

    @property
    def value(self) -> Any:
        """The value, or what was raised."""
        return pickle.loads(self.payload)


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
            packed = pickle.dumps(error, pickle.HIGHEST_PROTOCOL)
            pickle.loads(packed)  # an exception whose arguments are not those of its class fails here only
        except Exception:
            packed = None
        return cls(f"{type(error).__name__}: {error}", traceback.format_exc(), packed)

    def original(self) -> Exception | None:
        """The exception itself, where it could be sent and is known here."""
        try:
            return None if self.error is None else pickle.loads(self.error)
        except (ImportError, AttributeError):  # its class is known to the worker only
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
        answer = self._done(request.agent, request.task, request.payload)
        if not request.with_state:
            return answer
        # Half a solve that raised an exception has changed the state as well.
        state = self._done(request.agent, "state", pickle.dumps((), pickle.HIGHEST_PROTOCOL))
        return state if state.raised else replace(answer, state=state.payload)

    def _done(self, agent: str, name: str, payload: bytes) -> Answer:
        try:
            own: dict[str, Callable[..., Any]] = {"build": self.build, "rebuild": self.rebuild}
            task = partial(own[name], agent) if name in own else getattr(self._problems[agent], name)
            return Answer(pickle.dumps(task(*_read(payload)), pickle.HIGHEST_PROTOCOL))
        except Exception as error:
            return Answer(pickle.dumps(Raised.of(error), pickle.HIGHEST_PROTOCOL), raised=True)

    def build(self, agent: str, spec: HostedSpec | None = None) -> Any:
        """Build an agent; gives its facts."""
        self._problems.pop(agent, None)  # the old model's memory is free before the new one is built
        self._problems[agent] = problem = (spec or self._specs[agent]).build()
        return problem.facts()

    def rebuild(self, agent: str, spec: bytes, state: bytes | None) -> None:
        """Build an agent anew, and put it into a state."""
        self.build(agent, *_read(spec))
        if state is not None:
            self._problems[agent].restore(pickle.loads(state))


def _read(payload: bytes) -> Any:
    try:
        return pickle.loads(payload)
    except Exception as error:
        raise ModelError(
            f"a worker process cannot read what was sent to it ({type(error).__name__}: {error}). Functions have to "
            "stand in a file that other processes can import: in a module, or next to the notebook. Or install "
            "cloudpickle, by which they travel as they are."
        ) from error


def packed(label: str, thing: Any, instead: str, refusal: type[PyRobocopError] = ModelError) -> bytes:
    """A pickle of something: functions by value where cloudpickle is installed, else by their names.

    Parameters
    ----------
    label : str
        What it is.
    thing : object
    instead : str
        What needs no other process.
    refusal : type of exception
        What is raised when it cannot be pickled.
    """
    try:
        pickler = cloudpickle if cloudpickle_available else pickle
        return bytes(pickler.dumps(thing, pickle.HIGHEST_PROTOCOL))
    except Exception as error:
        with_cloudpickle = "" if cloudpickle_available else ", or install cloudpickle"
        raise refusal(
            f"{label} cannot be sent to another process ({type(error).__name__}: {error}). Define functions with 'def' "
            f"at the top level of a module (functools.partial fills in arguments){with_cloudpickle}; data have to be "
            f"plain: numbers, texts, arrays, tuples, dicts, dataclasses of a module. Or use {instead}."
        ) from error
