"""Problems as classes with PyRoboCOP's methods, in the styles that different authors have; most are published.

Formulations and numbers are from the paper (Raghunathan, Jha & Romeres, ICRA 2022, doi:10.1109/ICRA46639.2022.9812069)
and, for linear complementarity systems, from Vieira, Brogliato & Prieur, Quadratic optimal control of linear
complementarity systems (hal-01690400v3). `np.Infinity` is a name that NumPy 2 has removed.
"""

# ruff: noqa: NPY201
import numpy as np

FREE = 1e20


class _Timed:
    """Counts and times: what all have in common."""

    elements, horizon, points = 12, 1.0, 1
    states, algebraics, controls, parameters, pairs = 1, 0, 1, 0, 0

    def get_info(self):
        times = np.linspace(0.0, self.horizon, self.elements + 1)
        counts = (self.states, self.algebraics, self.controls, self.parameters, self.pairs)
        return (*counts, self.elements, times, 0, 0)

    def initialpoint(self, i):
        d, a, u = self.states, self.algebraics, self.controls
        return np.zeros((d, 1)), np.zeros((d, 1)), np.zeros((a, 1)), np.zeros((u, 1))


class SwingUp(_Timed):
    """A pendulum, from hanging to standing, in names of NumPy 1 and with both kinds of indices."""

    elements, horizon, states = 12, 3.0, 2

    def bounds(self, i):
        upper = np.array([[2 * np.pi], [10.0], [np.Infinity], [np.Infinity], [10.0]])
        return -upper, upper

    def initialcondition(self):
        return np.zeros((2, 1)), np.zeros((2, 1))

    def objective(self, t, x, xdot, y, u, p):
        return (x[0, 0] - np.pi) ** 2 + x[1, 0] ** 2 + 0.01 * u[0, 0] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = (xdot[0] - x[1]) * 2
        c[1, 0] = 2.0 * xdot[1] - (u[0] - 9.81 * np.sin(x[0]) - 0.1 * x[1])


def _matrix(*rows):
    return np.array(rows, dtype=float)


class LinearComplementarity(_Timed):
    """Vieira, Brogliato & Prieur: ``x' = A x + B v + F u``, ``0 <= v  perp  w = C x + D v + E u >= 0``.

    The start gives algebraics as well.
    """

    elements, points, states, algebraics, controls, pairs = 12, 3, 2, 4, 2, 2
    A, B, F = _matrix([1, 2], [2, 1]), _matrix([-1, 1], [-1, 1]), _matrix([1, 3], [2, 1])
    C, D, E = _matrix([3, -1], [-2, 0]), _matrix([1, 0], [0, 1]), _matrix([1, -1], [-1, 2])

    def bounds(self, i):
        lower = np.r_[np.full(4, -1e30), np.zeros(4), np.full(2, -1e30)]
        return lower, np.full(10, 1e30)

    def initialcondition(self):
        x0 = np.array([-0.5, 1.0])
        return x0, x0, np.zeros(4)

    def objective(self, t, x, xdot, y, u, p):
        return x @ x + 25.0 * (u @ u)

    def constraint(self, c, t, x, xdot, y, u, p):
        v, w = y[:2], y[2:]
        c[:2, 0] = xdot - (self.A @ x + self.B @ v + self.F @ u)
        c[2:, 0] = w - (self.C @ x + self.D @ v + self.E @ u)

    def get_complementarity_info(self):
        first = np.arange(2).reshape(-1, 1)
        return first, 0 * first, first + 2, 0 * first


class QuickCart(_Timed):
    """Least time: a parameter scales the horizon, and is the cost at the end; lists, and derivatives by hand."""

    elements, states, parameters = 10, 2, 1

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
        c[:] = xdot / p[0] - np.array([x[1], u[0]])

    def gradient(self, *arguments):
        raise AssertionError("derivatives are never asked for")


class ParameterCurve(_Timed):
    """A parameter in the running cost and in the cost at the end, which reads both ends in all of their shapes."""

    elements, parameters = 8, 1

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
        c[0] = (xdot[0] + x[0] - u[0]) / 2
        return c


class DeadZone(_Timed):
    """Play between ``y0 >= -1`` and ``y1 <= gap``, which changes from element to element; no p in the signatures."""

    elements, horizon, states, algebraics, pairs = 12, 2.0, 2, 2, 1

    def bounds(self, i):
        lower = np.r_[np.full(4, -np.inf), -1.0, -np.inf, -3.0]
        upper = np.r_[np.full(4, np.inf), np.inf, 0.5 if i < 6 else 0.8, 3.0]
        return lower, upper

    def initialcondition(self):
        return np.zeros(2)

    def objective(self, t, x, xdot, y, u):
        return np.sum((x - np.array([1.0, 0.0])) ** 2) + 0.1 * u @ u

    def constraint(self, c, t, x, xdot, y, u):
        c[0] = x[1] - xdot[0]
        c[1] = -xdot[1] + u[0] - (y[0] + 1.0)
        c[2] = y[1] - x[0]

    def get_complementarity_info(self):
        return [[0], [0], [1], [1]]


class Corridor(_Timed):
    """Bounds of states and of derivatives that change from element to element, given by the index."""

    elements, horizon, states = 8, 4.0, 2

    def bounds(self, i):
        centre, fastest = np.sin(2 * np.pi * i / self.elements), 1.5 if i % 4 else 0.6
        return [centre - 0.8, -FREE, -fastest, -FREE, -20], [centre + 0.8, FREE, fastest, FREE, 20]

    def initialpoint(self, i):
        return np.array([np.sin(2 * np.pi * i / self.elements), 0]), np.zeros(2), np.zeros(0), np.zeros(1)

    def initialcondition(self):
        return np.array([0.0, 0.0])

    def objective(self, t, x, xdot, y, u, p):
        return 1e-2 * u[0] ** 2 + x[1] ** 2

    def constraint(self, c, t, x, xdot, y, u, p):
        c[0] = xdot[0] - x[1]
        c[1] = xdot[1] - u[0] + 0.2 * x[1]


class Car(_Timed):
    """A square car, heading from the y axis clockwise, past a square; corners in a loop, the shape turned by hand."""

    elements, horizon, states, controls = 20, 5.0, 4, 2

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
        return np.sum((x - [3, 3, np.pi / 3, 0]) ** 2) + u @ u

    def constraint(self, c, t, x, xdot, y, u, p):
        _, _, a, v = x
        c[0], c[1] = xdot[0] - v * np.sin(a), xdot[1] - v * np.cos(a)
        c[2:, 0] = xdot[2:] - np.array([u[0] * v, u[1]])

    def get_objects_info(self):
        return 2, [0, 1], [4, 4]

    def get_object_vertices(self, V, ind, x, xdot, y, u):
        if ind == 0:
            V[0, :] = [1.5, 1.5, 2.5, 2.5]
            V[1, :] = [1.5, 2.5, 2.5, 1.5]
            return
        for k in range(4):
            V[0, k] = x[0] + 0.25 * np.sqrt(2) * np.cos(np.pi / 4 + k * np.pi / 2 - x[2])
            V[1, k] = x[1] + 0.25 * np.sqrt(2) * np.sin(np.pi / 4 + k * np.pi / 2 - x[2])
            V[2, k] = 0.0


PROBLEMS = (
    SwingUp,
    LinearComplementarity,
    QuickCart,
    ParameterCurve,
    DeadZone,
    Corridor,
    Car,
)
