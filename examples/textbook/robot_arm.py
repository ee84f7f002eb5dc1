"""Swing a telescopic robot arm through 120 degrees in the shortest time.

Dolan, More & Munson, Benchmarking Optimization Software with COPS 3.0, ANL/MCS-TM-273, 2004, problem 11: 9.14093
"""

from math import pi

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 9.14093
LENGTH = 5.0


def build(mesh=None, elements=None):
    """Length of the arm on one side and two angles, each with its rate and its motor."""
    m = pyo.ConcreteModel(name="robot arm")
    m.swing = b = rcp.PhaseBlock(duration=rcp.Duration(bounds=(1, 100), initial_guess=10), mesh=mesh, elements=elements)
    b.rho = rcp.State(initial=4.5, final=4.5, bounds=(0, LENGTH))
    b.theta = rcp.State(initial=0, final=2 * pi / 3, bounds=(-pi, pi))
    b.phi = rcp.State(initial=pi / 4, final=pi / 4, bounds=(0, pi))
    b.rate = rcp.State(index=["rho", "theta", "phi"], initial=0, final=0)
    b.motor = rcp.Control(index=["rho", "theta", "phi"], bounds=(-1, 1))
    b.initialize_straight_lines()

    @b.ode
    def arm(b, t):
        inertia = ((LENGTH - b.rho[t]) ** 3 + b.rho[t] ** 3) / 3
        r, theta, phi = b.rate[t]
        u = b.motor[t]
        turning = [u[0] / LENGTH, u[1] / (inertia * pyo.sin(b.phi[t]) ** 2), u[2] / inertia]
        return {b.rho: r, b.theta: theta, b.phi: phi, b.rate: turning}

    m.time_taken = pyo.Objective(expr=b.duration)
    return m


def draw(figure, m):
    """The arm's length and both angles, and the motors."""
    trajectory = m.swing.trajectory()
    motion, motors = figure.subplots(1, 2)
    for name in ("rho", "theta", "phi"):
        motion.plot(trajectory.time, getattr(trajectory, name), label=name)
    motors.plot(trajectory.points, trajectory.motor.T)
    motion.set(xlabel="time", title=m.name)
    motors.set(xlabel="time", ylabel="motors")
    motion.legend()


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=20)
