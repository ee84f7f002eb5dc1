"""Balance a pole on a cart by planning again and again, while somebody pushes it.

Each step measures the state, plans two seconds ahead from there, and applies the first of the plan. The model is stated
once; a step only moves numbers.
"""

from __future__ import annotations

import argparse
from math import pi
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
from cart_pole import LENGTH, accelerations
from matplotlib.figure import Figure
from mechanism_pictures import draw_linkage
from scipy.integrate import solve_ivp

import pyrobocop_pyomo as rcp

STEP = 0.04  # seconds between two plans
PUSHES = {1.2: 1.5, 2.4: -2.0}  # when, and by how much the pole's rate jumps
STATES = ("position", "theta", "velocity", "omega")


def build(elements: int = 50) -> pyo.ConcreteModel:
    """Two seconds from wherever the cart is, towards the pole standing at zero."""
    m = pyo.ConcreteModel(name="balance")
    m.ahead = b = rcp.PhaseBlock(duration=2.0, elements=elements)
    b.position = rcp.State(initial=0, bounds=(-3, 3))
    b.theta = rcp.State(initial=pi, initial_guess=pi)
    b.velocity = rcp.State(initial=0)
    b.omega = rcp.State(initial=0)
    b.force = rcp.Control(bounds=(-25, 25), parametrization="piecewise_constant")

    @b.ode
    def cart_pole(b, t):
        cart, pole = accelerations(b.theta[t], b.omega[t], b.force[t])
        return {b.position: b.velocity[t], b.theta: b.omega[t], b.velocity: cart, b.omega: pole}

    def distance(b, t):
        return b.position[t] ** 2 + 10 * (b.theta[t] - pi) ** 2 + 0.1 * (b.velocity[t] ** 2 + b.omega[t] ** 2)

    end = b.final_time
    m.cost = pyo.Objective(
        expr=b.integral(lambda b, t: distance(b, t) + 0.001 * b.force[t] ** 2) + 10 * distance(b, end)
    )
    return m


def plant(t, x, force):
    """The real system, which happens to be the model."""
    cart, pole = accelerations(x[1], x[3], force(t))
    return [x[2], x[3], cart, pole]


def run(elements: int = 50, seconds: float = 4.0) -> dict[str, np.ndarray]:
    """The closed loop; what was measured, applied and spent at each step."""
    m = build(elements)
    controller = rcp.studies.RecedingHorizon(m, m.ahead)
    state = np.array([0.8, pi + 0.4, 0.0, 0.0])
    log: dict[str, list] = {name: [] for name in ("time", "state", "force", "seconds", "ipopt", "iterations")}
    for k in range(round(seconds / STEP)):
        now = k * STEP
        for when, push in PUSHES.items():
            state[3] += push if abs(now - when) < STEP / 2 else 0.0
        step = controller.step(dict(zip(STATES, state, strict=True)), advance=STEP if k else 0.0)
        if not step.solved:
            print(f"t = {now:.2f}: {step.status.value} Going on with the plan before.")
        for name, entry in zip(
            log,
            (now, state.copy(), step.plan(0.0)["force"], step.seconds, step.ipopt_seconds, step.iterations),
            strict=True,
        ):
            log[name].append(entry)
        plan = step.plan
        moved = solve_ivp(plant, (0, STEP), state, args=(lambda t, plan=plan: plan(t)["force"],), rtol=1e-6)
        state = moved.y[:, -1]
    return {name: np.array(entries) for name, entries in log.items()}


def draw(log: dict[str, np.ndarray]) -> Figure:
    """The motion, and what each step cost."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    left, right = figure.subfigures(1, 2)
    cart = np.stack([log["state"][:, 0], np.zeros(len(log["time"]))], axis=-1)
    tip = cart + LENGTH * np.stack([np.sin(log["state"][:, 1]), -np.cos(log["state"][:, 1])], axis=-1)
    draw_linkage(log["time"], np.stack([cart, tip], axis=1), cart=(0.3, 0.15), title="balance", figure=left)
    angle, force, spent = right.subplots(3, 1, sharex=True)
    angle.plot(log["time"], log["state"][:, 1] - pi)
    angle.set_ylabel("lean [rad]")
    force.step(log["time"], log["force"], where="post")
    force.set_ylabel("force [N]")
    spent.plot(log["time"], 1e3 * log["seconds"], label="step")
    spent.plot(log["time"], 1e3 * log["ipopt"], label="of it Ipopt")
    spent.set_ylabel("spent [ms]")
    spent.set_ylim(0, 1.1e3 * np.sort(log["seconds"])[-2])
    spent.legend()
    spent.set_xlabel("time [s]")
    for axis in (angle, force, spent):
        axis.grid(alpha=0.3)
        for when in PUSHES:
            axis.axvline(when, color="0.5", linestyle=":")
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--coarse", action="store_true", help="few elements, for a quick look")
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder of the picture (default: output)")
    arguments = parser.parse_args()
    log = run(elements=15 if arguments.coarse else 50)
    arguments.output.mkdir(parents=True, exist_ok=True)
    draw(log).savefig(arguments.output / "cart_pole_closed_loop.png", dpi=100)
    lean = abs(log["state"][-1, 1] - pi)
    step, ipopt = (1e3 * np.median(log[name]) for name in ("seconds", "ipopt"))
    print(
        f"{len(log['time'])} steps, {log['iterations'].mean():.1f} iterations each; {step:.1f} ms each, of it Ipopt "
        f"{ipopt:.1f} ms; the pole leans {lean:.4f} rad at the end"
    )
    raise SystemExit(0 if lean < 0.05 else 1)
