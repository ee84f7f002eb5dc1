"""Whether a worker will find what it is sent: by name, or by value where cloudpickle is installed."""

from __future__ import annotations

import functools
import pickle
import sys
from collections.abc import Mapping
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
    for agent in getattr(spec, "agents", None) or [spec]:
        builder = _unwrapped(getattr(agent, "builder", None))
        if _is_interactive(builder) or (getattr(builder, "__module__", "") == "__main__" and not main_is_known):
            raise EngineError(
                f"agent '{agent.name}': its builder '{builder.__qualname__}' cannot be sent to a worker: it is defined "
                f"{'interactively' if _is_interactive(builder) else 'in the script that runs here'}, where workers do "
                "not find it. Define it with 'def' at the top level of a module that can be imported, or use "
                "engine='serial'."
            )
    try:
        return Request.of(spec.name, "build", spec)
    except Exception as error:
        raise EngineError(
            f"agent '{spec.name}' cannot be sent to a worker: {type(error).__name__}: {error}. Define its builder with "
            "'def' at the top level of a module; its data have to be plain: numbers, texts, arrays, tuples, dicts, "
            "dataclasses of a module. Models stay where they are built. Or use engine='serial'."
        ) from error


def _unwrapped(function: Any) -> Any:
    while isinstance(function, functools.partial):
        function = function.func
    return function


def _is_interactive(function: Any) -> bool:
    """Whether it is defined in a notebook or at a prompt, which other processes cannot import."""
    main = sys.modules["__main__"]
    has_file = getattr(main, "__spec__", None) is not None or getattr(main, "__file__", None)
    return getattr(function, "__module__", "") == "__main__" and not has_file


def pickled_by_value(thing: Any) -> bytes:
    """A pickle that holds functions where cloudpickle is installed, and their names where it is not."""
    return bytes(cloudpickle.dumps(thing)) if cloudpickle_available else pickle.dumps(thing)


def check_picklable(things: Mapping[str, Any]) -> None:
    """Refuse what `pickled_by_value` cannot send to another process.

    Parameters
    ----------
    things : mapping of what it is to the thing

    Raises
    ------
    ModelError
        Naming the first that cannot.
    """
    with_cloudpickle = "" if cloudpickle_available else ", or install cloudpickle"
    for label, sent in things.items():
        try:
            pickled_by_value(sent)
        except Exception as error:
            raise ModelError(
                f"{label} cannot be sent to another process ({error}). Define functions at the top level of a module "
                f"(functools.partial fills in arguments){with_cloudpickle}, or use workers=1."
            ) from error
        if not cloudpickle_available and _is_interactive(_unwrapped(sent)):
            raise ModelError(
                f"{label} is defined in a notebook or at a prompt, which other processes cannot import. Write it into "
                "a file next to the notebook and import it from there, or use workers=1."
            )
