"""Stick and slip: a mass on a moving belt, with dry friction of limited strength that holds it or drags it.

``v' = u + F`` (or ``- k x + F``), where the force of friction pulls the mass towards the speed V of the belt with its
full strength while the speeds differ, and takes the value that keeps them equal while the mass sticks.

``ride`` puts the mass at rest onto the belt and asks where to let it ride: it has to stand still again 2.5 m further
on, with as little effort of the actuator as possible. Riding is free; braking over a time tau against friction a
costs at least ``tau (V / tau + a)^2``, which is least for ``tau = V / a``. ``spring`` ties the mass to a wall and
leaves nothing to choose: it sticks until the spring is as strong as friction, and then swings.

Dry friction as complementarity: Stewart, Rigid-Body Dynamics with Friction and Impact, SIAM Review 42 (2000),
doi:10.1137/S0036144599360110
"""

from __future__ import annotations

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

# Metres, seconds, and a mass of 1 kg.
DURATION, BELT, FRICTION, STIFFNESS = 3.0, 1.0, 2.0, 4.0
DISTANCE = BELT * DURATION - BELT**2 / FRICTION
STRETCH = -0.5


def build(case: str = "ride", elements: int = 60, stages: int = 2) -> pyo.ConcreteModel:
    """A mass on a belt, pushed by an actuator or held by a spring."""
    m = pyo.ConcreteModel(name="stick-slip")
    m.motion = b = rcp.PhaseBlock(duration=DURATION, elements=elements, stages=stages)
    riding = case == "ride"
    start, final = (0.0, 0.0), (DISTANCE, 0.0)
    if not riding:
        start, final = (STRETCH, BELT), (None, None)
    b.x = rcp.State(initial=start[0], final=final[0], initial_guess=lambda t: start[0] + 0.8 * t)
    b.v = rcp.State(initial=start[1], final=final[1], initial_guess=BELT / 2)
    b.friction = rcp.mechanics.CoulombFriction(lambda b, t: b.v[t] - BELT, normal=FRICTION, coefficient=1.0)
    if riding:
        b.force = rcp.Control(bounds=(-10, 10), parametrization="piecewise_constant")

    @b.ode
    def newton(b, t):
        other = b.force[t] if riding else -STIFFNESS * b.x[t]
        return {b.x: b.v[t], b.v: other + b.friction[t]}

    m.effort = pyo.Objective(expr=b.integral(lambda b, t: b.force[t] ** 2) if riding else 0)
    return m


def smallest_effort() -> float:
    """Of the best brake, in closed form."""
    return 4 * BELT * FRICTION


def swing(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and speed on the spring, in closed form."""
    release = (FRICTION / STIFFNESS - STRETCH) / BELT
    phase = np.sqrt(STIFFNESS) * np.maximum(times - release, 0)
    x = STRETCH + BELT * np.minimum(times, release) + BELT / np.sqrt(STIFFNESS) * np.sin(phase)
    return x, BELT * np.cos(phase)


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Where the mass is, how fast it and the belt are, and what acts on it; sticking is shaded."""
    trajectory = m.motion.trajectory()
    labels = {"x": "position [m]", "v": "speed [m/s]", "friction": "friction [N]"}
    if "force" in trajectory.signals:
        labels["force"] = "actuator [N]"
    trajectory.plot(labels, figure=figure)
    figure.suptitle(m.name)
    sticks = trajectory.friction_forward + trajectory.friction_backward < 1e-3 * BELT
    through = sticks[1:] & sticks[:-1]  # a mass that has just reached the belt's speed did not stick before
    axes = figure.axes[: len(labels)]
    for axis in axes:
        for start, end in zip(trajectory.points[:-1][through], trajectory.points[1:][through], strict=True):
            axis.axvspan(start, end, color="C2", alpha=0.15, linewidth=0)
    axes[1].axhline(BELT, color="0.4", linewidth=1, linestyle="--")


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"case": name} for name in ("ride", "spring")}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 15}, size=(10, 6))
