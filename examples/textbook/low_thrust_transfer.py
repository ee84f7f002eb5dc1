"""A spiral of about eight revolutions from a low orbit to a high eccentric one, with a thrust far below the weight.

The initial guess is a simulation with the thrust along the velocity, as in the source.

Betts, Practical Methods for Optimal Control Using Nonlinear Programming, 2nd ed., SIAM 2010,
doi:10.1137/1.9780898718577, sec. 6.3: the final weight is 0.2201791 of the first
"""

import pyomo.environ as pyo
from equinoctial import START, WEIGHT, declare, position, rates

import pyrobocop_pyomo as rcp

PUBLISHED = 0.2201791
THRUST, IMPULSE = 4.446618e-3, 450.0


def build(mesh=None, elements=None):
    """Six elements and the weight; the direction of the thrust, its size by one parameter, a free duration."""
    m = pyo.ConcreteModel(name="low-thrust transfer")
    m.spiral = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(50000, 100000), initial_guess=86810), mesh=mesh, elements=elements
    )
    declare(b, START, {"p": 40007346.015232})
    b.weight = rcp.State(initial=1, bounds=(0.001, 2))
    b.throttle = rcp.Parameter(bounds=(-50, 0), initial_guess=-25)
    b.u = rcp.Control(index=["radial", "tangential", "normal"], bounds=(-1, 1), initial_guess=[0, 1, 0])

    @b.ode
    def motion(b, t):
        thrust = THRUST * (1 + 0.01 * b.throttle)
        acceleration = [WEIGHT * thrust / b.weight[t] * u for u in b.u[t]]
        return rates(b, t, acceleration) | {b.weight: -thrust / IMPULSE}

    @b.constraint
    def direction(b, t):
        return b.u[t] @ b.u[t] == 1

    f, g, h, k = (getattr(b, name)[b.final_time] for name in "fghk")
    m.eccentricity = pyo.Constraint(expr=f**2 + g**2 == 0.73550320568829**2)
    m.inclination = pyo.Constraint(expr=h**2 + k**2 == 0.61761258786099**2)
    m.perigee = pyo.Constraint(expr=f * h + g * k == 0)
    m.node = pyo.Constraint(expr=g * h - k * f <= 0)
    b.initialize(b.simulate())
    m.left = pyo.Objective(expr=b.weight[b.final_time], sense=pyo.maximize)
    return m


def draw(figure, m):
    """The path in space."""
    axes = figure.subplots(subplot_kw={"projection": "3d"})
    axes.plot(*position(m.spiral.trajectory()))
    axes.set(xlabel="x [1000 km]", ylabel="y [1000 km]", zlabel="z [1000 km]", title=m.name)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=60, coarse=30)
