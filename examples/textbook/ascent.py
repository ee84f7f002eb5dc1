"""The heaviest payload of a launcher: four phases, boosters dropped between them, in metres and kilogrammes.

Benson, A Gauss pseudospectral transcription for optimal control, PhD thesis, MIT 2005; Rao et al., GPOPS, ACM TOMS 37
(2010) 22, doi:10.1145/1731022.1731032: 7529.712 kg
"""

import numpy as np
import pyomo.environ as pyo
from launcher import EARTH, MASS, PAD, PERIGEE, PERIGEE_SPEED, PHASES, direction, in_orbit, rocket, turning

import pyrobocop_pyomo as rcp

PUBLISHED = 7529.712


def build(mesh=None, elements=None):
    """Position, velocity and mass; the direction of the thrust."""
    m = pyo.ConcreteModel(name="ascent to orbit")
    mass, before, jump = MASS, None, None
    for name, (duration, thrust, flow, dropped) in PHASES.items():
        first, last = name == "six", name == "last"
        time = rcp.Duration(bounds=(1, duration), initial_guess=duration) if last else duration
        b = rcp.PhaseBlock(duration=time, mesh=mesh and mesh[name], elements=elements)
        m.add_component(name, b)
        r, v = (PERIGEE, PERIGEE_SPEED) if last else (PAD, turning(PAD))
        b.r = rcp.State(index=3, initial=r if first else None, bounds=(-2 * EARTH, 2 * EARTH), initial_guess=r)
        b.v = rcp.State(index=3, initial=v if first else None, bounds=(-10000, 10000), initial_guess=v)
        b.mass = rcp.State(initial=mass if first else None, bounds=(mass - flow * duration, mass), initial_guess=mass)
        b.u = rcp.Control(index=3, bounds=(-1, 1), initial_guess=[1, 0, 0])
        b.ode(rocket(thrust, flow))
        b.constraint(direction)
        if not first:
            m.add_component(f"to_{name}", rcp.Link(before, b, jump=jump))
        before, jump = b, lambda pre, post, dropped=dropped: {"mass": pre.mass - dropped}
        mass -= flow * duration + dropped
    end = m.last.final_time
    m.orbit = pyo.ConstraintList()
    for relation in in_orbit(m.last.r[end], m.last.v[end]):
        m.orbit.add(relation)
    m.payload = pyo.Objective(expr=m.last.mass[end], sense=pyo.maximize)
    return m


def draw(figure, m):
    """Altitude and mass over time."""
    altitude, mass = figure.subplots(1, 2)
    start = 0.0
    for name in PHASES:
        trajectory = m.component(name).trajectory()
        altitude.plot(start + trajectory.time, (np.linalg.norm(trajectory.r, axis=0) - EARTH) / 1000)
        mass.plot(start + trajectory.time, trajectory.mass / 1000)
        start += trajectory.duration
    altitude.set(xlabel="time [s]", ylabel="altitude [km]")
    mass.set(xlabel="time [s]", ylabel="mass [t]")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=10, coarse=5)
