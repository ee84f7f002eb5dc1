"""A one-legged hopper: stance and flight are phases with different states, joined by the geometry of the leg.

The body is a point, the leg has no mass: a spring, a damper and a motor between body and foot. In flight the body falls
freely (``x, y`` and their rates); in stance it moves about its foot (length and angle of the leg, and their rates). At
lift-off the states of the body follow from the states of the leg, at touch-down the states of the leg from the body's.
Only the damper loses energy.

``leap`` jumps from rest onto the height of a ledge. ``gait`` is a periodic run at a given mean speed: the end of stance
is linked to the start of flight, all but the distance travelled. Both take the least motor force, squared and
integrated; the gait per distance.

The gait belongs to the spring-loaded inverted pendulum with a damper and a motor along the leg: Blickhan, The
spring-mass model for running and hopping, J. Biomechanics 22 (1989), doi:10.1016/0021-9290(89)90224-8
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

# Of a body of 1 kg with a leg of 1 m.
GRAVITY, LENGTH, STIFFNESS, DAMPING = 9.81, 1.0, 200.0, 2.0
LEDGE = (0.6, 1.5)


def build(case: str = "gait", elements: int = 20, stages: int = 3, speed: float = 3.0) -> pyo.ConcreteModel:
    """A leap, or one stride of a run."""
    m = pyo.ConcreteModel(name="hopper")
    grid = {"elements": elements, "stages": stages}
    m.flight = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 1), initial_guess=0.3), elements=1, stages=stages)
    m.stance = rcp.PhaseBlock(duration=rcp.Duration(bounds=(0.1, 1), initial_guess=0.3), **grid)
    if case == "leap":
        state_stance(m.stance, initial={"leg": 0.75, "leg_rate": 0, "angle_rate": 0}, angle=0.2)
        state_flight(m.flight, final={"x": LEDGE[0], "y": LEDGE[1], "v_y": 0})
        m.stance.foot.fix(0)
        m.lift_off = rcp.Link(m.stance, m.flight, jump=body_of_leg)
        m.effort = pyo.Objective(expr=effort(m.stance))
    else:
        state_flight(m.flight, initial={"x": 0})
        state_stance(m.stance, initial={"leg": LENGTH}, angle=-0.4)
        m.touch_down = rcp.Link(m.flight, m.stance, jump=lambda pre, post: leg_of_body(post, pre))
        m.lift_off = rcp.Link(m.stance, m.flight, omit=["x"], jump=body_of_leg_anywhere)
        stride = body_of_leg(m.lift_off.pre, None)["x"]
        m.mean_speed = pyo.Constraint(expr=stride == speed * (m.flight.duration + m.stance.duration))
        m.least_flight = pyo.Constraint(expr=m.flight.duration >= 0.25)
        m.effort_per_distance = pyo.Objective(expr=effort(m.stance) / stride)
    return m


def state_flight(b, initial=None, final=None) -> None:
    """The body falls freely."""
    for name, start in {"x": lambda t: 0.8 * t, "y": 1.0, "v_x": 2.0, "v_y": lambda t: 1 - 2 * t}.items():
        b.declare(
            name, rcp.State(initial=(initial or {}).get(name), final=(final or {}).get(name), initial_guess=start)
        )
    b.ode(lambda b, t: {b.x: b.v_x[t], b.y: b.v_y[t], b.v_x: 0, b.v_y: -GRAVITY})


def state_stance(b, initial, angle) -> None:
    """The body moves about its foot until the leg has its full length; the ground cannot pull."""
    b.leg = rcp.State(initial=initial.get("leg"), final=LENGTH, bounds=(0.4, LENGTH), initial_guess=0.9)
    b.angle = rcp.State(bounds=(-1, 1), initial_guess=lambda t: angle * (1 - 2 * t) if angle < 0 else angle)
    b.leg_rate = rcp.State(initial=initial.get("leg_rate"), initial_guess=lambda t: 2 * t - 1)
    b.angle_rate = rcp.State(initial=initial.get("angle_rate"), initial_guess=2)
    b.foot = rcp.Parameter(initial_guess=1)
    b.motor = rcp.Control(bounds=(-60, 60))

    @b.ode
    def spring_loaded_pendulum(b, t):
        force = ground_force(b, t)
        return {
            b.leg: b.leg_rate[t],
            b.angle: b.angle_rate[t],
            b.leg_rate: force - GRAVITY * pyo.cos(b.angle[t]) + b.leg[t] * b.angle_rate[t] ** 2,
            b.angle_rate: (GRAVITY * pyo.sin(b.angle[t]) - 2 * b.leg_rate[t] * b.angle_rate[t]) / b.leg[t],
        }

    @b.constraint
    def ground_pushes(b, t):
        return ground_force(b, t) >= 0


def ground_force(b, t):
    """Along the leg: spring, damper and motor."""
    return STIFFNESS * (LENGTH - b.leg[t]) - DAMPING * b.leg_rate[t] + b.motor[t]


def effort(stance):
    """What the motor costs."""
    return stance.integral(lambda b, t: b.motor[t] ** 2)


def body_of_leg(pre, post):
    """Position and velocity of the body: the start of flight at lift-off."""
    s, c = pyo.sin(pre.angle), pyo.cos(pre.angle)
    return {
        "x": pre.foot + pre.leg * s,
        "y": pre.leg * c,
        "v_x": pre.leg_rate * s + pre.leg * pre.angle_rate * c,
        "v_y": pre.leg_rate * c - pre.leg * pre.angle_rate * s,
    }


def body_of_leg_anywhere(pre, post):
    """The same without the distance travelled."""
    return {name: value for name, value in body_of_leg(pre, post).items() if name != "x"}


def leg_of_body(leg, body):
    """Touch-down: the same equations, which now determine the states of the leg and where the foot stands."""
    return [getattr(body, name) == value for name, value in body_of_leg(leg, None).items()]


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Body, leg and foot over the ground, and the signals of both phases."""
    stance, flight = m.stance.trajectory(), m.flight.trajectory()
    x, y = stance.foot + stance.leg * np.sin(stance.angle), stance.leg * np.cos(stance.angle)
    dense = flight(np.linspace(flight.time[0], flight.time[-1], 50))
    periodic = m.component("touch_down") is not None
    strides = [i * x[-1] for i in range(3)] if periodic else [0.0]
    above, below = figure.subfigures(2, 1, height_ratios=(1, 1.2))
    axis = above.subplots()
    for shift in strides:
        for i in np.linspace(0, len(x) - 1, 7).astype(int):
            axis.plot([stance.foot + shift, x[i] + shift], [0, y[i]], color="0.75", linewidth=1.2)
            axis.plot(x[i] + shift, y[i], "o", color="C0", markersize=4)
        axis.plot(stance.foot + shift, 0, "s", color="0.25", markersize=5)
        axis.plot(x + shift, y, color="C0", label="stance" if shift == 0 else None)
        axis.plot(dense["x"] + shift, dense["y"], color="C1", label="flight" if shift == 0 else None)
    axis.axhline(0, color="0.4", linewidth=1)
    if not periodic:
        axis.plot(*LEDGE, "*", color="C3", markersize=12, label="goal")
        axis.set_xlim(-1.2, 1.2)
    axis.set(xlabel="x [m]", ylabel="y [m]", title=m.name, ylim=(-0.08, 1.6), aspect="equal")
    axis.legend(loc="upper left")
    joined = rcp.join_trajectories([flight, stance] if periodic else [stance, flight])
    labels = {"y": "height [m]", "leg": "leg [m]", "motor": "motor [N]"}
    joined.plot(labels, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"case": name} for name in ("leap", "gait")}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 6}, size=(11, 7))
