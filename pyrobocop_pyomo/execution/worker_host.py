"""`WorkerHost`: keeps agents where they are solved, and answers what the coordinator asks of them."""

from __future__ import annotations

import contextlib
import pickle
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.modeling.failures import failures_as
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
    """What one agent is told to do, with all that it takes to do so on any worker.

    Attributes
    ----------
    agent : str
    spec : bytes or HostedSpec
        By which it is built where it is not there yet; pickled where it travels.
    place : int
        Where it is done.
    label : object
        By which deaths of its worker are counted.
    state : tuple of int and bytes or None
        That the agent is to be in: how many requests have changed it; and the state itself, pickled, where any has.
    method : str
        Of its problem.
    arguments : bytes
        Pickled.
    with_state : bool
        Whether the state afterwards is wanted as well.
    """

    agent: str
    spec: bytes | HostedSpec
    place: int
    label: Any
    state: tuple[int, bytes | None] = (0, None)
    method: str = ""
    arguments: bytes = b""
    with_state: bool = False

    def request_for(self, method: str, arguments: tuple[Any, ...], with_state: bool = False) -> Request:
        """The request to call a method."""
        packed_arguments = pickle.dumps(arguments, pickle.HIGHEST_PROTOCOL)
        return replace(self, method=method, arguments=packed_arguments, with_state=with_state)


@dataclass(frozen=True)
class Answer:
    """What came of a request.

    Attributes
    ----------
    payload : bytes or None
        The value, pickled; of an agent that raised an exception that, where it can be sent.
    state : tuple of int and bytes, or None
        The state afterwards, as in a `Request`, where it was wanted.
    raised : str
        Type and text of an exception; empty where there was none.
    traceback : str
        Of the exception.
    """

    payload: bytes | None
    state: tuple[int, bytes | None] | None = None
    raised: str = ""
    traceback: str = ""

    @classmethod
    def of(cls, call: Callable[[], Any]) -> Answer:
        """What comes of a call: an exception is an answer like any other."""
        try:
            return cls(pickle.dumps(call(), pickle.HIGHEST_PROTOCOL))
        except Exception as error:
            payload = None
            with contextlib.suppress(Exception):
                payload = pickle.dumps(error, pickle.HIGHEST_PROTOCOL)
            return cls(payload, None, f"{type(error).__name__}: {error}", traceback.format_exc())

    @property
    def value(self) -> Any:
        """The value, or the exception; None where that could not be sent."""
        return None if self.payload is None else pickle.loads(self.payload)

    def error(self, kinds: type[Exception], instead: PyRobocopError, place: str) -> Exception:
        """The exception, to be raised here, with the traceback of the place where it was raised.

        Parameters
        ----------
        kinds : type of exception
            Which are raised as they are.
        instead : PyRobocopError
            In place of others, and of those that could not be sent or are known to the worker only.
        place : str
        """
        error = None
        with contextlib.suppress(Exception):  # whose arguments are not those of its class, it fails here only
            error = self.value
        error = error if isinstance(error, kinds) else instead
        error.__cause__ = RuntimeError(f"in {place}\n{self.traceback}")
        return error


class WorkerHost:
    """Keeps agents and answers requests.

    One lives in every worker, and one in the coordinator's process for the serial engine. Nothing that an agent does
    ends its host, except to end the process.
    """

    def __init__(self) -> None:
        self._agents: dict[str, tuple[int, Any]] = {}  # with the number of the state that each is in

    def answer(self, request: Request) -> Answer:
        """Answer a request."""
        answer = Answer.of(lambda: getattr(self._agent(request), request.method)(*_read(request.arguments)))
        if not request.with_state or request.agent not in self._agents:
            return answer
        # Half a solve that raised an exception has changed the state as well.
        (number, _), agent = request.state, self._agents.pop(request.agent)[1]
        state = Answer.of(agent.state)
        if state.raised:
            return state
        self._agents[request.agent] = number + 1, agent
        return replace(answer, state=(number + 1, state.payload))

    def _agent(self, request: Request) -> Any:
        """The agent in the state that is required: built where it is not here, restored where it has another state."""
        number, state = request.state
        held, agent = self._agents.pop(request.agent, (None, None))
        if held != number:
            if agent is None or state is None:
                agent = None  # the old model's memory is free before the new one is built
                agent = (_read(request.spec) if isinstance(request.spec, bytes) else request.spec).build()
            if state is not None:
                agent.restore(pickle.loads(state))
        self._agents[request.agent] = number, agent
        return agent


def _read(payload: bytes) -> Any:
    remedy = (
        "Functions have to stand in a file that other processes can import: in a module, or next to the notebook. Or "
        "install cloudpickle, by which they travel as they are."
    )
    with failures_as(ModelError, "a worker process cannot read what was sent to it", remedy):
        return pickle.loads(payload)


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
    pickler, with_cloudpickle = (cloudpickle, "") if cloudpickle_available else (pickle, ", or install cloudpickle")
    remedy = (
        f"Define functions with 'def' at the top level of a module (functools.partial fills in "
        f"arguments){with_cloudpickle}; data have to be plain: numbers, texts, arrays, tuples, dicts, dataclasses of a "
        f"module. Or use {instead}."
    )
    with failures_as(refusal, f"{label} cannot be sent to another process", remedy):
        return bytes(pickler.dumps(thing, pickle.HIGHEST_PROTOCOL))
