"""Motion around the Earth in modified equinoctial elements, with its flattening; feet and seconds.

Betts, Practical Methods for Optimal Control Using Nonlinear Programming, 2nd ed., SIAM 2010, sec. 6.3
"""

from math import pi

import numpy as np
import pyomo.environ as pyo

import pyrobocop_pyomo as rcp

GRAVITY, EARTH, WEIGHT = 1.407645794e16, 20925662.73, 32.174  # ft^3/s^2, ft, ft/s^2
ZONAL = {2: 1082.639e-6, 3: -2.565e-6, 4: -1.608e-6}
NAMES = ("p", "f", "g", "h", "k", "L")
START = {"p": 21837080.052835, "f": 0, "g": 0, "h": -0.25396764647494, "k": 0, "L": pi}
BOUNDS = {"p": (10e6, 2e8), "f": (-1, 1), "g": (-1, 1), "h": (-1, 1), "k": (-1, 1), "L": (pi, 30 * pi)}


def declare(b, initial, final):
    """The six elements as states of a phase."""
    for name in NAMES:
        b.declare(name, rcp.State(initial=initial.get(name), final=final.get(name), bounds=BOUNDS[name]))
    b.initialize(**START)


def rates(b, t, thrust):
    """Of the elements, given an acceleration along the radius, along the motion and along the normal of the orbit."""
    p, f, g, h, k, longitude = (getattr(b, name)[t] for name in NAMES)
    sin, cos = pyo.sin(longitude), pyo.cos(longitude)
    q, s2 = 1 + f * cos + g * sin, 1 + h**2 + k**2
    x = h * sin - k * cos
    flat = [
        a + c
        for a, c in zip(
            flattening(p / q, (2 * x / s2, 2 * (h * cos + k * sin) / s2, (2 - s2) / s2)), thrust, strict=True
        )
    ]
    radial, tangential, normal = (pyo.sqrt(p / GRAVITY) * a for a in flat)
    return {
        b.p: 2 * p / q * tangential,
        b.f: sin * radial + ((q + 1) * cos + f) / q * tangential - g / q * x * normal,
        b.g: -cos * radial + ((q + 1) * sin + g) / q * tangential + f / q * x * normal,
        b.h: s2 * cos / (2 * q) * normal,
        b.k: s2 * sin / (2 * q) * normal,
        b.L: x / q * normal + pyo.sqrt(GRAVITY * p) * (q / p) ** 2,
    }


def coasting(b, t):
    """Rates without thrust."""
    return rates(b, t, (0, 0, 0))


def burning(thrust, impulse):
    """Rates under a full thrust of given pitch and yaw relative to the velocity, of the weight too."""

    def rule(b, t):
        sin, cos = pyo.sin(b.L[t]), pyo.cos(b.L[t])
        outward, around = b.f[t] * sin - b.g[t] * cos, 1 + b.f[t] * cos + b.g[t] * sin  # the velocity's direction
        size = thrust * WEIGHT / b.weight[t]
        along, up = (turn(b.pitch[t]) / pyo.sqrt(outward**2 + around**2) for turn in (pyo.cos, pyo.sin))
        along = along * pyo.cos(b.yaw[t])
        normal = -size * pyo.cos(b.pitch[t]) * pyo.sin(b.yaw[t])
        acceleration = (size * (along * outward - up * around), size * (along * around + up * outward), normal)
        return rates(b, t, acceleration) | {b.weight: -thrust / impulse}

    return rule


def flattening(r, north):
    """What the zonal harmonics add to gravity, given the direction of the north pole in the frame of the orbit."""
    s = north[0]  # the sine of the latitude
    legendre = {2: (3 * s**2 - 1) / 2, 3: (5 * s**3 - 3 * s) / 2, 4: (35 * s**4 - 30 * s**2 + 3) / 8}
    slopes = {2: 3 * s, 3: (15 * s**2 - 3) / 2, 4: (35 * s**3 - 15 * s) / 2}
    force = {n: GRAVITY / r**2 * (EARTH / r) ** n * ZONAL[n] for n in ZONAL}
    radial = sum(force[n] * (n + 1) * legendre[n] for n in ZONAL)
    northward = -sum(force[n] * slopes[n] for n in ZONAL)
    return radial, northward * north[1], northward * north[2]


def position(trajectory):
    """Places over time, shape (3, points), in 1000 km."""
    p, f, g, h, k, longitude = (getattr(trajectory, name) for name in NAMES)
    sin, cos = np.sin(longitude), np.cos(longitude)
    r = 0.3048e-6 * p / (1 + f * cos + g * sin) / (1 + h**2 + k**2)
    x, y = (1 + h**2 - k**2) * cos + 2 * h * k * sin, (1 - h**2 + k**2) * sin + 2 * h * k * cos
    return r * np.array([x, y, 2 * (h * sin - k * cos)])
