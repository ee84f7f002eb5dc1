"""Keep a pole upright on a cart between two soft walls, which its tip may lean on.

The motor is too weak to catch the pole by itself from where it falls: a wall has to push it back. A wall is a spring
that acts only while it is pressed in; the optimiser finds whether and when.

``linear`` is the published model, linear but for the walls. ``nonlinear`` is the same machine with its full equations:
the tip is at ``x - l sin(theta)``, and the force on it moves the cart too.

The mass of the pole and the two stiffnesses are parameters of the phase. Planning fixes them; an identification frees
them (`state_cart_pole` states the machine on any phase).

Aydinoglu, Preciado & Posa, Contact-Aware Controller Design for Complementarity Systems, ICRA 2020,
doi:10.1109/ICRA40945.2020.9197568; Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization
Package for Manipulation, ICRA 2022, sec. V-E, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_linkage

import pyrobocop_pyomo as rcp

CART, LENGTH, GRAVITY, WALL = 1.0, 0.5, 9.81, 0.1
# What an identification finds: mass of the pole in kg, stiffness of the walls in N/m.
NOMINAL = {"pole_mass": 0.1, "right_stiffness": 10.0, "left_stiffness": 10.0}
STATES = ("x", "theta", "v", "omega")


def build(
    case: str = "linear",
    elements: int = 100,
    duration: float = 2.0,
    start: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 2.0),
    strongest: float = 1.0,
) -> pyo.ConcreteModel:
    """Bring the pole to rest in the middle, from a kick that throws it against the left wall."""
    m = pyo.ConcreteModel(name="cart-pole with soft walls")
    m.balance = b = rcp.PhaseBlock(duration=duration, elements=elements, scheme="implicit_euler")
    b.force = rcp.Control(bounds=(-strongest, strongest))
    state_cart_pole(b, start, linear=case == "linear")
    for name, value in NOMINAL.items():
        b.component(name).fix(value)
    m.cost = pyo.Objective(
        expr=b.integral(
            lambda b, t: 10 * b.x[t] ** 2 + b.theta[t] ** 2 + b.v[t] ** 2 + b.omega[t] ** 2 + b.force[t] ** 2
        )
    )
    return m


def state_cart_pole(
    b,
    start: tuple[float, float, float, float],
    *,
    linear: bool = True,
    parameters: Mapping[str, float] = NOMINAL,
    bounds: tuple[float, float] = (1e-3, 1e3),
) -> None:
    """States, walls and equations of the machine on a phase that has its ``force``; parameters are guesses here."""
    for name, guess in parameters.items():
        b.declare(name, rcp.Parameter(bounds=bounds, initial_guess=guess))
    for name, value in zip(STATES, start, strict=True):
        b.declare(name, rcp.State(initial=value, initial_guess=value))

    def tip(b, t):
        return b.x[t] - LENGTH * (b.theta[t] if linear else pyo.sin(b.theta[t]))

    b.right = rcp.mechanics.SoftWall(lambda b, t: WALL - tip(b, t), stiffness=b.right_stiffness)
    b.left = rcp.mechanics.SoftWall(lambda b, t: WALL + tip(b, t), stiffness=b.left_stiffness)

    @b.ode
    def cart_pole(b, t):
        accelerations = linear_accelerations if linear else nonlinear_accelerations
        cart, pole = accelerations(b.theta[t], b.omega[t], b.force[t], b.left[t] - b.right[t], b.pole_mass)
        return {b.x: b.v[t], b.theta: b.omega[t], b.v: cart, b.omega: pole}


def linear_accelerations(theta, omega, force, push, mass):
    """Of the cart and of the angle, near upright, where a push on the tip leaves the cart alone."""
    cart = (force + mass * GRAVITY * theta) / CART
    return cart, (cart + GRAVITY * theta - push / mass) / LENGTH


def nonlinear_accelerations(theta, omega, force, push, mass):
    """Of the cart and of the angle, from upright, with a horizontal push on the tip."""
    s, c = pyo.sin(theta), pyo.cos(theta)
    cart = (force + push * s**2 + mass * s * (GRAVITY * c - LENGTH * omega**2)) / (CART + mass * s**2)
    return cart, (c * cart + GRAVITY * s - c * push / mass) / LENGTH


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Cart and pole over time, and what acts on them."""
    trajectory = m.balance.trajectory()
    cart = np.stack([trajectory.x, np.zeros_like(trajectory.x)], axis=-1)
    tip = cart + LENGTH * np.stack([-np.sin(trajectory.theta), np.cos(trajectory.theta)], axis=-1)
    above, below = figure.subfigures(2, 1, height_ratios=(1.2, 1))
    draw_linkage(trajectory.time, np.stack([cart, tip], axis=1), cart=(0.1, 0.05), title=m.name, figure=above)
    for wall in (-WALL, WALL):
        above.axes[0].axvline(wall, color="C3", linewidth=1)
    trajectory.plot({"x": "cart [m]", "theta": "angle [rad]", "force": "motor [N]", "left": "wall [N]"}, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"case": name} for name in ("linear", "nonlinear")}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 40}, size=(12, 8))
