"""Studies around a solve: many starts or data, receding horizons.

`multistart` and `sweep` give a `StudyResult`: a sequence of outcomes that prints as a
table. Its members mean the same in all of them:

* ``best``: the outcome that answers the study; its point is the one on the model;
* ``result``: the `SolveResult` of that outcome;
* ``reached``: whether the goal was reached, at a point that is optimal and, where there are obstacles, safe;
* ``remaining``: what a time limit or Ctrl-C left undone;
* ``to_pandas()`` and ``table()``: a row per outcome, with the same columns behind the numbers of the cases.

``time_limit`` is for the whole study.
"""

from importlib import import_module
from typing import Any

from .multistart import multistart
from .persistent_nlp import PersistentNLP
from .receding_horizon import RecedingHorizon

__all__ = [
    "PersistentNLP",
    "RecedingHorizon",
    "multistart",
    "sensitivity",
]


def __getattr__(name: str) -> Any:
    """What is of `contrib`, whose folder is loaded at its first use."""
    if name != "sensitivity":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module("pyrobocop_pyomo.contrib.sensitivity").sensitivity
