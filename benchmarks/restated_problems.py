"""Problems stated once, in metres, seconds and radians, and built in any other units of these.

A user who measures in feet, hours and degrees writes down other numbers: bounds, values at both ends, guesses and
coefficients. `Restated` makes these numbers. Rules are written in the base units; what they read is converted to these,
and what they give is converted back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

Values = SimpleNamespace
PLAIN, LENGTH, SPEED, ACCELERATION = (0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -2, 0)  # powers of length, time, angle
TIME, ANGLE, TURN, TURN_FASTER = (0, 1, 0), (0, 0, 1), (0, -1, 1), (0, -2, 1)


@dataclass(frozen=True)
class Units:
    """How many of the units chosen a metre, a second and a radian are."""

    metre: float = 1.0
    second: float = 1.0
    radian: float = 1.0

    def factor(self, dimension: tuple[int, int, int]) -> float:
        """How many of the units chosen one base unit of a dimension is."""
        length, time, angle = dimension
        return self.metre**length * self.second**time * self.radian**angle


UNITS = {
    "m, s, rad": Units(),
    "ft": Units(metre=1 / 0.3048),
    "h": Units(second=1 / 3600),
    "deg": Units(radian=180 / pi),
    "ft, h, deg": Units(1 / 0.3048, 1 / 3600, 180 / pi),
}


class Restated:
    """A model of one phase in units chosen, from numbers and rules in base units.

    Parameters
    ----------
    units : Units
    duration : float or tuple of float
        In seconds; least, largest and guessed where it is free.
    **mesh
        Of the phase.
    """

    def __init__(self, units: Units, duration: Any, **mesh: Any) -> None:
        self.model, self._units, self._dimensions = pyo.ConcreteModel(), units, {}
        if isinstance(duration, tuple):
            least, largest, guess = (number * units.second for number in duration)
            length: Any = rcp.Duration(bounds=(least, largest), initial_guess=guess)
        else:
            length = duration * units.second
        self.model.p = self.phase = rcp.PhaseBlock(duration=length, **mesh)

    def declare(self, kind: Callable[..., Any], dimension: tuple[int, int, int], **numbers: dict[str, Any]) -> None:
        """States, controls or algebraics of one dimension, by name."""
        by = self._units.factor(dimension)
        for name, said in numbers.items():
            self._dimensions[name] = dimension
            self.phase.declare(name, kind(**{key: _times(by, value) for key, value in said.items()}))

    def straight(self) -> None:
        """Straight lines as initial guess, where both ends are given."""
        self.phase.initialize_straight_lines()

    def values(self, b: Any, t: Any) -> Values:
        """What a rule reads, in base units."""
        return Values(**{name: getattr(b, name)[t] / self._units.factor(of) for name, of in self._dimensions.items()})

    def ode(self, rule: Callable[[Values], dict[str, Any]]) -> None:
        """Rates of change by name of the state."""

        def rates(b: Any, t: Any) -> Any:
            found = rule(self.values(b, t))
            return {
                getattr(b, name): rate * (self._units.factor(self._dimensions[name]) / self._units.second)
                for name, rate in found.items()
            }

        self.phase.ode(rates)

    def constraint(
        self, name: str, dimension: tuple[int, int, int], rule: Callable[[Values], tuple[Any, Any, Any]]
    ) -> None:
        """A lower bound, what is bounded, an upper bound."""
        by = self._units.factor(dimension)

        def bounded(b: Any, t: Any) -> Any:
            lower, body, upper = rule(self.values(b, t))
            return (_times(by, lower), by * body, _times(by, upper))

        bounded.__name__ = name
        self.phase.constraint(bounded)

    def pairs(
        self, rule: Callable[[Values], list[tuple[Any, tuple[int, int, int], Any, tuple[int, int, int]]]]
    ) -> None:
        """Two sides with their dimensions each."""

        def complementary(b: Any, t: Any) -> Any:
            return [
                rcp.complements(self._units.factor(of) * one >= 0, self._units.factor(to) * other >= 0)
                for one, of, other, to in rule(self.values(b, t))
            ]

        self.phase.complementarity(complementary)

    def integral(self, rule: Callable[[Values], Any], dimension: tuple[int, int, int]) -> Any:
        """Over time, in the units chosen."""
        return self._units.factor(dimension) * self.phase.integral(lambda b, t: rule(self.values(b, t)))

    def end(self) -> Values:
        """Values at the end of the phase, in base units."""
        return self.values(self.phase, self.phase.final_time)


def _times(by: float, value: Any) -> Any:
    """Numbers, also in tuples; None stays."""
    if value is None:
        return None
    return tuple(_times(by, part) for part in value) if isinstance(value, tuple) else by * value


def brachistochrone(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """The wire of the shortest time."""
    p = Restated(units, (0.1, 10, 2))
    p.declare(rcp.State, LENGTH, x={"initial": 0, "final": 10}, y={"initial": 10, "final": 5})
    p.declare(rcp.State, SPEED, v={"initial": 0, "initial_guess": 5})
    p.declare(rcp.Control, ANGLE, angle={"bounds": (0, pi), "initial_guess": 0.8})
    p.straight()
    p.ode(
        lambda v: {
            "x": v.v * pyo.sin(v.angle),
            "y": -v.v * pyo.cos(v.angle),
            "v": 9.80665 * pyo.cos(v.angle),
        }
    )
    p.model.cost = pyo.Objective(expr=p.phase.duration)
    return p.model, TIME


def bryson_denham(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """Turn back before a wall with the least effort."""
    p = Restated(units, 1)
    p.declare(rcp.State, LENGTH, x={"initial": 0, "final": 0, "bounds": (0, 1 / 9)})
    p.declare(rcp.State, SPEED, v={"initial": 1, "final": -1})
    p.declare(rcp.Control, ACCELERATION, u={})
    p.straight()
    p.ode(lambda v: {"x": v.v, "v": v.u})
    effort = (2, -4, 0)
    p.model.cost = pyo.Objective(expr=0.5 * p.integral(lambda v: v.u**2, effort))
    return p.model, (2, -3, 0)


def cart_pole(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """Swing a pole up with the least effort."""
    p = Restated(units, 2, elements=20)
    p.declare(rcp.State, LENGTH, x={"initial": 0, "final": 1, "bounds": (-2, 2)})
    p.declare(rcp.State, ANGLE, angle={"initial": 0, "final": pi, "bounds": (-2 * pi, 2 * pi)})
    p.declare(rcp.State, SPEED, v={"initial": 0, "final": 0})
    p.declare(rcp.State, TURN, turn={"initial": 0, "final": 0})
    p.declare(rcp.Control, ACCELERATION, u={"bounds": (-20, 20)})
    p.straight()

    def swing(v: Values) -> dict[str, Any]:
        sine, cosine = pyo.sin(v.angle), pyo.cos(v.angle)
        inertia = 1 + 0.3 * (1 - cosine**2)
        cart = (0.15 * sine * v.turn**2 + v.u + 0.3 * 9.81 * cosine * sine) / inertia
        pole = -(0.15 * cosine * sine * v.turn**2 + v.u * cosine + 1.3 * 9.81 * sine) / (0.5 * inertia)
        return {"x": v.v, "angle": v.turn, "v": cart, "turn": pole}

    p.ode(swing)
    p.model.cost = pyo.Objective(expr=p.integral(lambda v: v.u**2, (2, -4, 0)))
    return p.model, (2, -3, 0)


def moon_landing(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """Land softly with the least fuel."""
    p = Restated(units, (0.1, 100, 4), elements=20)
    p.declare(rcp.State, LENGTH, h={"initial": 10, "final": 0, "bounds": (0, None)})
    p.declare(rcp.State, SPEED, v={"initial": -2, "final": 0})
    p.declare(rcp.Control, ACCELERATION, u={"bounds": (0, 3), "initial_guess": 1.5})
    p.straight()
    p.ode(lambda v: {"h": v.v, "v": v.u - 1.5})
    p.model.cost = pyo.Objective(expr=p.integral(lambda v: v.u, ACCELERATION))
    return p.model, SPEED


def hang_glider(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """As far as possible, through an updraft."""
    p = Restated(units, (10, 200, 100), elements=50)
    p.declare(rcp.State, LENGTH, x={"initial": 0, "bounds": (0, None), "initial_guess": 600})
    p.declare(rcp.State, LENGTH, y={"initial": 1000, "final": 900, "bounds": (0, None)})
    p.declare(rcp.State, SPEED, u={"initial": 13.2275675, "final": 13.2275675, "bounds": (0, None)})
    p.declare(rcp.State, SPEED, v={"initial": -1.28750052, "final": -1.28750052})
    p.declare(rcp.Control, PLAIN, lift={"bounds": (0, 1.4), "initial_guess": 1})
    p.straight()

    def glider(v: Values) -> dict[str, Any]:
        place = (v.x / 100 - 2.5) ** 2
        w = v.v - 2.5 * (1 - place) * pyo.exp(-place)
        pressure = 0.5 * 1.13 * 14 * pyo.sqrt(v.u**2 + w**2) / 100
        drag = 0.034 + 0.069662 * v.lift**2
        forward, upward = pressure * (-v.lift * w - drag * v.u), pressure * (v.lift * v.u - drag * w) - 9.80665
        return {"x": v.u, "y": v.v, "u": forward, "v": upward}

    p.ode(glider)
    p.model.cost = pyo.Objective(expr=p.phase.x[p.phase.final_time], sense=pyo.maximize)
    return p.model, LENGTH


def zermelo(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """Home across a current."""
    p = Restated(units, (0.1, 20, 5))
    p.declare(rcp.State, LENGTH, x={"initial": 3.65866, "final": 0}, y={"initial": -1.8637, "final": 0})
    p.declare(rcp.Control, ANGLE, heading={"bounds": (0, 2 * pi), "initial_guess": 3})
    p.straight()
    p.ode(lambda v: {"x": pyo.cos(v.heading) - v.y, "y": pyo.sin(v.heading)})
    p.model.cost = pyo.Objective(expr=p.phase.duration)
    return p.model, TIME


def robot_arm(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """Swing a telescopic arm in the shortest time."""
    p = Restated(units, (1, 100, 10), elements=20)
    p.declare(rcp.State, LENGTH, rho={"initial": 4.5, "final": 4.5, "bounds": (0, 5)})
    p.declare(rcp.State, ANGLE, theta={"initial": 0, "final": 2 * pi / 3, "bounds": (-pi, pi)})
    p.declare(rcp.State, ANGLE, phi={"initial": pi / 4, "final": pi / 4, "bounds": (0, pi)})
    p.declare(rcp.State, SPEED, rho_rate={"initial": 0, "final": 0})
    p.declare(rcp.State, TURN, theta_rate={"initial": 0, "final": 0}, phi_rate={"initial": 0, "final": 0})
    p.declare(rcp.Control, PLAIN, **{f"u{i}": {"bounds": (-1, 1)} for i in range(3)})
    p.straight()

    def arm(v: Values) -> dict[str, Any]:
        inertia = ((5 - v.rho) ** 3 + v.rho**3) / 3
        rates = {"rho_rate": v.u0 / 5, "phi_rate": v.u2 / inertia}
        rates["theta_rate"] = v.u1 / (inertia * pyo.sin(v.phi) ** 2)
        return {"rho": v.rho_rate, "theta": v.theta_rate, "phi": v.phi_rate, **rates}

    p.ode(arm)
    p.model.cost = pyo.Objective(expr=p.phase.duration)
    return p.model, TIME


def missile(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """A bunt: arrive from above in the shortest time."""
    p = Restated(units, (20, 50, 45), elements=40)
    p.declare(rcp.State, ANGLE, path={"initial": 0, "final": -pi / 2})
    p.declare(rcp.State, SPEED, v={"initial": 272, "final": 310, "bounds": (200, 310)})
    p.declare(rcp.State, LENGTH, x={"initial": 0, "final": 10000})
    p.declare(rcp.State, LENGTH, h={"initial": 30, "final": 0, "bounds": (0, 3000), "initial_guess": 500})
    p.declare(rcp.Control, ANGLE, attack={"bounds": (-0.3, 0.3)})
    p.declare(rcp.Control, ACCELERATION, thrust={"bounds": (1000 / 1005, 6000 / 1005), "initial_guess": 4})
    p.straight()

    def forces(v: Values) -> tuple[Any, Any]:
        pressure = 0.5 * (3.312e-9 * v.h**2 - 1.142e-4 * v.h + 1.224) * v.v**2 * 0.3376 / 1005
        along = v.thrust - pressure * (-1.9431 * v.attack**2 - 0.1499 * v.attack + 0.2359)
        lift = pressure * 21.9 * v.attack
        return (
            along * pyo.cos(v.attack) - lift * pyo.sin(v.attack),
            along * pyo.sin(v.attack) + lift * pyo.cos(v.attack),
        )

    def flight(v: Values) -> dict[str, Any]:
        along, upward = forces(v)
        sine, cosine = pyo.sin(v.path), pyo.cos(v.path)
        turning = (upward - 9.81 * cosine) / v.v
        return {"path": turning, "v": along - 9.81 * sine, "x": v.v * cosine, "h": v.v * sine}

    p.ode(flight)
    p.constraint("load", ACCELERATION, lambda v: (-4 * 9.81, forces(v)[1], 4 * 9.81))
    p.model.cost = pyo.Objective(expr=p.phase.duration)
    return p.model, TIME


def around_a_disc(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """A car past a disc in the shortest time."""
    p = Restated(units, (1, 60, 15), elements=30)
    p.declare(rcp.State, LENGTH, x={"initial": 0, "final": 20}, y={"initial": 0, "final": 2})
    p.declare(rcp.State, ANGLE, heading={"initial": 0, "final": 0, "bounds": (-pi, pi)})
    p.declare(rcp.State, SPEED, v={"initial": 0, "final": 0, "bounds": (0, 5)})
    p.declare(rcp.Control, ACCELERATION, a={"bounds": (-2, 1)})
    p.declare(rcp.Control, (-1, 0, 1), curvature={"bounds": (-0.3, 0.3)})
    p.straight()
    p.ode(
        lambda v: {
            "x": v.v * pyo.cos(v.heading),
            "y": v.v * pyo.sin(v.heading),
            "heading": v.v * v.curvature,
            "v": v.a,
        }
    )
    p.constraint("apart", (2, 0, 0), lambda v: (9, (v.x - 10) ** 2 + (v.y - 0.5) ** 2, None))
    p.model.cost = pyo.Objective(expr=p.phase.duration)
    return p.model, TIME


def quadrotor(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """From rest to rest in a vertical plane with little effort."""
    p = Restated(units, 3, elements=30)
    p.declare(rcp.State, LENGTH, x={"initial": 0, "final": 2}, z={"initial": 0, "final": 1})
    p.declare(rcp.State, SPEED, u={"initial": 0, "final": 0}, w={"initial": 0, "final": 0})
    p.declare(rcp.State, ANGLE, tilt={"initial": 0, "final": 0})
    p.declare(rcp.State, TURN, turn={"initial": 0, "final": 0})
    p.declare(rcp.Control, ACCELERATION, left={"bounds": (0, 10)}, right={"bounds": (0, 10)})
    p.straight()

    def body(v: Values) -> dict[str, Any]:
        lift = v.left + v.right
        return {
            "x": v.u,
            "z": v.w,
            "tilt": v.turn,
            "u": -lift * pyo.sin(v.tilt),
            "w": lift * pyo.cos(v.tilt) - 9.81,
            "turn": 6 * (v.right - v.left),
        }

    p.ode(body)
    p.model.cost = pyo.Objective(expr=p.integral(lambda v: v.left**2 + v.right**2, (2, -4, 0)))
    return p.model, (2, -3, 0)


def orbit_raising(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """The largest circular orbit in 193 days; a length of the first radius, a time of a radian of the first orbit."""
    p = Restated(units, 3.3207, elements=20)
    p.declare(rcp.State, LENGTH, r={"initial": 1, "bounds": (0.5, 3), "initial_guess": 1.2})
    p.declare(rcp.State, SPEED, u={"initial": 0, "final": 0}, v={"initial": 1, "initial_guess": 0.9})
    p.declare(rcp.State, (0, 0, 0), mass={"initial": 1, "initial_guess": 0.9})
    p.declare(rcp.Control, ANGLE, way={"bounds": (-pi, 2 * pi), "initial_guess": 1})

    def orbit(v: Values) -> dict[str, Any]:
        thrust = 0.1405 / v.mass
        outward = v.v**2 / v.r - 1 / v.r**2 + thrust * pyo.sin(v.way)
        return {"r": v.u, "u": outward, "v": -v.u * v.v / v.r + thrust * pyo.cos(v.way), "mass": -0.0749}

    p.ode(orbit)
    end = p.end()
    p.model.circle = pyo.Constraint(expr=units.factor((3, -2, 0)) * end.v**2 * end.r == units.factor((3, -2, 0)))
    p.model.cost = pyo.Objective(expr=p.phase.r[p.phase.final_time], sense=pyo.maximize)
    return p.model, LENGTH


def block_with_friction(units: Units) -> tuple[pyo.ConcreteModel, tuple[int, int, int]]:
    """A block on a rough floor, from rest to rest with the least effort: pairs for its sliding both ways."""
    p = Restated(units, 3, elements=20, scheme="implicit_euler")
    p.declare(rcp.State, LENGTH, x={"initial": 0, "final": 2})
    p.declare(rcp.State, SPEED, v={"initial": 0, "final": 0})
    p.declare(rcp.Control, ACCELERATION, u={"bounds": (-5, 5)}, friction={"bounds": (-1, 1)})
    p.declare(rcp.Algebraic, SPEED, ahead={"bounds": (0, None)})
    p.straight()
    p.ode(lambda v: {"x": v.v, "v": v.u - v.friction})
    p.pairs(
        lambda v: [
            (v.ahead, SPEED, 1 - v.friction, ACCELERATION),
            (v.ahead - v.v, SPEED, 1 + v.friction, ACCELERATION),
        ]
    )
    p.model.cost = pyo.Objective(expr=p.integral(lambda v: v.u**2, (2, -4, 0)))
    return p.model, (2, -3, 0)


PROBLEMS = (
    brachistochrone, bryson_denham, cart_pole, moon_landing, hang_glider, zermelo, robot_arm, missile, around_a_disc,
    quadrotor, orbit_raising, block_with_friction,
)  # fmt: skip


def value_of(model: pyo.ConcreteModel, units: Units, dimension: tuple[int, int, int]) -> float:
    """The objective in base units."""
    return float(np.float64(pyo.value(model.cost)) / units.factor(dimension))
