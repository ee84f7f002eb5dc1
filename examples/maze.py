"""Roll a ball along the rings of a tilting maze, by a model of its friction that was learned from data.

The plate tilts by two angles that follow the commands of two servos; the ball rolls in a circular ring. Its
acceleration by gravity and rotation is known; the effect of friction is learned as the mean of a Gaussian process in
nine inputs, from 4842 recorded steps of 1/30 s. The data are made here: by a simulation with a dry friction that varies
along the ring, which the planner does not know. The plan is then tried on that simulation.

What is learned from recorded steps is the mean acceleration over a step. So the model is a map from one step to the
next, and is used as that map: as a step map with the very step of the data. Taken for a differential equation, and
integrated by another step or another method, it would be another model.

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, doi:10.1109/ICRA46639.2022.9812069; the semi-parametric model is that of Romeres, Jha, Dalla Libera,
Yerazunis & Nikovski, Semiparametrical Gaussian Processes Learning of Forward Dynamical Models for Navigating in a
Circular Maze, ICRA 2019, arXiv:1809.04993
"""

from __future__ import annotations

from functools import cache
from math import exp, pi
from typing import Any, NamedTuple

import numpy as np
import pyomo.environ as pyo
from gaussian_process import GaussianProcessMean

import pyrobocop_pyomo as rcp

STEP = 1 / 30  # s, of the camera
GRAVITY = 9.806
SERVO = 15.0  # rad/s; both servos are critically damped
RADII = {"outer": 0.175, "second": 0.14, "third": 0.105, "inner": 0.07}
INPUTS = ["theta_rate", "gamma_rate", "beta_rate", "sin_theta", "cos_theta", "sin_gamma", "cos_gamma", "sin_beta",
          "cos_beta"]  # fmt: skip


class LearnedRing(NamedTuple):
    """Weights of the known terms, and the function that was learned for the rest, with what it is made of."""

    weights: np.ndarray
    friction: Any
    mean: GaussianProcessMean | None = None


def build(ring: str = "outer", samples: int = 4842, elements: int = 90) -> pyo.ConcreteModel:
    """From 0 to 45 degrees in the outer and the third ring, back in the other two."""
    outward = ring in ("outer", "third")
    start, goal = (0.0, pi / 4) if outward else (pi / 4, 0.0)
    model = learned(ring, samples)
    m = pyo.ConcreteModel(name="maze")
    m.ring = pyo.Param(initialize=ring, within=pyo.Any)
    m.roll = b = rcp.PhaseBlock(duration=elements * STEP, elements=elements, scheme="implicit_euler")
    b.theta = rcp.State(initial=start, bounds=(-2 * pi, 2 * pi))
    b.theta_rate = rcp.State(initial=0, bounds=(-10, 10))
    for name in ("beta", "gamma"):
        setattr(b, name, rcp.State(initial=0, bounds=(-2 * pi, 2 * pi)))
        setattr(b, f"{name}_rate", rcp.State(initial=0, bounds=(-10, 10)))
        setattr(b, f"{name}_command", rcp.Control(bounds=(-0.1, 0.1)))

    @b.step_map
    def recorded_step(b, t, previous):
        theta, rate, beta, gamma = previous.theta, previous.theta_rate, previous.beta, previous.gamma
        sines, cosines = [[f(a) for a in (theta, gamma, beta)] for f in (pyo.sin, pyo.cos)]
        trigonometric = [number for both in zip(sines, cosines, strict=True) for number in both]
        inputs = [rate, previous.gamma_rate, previous.beta_rate, *trigonometric]
        known = sum(w * term for w, term in zip(model.weights, known_terms(inputs), strict=True))
        acceleration = known + model.friction(inputs)
        following = {
            b.theta: theta + STEP * rate + STEP**2 / 2 * acceleration,
            b.theta_rate: rate + STEP * acceleration,
        }
        for name in ("beta", "gamma"):
            angle, angle_rate, command = (b.component(name + part) for part in ("", "_rate", "_command"))
            following[angle], following[angle_rate] = servo_step(
                getattr(previous, name), getattr(previous, f"{name}_rate"), command[t]
            )
        return following

    @b.integral
    def effort(b, t):
        commands = pyo.cosh(b.beta_command[t] / 0.02) + pyo.cosh(b.gamma_command[t] / 0.02)
        return (b.theta[t] - goal) ** 2 + 0.1 * b.theta_rate[t] ** 2 + 0.04 * (commands - 2)

    m.cost = pyo.Objective(expr=effort)
    return m


def known_terms(inputs: Any) -> list:
    """Rotation, gravity and drag, each with a weight of its own; the inputs are numbers, arrays or expressions."""
    rate, gamma_rate, beta_rate, s, c, s_gamma, c_gamma, s_beta, _ = inputs
    return [
        -(beta_rate**2) * s * c * c_gamma**2,
        -2 * gamma_rate * beta_rate * c_gamma * c**2,
        gamma_rate**2 * s * c,
        -GRAVITY * s_gamma * s,
        -GRAVITY * s_beta * c_gamma * c,
        -rate,
    ]


def servo_step(angle: Any, rate: Any, command: Any) -> tuple[Any, Any]:
    """Angle and rate of a critically damped servo one step later, its command constant."""
    decay, error = exp(-SERVO * STEP), angle - command
    slope = rate + SERVO * error
    return command + decay * (error + STEP * slope), decay * (rate - STEP * SERVO * slope)


# ---------------------------------------------------------------- the maze that the planner does not know


def simulate_step(ring: str, state: np.ndarray, commands: np.ndarray, parts: int = 20) -> np.ndarray:
    """(theta, rate, beta, beta rate, gamma, gamma rate) a step later, for many balls at once; Runge-Kutta."""

    def rates(x: np.ndarray) -> np.ndarray:
        theta, rate, beta, beta_rate, gamma, gamma_rate = x
        pull = -np.sin(gamma) * np.sin(theta) - np.sin(beta) * np.cos(gamma) * np.cos(theta)
        rolling = 5 / 7 * (GRAVITY / RADII[ring] * pull + gamma_rate**2 * np.sin(theta) * np.cos(theta))
        dry = 0.6 * (1 + 0.5 * np.sin(3 * theta)) * np.tanh(rate / 0.3)
        beta_acceleration, gamma_acceleration = (
            SERVO * (SERVO * (command - angle) - 2 * angle_rate)
            for command, angle, angle_rate in zip(commands, (beta, gamma), (beta_rate, gamma_rate), strict=True)
        )
        return np.array(
            [rate, rolling - dry - 0.2 * rate, beta_rate, beta_acceleration, gamma_rate, gamma_acceleration]
        )

    h = STEP / parts
    for _ in range(parts):
        first = rates(state)
        second = rates(state + h / 2 * first)
        third = rates(state + h / 2 * second)
        state = state + h / 6 * (first + 2 * second + 2 * third + rates(state + h * third))
    return state


def inputs_of(state: np.ndarray) -> list[np.ndarray]:
    """What the learned model reads, in the order of its inputs."""
    theta, rate, beta, beta_rate, gamma, gamma_rate = state
    return [rate, gamma_rate, beta_rate, np.sin(theta), np.cos(theta), np.sin(gamma), np.cos(gamma), np.sin(beta),
            np.cos(beta)]  # fmt: skip


@cache
def recorded(ring: str, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and mean accelerations of recorded steps, with the noise of the measurement of rates."""
    random = np.random.default_rng(sorted(RADII).index(ring))
    balls = -(-samples // 90)
    state = np.zeros((6, balls))
    state[0] = random.uniform(-pi, pi, balls)
    inputs, accelerations = [], []
    for k in range(90):
        if k % 8 == 0:
            commands = random.uniform(-0.1, 0.1, (2, balls)) * random.uniform(0, 1, balls)
        following = simulate_step(ring, state, commands)
        inputs.append(np.array(inputs_of(state)).T)
        accelerations.append((following[1] - state[1]) / STEP + random.normal(0, 0.02, balls))
        state = following
    return np.concatenate(inputs)[:samples], np.concatenate(accelerations)[:samples]


@cache
def learned(ring: str, samples: int) -> LearnedRing:
    """Weights by least squares, and a Gaussian process for what they leave."""
    inputs, accelerations = recorded(ring, samples)
    terms = np.array(known_terms(inputs.T)).T
    weights = np.linalg.lstsq(terms, accelerations, rcond=None)[0]
    mean = GaussianProcessMean.fit(inputs, accelerations - terms @ weights)
    return LearnedRing(weights, mean.as_function(f"friction of the {ring} ring", INPUTS), mean)


def tried(m: pyo.ConcreteModel) -> np.ndarray:
    """Angles of the ball in the simulation, with the commands of the plan."""
    plan = m.roll.trajectory()
    state = np.array([[plan.theta[0]], [0.0], [0.0], [0.0], [0.0], [0.0]])
    angles = [state[0, 0]]
    for k in range(1, len(plan.time)):
        commands = np.array([[plan.beta_command[k - 1]], [plan.gamma_command[k - 1]]])
        state = simulate_step(m.ring.value, state, commands)
        angles.append(state[0, 0])
    return np.array(angles)


def draw(figure, m: pyo.ConcreteModel) -> None:
    """The way of the ball in its ring, its angle as planned and as tried, and the tilt of the plate."""
    plan, angles = m.roll.trajectory(), tried(m)
    print(f"ball at the end: planned {plan.theta[-1]:.4f}, tried {angles[-1]:.4f} rad")
    above, middle, below = figure.subplots(3, 1, height_ratios=(2.2, 1, 1))
    around = np.linspace(0, 2 * pi, 200)
    for ring, radius in RADII.items():
        above.plot(radius * np.cos(around), radius * np.sin(around), color="0.6" if ring == m.ring.value else "0.85")
    radius = RADII[m.ring.value]
    above.plot(radius * np.cos(angles), radius * np.sin(angles), lw=3)
    above.plot(radius * np.cos(angles[[0, -1]]), radius * np.sin(angles[[0, -1]]), "o", color="black", ms=4)
    above.set_aspect("equal")
    above.set_axis_off()
    above.set_title(f"{m.ring.value} ring")
    middle.plot(plan.time, plan.theta, label="planned")
    middle.plot(plan.time, angles, "--", label="tried")
    middle.set_ylabel("angle [rad]")
    middle.legend()
    below.plot(plan.time, plan.beta, label="beta")
    below.plot(plan.time, plan.gamma, label="gamma")
    below.set_ylabel("tilt [rad]")
    below.set_xlabel("time [s]")
    below.legend()


if __name__ == "__main__":
    from run_example import run_example

    cases = {ring: {"ring": ring} for ring in RADII}
    run_example(build, draw, cases=cases, default="all", coarse={"samples": 100, "elements": 45}, size=(14, 7))
