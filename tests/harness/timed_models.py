"""Several ways to spend time in this package, each with a time limit that it has to keep."""

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module as example
from typing import Any

import pyomo.environ as pyo
from known_mpccs import mpcc_problem
from known_mpccs.generated import _crossed

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import EvaluationError, SolveFailed


def belt_drive(elements: int = 200, duration: float = 6.0) -> pyo.ConcreteModel:
    """Two point masses, joined by a spring and damper; the upper one is pulled, the lower one meets the pulley."""
    build = example("belt_drive").build
    return build("first", elements=(elements, 1), durations=(duration, 1.0))


def crossed_pairs(pairs: int, seed: int = 41) -> pyo.ConcreteModel:
    """A quadratic program with so many pairs, of which nothing says beforehand which side is zero."""
    model = _crossed(max(2, pairs // 5), pairs, seed, False)
    model.name = f"{pairs} crossed pairs"
    return model


def weighted_pairs(pairs: int = 60) -> pyo.ConcreteModel:
    """Crossed pairs with a parameter to differentiate for."""
    model = crossed_pairs(pairs)
    model.weight = pyo.Param(initialize=1.0, mutable=True)
    model.cost.set_value(model.weight * model.cost.expr)
    return model


def _solve(model: Any, limit: float) -> Sequence[Any]:
    return [rcp.solve(model, time_limit=limit, progress=False)]


def _solve_and_differentiate(model: Any, limit: float) -> Sequence[Any]:
    result = rcp.solve(model, time_limit=limit, progress=False)
    if result.quality is not rcp.Quality.INFEASIBLE:
        with contextlib.suppress(EvaluationError):
            rcp.studies.sensitivity(model, result, model.weight)
    return [result]


def _starts(model: Any, limit: float) -> Sequence[Any]:
    found = rcp.studies.multistart(model, 30, time_limit=limit, progress=False)
    return [outcome.result for outcome in found if outcome.result is not None]


def _path(model: Any, limit: float) -> Sequence[Any]:
    try:
        found = rcp.studies.homotopy(model, {"weight": (0.01, 1.0)}, 30, time_limit=limit, progress=False)
    except SolveFailed as stalled:
        found = stalled.result
    return [step.result for step in found if step.result is not None]


@dataclass(frozen=True)
class TimedModel:
    """Something that takes longer than a short limit.

    Attributes
    ----------
    name : str
    build : callable
        What `run` works on; not part of the time.
    run : callable
        ``run(built, limit)`` returns the results of all solves in it.
    solves : int
        How many solves have the limit each.
    """

    name: str
    build: Callable[[], Any]
    run: Callable[[Any, float], Sequence[Any]] = field(default=_solve)
    solves: int = 1


TIMED_MODELS = (
    TimedModel("a hundred pairs", partial(crossed_pairs, 100)),
    TimedModel("obstacles", lambda: example("crossing").build(28)),
    TimedModel("sensitivity after a solve", weighted_pairs, _solve_and_differentiate),
    TimedModel("belt drive", partial(belt_drive, 60)),
    TimedModel("planar pushing", lambda: example("planar_pushing").build()),
    TimedModel("cart-pole", lambda: example("cart_pole").build(300)),
    TimedModel("no pairs", lambda: example("acrobot").build(300)),
    TimedModel("nonsmooth control", lambda: example("turbo_car").build()),
    TimedModel("several starts", partial(crossed_pairs, 40), _starts),
    TimedModel("homotopy", partial(weighted_pairs, 30), _path),
)


def small_program_without_strong_multipliers() -> pyo.ConcreteModel:
    """One pair whose certificate takes linear programs: there are no multipliers of a strong kind."""
    return mpcc_problem("ralph1").build()
