"""A ball that bounces: phases of free flight, linked by the law of impact.

Each impact turns the vertical speed around and takes a part of it: ``v+ = -e v-``; the horizontal speed and the
position continue. The times of the impacts are not given: every flight lasts until the ball is back on the floor.

``drop`` lets the ball fall from a height; nothing is left to choose, and the times of all impacts are known in
closed form. The picture compares them with a simulation that knows no flights: one phase with the floor as a pair,
which finds its impacts step by step. ``throw`` seeks the slowest throw from the floor whose ball, after a number of
impacts, lands at a given distance: the first flight then lasts ``T = 2 v / g``, each other ``e`` times as long as the
one before.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

GRAVITY, RESTITUTION, HEIGHT, DISTANCE = 9.81, 0.8, 1.0, 5.0


def build(case: str = "drop", bounces: int = 4, elements: int = 1) -> pyo.ConcreteModel:
    """One flight more than there are bounces. A parabola is exact on a single element of two stages or more."""
    m = pyo.ConcreteModel(name="bouncing ball")
    m.flights = rcp.PhaseBlock(
        range(bounces + 1),
        duration=rcp.Duration(bounds=(0.01, 5), initial_guess=0.5),
        elements=elements,
        rule=state_flight,
    )
    m.impacts = rcp.Link(m.flights, jump=impact)
    first, last = m.flights[0], m.flights[bounces]
    first.x[0].fix(0)
    first.height[0].fix(HEIGHT if case == "drop" else 0)
    if case == "drop":
        first.v_x[0].fix(0.5)
        first.v_y[0].fix(0)
        m.nothing_to_choose = pyo.Objective(expr=0)
    else:
        last.x[1].fix(DISTANCE)
        m.squared_speed = pyo.Objective(expr=first.v_x[0] ** 2 + first.v_y[0] ** 2)
    return m


def state_flight(b, k) -> None:
    """Free flight that ends on the floor."""
    b.x, b.height = rcp.State(), rcp.State(bounds=(0, None), final=0)
    b.v_x, b.v_y = rcp.State(initial_guess=1), rcp.State(initial_guess=lambda t: 1 - 2 * t)
    b.ode(lambda b, t: {b.x: b.v_x[t], b.height: b.v_y[t], b.v_x: 0, b.v_y: -GRAVITY})


def impact(pre, post):
    """The law of impact; what is not in it continues."""
    return post.v_y == -RESTITUTION * pre.v_y


def step_through(duration: float, elements: int = 500) -> rcp.Trajectory:
    """The dropped ball in one phase, simulated with the floor as a pair of height and force."""
    m = pyo.ConcreteModel(name="stepped ball")
    m.ball = b = rcp.PhaseBlock(duration=duration, elements=elements, scheme="implicit_euler")
    b.height, b.v_y = rcp.State(initial=HEIGHT), rcp.State(initial=0)
    b.push = rcp.Algebraic(bounds=(0, None))
    b.ode(lambda b, t: {b.height: b.v_y[t], b.v_y: b.push[t] - GRAVITY})

    @b.complementarity
    def floor(b, t):
        return rcp.complements(b.height[t] >= 0, b.push[t] >= 0)

    return b.simulate(restitution={"floor": RESTITUTION})


def impact_times(bounces: int) -> np.ndarray:
    """When the dropped ball meets the floor, in closed form."""
    fall = sqrt(2 * HEIGHT / GRAVITY)
    return fall + np.concatenate([[0.0], np.cumsum(2 * fall * RESTITUTION ** np.arange(1, bounces + 1))])


def smallest_squared_speed(bounces: int) -> float:
    """Of the throw, in closed form: ``v_x v_y`` is given by the distance, so that both are equal at the best."""
    flights = sum(RESTITUTION**k for k in range(bounces + 1))
    return GRAVITY * DISTANCE / flights


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The path of the ball, and height and speed over time."""
    joined = rcp.join_trajectories(m.flights.values())
    left, right = figure.subfigures(1, 2, width_ratios=(1.1, 1))
    axis = left.subplots()
    dense = np.linspace(*joined.boundaries[[0, -1]], 400)
    values = joined(dense)
    axis.plot(values["x"], values["height"])
    grounded = joined(joined.boundaries[1:])
    axis.plot(grounded["x"], grounded["height"], "o", color="0.25", markersize=4)
    axis.axhline(0, color="0.4", linewidth=1)
    axis.set(xlabel="x [m]", ylabel="height [m]", title=f"{m.name}, {len(m.impacts)} impacts")
    joined.plot({"height": "height [m]", "v_y": "vertical\nspeed [m/s]"}, figure=right)
    if m.flights[0].v_x[0].fixed:  # the dropped ball
        stepped = step_through(joined.boundaries[-1] - joined.boundaries[0])
        for axis, name in zip(right.axes, ("height", "v_y"), strict=False):
            axis.plot(stepped.time, stepped.states[name], "--", color="C3", linewidth=1, label="simulated in steps")
        right.axes[0].legend(loc="upper right", fontsize="small")


if __name__ == "__main__":
    from run_example import run_example

    cases = {"drop": {"case": "drop"}, "throw": {"case": "throw", "bounces": 2}}
    run_example(build, draw, cases=cases, default="all", coarse={}, size=(13, 4.2))
