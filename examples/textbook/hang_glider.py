"""The longest flight of a hang glider with the help of one thermal updraft.

Bulirsch, Nerz, Pesch & von Stryk, in: Optimal Control, ISNM 111, 1993, p. 273; Dolan, More & Munson, COPS 3.0,
ANL/MCS-TM-273, 2004, problem 9: 1248.03 m
"""

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 1248.03


def build(mesh=None, elements=None):
    """Position and velocity in a vertical plane, the lift coefficient as control, a free duration."""
    m = pyo.ConcreteModel(name="hang glider")
    m.glide = b = rcp.PhaseBlock(
        duration=rcp.Duration(bounds=(10, 200), initial_guess=100), mesh=mesh, elements=elements
    )
    b.x = rcp.State(initial=0, bounds=(0, None), initial_guess=lambda t: 1250 * t)
    b.y = rcp.State(initial=1000, final=900, bounds=(0, None), initial_guess=950)
    b.vx = rcp.State(initial=13.2275675, final=13.2275675, bounds=(0, None), initial_guess=13)
    b.vy = rcp.State(initial=-1.28750052, final=-1.28750052, initial_guess=-1.3)
    b.lift = rcp.Control(bounds=(0, 1.4), initial_guess=1)

    @b.ode
    def glider(b, t):
        place = (b.x[t] / 100 - 2.5) ** 2
        w = b.vy[t] - 2.5 * (1 - place) * pyo.exp(-place)  # against the updraft
        v = pyo.sqrt(b.vx[t] ** 2 + w**2)
        pressure = 0.5 * 1.13 * 14 * v / 100  # times the speed, over the mass
        drag = 0.034 + 0.069662 * b.lift[t] ** 2
        forward = pressure * (-b.lift[t] * w - drag * b.vx[t])
        upward = pressure * (b.lift[t] * b.vx[t] - drag * w) - 9.80665
        return {b.x: b.vx[t], b.y: b.vy[t], b.vx: forward, b.vy: upward}

    m.distance = pyo.Objective(expr=b.x[b.final_time], sense=pyo.maximize)
    return m


def draw(figure, m):
    """The path and the lift coefficient."""
    trajectory = m.glide.trajectory()
    path, lift = figure.subplots(2, 1)
    path.plot(trajectory.x, trajectory.y)
    path.set(xlabel="x [m]", ylabel="y [m]", title=m.name)
    lift.plot(trajectory.points, trajectory.lift)
    lift.set(xlabel="time [s]", ylabel="lift coefficient")


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED, elements=50, coarse=30)
