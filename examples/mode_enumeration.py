"""Bring a slider to a pose in minimum time, trying every sequence of faces to push at.

A finger pushes at one face after the other without slipping; between two pushes it moves for free. It may push anywhere
along a face, and each push may take any time: these are smooth choices, left to the optimiser. The faces and their
order are discrete: all sequences of one or two different faces are solved and ranked, in several processes.

The pushes are quasi-static; the pusher-slider is that of

Raghunathan, Jha & Romeres, PYROBOCOP: Python-based Robotic Control & Optimization Package for Manipulation,
ICRA 2022, sec. V-D, doi:10.1109/ICRA46639.2022.9812069
"""

from __future__ import annotations

from functools import partial
from itertools import permutations
from math import pi

import numpy as np
import pyomo.environ as pyo
from mechanism_pictures import draw_planar_pushing

import pyrobocop_pyomo as rcp

SLIDER = rcp.mechanics.SquareSlider()
FRICTION = 0.3
LONGEST_PUSH = 10.0
# Direction of the push, out of the finger and into the face, in the slider's frame.
FACES = {"left": (1, 0), "right": (-1, 0), "bottom": (0, 1), "top": (0, -1)}
GOALS = {"turn": (0.0, 0.3, pi / 2), "shift": (0.3, 0.3, 0.0)}


def build(sequence: tuple[str, ...], goal: tuple[float, float, float] = GOALS["turn"], elements: int = 20):
    """A push per face of the sequence, the pose continuing from each to the next."""
    m = pyo.ConcreteModel(name=" - ".join(sequence))
    m.pushes = rcp.PhaseBlock(
        list(enumerate(sequence)),
        duration=rcp.Duration(bounds=(0.05, LONGEST_PUSH), initial_guess=3),
        elements=elements,
        scheme="implicit_euler",
        rule=lambda b, k, face: state_push(
            b,
            FACES[face],
            initial=(0, 0, 0) if k == 0 else (None, None, None),
            final=goal if k == len(sequence) - 1 else (None, None, None),
        ),
    )
    if len(sequence) > 1:
        m.changes_of_face = rcp.Link(m.pushes)
    m.total_time = pyo.Objective(expr=sum(push.duration for push in m.pushes.values()))
    return m


def state_push(b, into, initial, final) -> None:
    """Push at one point of a face without slipping."""
    for name, start, end in zip(("x", "y", "theta"), initial, final, strict=True):
        b.declare(name, rcp.State(initial=start, final=end, bounds=(-5, 5)))
    b.normal = rcp.Control(bounds=(0, 0.5), initial_guess=0.2)
    b.tangential = rcp.Control(bounds=(-0.5, 0.5))
    b.place = rcp.Parameter(bounds=(-0.9, 0.9))  # along the face, in half sides

    @b.ode
    def pusher_slider(b, t):
        rates = SLIDER.velocity(b.theta[t], contact(into, b.place), force(into, b.normal[t], b.tangential[t]))
        return dict(zip((b.x, b.y, b.theta), rates, strict=True))

    @b.constraint
    def friction_cone(b, t):
        return [b.tangential[t] <= FRICTION * b.normal[t], b.tangential[t] >= -FRICTION * b.normal[t]]


def contact(into, place):
    """Where the finger touches, in the slider's frame: on the face that it pushes into, off its middle by place."""
    along = (-into[1], into[0])
    return tuple(SLIDER.half_side * (place * a - i) for a, i in zip(along, into, strict=True))


def force(into, normal, tangential):
    """The force of the finger in the slider's frame."""
    along = (-into[1], into[0])
    return tuple(normal * i + tangential * a for a, i in zip(along, into, strict=True))


def search(goal: tuple[float, float, float] = GOALS["turn"], elements: int = 20, workers: int = 2, **options):
    """Solve all sequences of one or two faces; print what they give, and solve the best one again."""
    sequences = [faces for length in (1, 2) for faces in permutations(FACES, length)]
    build_sequence = partial(build, goal=goal, elements=elements)
    found = rcp.sweep(build_sequence, sequences, start_from=None, workers=workers, **options)
    print(found)
    best = build_sequence(found.best.case.data)
    return best, rcp.solve(best, mesh_tolerance=None, **options)


def draw(figure, m: pyo.ConcreteModel) -> None:
    """Slider and finger over the pushes of the best sequence, and the forces."""
    joined = rcp.join_trajectories(m.pushes.values())
    touched = [contact(FACES[face], push.place.value) for (_, face), push in m.pushes.items()]
    above, below = figure.subfigures(2, 1, height_ratios=(1.7, 1))
    draw_planar_pushing(
        joined.time,
        np.column_stack([joined.x, joined.y, joined.theta]),
        np.concatenate(
            [np.tile(where, (len(part.time), 1)) for where, part in zip(touched, joined.parts, strict=True)]
        ),
        half_side=SLIDER.half_side,
        snapshots=7,
        title=f"{' - '.join(face for _, face in m.pushes)}, {joined.duration:.2f} s",
        figure=above,
    )
    joined.plot({"normal": "normal [N]", "tangential": "tangential [N]"}, figure=below)


if __name__ == "__main__":
    from run_example import run_example

    cases = {name: {"goal": goal} for name, goal in GOALS.items()}
    run_example(build, draw, cases=cases, default="all", coarse={"elements": 6}, size=(10, 7), search=search)
