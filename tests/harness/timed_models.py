"""Models that take long, for time limits that have to be kept."""

from collections.abc import Callable
from functools import partial
from importlib import import_module as example
from typing import Any

import pyomo.environ as pyo
from known_mpccs.generated import _crossed


def belt_drive(elements: int = 200, duration: float = 6.0) -> pyo.ConcreteModel:
    """Two point masses, joined by a spring and damper; the upper one is pulled, the lower one meets the pulley."""
    build = example("belt_drive").build
    return build("first", elements=(elements, 1), durations=(duration, 1.0))


def crossed_pairs(pairs: int, seed: int = 41) -> pyo.ConcreteModel:
    """A quadratic program with so many pairs, of which nothing says beforehand which side is zero."""
    model = _crossed(max(2, pairs // 5), pairs, seed, False)
    model.name = f"{pairs} crossed pairs"
    return model


# What takes longer than a short limit.
TIMED_MODELS: dict[str, Callable[[], Any]] = {
    "a hundred pairs": partial(crossed_pairs, 100),
    "obstacles": lambda: example("crossing").build(28),
    "belt drive": partial(belt_drive, 60),
    "cart-pole": lambda: example("cart_pole").build(300),
    "nonsmooth control": lambda: example("turbo_car").build(),
}
