"""Whether a worker will find what it is sent: by name, or by value where cloudpickle is installed."""

from __future__ import annotations

import functools
import pickle
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from pyrobocop_pyomo.errors import EngineError, ModelError
from pyrobocop_pyomo.optional_imports import cloudpickle, cloudpickle_available

from .worker_host import HostedSpec, Request


def build_request(spec: HostedSpec, *, main_is_known: bool) -> Request:
    """What has an agent built in another process.

    Parameters
    ----------
    spec : HostedSpec
    main_is_known : bool
        Whether workers run the same script, so that they find what it defines.

    Returns
    -------
    Request

    Raises
    ------
    EngineError
        When a builder has no name that a worker would find, or the data cannot be pickled; the message says which.
    """
    for where, builder in _builders(spec):
        fault = _why_not_found(builder, main_is_known)
        if fault:
            raise EngineError(
                f"agent '{where}': its builder {getattr(builder, '__qualname__', builder)!r} cannot be sent to a "
                f"worker: {fault}. Define it with 'def' at the top level of a module that can be imported, or use "
                "engine='serial'."
            )
    try:
        return Request.of(spec.name, "build", spec)
    except Exception as error:
        raise EngineError(
            f"agent '{spec.name}' cannot be sent to a worker{_culprit(spec)}: {type(error).__name__}: {error}. Its "
            "data have to be plain: numbers, texts, arrays, tuples, dicts, dataclasses of a module. Models stay where "
            "they are built."
        ) from error


def _builders(spec: Any) -> list[tuple[str, Any]]:
    """Name of agent and builder, of a spec with one or of one with several agents."""
    agents = getattr(spec, "agents", None) or [spec]
    return [(agent.name, agent.builder) for agent in agents if hasattr(agent, "builder")]


def _why_not_found(builder: Any, main_is_known: bool) -> str:
    while isinstance(builder, functools.partial):
        builder = builder.func
    module, name = getattr(builder, "__module__", None), getattr(builder, "__qualname__", None)
    if module is None or name is None:
        return ""  # an object that can be called: pickle tells
    if "<lambda>" in name:
        return "a lambda has no name"
    if "<locals>" in name:
        return "it is defined inside a function"
    if module == "__main__":
        main = sys.modules["__main__"]
        if getattr(main, "__spec__", None) is None and not getattr(main, "__file__", None):
            return "it is defined interactively, in a notebook or at a prompt"
        if not main_is_known:
            return "it is defined in the script that runs here, which the workers of a cluster do not have"
    found = sys.modules.get(module)
    if found is None:
        return f"it belongs to '{module}', which is no module that was imported"
    for part in name.split("."):
        found = getattr(found, part, None)
    return "" if found is builder else f"'{module}.{name}' is something else by now"


def _culprit(spec: Any) -> str:
    """Which of its data cannot be pickled, as far as can be told."""
    for agent in getattr(spec, "agents", None) or [spec]:
        for where, value in _parts(agent):
            try:
                pickle.dumps(value)
            except Exception:
                return f", because of {where}"
    return ""


def _parts(value: Any) -> list[tuple[str, Any]]:
    if not is_dataclass(value):
        return []
    parts: list[tuple[str, Any]] = []
    for field in fields(value):
        held = getattr(value, field.name)
        if isinstance(held, (tuple, list)):
            parts += [(f"{field.name}[{i}]", item) for i, item in enumerate(held)]
        elif isinstance(held, Mapping):
            parts += [(f"{field.name}[{key!r}]", item) for key, item in held.items()]
        else:
            parts.append((field.name, held))
    return parts


def pickled_by_value(thing: Any) -> bytes:
    """A pickle that holds functions where cloudpickle is installed, and their names where it is not."""
    return bytes(cloudpickle.dumps(thing)) if cloudpickle_available else pickle.dumps(thing)


def check_picklable(things: Mapping[str, Any], *, by_value: bool = False) -> None:
    """Refuse what cannot be sent to another process.

    Parameters
    ----------
    things : mapping of what it is to the thing
    by_value : bool
        Whether they are sent by `pickled_by_value`.

    Raises
    ------
    ModelError
        Naming the first that cannot.
    """
    with_cloudpickle = ", or install cloudpickle" if by_value and not cloudpickle_available else ""
    for label, sent in things.items():
        try:
            (pickled_by_value if by_value else pickle.dumps)(sent)
        except Exception as error:
            raise ModelError(
                f"{label} cannot be sent to another process ({error}). Define functions at the top level of a module "
                f"(functools.partial fills in arguments){with_cloudpickle}, or use workers=1."
            ) from error
        function = getattr(sent, "func", sent)
        if by_value and cloudpickle_available:
            continue
        if getattr(function, "__module__", "") == "__main__" and not hasattr(sys.modules["__main__"], "__file__"):
            raise ModelError(
                f"{label} is defined in a notebook or at a prompt, which other processes cannot import. Write it into "
                "a file next to the notebook and import it from there, or use workers=1."
            )
