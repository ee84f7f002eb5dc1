"""A launcher of the Delta III class with nine boosters and its transfer orbit; metres, kilogrammes.

Benson, A Gauss pseudospectral transcription for optimal control, PhD thesis, MIT 2005, sec. 8.5
"""

from math import cos, pi, radians, sin, sqrt

import numpy as np
import pyomo.environ as pyo

GRAVITY, EARTH, SPIN = 3.986012e14, 6378145.0, np.array([0, 0, 7.29211585e-5])
MASS = 301454.0
PHASES = {  # duration, thrust, flow of mass, and what is dropped at the end
    "six": (75.2, 6 * 628500.0 + 1083100, 6 * 17010 / 75.2 + 95550 / 261, 6 * 2280),
    "three": (75.2, 3 * 628500.0 + 1083100, 3 * 17010 / 75.2 + 95550 / 261, 3 * 2280),
    "main": (110.6, 1083100.0, 95550 / 261, 8830),
    "last": (700.0, 110094.0, 16820 / 700, 0),
}
AXIS, SHAPE = 24361140.0, 0.7308  # of the orbit that is wanted
NODE, TILT, ARGUMENT = radians(269.8), radians(28.5), radians(130.5)
ASCENDING = np.array([cos(NODE), sin(NODE), 0])
NORMAL = np.array([sin(TILT) * sin(NODE), -sin(TILT) * cos(NODE), cos(TILT)])
TO_PERIGEE = cos(ARGUMENT) * ASCENDING + sin(ARGUMENT) * np.cross(NORMAL, ASCENDING)
PAD = EARTH * np.array([cos(TILT), 0, sin(TILT)])
MOMENTUM = sqrt(GRAVITY * AXIS * (1 - SHAPE**2))

PERIGEE = AXIS * (1 - SHAPE) * TO_PERIGEE
PERIGEE_SPEED = MOMENTUM / (AXIS * (1 - SHAPE)) * np.cross(NORMAL, TO_PERIGEE)


def turning(r):
    """The velocity of the air at a place."""
    return np.cross(SPIN, r)


def rocket(thrust, flow):
    """Gravity, drag against the turning air, thrust; as a rule."""

    def rule(b, t):
        r, v = b.r[t], b.v[t]
        distance = pyo.sqrt(r @ r)
        wind = v - turning(r)
        drag = 0.5 * 1.225 * pyo.exp((EARTH - distance) / 7200) * 0.5 * 4 * pi * pyo.sqrt(wind @ wind)
        acceleration = (thrust * b.u[t] - drag * wind) / b.mass[t] - GRAVITY / distance**3 * r
        return {b.r: v, b.v: acceleration, b.mass: -flow}

    return rule


def direction(b, t):
    """Of the thrust: a unit vector."""
    return b.u[t] @ b.u[t] == 1


def in_orbit(r, v):
    """Five relations: the momentum of the orbit that is wanted, and the direction and size of its eccentricity."""
    momentum = np.cross(r, v)
    shape = np.cross(v, momentum) / GRAVITY - r / pyo.sqrt(r @ r)  # towards the perigee
    plane = [momentum[i] / MOMENTUM == NORMAL[i] for i in range(3)]
    return [*plane, shape @ TO_PERIGEE == SHAPE, shape @ np.cross(NORMAL, TO_PERIGEE) == 0]
