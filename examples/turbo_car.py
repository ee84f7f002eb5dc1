"""A car with a turbo charger, from rest to rest in minimal time.

Above 15 m/s the charger multiplies the acceleration by three: the right-hand side jumps. In the case ``turbo`` it
works exactly above that speed; with ``hysteresis`` it goes on above 15 m/s and off again only below 10 m/s, so that
the car also brakes better.

The charger is the Heaviside step of ``speed - 15 m/s``, written with two complementary pairs. With hysteresis it is
the step of a memory z that follows the speed with play: it stays put while ``v - 15 <= z <= v - 10`` and is dragged
along by either end, which is two pairs more, and no state jumps.

A switch in the middle of an element would spoil the order of the scheme, and worse: on a fixed mesh an optimiser gets
stuck where a switch meets an element boundary. So the boundaries may move, and the pairs are summed up over each
element, from its left end on: then no element holds two modes, and the switches are found to all digits.

Nurkanović, Sperl, Albrecht & Diehl, Finite Elements with Switch Detection for direct optimal control of nonsmooth
systems, Numer. Math. 156 (2024), doi:10.1007/s00211-024-01412-z; Brokate & Sprekels, Hysteresis and Phase Transitions
(1996), ch. 2, doi:10.1007/978-1-4612-4048-8
"""

from __future__ import annotations

from itertools import groupby

import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

# Speeds in 10 m/s and distances in 100 m, so that all variables are about one.
DISTANCE, FASTEST, ON, OFF = 2.0, 2.5, 1.5, 1.0
PLAIN, FACTOR = 0.5, 3.0  # acceleration in 10 m/s^2, and what the charger makes of it
HUNDREDS = 0.1  # from 10 m/s to 100 m per second


def build(case: str = "turbo", elements: int = 20, stages: int = 2) -> pyo.ConcreteModel:
    """Rest to rest in minimal time."""
    m = pyo.ConcreteModel(name="turbo car")
    duration = rcp.Duration(bounds=(1, 40), initial_guess=15)
    m.drive = b = rcp.PhaseBlock(duration=duration, elements=elements, stages=stages, free_element_widths=(0.2, 3))
    b.x = rcp.State(initial=0, final=DISTANCE, initial_guess=lambda t: DISTANCE * t)
    b.v = rcp.State(initial=0, final=0, bounds=(0, FASTEST), initial_guess=2)
    b.pedal = rcp.Control(bounds=(-1, 1), parametrization="piecewise_constant")
    if case == "hysteresis":
        b.memory = rcp.State(initial=-ON, initial_guess=-ON)
        b.rise = rcp.Algebraic(bounds=(0, None))
        b.fall = rcp.Algebraic(bounds=(0, None))

        @b.complementarity
        def play(b, t):
            return [
                rcp.complements(b.memory[t] - (b.v[t] - ON) >= 0, b.rise[t] >= 0),
                rcp.complements((b.v[t] - OFF) - b.memory[t] >= 0, b.fall[t] >= 0),
            ]

    b.turbo = rcp.mechanics.Step(b.memory if case == "hysteresis" else lambda b, t: b.v[t] - ON, initial_guess=0.5)
    b.initialize(turbo_above=0.0, turbo_below=0.0)  # in neither mode

    @b.ode
    def car(b, t):
        rates = {b.x: HUNDREDS * b.v[t], b.v: PLAIN * b.pedal[t] * (1 + (FACTOR - 1) * b.turbo[t])}
        if case == "hysteresis":
            rates[b.memory] = b.rise[t] - b.fall[t]
        return rates

    switch_at_boundaries(m)
    m.time = pyo.Objective(expr=b.duration)
    return m


def switch_at_boundaries(m: pyo.ConcreteModel) -> None:
    """Replace the pairs at the points, ``a ⟂ b`` with a continuous side a, by pairs of sums over each element.

    The pairs of the phase are only deactivated: its trajectory is still verified by them.
    """

    def family(pair):
        return pair.source.parent_component().local_name, pair.source.index()[1]

    sums, sides = {}, []
    for name, pairs in groupby(sorted(rcp.active_pairs(m), key=family), key=family):
        left_end = []  # the last stage of an element is the left end of the next one
        for element, group in groupby(pairs, key=lambda pair: pair.group):
            here = list(group)
            sums[(*name, element)] = sum(left_end + [pair.a for pair in here]), sum(pair.b for pair in here)
            left_end = [here[-1].a]
            for pair in here:
                sides += [row for row in (pair.a_row, pair.b_row) if row is not None]
                pair.source.deactivate()
    m.sides = pyo.Constraint(range(len(sides)), rule=lambda m, i: sides[i])
    m.switches = rcp.Complementarity(
        list(sums), rule={index: rcp.complements(a >= 0, b >= 0) for index, (a, b) in sums.items()}
    )


def minimal_time(case: str) -> float:
    """In closed form: full pedal up to the highest speed, that speed, full brake."""
    seconds = metres = 0.0
    for threshold in (ON, ON if case == "turbo" else OFF):
        seconds += threshold / PLAIN + (FASTEST - threshold) / (FACTOR * PLAIN)
        metres += HUNDREDS * (threshold**2 + (FASTEST**2 - threshold**2) / FACTOR) / (2 * PLAIN)
    return seconds + (DISTANCE - metres) / (HUNDREDS * FASTEST)


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Speed with its thresholds, pedal and charger over time."""
    trajectory = m.drive.trajectory()
    labels = {"v": "speed [10 m/s]", "pedal": "pedal [-]", "turbo": "turbo [-]"}
    if "memory" in trajectory.states:
        labels["memory"] = "memory [10 m/s]"
    trajectory.plot(labels, figure=figure)
    figure.suptitle(f"{m.name}: {trajectory.duration:.3f} s")
    for level in (ON, OFF) if "memory" in trajectory.states else (ON,):
        figure.axes[0].axhline(level, color="0.4", linewidth=1, linestyle="--")


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"case": name} for name in ("turbo", "hysteresis")}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 10}, size=(10, 6))
