"""Published problems of manipulation and contact as classes with PyRoboCOP's methods, as authors write them.

Formulations and numbers are from the paper (Raghunathan, Jha & Romeres, ICRA 2022, doi:10.1109/ICRA46639.2022.9812069)
and, for linear complementarity systems, from Vieira, Brogliato & Prieur, Quadratic optimal control of linear
complementarity systems (hal-01690400v3). `np.Infinity` and `np.infty` are names that NumPy 2 has removed.
"""

# ruff: noqa: NPY201
from __future__ import annotations

import numpy as np


class _Timed:
    """Counts and times: what all have in common."""

    elements, horizon = 100, 1.0
    states, algebraics, controls, parameters, pairs = 1, 0, 1, 0, 0

    def get_info(self):
        times = np.linspace(0.0, self.horizon, self.elements + 1)
        counts = (self.states, self.algebraics, self.controls, self.parameters, self.pairs)
        return (*counts, self.elements, times, 0, 0)

    def initialpoint(self, i):
        d, a, u = self.states, self.algebraics, self.controls
        return np.zeros((d, 1)), np.zeros((d, 1)), np.zeros((a, 1)), np.zeros((u, 1))


class SwingUp(_Timed):
    """A pendulum, from hanging to standing."""

    elements, horizon, states = 150, 7.5, 2

    def bounds(self, i):
        upper = np.array([[2 * np.pi], [10.0], [np.Infinity], [np.Infinity], [10.0]])
        return -upper, upper

    def initialcondition(self):
        return np.zeros((2, 1)), np.zeros((2, 1))

    def objective(self, t, x, xdot, y, u, p):
        return (x[0, 0] - np.pi) ** 2 + x[1, 0] ** 2 + 0.01 * u[0, 0] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] - x[1]
        c[1] = 9.81 * xdot[1] - (u[0] - 9.81 * np.sin(x[0]) - 0.01 * x[1])


class SoftWalls(_Timed):
    """A pendulum between two stiff walls; the guess is a touch, and the start gives algebraics as well."""

    elements, horizon, states, algebraics, pairs = 150, 7.5, 2, 4, 2
    m, length, stiffness, d = 0.1, 0.5, 1e5, 0.1

    def bounds(self, i):
        lower = np.array([-2 * np.pi, -10, -np.infty, -np.infty, 0, 0, 0, 0, -10])
        return lower, np.array([2 * np.pi, 10, np.infty, np.infty, 1e30, 1e30, 1e30, 1e30, 10])

    def initialpoint(self, i):
        return np.array([np.pi - 0.2, 0.0]), np.zeros(2), np.zeros(4), np.array([2.0])

    def initialcondition(self):
        x0 = np.array([np.pi - 0.2, 0.0])
        return x0, x0, np.zeros(4)

    def objective(self, t, x, xdot, y, u, p):
        return (x[0] - np.pi) ** 2 + x[1] ** 2 + 0.01 * u[0] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        inertia, reach = self.m * 9.81 * self.length**2, self.length * np.sin(x[0])
        push = (y[0] - y[1]) / (self.length * self.m)
        c[0] = xdot[0] - x[1]
        c[1] = inertia * xdot[1] - (u[0] - self.m * 9.81 * reach + push)
        c[2] = y[2] - (reach + y[0] / self.stiffness + self.d)
        c[3] = y[3] - (-reach + y[1] / self.stiffness + self.d)

    def get_complementarity_info(self):
        return np.array([[0], [1]]), np.zeros((2, 1)), np.array([[2], [3]]), np.zeros((2, 1))


class Acrobot(_Timed):
    """Two links with a motor between them; NumPy's matrices of the states."""

    elements, horizon, states = 100, 5.0, 4

    def bounds(self, i):
        upper = np.concatenate([[2 * np.pi, 2 * np.pi], 40.0 * np.ones(7)])
        return -upper, upper

    def initialcondition(self):
        return np.zeros(4)

    def bounds_finaltime(self):
        goal = np.array([np.pi, 0, 0, 0])
        return goal, goal

    def objective(self, t, x, xdot, y, u, p):
        return (x[0] - np.pi) ** 2 + x[1] ** 2 + 0.1 * x[2] ** 2 + 0.1 * x[3] ** 2 + 0.1 * u[0] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        m1 = m2 = length1 = length2 = i1 = i2 = 0.5
        centre1 = centre2 = 0.2
        g, a, b = 9.81, x[0], x[1]
        coupling = m2 * length1 * centre2
        mass = np.array(
            [
                [i1 + i2 + m2 * length1**2 + 2 * coupling * np.cos(b), i2 + coupling * np.cos(b)],
                [i2 + coupling * np.cos(b), i2],
            ]
        )
        turning = np.array(
            [
                [-2 * coupling * np.sin(b) * x[3], -coupling * np.sin(b) * x[3]],
                [coupling * np.sin(b) * x[2], 0.0],
            ]
        )
        lower_link = m2 * g * length2 * np.sin(a + b)
        weight = np.array([(m1 * centre1 + m2 * length1) * g * np.sin(a) + lower_link, lower_link])
        c[0:2, 0] = xdot[0:2] - x[2:4]
        c[2:4, 0] = mass @ xdot[2:4] + turning @ x[2:4] + weight - np.array([0.0, u[0]])


class CartPole(_Timed):
    """A cart carries a pole up; three points per element."""

    points, elements, horizon, states = 3, 100, 3.3, 4

    def bounds(self, i):
        upper = np.array([5, 2 * np.pi, 10, 10, 10, 10, 100, 100, 20])
        return -upper, upper

    def initialpoint(self, i):
        return [3, 0, 0, 0], [0, 0, 0, 0], [], [5]

    def initialcondition(self):
        return [3, 0, 0, 0], [3, 0, 0, 0]

    def bounds_finaltime(self):
        return [0.5, np.pi, 0, 0], [0.5, np.pi, 0, 0]

    def objective(self, t, x, xdot, y, u, p):
        s, a, v, w = x
        return (a - np.pi) ** 2 + 0.1 * v**2 + 0.1 * w**2 + 0.1 * (s - 0.5) ** 2 + 0.01 * u[0] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        _, a, v, w = x
        length, g, mp, mc = 0.75, 9.8, 1.0, 1.0
        moving = mc + mp * np.sin(a) ** 2
        c[0], c[1] = xdot[0] - v, xdot[1] - w
        c[2] = xdot[2] - (u[0] + mp * np.sin(a) * (length * w**2 + g * np.cos(a))) / moving
        swing = -u[0] * np.cos(a) - mp * length * w**2 * np.cos(a) * np.sin(a) - (mc + mp) * g * np.sin(a)
        c[3] = xdot[3] - swing / (length * moving)


class Quadrotor(_Timed):
    """Twelve states of a quadrotor that flies to a corner."""

    elements, horizon, states, controls = 200, 6.6, 12, 4
    inertia = (0.04856, 0.04856, 0.08801)
    goal = np.array([2.0, 2.0, 3.0] + [0.0] * 9)

    def bounds(self, i):
        upper = np.hstack([np.Infinity * np.ones(24), 10 * np.ones(4)])
        return -upper, upper

    def initialcondition(self):
        return np.zeros(12)

    def bounds_finaltime(self):
        return self.goal, self.goal

    def objective(self, t, x, xdot, y, u, p):
        return np.sum((x[0:3] - self.goal[0:3]) ** 2) + np.dot(u, u)

    def constraint(self, c, t, x, xdot, y, u, p):
        psi, theta, phi, vx, vy, vz, p1, q1, r1 = x[3:]
        mass, g = 0.468, 9.8
        ix, iy, iz = self.inertia
        s, co = np.sin, np.cos
        f = np.array(
            [
                vx,
                vy,
                vz,
                q1 * s(phi) / co(theta) + r1 * co(phi) / co(theta),
                q1 * co(phi) - r1 * s(phi),
                p1 + q1 * s(phi) * np.tan(theta) + r1 * co(phi) * np.tan(theta),
                -(s(phi) * s(psi) + co(phi) * co(psi) * s(theta)) * u[0] / mass,
                -(co(psi) * s(phi) - co(phi) * s(psi) * s(theta)) * u[0] / mass,
                g - co(phi) * co(theta) * u[0] / mass,
                ((iy - iz) * q1 * r1 + u[1]) / ix,
                ((iz - ix) * p1 * r1 + u[2]) / iy,
                ((ix - iy) * p1 * q1 + u[3]) / iz,
            ]
        )
        for j in range(12):
            c[j, 0] = xdot[j] - f[j]


class Pushing(_Timed):
    """A pusher that sticks and slips along the left side of a square on a table."""

    elements, horizon, states, algebraics, controls, pairs = 100, 10.0, 4, 4, 2, 2
    goal = (0.0, 0.5, np.pi)
    half, friction = 0.045, 0.3

    def __init__(self):
        c0 = (2 / (0.5 * 9.81)) ** 2
        radius = 0.09 / 6 * (np.sqrt(2) + np.arcsinh(1))
        self.surface = np.diag([c0, c0, c0 / radius**2])
        self.step = self.horizon / self.elements

    def bounds(self, i):
        lower = [-5, -5, -2 * np.pi, -1, -5, -5, -5, -0.5, 0, 0, 0, 0, 0, -1]
        upper = [5, 5, 2 * np.pi, 1, 5, 5, 5, 0.5, np.Infinity, np.Infinity, 0.5, 0.5, 0.5, 1]
        return np.array(lower), np.array(upper)

    def initialcondition(self):
        return np.zeros(4), np.zeros(4)

    def bounds_finaltime(self):
        return np.array([*self.goal, -0.5]), np.array([*self.goal, 0.5])

    def objective(self, t, x, xdot, y, u, p):
        cost = x[3] ** 2
        for j in range(3):
            cost = cost + (x[j] - self.goal[j]) ** 2
        return cost

    def twist(self, x, y, u):
        px, py = -self.half, self.half * (x[3] + self.step * (y[2] - y[3]))
        wrench = np.array([u[0], u[1], -py * u[0] + px * u[1]])
        c, s = np.cos(x[2]), np.sin(x[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return turn @ (self.surface @ wrench)

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0:3, 0] = xdot[0:3] - self.twist(x, y, u)
        c[3] = xdot[3] - (y[2] - y[3])
        c[4] = y[0] - (u[1] + self.friction * u[0])
        c[5] = y[1] - (-u[1] + self.friction * u[0])

    def get_complementarity_info(self):
        return np.array([[1], [0]]), np.array([[0], [0]]), np.array([[2], [3]]), np.array([[0], [0]])


class PushingAround(Pushing):
    """The same past two squares, which the slider has to keep away from."""

    goal = (0.5, 0.5, 0.0)

    def get_objects_info(self):
        return 3, np.array([0, 1, 0]), np.array([4, 4, 4])

    def get_object_vertices(self, V, ind, x, xdot, y, u):
        for k in range(4):
            corner = np.pi / 4 + k * np.pi / 2
            if ind == 1:
                V[0, k] = x[0] + self.half * np.sqrt(2) * np.cos(corner - x[2])
                V[1, k] = x[1] + self.half * np.sqrt(2) * np.sin(corner - x[2])
            else:
                V[0, k] = 0.5 + 0.05 * np.sqrt(2) * np.cos(corner)
                V[1, k] = (0.62 if ind == 0 else 0.38) + 0.05 * np.sqrt(2) * np.sin(corner)
            V[2, k] = 0.0


class PushingModes(Pushing):
    """Two modes one after the other, whose durations are parameters."""

    elements, horizon, states, algebraics, parameters, pairs = 200, 2.0, 3, 2, 2, 0
    goal = (0.0, 0.0, np.pi)

    def bounds(self, i):
        lower = [-5, -5, -2 * np.pi, -5, -5, -5, 0, -np.Infinity, 0, -1]
        return np.array(lower), np.array([5, 5, 2 * np.pi, 5, 5, 5, np.Infinity, 0, 0.5, 1])

    def initialcondition(self):
        return np.zeros(3), np.zeros(3)

    def bounds_finaltime(self):
        return np.array(self.goal), np.array(self.goal)

    def bounds_params(self):
        return np.array([0.01, 0.01]), np.array([100.0, 200.0])

    def initialpoint_params(self):
        return np.array([10.0, 20.0])

    def objective(self, t, x, xdot, y, u, p):
        return 0.0

    def objective_mayer(self, x0, xf, p):
        return p[0] + p[1]

    def constraint(self, c, t, x, xdot, y, u, p):
        px, py, duration = (-self.half, 0.0, p[0]) if t <= 1.0 else (0.0, self.half, p[1])
        wrench = np.array([u[0], u[1], -py * u[0] + px * u[1]])
        co, s = np.cos(x[2]), np.sin(x[2])
        body = self.surface @ wrench
        c[0] = xdot[0] - duration * (co * body[0] - s * body[1])
        c[1] = xdot[1] - duration * (s * body[0] + co * body[1])
        c[2] = xdot[2] - duration * body[2]
        c[3] = y[0] - (u[1] + self.friction * u[0])
        c[4] = y[1] - (u[1] - self.friction * u[0])


class BeltOverFirstPulley(_Timed):
    """A belt is taken over a pulley: elastic only where it is stretched, normal force only at the pulley."""

    elements, horizon, states, algebraics, controls, pairs = 200, 6.0, 12, 5, 3, 2
    k, c, m, length = 63.34, 4.613, 0.042, 0.1418
    goal = np.array([0.55, 0.23, 0.5325, 0.55, 0.23, 0.34])
    start = np.array([0.55, 0.0, 0.4825, 0.55, 0.0, 0.34])

    def bounds(self, i):
        upper = np.concatenate([0.7 * np.ones(6), 0.12 * np.ones(6), np.Infinity * np.ones(12)])
        lower = -upper
        return (
            np.concatenate([lower, [0, 0, 0, 1e-8, 0], -20 * np.ones(3)]),
            np.concatenate([upper, 1e30 * np.ones(5), 20 * np.ones(3)]),
        )

    def initialpoint(self, i):
        x = np.concatenate([[0.55, 0.23, 0.4825, 0.55, 0.23, 0.34], np.zeros(6)])
        return x, np.zeros(12), np.zeros(5), np.zeros(3)

    def initialcondition(self):
        x0 = np.concatenate([self.start, np.zeros(6)])
        return x0, x0

    def objective(self, t, x, xdot, y, u, p):
        usual = np.array([0, 0, (self.goal[2] - self.goal[5] - self.length) * self.k])
        return 1000 * np.sum((x[0:6] - self.goal) ** 2) + 10 * np.sum(x[6:12] ** 2) + 1e-5 * np.sum((u - usual) ** 2)

    def constraint(self, c, t, x, xdot, y, u, p):
        first, second, v1, v2 = x[0:3], x[3:6], x[6:9], x[9:12]
        apart = np.sqrt(np.sum((first - second) ** 2))
        along = (first - second) / apart
        up = np.array([0.0, 0.0, 1.0])
        c[0:6, 0] = xdot[0:6] - x[6:12]
        c[6:9, 0] = xdot[6:9] - (u - y[0] * along - self.c * (v1 - v2)) / self.m + 10 * up
        c[9:12, 0] = xdot[9:12] - (y[0] * along + self.c * (v1 - v2) - y[1] * up) / self.m + 10 * up
        c[12] = y[2] - (y[0] / self.k + self.length - apart)
        c[13] = y[3] - np.sqrt(np.sum((second - np.array([0.55, 0.23, 0.34])) ** 2) + 1e-16)
        far = (x[3] - 0.55) ** 2 / 20**2 + (x[4] - 0.21) ** 2 / 2**2 + (x[5] - 0.37) ** 2 / 8**2
        c[14] = y[4] - (far - 1e-4)

    def get_complementarity_info(self):
        return np.array([[0], [1]]), np.zeros((2, 1)), np.array([[2], [3]]), np.zeros((2, 1))


class BeltOverSecondPulley(_Timed):
    """The belt is wound over another pulley, whose side of the pair is not zero."""

    elements, horizon, states, algebraics, controls, pairs = 50, 1.0, 18, 3, 6, 1
    k, c, m, length = 63.34, 4.613, 0.042, 0.1118
    pulley, goal = np.array([0.55, 0.23, 0.37]), np.array([0.39, 0.23, 0.35])
    obstacle = np.array([0.42, 0.23, 0.37]) - np.array([1.0, 0.0, 0.0])
    turn = np.array([0.0, -np.pi / 2, 3 * np.pi / 8])

    def __init__(self):
        self.force = self.k * (np.linalg.norm(self.goal - self.pulley) - self.length)

    def bounds(self, i):
        upper = np.concatenate([0.7 * np.ones(6), 0.27 * np.ones(6), 10 * np.ones(6), np.Infinity * np.ones(18)])
        push = np.concatenate([10 * np.ones(3), [0, 10, 200]])
        return (
            np.concatenate([-upper, [self.force / 2, 0, 0], -push]),
            np.concatenate([upper, [1e30, 1e30, 1e30], push]),
        )

    def initialpoint(self, i):
        x = np.concatenate([self.goal, [0.55, 0.23, 0.3], np.zeros(6), self.turn, np.zeros(3)])
        return x, np.zeros(18), np.zeros(3), np.zeros(6)

    def initialcondition(self):
        x0 = np.concatenate([[0.55, 0.23, 0.5325, 0.55, 0.23, 0.34], np.zeros(12)])
        return x0, x0

    def objective(self, t, x, xdot, y, u, p):
        return (
            1000 * np.sum((x[0:3] - self.goal) ** 2)
            + np.sum(x[6:9] ** 2)
            + 1e-5 * np.sum(u**2)
            + 100 * np.sum((x[12:15] - self.turn) ** 2)
            + np.sum(x[15:18] ** 2)
            + 100 * (y[0] - self.force) ** 2
            + 1e4 * (x[1] - 0.23) ** 2
        )

    def constraint(self, c, t, x, xdot, y, u, p):
        apart = np.sqrt(np.sum((x[0:3] - self.pulley) ** 2))
        along = (x[0:3] - self.pulley) / apart
        c[0:6, 0] = xdot[0:6] - x[6:12]
        c[6:9, 0] = xdot[6:9] - (u[0:3] - y[0] * along - self.c * x[6:9]) / self.m + np.array([0, 0, 10.0])
        c[9:12, 0] = xdot[9:12]
        c[12:15, 0] = xdot[12:15] - x[15:18]
        c[15:18, 0] = xdot[15:18] - u[3:6]
        c[18] = y[1] - (y[0] / self.k + self.length - apart)
        away = x[0:3] - self.obstacle
        c[19] = y[2] - (away[0] ** 2 / 4 + away[1] ** 2 + away[2] ** 2 / 4 - 1e-4)

    def get_complementarity_info(self):
        return np.array([[0]]), np.array([[0]]), np.array([[1]]), np.array([[0]])


class LearnedMaze(_Timed):
    """A marble in a tilted ring: its acceleration is a physical part and a sum over many radial functions."""

    elements, horizon, states, controls = 90, 90 * 0.033, 6, 2
    centres = 4842

    def __init__(self):
        generator = np.random.default_rng(7)
        self.X = generator.normal(size=(self.centres, 9))
        self.weights = generator.normal(size=self.centres) * 0.3 / np.sqrt(self.centres)
        self.lengths = np.array([2.0, 3.0, 3.0, 1.5, 1.5, 2.0, 2.0, 2.0, 2.0])
        self.scale = np.array([1.0, 0.5, 0.5, 0.7, 0.7, 0.3, 1.0, 0.3, 1.0])
        self.beta = np.array([-1.50222372, 0.931466148, -0.109510221, -9.24299235e-4, 1.54154966, -0.0432335212])
        self.gamma = np.array([-0.08791515, -0.00451278, -1.37314616, 0.9334687, 0.03390455, 1.45394861])
        self.physical = np.array([0.6, 0.6, 0.6, 0.6, 0.7, 0.7, 0.4])

    def bounds(self, i):
        upper = np.array([2 * np.pi, 10, 2 * np.pi, 10, 2 * np.pi, 10, *[np.Infinity] * 6, 0.1, 0.1])
        return -upper, upper

    def initialcondition(self):
        return np.zeros((6, 1)), np.zeros((6, 1))

    def objective(self, t, x, xdot, y, u, p):
        effort = 0.04 * (np.cosh(u[0, 0] / 0.02) + np.cosh(u[1, 0] / 0.02) - 2)
        return (x[0, 0] - np.pi / 4) ** 2 + 0.1 * x[1, 0] ** 2 + effort

    def learned(self, th, rate, x2, x3, x4, x5):
        z = np.array([rate, x3, x5, np.sin(th), np.cos(th), np.sin(x2), np.cos(x2), np.sin(x4), np.cos(x4)])
        distance = (z / self.scale - self.X) / self.lengths
        return np.dot(np.exp(-0.5 * np.sum(distance**2, axis=1)), self.weights)

    def constraint(self, c, t, x, xdot, y, u, p):
        th, rate, x2, x3, x4, x5 = [x[j, 0] for j in range(6)]
        v = np.array([x4, x5, x2, x3, u[0, 0], u[1, 0]])
        terms = np.array(
            [
                -(x3**2) * np.sin(th) * np.cos(x4) ** 2 * np.cos(th),
                -2 * x3 * x5 * np.cos(x4) * np.cos(th) ** 2,
                2 * x3 * x5 * np.cos(x4),
                0.5 * x5**2 * np.sin(2 * th),
                -9.806 * np.sin(x2) * np.sin(th),
                -9.806 * np.sin(x4) * np.cos(x2) * np.cos(th),
                -rate,
            ]
        )
        h = 1 / 30
        acceleration = np.dot(self.physical, terms) + self.learned(th, rate, x2, x3, x4, x5)
        gamma, beta = np.dot(self.gamma, v), np.dot(self.beta, v)
        after = [th + h * rate, rate + h * acceleration, x2 + h * gamma, gamma, x4 + h * beta, beta]
        for j in range(6):
            c[j, 0] = xdot[j, 0] - (after[j] - x[j, 0]) / 0.033


class LinearComplementarity(_Timed):
    """Vieira, Brogliato & Prieur: ``x' = A x + B v + F u``, ``0 <= v  perp  w = C x + D v + E u >= 0``."""

    elements, pairs = 1000, 1
    A = B = F = C = D = E = np.zeros((1, 1))
    x0 = np.zeros(1)
    of_control = 1.0

    def get_info(self):
        self.states, self.pairs, self.controls = len(self.A), self.D.shape[0], self.F.shape[1]
        self.algebraics = 2 * self.pairs
        return super().get_info()

    def bounds(self, i):
        lower = np.full(2 * self.states + 2 * self.pairs + self.controls, -1e30)
        upper = -lower
        lower[2 * self.states : 2 * self.states + 2 * self.pairs] = 0
        return lower, upper

    def initialcondition(self):
        return self.x0, self.x0

    def objective(self, t, x, xdot, y, u, p):
        return x @ x + self.of_control * (u @ u)

    def constraint(self, c, t, x, xdot, y, u, p):
        v, w, n = y[: self.pairs], y[self.pairs :], self.states
        c[:n, 0] = xdot - (self.A @ x + self.B @ v + self.F @ u)
        c[n:, 0] = w - (self.C @ x + self.D @ v + self.E @ u)

    def get_complementarity_info(self):
        first = np.arange(self.pairs).reshape(-1, 1)
        return first, 0 * first, first + self.pairs, 0 * first


def _matrix(*rows):
    return np.array(rows, dtype=float)


class LinearComplementarity1(LinearComplementarity):
    A, B, F, C, D, E = (_matrix([number]) for number in (3, -0.5, 3, 0, 1, -2))
    x0 = np.ones(1)


class LinearComplementarity2(LinearComplementarity):
    A, B, F = _matrix([0, 1], [0, 0]), _matrix([-1], [1]), _matrix([0], [1])
    C, D, E = _matrix([-1, 1]), _matrix([0]), _matrix([1])
    x0 = np.array([-0.5, 1.0])


class LinearComplementarity3(LinearComplementarity):
    A, B, F = _matrix([1, 2], [2, 1]), _matrix([-1, 1], [-1, 1]), _matrix([1, 3], [2, 1])
    C, D, E = _matrix([3, -1], [-2, 0]), _matrix([1, 0], [0, 1]), _matrix([1, -1], [-1, 2])
    x0, of_control = np.array([-0.5, 1.0]), 25.0


class LinearComplementarity4(LinearComplementarity):
    A, B, F = _matrix([5, -6], [3, 9]), _matrix([4], [5]), _matrix([0], [-4])
    C, D, E = _matrix([1, 5]), _matrix([1]), _matrix([6])
    x0 = np.array([-0.5, -1.0])


class LinearComplementarity6(LinearComplementarity):
    A, B, F = _matrix([1, -3], [-8, 10]), _matrix([-3], [-1]), _matrix([4], [8])
    C, D, E = _matrix([1, -3]), _matrix([5]), _matrix([3])
    x0 = np.array([-0.5, -1.0])


class LinearComplementarity7(LinearComplementarity):
    elements, horizon = 1000, 10.0
    A, B, F = _matrix([0, 1, 0], [0, 0, 1], [0, 0, 0]), _matrix([0], [0], [1]), _matrix([0], [0], [1])
    C, D, E = _matrix([1, 0, 0]), _matrix([0]), _matrix([1])
    x0 = np.array([-2.0, 1.0, -1.0])


PROBLEMS = (
    SwingUp,
    SoftWalls,
    Acrobot,
    CartPole,
    Quadrotor,
    Pushing,
    PushingAround,
    PushingModes,
    BeltOverFirstPulley,
    BeltOverSecondPulley,
    LearnedMaze,
    LinearComplementarity1,
    LinearComplementarity2,
    LinearComplementarity3,
    LinearComplementarity4,
    LinearComplementarity6,
    LinearComplementarity7,
)
