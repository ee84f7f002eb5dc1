"""The five rates of the isomerisation of alpha-pinene, from measurements of five substances at eight times.

Box, Hunter, MacGregor & Erjavec, Technometrics 15 (1973) 33, doi:10.1080/00401706.1973.10489009; Dolan, More & Munson,
COPS 3.0, ANL/MCS-TM-273, 2004, problem 17: 19.8721
"""

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

PUBLISHED = 19.8721
TIMES = np.array([1230.0, 3060, 4920, 7800, 10680, 15030, 22620, 36420])
MEASURED = np.array(
    [
        [88.35, 76.4, 65.1, 50.4, 37.5, 25.9, 14.0, 4.5],
        [7.3, 15.6, 23.1, 32.9, 42.7, 49.1, 57.4, 63.1],
        [2.3, 4.5, 5.3, 6.0, 6.0, 5.9, 5.1, 3.8],
        [0.4, 0.7, 1.1, 1.5, 1.9, 2.2, 2.6, 2.9],
        [1.75, 2.8, 5.8, 9.3, 12.0, 17.0, 21.0, 25.7],
    ]
)


def build(mesh=None, elements=None):
    """Five fractions in per cent, from the first substance alone; the measurements lie on element boundaries."""
    m = pyo.ConcreteModel(name="isomerisation of alpha-pinene")
    if mesh is None:
        mesh = [0.0, *TIMES]
    m.reactor = b = rcp.PhaseBlock(duration=TIMES[-1], mesh=mesh)
    b.y = rcp.State(index=5, initial=[100, 0, 0, 0, 0], initial_guess=lambda t: [100, 0, 0, 0, 0])
    b.rate = rcp.Parameter(index=5, bounds=(0, None), initial_guess=0)

    @b.ode
    def reactions(b, t):
        y, k = b.y[t], b.rate
        back = k[3] * y[2] - k[4] * y[4]
        return {b.y: [-(k[0] + k[1]) * y[0], k[0] * y[0], k[1] * y[0] - k[2] * y[2] - back, k[2] * y[2], back]}

    misses = (b.y[i, t] - MEASURED[i, j] for i in range(5) for j, t in enumerate(TIMES))
    m.misfit = pyo.Objective(expr=sum(miss**2 for miss in misses))
    return m


def draw(figure, m):
    """The fractions and the measurements."""
    trajectory = m.reactor.trajectory()
    axes = figure.subplots()
    for fraction, measured in zip(trajectory.y, MEASURED, strict=True):
        (line,) = axes.plot(trajectory.time, fraction)
        axes.plot(TIMES, measured, "o", color=line.get_color())
    axes.set(xlabel="time [min]", ylabel="fraction [%]", title=m.name)


if __name__ == "__main__":
    from run_textbook import run_textbook

    run_textbook(build, draw, PUBLISHED)
