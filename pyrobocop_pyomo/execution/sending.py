"""What is sent to other processes: functions by value where cloudpickle is installed, else by their names."""

from __future__ import annotations

import pickle
from typing import Any

from pyrobocop_pyomo.errors import ModelError, PyRobocopError
from pyrobocop_pyomo.optional_imports import cloudpickle, cloudpickle_available

from .worker_host import PROTOCOL


def packed(label: str, thing: Any, instead: str, refusal: type[PyRobocopError] = ModelError) -> bytes:
    """A pickle of something.

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
        return bytes(cloudpickle.dumps(thing, PROTOCOL) if cloudpickle_available else pickle.dumps(thing, PROTOCOL))
    except Exception as error:
        with_cloudpickle = "" if cloudpickle_available else ", or install cloudpickle"
        raise refusal(
            f"{label} cannot be sent to another process ({type(error).__name__}: {error}). Define functions with 'def' "
            f"at the top level of a module (functools.partial fills in arguments){with_cloudpickle}; data have to be "
            f"plain: numbers, texts, arrays, tuples, dicts, dataclasses of a module. Or use {instead}."
        ) from error
