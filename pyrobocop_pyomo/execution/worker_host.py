"""`WorkerHost`: keeps agents where they are solved, and answers what the coordinator asks of them."""

from __future__ import annotations

import contextlib
import os
import pickle
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, replace
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
        A method of its problem, "build" or "process_id".
    payload : bytes
        Its arguments, pickled.
    with_state : bool
        Whether the state afterwards is wanted as well.
    state : bytes or None
        The state that it is put into once it is built, pickled.
    """

    agent: str
    task: str
    payload: bytes
    with_state: bool = False
    state: bytes | None = None

    @classmethod
    def of(cls, agent: str, task: str, *arguments: Any, with_state: bool = False) -> Request:
        """The request with these arguments."""
        return cls(agent, task, pickle.dumps(arguments, pickle.HIGHEST_PROTOCOL), with_state)


@dataclass(frozen=True)
class Answer:
    """What came of a request.

    Attributes
    ----------
    payload : bytes or None
        The value, pickled; of an agent that raised an exception that, where it can be sent.
    state : bytes or None
        The state afterwards, pickled, where it was wanted.
    raised : str
        Type and text of an exception; empty where there was none.
    traceback : str
        Of the exception.
    """

    payload: bytes | None
    state: bytes | None = None
    raised: str = ""
    traceback: str = ""

    @classmethod
    def of_error(cls, error: Exception) -> Answer:
        """The form in which an exception that is being handled travels."""
        try:
            packed_error = pickle.dumps(error, pickle.HIGHEST_PROTOCOL)
            pickle.loads(packed_error)  # an exception whose arguments are not those of its class fails here only
        except Exception:
            packed_error = None
        return cls(packed_error, None, f"{type(error).__name__}: {error}", traceback.format_exc())

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
        with contextlib.suppress(ImportError, AttributeError):
            error = self.value
        error = error if isinstance(error, kinds) else instead
        error.__cause__ = RuntimeError(f"in {place}\n{self.traceback}")
        return error


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
            answer = Answer(pickle.dumps(self._done(request), pickle.HIGHEST_PROTOCOL))
        except Exception as error:
            answer = Answer.of_error(error)
        if not request.with_state:
            return answer
        # Half a solve that raised an exception has changed the state as well.
        state = self.answer(Request.of(request.agent, "state"))
        return state if state.raised else replace(answer, state=state.payload)

    def _done(self, request: Request) -> Any:
        if request.task == "process_id":
            return os.getpid()
        if request.task != "build":
            return getattr(self._problems[request.agent], request.task)(*_read(request.payload))
        self._problems.pop(request.agent, None)  # the old model's memory is free before the new one is built
        (spec,) = _read(request.payload) or (self._specs[request.agent],)
        self._problems[request.agent] = problem = spec.build()
        if request.state is not None:
            problem.restore(pickle.loads(request.state))
        return problem.facts()


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
