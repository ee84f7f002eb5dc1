"""A gripper lays an elastic belt over a pulley: the belt is stretched or slack, its lower end lies on or not."""

from __future__ import annotations

from typing import Any

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

STIFFNESS, DAMPING, MASS, GRAVITY, LENGTH = 63.34, 4.613, 0.042, 10.0, 0.1418
PULLEY = {"x": 0.55, "y": 0.23, "z": 0.34}
HOLDING = {"x": 0.0, "y": 0.0, "z": 3.2113}
START = {"upper": {"x": 0.55, "y": 0.0, "z": 0.4825}, "lower": {"x": 0.55, "y": 0.0, "z": 0.34}}
TARGET = {"upper": {"x": 0.55, "y": 0.23, "z": 0.5325}, "lower": PULLEY}
GUESS = {"upper": {"x": 0.55, "y": 0.23, "z": 0.4825}, "lower": PULLEY}


def belt_drive(elements: int = 200, duration: float = 6.0) -> pyo.ConcreteModel:
    """Two point masses, joined by a spring and damper; the upper one is pulled, the lower one meets the pulley."""
    m = pyo.ConcreteModel(name="belt drive")
    m.belt = b = rcp.PhaseBlock(duration=duration, elements=elements, scheme="implicit_euler")
    for end in START:
        for axis in PULLEY:
            place = rcp.State(initial=START[end][axis], bounds=(-0.7, 0.7), initial_guess=GUESS[end][axis])
            setattr(b, f"{end}_{axis}", place)
            setattr(b, f"{end}_v{axis}", rcp.State(initial=0.0, bounds=(-0.12, 0.12)))
    for axis in PULLEY:
        setattr(b, f"pull_{axis}", rcp.Control(bounds=(-20, 20)))
    b.tension, b.support = rcp.Algebraic(bounds=(0, None)), rcp.Algebraic(bounds=(0, None))
    b.slack, b.gap = rcp.Algebraic(bounds=(0, None)), rcp.Algebraic(bounds=(1e-8, None))
    b.ode(_rates)
    b.residual(_lengths)
    b.constraint(_clear)
    b.complementarity(_elastic)
    b.complementarity(_contact)
    m.cost = pyo.Objective(expr=b.integral(_cost))
    return m


def _of(b: Any, name: str, t: float) -> list[Any]:
    return [getattr(b, f"{name}{axis}")[t] for axis in PULLEY]


def _distance(b: Any, t: float) -> Any:
    return pyo.sqrt(sum((p - q) ** 2 for p, q in zip(_of(b, "upper_", t), _of(b, "lower_", t), strict=True)))


def _rates(b: Any, t: float) -> dict[Any, Any]:
    rates = {}
    for axis in PULLEY:
        upper, lower = getattr(b, f"upper_v{axis}"), getattr(b, f"lower_v{axis}")
        direction = (getattr(b, f"upper_{axis}")[t] - getattr(b, f"lower_{axis}")[t]) / _distance(b, t)
        inner = b.tension[t] * direction + DAMPING * (upper[t] - lower[t])
        weight, support = (GRAVITY, b.support[t]) if axis == "z" else (0.0, 0.0)
        rates[getattr(b, f"upper_{axis}")] = upper[t]
        rates[getattr(b, f"lower_{axis}")] = lower[t]
        rates[upper] = (getattr(b, f"pull_{axis}")[t] - inner) / MASS - weight
        rates[lower] = (inner - support) / MASS - weight
    return rates


def _lengths(b: Any, t: float) -> list[Any]:
    from_pulley = sum((p - q) ** 2 for p, q in zip(_of(b, "lower_", t), PULLEY.values(), strict=True))
    return [
        b.slack[t] == b.tension[t] / STIFFNESS + LENGTH - _distance(b, t),
        b.gap[t] == pyo.sqrt(from_pulley + 1e-16),
    ]


def _clear(b: Any, t: float) -> Any:
    x, y, z = _of(b, "lower_", t)
    return ((x - 0.55) / 20) ** 2 + ((y - 0.21) / 2) ** 2 + ((z - 0.37) / 8) ** 2 >= 1e-4


def _elastic(b: Any, t: float) -> Any:
    return rcp.complements(b.tension[t] >= 0, b.slack[t] >= 0)


def _contact(b: Any, t: float) -> Any:
    return rcp.complements(b.support[t] >= 0, b.gap[t] >= 1e-8)


def _cost(b: Any, t: float) -> Any:
    places = speeds = 0.0
    for end, target in TARGET.items():
        places += sum((p - q) ** 2 for p, q in zip(_of(b, f"{end}_", t), target.values(), strict=True))
        speeds += sum(v**2 for v in _of(b, f"{end}_v", t))
    pull = sum((p - q) ** 2 for p, q in zip(_of(b, "pull_", t), HOLDING.values(), strict=True))
    return 1000 * places + 10 * speeds + 1e-5 * pull
