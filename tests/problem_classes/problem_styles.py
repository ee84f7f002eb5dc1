"""Problems written with PyRoboCOP's methods, in the styles that different authors have."""

from __future__ import annotations

import numpy as np

FREE = 1e20


class Pendulum:
    """Swing up; rows filled one by one, functions of single entries, an inertia in front of the derivative."""

    elements = 12

    def get_info(self):
        h = 3.0 / self.elements
        return 2, 0, 1, 0, 0, self.elements, np.array([h * i for i in range(self.elements + 1)]), 0, 0

    def bounds(self, i):
        lower = np.array([-2 * np.pi, -10, -FREE, -FREE, -10])
        return lower, -lower

    def initialpoint(self, i):
        return np.zeros(2), np.zeros(2), np.zeros(0), np.zeros(1)

    def initialcondition(self):
        return np.zeros(2)

    def objective(self, t, x, xdot, y, u, p):
        return (x[0] - np.pi) ** 2 + x[1] ** 2 + 0.01 * u[0] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] - x[1]
        c[1, 0] = 2.0 * xdot[1] - (u[0] - 9.81 * np.sin(x[0, 0]) - 0.1 * x[1])


class QuickCart(Pendulum):
    """Least time: a parameter scales the horizon, and is the cost at the end; lists, and derivatives by hand."""

    elements = 10

    def get_info(self):
        return [2, 0, 1, 1, 0, self.elements, list(np.linspace(0, 1, self.elements + 1)), 5, 5]

    def bounds(self, i):
        return [-2, -FREE, -FREE, -FREE, -1], [2, FREE, FREE, FREE, 1]

    def initialpoint(self, i):
        return [i / self.elements, 0.5], [0, 0], [], [0]

    def initialcondition(self):
        return [0.0, 0.0], [0.0, 0.0]

    def bounds_finaltime(self):
        return [1.0, 0.0], [1.0, 0.0]

    def bounds_params(self):
        return np.array([[0.1]]), np.array([[10.0]])

    def initialpoint_params(self):
        return 3.0

    def objective(self, t, x, xdot, y, u, p):
        return 0

    def objective_mayer(self, x0, xf, p):
        return p[0]

    def constraint(self, c, t, x, xdot, y, u, p):
        c[:] = xdot - p[0] * np.array([x[1], u[0]])

    def gradient(self, *arguments):
        raise AssertionError("derivatives are never asked for")

    jacobian = hessian = gradient


class ParameterCurve(Pendulum):
    """A parameter in the running cost and in the cost at the end, which reads both ends in all of their shapes."""

    elements = 8

    def get_info(self):
        return 1, 0, 1, 1, 0, self.elements, np.linspace(0, 1, self.elements + 1), 0, 0

    def bounds(self, i):
        return np.array([-FREE, -FREE, -FREE]), np.array([FREE, FREE, FREE])

    def initialpoint(self, i):
        return 0.0, 0.0, None, 0.0

    def initialcondition(self):
        return np.array([[0.5]])

    def bounds_params(self):
        return -FREE, FREE

    def initialpoint_params(self):
        return np.array([1.0])

    def objective(self, t, x, xdot, y, u, p):
        return u**2 + (p[0] - t) ** 2

    def objective_mayer(self, x0, xf, p):
        return (xf[0, 0] - 1) ** 2 + 0.1 * x0[0] + 0.1 * x0[0, -1] + xf[0] * p[0]

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] + x[0] - u[0]


class OneSided:
    """A linear complementarity system (Vieira, Brogliato, Prieur), first example; no p in the signatures."""

    elements = 12

    def get_info(self):
        return (1, 2, 1, 0, 1, self.elements, np.linspace(0.0, 1.0, self.elements + 1).reshape(-1, 1), 0, 0)

    def bounds(self, i):
        big = 1e30
        return np.array([-big, -big, 0, 0, -big]), np.array([big, big, big, big, big])

    def initialpoint(self, i):
        return np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((2, 1)), np.zeros((1, 1))

    def initialcondition(self):
        return np.ones((1, 1)), np.ones((1, 1))

    def objective(self, t, x, xdot, y, u):
        return x[0] ** 2 + u[0] ** 2

    def constraint(self, c, t, x, xdot, y, u):
        v, w = y[0], y[1]
        c[0] = xdot[0] - (3 * x[0] - 0.5 * v + 3 * u[0])
        c[1] = w - (v - 2 * u[0])
        return c

    def get_complementarity_info(self):
        return np.array([[0]]), np.array([[0]]), np.array([[1]]), np.array([[0]])


class DeadZone(OneSided):
    """Mixed bounds: play between ``y0 >= -1`` and ``y1 <= gap``, where the gap changes from element to element."""

    elements = 12

    def gap(self, i):
        return 0.5 if i < self.elements // 2 else 0.8

    def get_info(self):
        return 2, 2, 1, 0, 1, self.elements, 2.0 * np.arange(self.elements + 1) / self.elements, 0, 0

    def bounds(self, i):
        lower = np.r_[np.full(4, -np.inf), -1.0, -np.inf, -3.0]
        upper = np.r_[np.full(4, np.inf), np.inf, self.gap(i), 3.0]
        return lower, upper

    def initialpoint(self, i):
        return np.zeros(2), np.zeros(2), np.array([0.0, 0.0]), np.zeros(1)

    def initialcondition(self):
        return np.zeros(2)

    def objective(self, t, x, xdot, y, u, p=None):
        return np.sum((x - np.array([1.0, 0.0])) ** 2) + 0.1 * u @ u

    def constraint(self, c, t, x, xdot, y, u, p=None):
        c[0] = x[1] - xdot[0]
        c[1] = -xdot[1] + u[0] - (y[0] + 1.0)
        c[2] = y[1] - x[0]

    def get_complementarity_info(self):
        return [[0], [0], [1], [1]]


class ModeSequence:
    """Gears by hand: the dynamics branch on time, a parameter per mode scales it; constants of the class as arrays."""

    elements = 10

    def __init__(self):
        self.gears = (np.array([[0.0, 1.0], [0.0, -0.5]]), np.array([[0.0, 1.0], [-1.0, 0.0]]))
        self.inputs = (np.array([0.0, 2.0]), np.array([0.0, 1.0]))

    def get_info(self):
        half = self.elements // 2
        times = np.concatenate([np.linspace(0, 1, half + 1), 1 + np.linspace(0, 1, half + 1)[1:] ** 1.2])
        return 2, 0, 1, 2, 0, self.elements, times, 0, 0

    def bounds(self, i):
        one = np.ones(1)
        return np.concatenate([-FREE * np.ones(4), -one]), np.concatenate([FREE * np.ones(4), one])

    def initialpoint(self, i):
        return np.array([0.1 * i, 0.5]), np.zeros(2), np.array([]), np.array([0.1])

    def initialcondition(self):
        return np.zeros(2)

    def bounds_finaltime(self):
        goal = np.array([2.0, 0.0])
        return goal, goal

    def bounds_params(self):
        return 0.1 * np.ones(2), 5.0 * np.ones(2)

    def initialpoint_params(self):
        return np.ones(2)

    def objective(self, t, x, xdot, y, u, p):
        duration = p[0] if t <= 1 else p[1]
        return 0.1 * duration * u[0] ** 2

    def objective_mayer(self, x0, xf, p):
        return np.sum(p)

    def constraint(self, c, t, x, xdot, y, u, p):
        mode = 0 if t <= 1.0 else 1
        rates = p[mode] * (self.gears[mode].dot(x) + self.inputs[mode] * u[0])
        for j in range(2):
            c[j, 0] = xdot[j] - rates[j]


class LearnedFriction:
    """A learned model: radial functions with arrays of the class, over a vector of features."""

    elements = 8

    def __init__(self, centres=12):
        generator = np.random.default_rng(3)
        self.X = generator.uniform(-1, 1, (centres, 3))
        self.weights = generator.normal(size=centres) / centres
        self.scale = np.array([1.0, 0.7, 1.3])

    def predict(self, z):
        difference = (z - self.X) / self.scale
        return np.dot(np.exp(-0.5 * np.sum(difference**2, axis=1)), self.weights)

    def get_info(self):
        return 2, 0, 1, 0, 0, self.elements, np.linspace(0, 1.5, self.elements + 1), 0, 0

    def bounds(self, i):
        lb, ub = np.zeros((5, 1)), np.zeros((5, 1))
        lb[0:4, 0], ub[0:4, 0] = -FREE, FREE
        lb[4], ub[4] = -3, 3
        return lb, ub

    def initialpoint(self, i):
        x, xdot, u = np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((1, 1))
        return x, xdot, [], u

    def initialcondition(self):
        return np.array([0.0, 0.0])

    def objective(self, t, x, xdot, y, u, p):
        return np.array([(x[0] - 1) ** 2 + 0.1 * x[1] ** 2 + 0.02 * (np.cosh(u[0]) - 1)])

    def constraint(self, c, t, x, xdot, y, u, p):
        z = np.array([np.sin(x[0]), x[1], u[0]])
        c[0] = xdot[0] - x[1]
        c[1] = xdot[1] - u[0] + self.predict(z)


class Arm:
    """Two links: a mass matrix of the states in front of the derivatives, vector arithmetic, blocks of rows."""

    elements = 6

    def get_info(self):
        return 4, 0, 2, 0, 0, self.elements, np.linspace(0, 1, self.elements + 1), 0, 0

    def bounds(self, i):
        free = np.full(8, FREE)
        return np.hstack([-free, -20 * np.ones(2)]), np.hstack([free, 20 * np.ones(2)])

    def initialpoint(self, i):
        return np.array([0.1, 0.2, 0, 0]) * i / self.elements, np.zeros(4), np.zeros(0), np.zeros(2)

    def initialcondition(self):
        return np.zeros(4)

    def bounds_finaltime(self):
        goal = np.array([1.0, -0.5, 0, 0])
        return goal, goal

    def objective(self, t, x, xdot, y, u, p):
        return u.dot(u) * 0.01 + x[2:].dot(x[2:])

    def mass(self, q):
        coupling = np.cos(q[1])
        return np.array([[3 + 2 * coupling, 1 + coupling], [1 + coupling, 1 + 0 * coupling]])

    def constraint(self, c, t, x, xdot, y, u, p):
        q, w = x[0:2], x[2:4]
        c[0:2, 0] = xdot[0:2] - w
        centrifugal = np.sin(q[1]) * np.array([-w[1] * (2 * w[0] + w[1]), w[0] ** 2])
        c[2:4, 0] = self.mass(q) @ xdot[2:4] + centrifugal - u


class CoupledMasses:
    """A constant mass matrix that couples derivatives, and an algebraic that is a force; time does not start at 0."""

    elements = 12
    M = np.array([[2.0, 1.0], [1.0, 3.0]])

    def get_info(self):
        return 2, 1, 1, 0, 0, self.elements, -1.0 + np.linspace(0, 1, self.elements + 1) ** 1.5, 0, 0

    def bounds(self, i):
        return np.array([-9] * 4 + [-9, -2.0]), np.array([9] * 4 + [9, 2.0])

    def initialpoint(self, i):
        return (np.zeros(2), np.zeros(2), np.zeros(1), np.zeros(1))

    def initialcondition(self):
        return np.array([1.0, -1.0])

    def objective(self, t, x, xdot, y, u, p):
        return 1.0 * x[0] ** 2 + x[1] ** 2 + u[0] ** 2 + 0.1 * xdot[0] ** 2 + 0.1 * y[0] * y[0]

    def constraint(self, c, t, x, xdot, y, u, p):
        force = np.array([u[0] + np.sin(3 * t), y[0]])
        rows = self.M @ xdot - force
        c[0] = y[0] + 2 * x[1] - x[0] * xdot[0]
        c[1], c[2] = rows


class RollingBall:
    """Nonlinear in the derivative: nothing is solved for it."""

    elements = 10

    def get_info(self):
        return 1, 1, 1, 0, 0, self.elements, np.linspace(0, 1, self.elements + 1), 0, 0

    def bounds(self, i):
        return np.array([-5, 0.1, 0, -5.0]), np.array([5, 5.0, 9, 5.0])

    def initialpoint(self, i):
        return np.array([0.0]), np.array([1.0]), np.array([1.0]), np.array([1.0])

    def initialcondition(self):
        return np.array([0.0])

    def objective(self, t, x, xdot, y, u, p):
        return (x[0] - t) ** 2 + 0.1 * u[0] ** 2 + 0.1 * y[0]

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] ** 2 - y[0]
        c[1] = y[0] * np.exp(0.2 * x[0]) - 1.0 - u[0]


class Corridor:
    """Bounds of states and of derivatives that change from element to element, given by the index."""

    elements = 8

    def get_info(self):
        return 2, 0, 1, 0, 0, self.elements, np.linspace(0, 4, self.elements + 1), 0, 0

    def bounds(self, i):
        centre = np.sin(2 * np.pi * i / self.elements)
        fastest = 1.5 if i % 4 else 0.6
        return (
            np.array([centre - 0.8, -FREE, -fastest, -FREE, -20]),
            np.array([centre + 0.8, FREE, fastest, FREE, 20]),
        )

    def initialpoint(self, i):
        return np.array([np.sin(2 * np.pi * i / self.elements), 0]), np.zeros(2), np.zeros(0), np.zeros(1)

    def initialcondition(self):
        return np.array([0.0, 0.0])

    def objective(self, t, x, xdot, y, u, p):
        return 1e-2 * u[0] ** 2 + x[1] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] - x[1]
        c[1] = xdot[1] - u[0] + 0.2 * np.abs(1.0) * x[1]


class Car:
    """A square car, heading from the y axis clockwise, past a square; corners in a loop, the shape turned by hand."""

    elements = 20
    centres = ((2.0, 2.0),)

    def get_info(self):
        return 4, 0, 2, 0, 0, self.elements, np.linspace(0, 5, self.elements + 1), 0, 0

    def bounds(self, i):
        lower = np.concatenate([-FREE * np.ones(8), [-np.pi / 3, -10]])
        return lower, -lower

    def initialpoint(self, i):
        a = np.pi / 2 * i / self.elements
        return np.array([3 - 3 * np.cos(a), 3 * np.sin(a), 0.0, 1.0]), np.zeros(4), np.zeros(0), np.zeros(2)

    def initialcondition(self):
        return np.zeros(4)

    def bounds_finaltime(self):
        goal = np.array([3, 3, np.pi / 2, 0])
        return goal, goal

    def objective(self, t, x, xdot, y, u, p):
        return (x[0] - 3) ** 2 + (x[1] - 3) ** 2 + (x[2] - np.pi / 3) ** 2 + x[3] ** 2 + u[0] ** 2 + u[1] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] - x[3] * np.sin(x[2])
        c[1] = xdot[1] - x[3] * np.cos(x[2])
        c[2] = xdot[2] - u[0] * x[3]
        c[3] = xdot[3] - u[1]

    def get_objects_info(self):
        count = len(self.centres)
        return count + 1, [0] * count + [1], [4] * (count + 1)

    def get_object_vertices(self, V, ind, x, xdot, y, u):
        if ind < len(self.centres):
            cx, cy = self.centres[ind]
            V[0, :] = [cx - 0.5, cx - 0.5, cx + 0.5, cx + 0.5]
            V[1, :] = [cy - 0.5, cy + 0.5, cy + 0.5, cy - 0.5]
            V[2, :] = 0
        else:
            for k in range(4):
                V[0, k] = x[0] + 0.25 * np.sqrt(2) * np.cos(np.pi / 4 + k * np.pi / 2 - x[2])
                V[1, k] = x[1] + 0.25 * np.sqrt(2) * np.sin(np.pi / 4 + k * np.pi / 2 - x[2])
                V[2, k] = 0.0
