"""Find the mass of a pole and the stiffness of two soft walls from a noisy motion between them.

A feedback keeps the pole between the walls while two sinusoids throw it against them; its force is recorded, and
applied again to the model with the unknown parameters. (With sinusoids alone the unstable pole runs away, and nothing
can be learned from it.) The data do not say when the pole leans on which wall: the fit finds it, by complementarity.

Positions and velocities are measured with errors of a given standard deviation. The data come from the time stepping
that the model has, implicit Euler, so that without errors the parameters are found exactly; ``fine`` steps ten times
as often instead, and shows what the steps of the model cost.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, sec. V-E, doi:10.1109/ICRA46639.2022.9812069; the model is that of Aydinoglu, Preciado & Posa, ICRA 2020,
doi:10.1109/ICRA40945.2020.9197568
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np
import pyomo.environ as pyo
from cart_pole_soft_walls import CART, GRAVITY, LENGTH, NOMINAL, STATES, WALL, state_cart_pole

import pyrobocop_pyomo as rcp

STEP = 0.02
TRUE = (0.25, 8.0, 13.0)
# Of the linear-quadratic regulator for the nominal pole, states weighted by 10, 1, 1, 1 and the force by 1.
FEEDBACK = np.array([-3.1623, 36.8440, -4.2186, 8.1519])
BOUNDS = {"pole_mass": (0.02, 1.0), "right_stiffness": (1.0, 100.0), "left_stiffness": (1.0, 100.0)}


def build(elements: int = 200) -> pyo.ConcreteModel:
    """The machine with unknown parameters; its force is an input."""
    m = pyo.ConcreteModel(name="cart-pole identification")
    m.motion = b = rcp.PhaseBlock(duration=elements * STEP, elements=elements, scheme="implicit_euler")
    b.force = rcp.Control()
    state_cart_pole(b, (0.0, 0.0, 0.0, 0.0))
    for name, (lower, upper) in BOUNDS.items():
        b.component(name).setlb(lower)
        b.component(name).setub(upper)
    return m


def record(parameters: Sequence[float] = TRUE, elements: int = 200, substeps: int = 1) -> dict[str, np.ndarray]:
    """A motion without errors: times, states and the force that was applied, at the ends of the steps."""
    state, rows, forces = np.zeros(4), [], []
    for k in range(1, elements + 1):
        time = k * STEP
        force = 6 * np.sin(np.pi * time) + 4 * np.sin(2.2 * np.pi * time + 0.5) - FEEDBACK @ state
        for _ in range(substeps):
            state = stepped(state, force, STEP / substeps, *parameters)
        rows.append(state)
        forces.append(force)
    series = dict(zip(STATES, np.array(rows).T, strict=True))
    return {"time": STEP * np.arange(1, elements + 1), **series, "force": np.array(forces)}


def stepped(state: np.ndarray, force: float, step: float, mass: float, right: float, left: float) -> np.ndarray:
    """One step of implicit Euler: of all ways to touch the walls, the one whose forces and gaps have the right sign."""
    motion = np.zeros((4, 4))
    motion[:2, 2:] = np.eye(2)
    motion[2:, 1] = GRAVITY * mass / CART, GRAVITY * (CART + mass) / (LENGTH * CART)
    input_of = np.array([0.0, 0.0, 1.0, 1.0 / LENGTH]) / CART
    push = np.zeros((4, 2))
    push[3] = 1.0 / (LENGTH * mass), -1.0 / (LENGTH * mass)
    distance = np.array([[-1.0, LENGTH, 0.0, 0.0], [1.0, -LENGTH, 0.0, 0.0]])
    solve = np.linalg.inv(np.eye(4) - step * motion)
    alone, reach = solve @ (state + step * input_of * force), solve @ (step * push)
    gaps, matrix = distance @ alone + WALL, distance @ reach + np.diag([1.0 / right, 1.0 / left])
    for touched in itertools.chain.from_iterable(itertools.combinations((0, 1), count) for count in range(3)):
        forces, on = np.zeros(2), list(touched)
        forces[on] = np.linalg.solve(matrix[np.ix_(on, on)], -gaps[on]) if on else 0.0
        if min(forces.min(), (gaps + matrix @ forces).min()) >= -1e-12:
            return alone + reach @ forces
    raise ArithmeticError(f"no forces of the walls fit the step at {state}")


def measured(data: dict[str, np.ndarray], deviation: float, seed: int | Sequence[int] = 0) -> dict[str, np.ndarray]:
    """The same with errors on the states."""
    generator = np.random.default_rng(seed)
    return {
        name: values + deviation * generator.normal(size=values.size) if name in STATES else values
        for name, values in data.items()
    }


def label(m: pyo.ConcreteModel, data: dict[str, np.ndarray], deviation: float) -> pyo.ConcreteModel:
    """Apply the force, start from what was measured (at the guess the open-loop motion runs away), label the states."""
    m.motion.initialize({name: partial(np.interp, xp=data["time"], fp=data[name]) for name in (*STATES, "force")})
    m.motion.force.fix()
    return rcp.label_measurements(m, m.motion, data, outputs=STATES, error=deviation)


def identify(
    deviation: float = 1e-2, elements: int = 200, substeps: int = 1, **options
) -> tuple[pyo.ConcreteModel, rcp.SolveResult]:
    """Estimate the parameters, print what was found, and return the fitted model."""
    data = measured(record(elements=elements, substeps=substeps), deviation)
    m = label(build(elements), data, deviation)
    found = rcp.estimate(m, **options)
    print(found)
    for name, true in zip(NOMINAL, TRUE, strict=True):
        print(f"{name}: {found.estimates[f'motion.{name}'] / true - 1:+.1e} relative to the truth")
    m.found, m.title = found, f"errors of {deviation:g}, data of {substeps} steps per step of the model"
    return m, found.result


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Measurements and the fitted motion."""
    motion = m.motion.trajectory()
    axes = figure.subplots(len(STATES), sharex=True)
    by_output = m.found.residuals.groupby("output", sort=False)
    for axis, name, (_, rows) in zip(axes, STATES, by_output, strict=True):
        axis.plot(motion.time, motion[name], linewidth=1.4)
        axis.plot(rows["time"], rows["measured"], "C1.", markersize=4, alpha=0.6)
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time")
    figure.suptitle(m.title)


if __name__ == "__main__":
    from run_example import run_example

    cases = {
        "noisy": {"deviation": 1e-2},
        "fine": {"deviation": 1e-2, "substeps": 10},
    }
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 100}, size=(12, 8), search=identify)
